// Loops on several threads, within one arena of that many.
//
// What the loop's caller wrote before it is seen by every turn, and what the turns wrote is seen by
// the caller after it. TBB's library itself is not built to be watched by ThreadSanitizer, which
// hence is told so; nothing is said of one turn to another, so that races between them are found.
#pragma once

#include <cstddef>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace isolux {

inline constexpr int kAllThreads = tbb::task_arena::automatic;

// Calls turn(begin, end) for parts of [first, last) of about `grain` numbers or more.
template <typename Index, typename Turn>
void parallel_blocks(int threads, Index first, Index last, Index grain, const Turn& turn) {
#ifdef __SANITIZE_THREAD__
    char begun = 0, ended = 0;
    __tsan_release(&begun);
#endif
    tbb::task_arena(threads).execute([&] {
        tbb::parallel_for(tbb::blocked_range<Index>(first, last, grain), [&](const auto& block) {
#ifdef __SANITIZE_THREAD__
            __tsan_acquire(&begun);
#endif
            turn(block.begin(), block.end());
#ifdef __SANITIZE_THREAD__
            __tsan_release(&ended);
#endif
        });
    });
#ifdef __SANITIZE_THREAD__
    __tsan_acquire(&ended);
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
