// Loops on several threads. What their caller wrote before is seen by every turn, and what the
// turns wrote is seen by the caller after.
#pragma once

#include <cstddef>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/float_traps.h"

#ifdef __SANITIZE_THREAD__
#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>
#endif

namespace isolux {

inline constexpr int kAllThreads = tbb::task_arena::automatic;

// Calls turn(begin, end) for parts of [first, last) of about `grain` numbers or more.
template <typename Index, typename Turn>
void parallel_blocks(int threads, Index first, Index last, Index grain, const Turn& turn) {
#ifdef __SANITIZE_THREAD__
    // TBB's library is not instrumented: ThreadSanitizer does not see what it puts in order.
    std::atomic<Index> next{first};
    std::vector<std::jthread> running(threads > 0 ? threads : 4);
    for (auto& thread : running) {
        thread = std::jthread([&] {
            for (Index begin = next.fetch_add(grain); begin < last; begin = next.fetch_add(grain)) {
                turn(begin, std::min<Index>(begin + grain, last));
            }
        });
    }
#else
    tbb::task_arena(threads).execute([&] {
        tbb::parallel_for(tbb::blocked_range<Index>(first, last, grain), [&](const auto& block) {
            [[maybe_unused]] const FloatTraps traps(true);
            turn(block.begin(), block.end());
        });
    });
#endif
}

// Calls turn(i) for i in [0, count).
template <typename Turn> void parallel_for(int threads, std::size_t count, const Turn& turn) {
    parallel_blocks(threads, std::size_t{0}, count, std::size_t{1},
                    [&](std::size_t begin, std::size_t end) {
                        for (std::size_t i = begin; i < end; ++i) {
                            turn(i);
                        }
                    });
}

} // namespace isolux
