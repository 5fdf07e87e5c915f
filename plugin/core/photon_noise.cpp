#include "core/photon_noise.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace isolux {
namespace {

// Records that stand for all.
constexpr std::size_t kRecords = 64;
constexpr std::array kPaths{LightPath::direct, LightPath::indirect};

constexpr std::size_t kBlocks = 64;
// Rays that the mean noise of all records counts as, beside those of one.
constexpr double kRaysOfMean = 16.0;

double square(double x) { return x * x; }

// Relative deviations of the light on a side of a mesh, one of each batch of photons: the sum of
// their squares is the variance, of their products the covariance. Photons that bounce light
// several sides, so that no count by itself tells it.
using Deviations = std::array<double, kBatches>;

struct SideLight {
    std::array<std::vector<Deviations>, 2> deviations; // of each path, one a side
    std::vector<double> kept; // share of the indirect light that is photons', one a side
};

SideLight side_light(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                     const EachPathJoined& joined, const PhotonBuckets& buckets,
                     double photon_flux) {
    SideLight out;
    for (const LightPath path : kPaths) {
        const auto p = static_cast<std::size_t>(path);
        auto& sides = out.deviations[p];
        sides.resize(mesh_side_count(mesh));
        for (std::size_t v = 0; v < receivers.size(); ++v) {
            const auto counts = buckets.batch_hit_counts(static_cast<std::int32_t>(v), path);
            Deviations& side = sides[mesh_side(receivers[v])];
            for (std::size_t b = 0; b < kBatches; ++b) {
                side[b] += static_cast<double>(counts[b]);
            }
        }
        constexpr double k = static_cast<double>(kBatches);
        for (std::size_t s = 0; s < sides.size(); ++s) {
            const double flux = joined[p]->side_flux[s];
            const double photon = flux > 0.0 ? photon_flux / flux : 0.0;
            double all = 0.0;
            for (const double count : sides[s]) {
                all += count;
            }
            if (path == LightPath::indirect) {
                out.kept.push_back(std::min(1.0, all * photon));
            }
            for (double& count : sides[s]) {
                count = (count - all / k) * photon * std::sqrt(k / (k - 1.0));
            }
        }
    }
    return out;
}

// Shares of the exitance: what had been reflected before, and of that what isn't photons' own.
struct ReflectedAgain {
    double all, gathered;
};

ReflectedAgain reflected_again(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                               const SeenLight& seen, const SideLight& sides) {
    double exitant = 0.0, again = 0.0, gathered = 0.0; // lm
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        const double light = luminance(seen.illuminance[v].as<double>());
        if (light > 0.0) {
            const double flux = mesh.areas[v] * photometric(seen.exitances[v]);
            const double indirect =
                flux * luminance(seen.joined[1]->illuminance[v].as<double>()) / light;
            exitant += flux;
            again += indirect;
            gathered += indirect * (1.0 - sides.kept[mesh_side(receivers[v])]);
        }
    }
    return exitant > 0.0 ? ReflectedAgain{again / exitant, gathered / exitant}
                         : ReflectedAgain{0.0, 0.0};
}

double side_noise(std::span<const Receiver> receivers, std::span<const GatherRecord> records,
                  const SeenLight& seen, const SideLight& sides, const ReflectedAgain& again) {
    double common = 0.0, squares = 0.0; // lx²
    const std::size_t step = (records.size() + kRecords - 1) / kRecords;
    for (std::size_t r = 0; r < records.size(); r += step) {
        const GatherRecord& record = records[r];
        Deviations off{};
        const double share = 1.0 / static_cast<double>(record.rays());
        for_each_lookup(record, 2 * receivers.size(), [&](std::size_t i, double weight) {
            const std::size_t v = i % receivers.size();
            const double light = luminance(seen.illuminance[v].as<double>());
            if (light <= 0.0) {
                return;
            }
            const double reflected = share * weight * photometric(seen.exitances[v]) / light;
            const std::size_t side = mesh_side(receivers[v]);
            for (std::size_t p = i == v ? 0 : 1; p < kPaths.size(); ++p) {
                const double part =
                    reflected * luminance(seen.joined[p]->illuminance[v].as<double>());
                for (std::size_t b = 0; b < kBatches; ++b) {
                    off[b] += part * sides.deviations[p][side][b];
                }
            }
        });
        for (const double of_batch : off) {
            common += of_batch * of_batch;
        }
        squares += square(luminance(record.illuminance.as<double>()));
    }
    // What isn't photons' own was gathered with the same error.
    return squares > 0.0 ? common / square(1.0 - again.gathered) / squares : 0.0;
}

std::vector<double> bucket_noise(std::span<const GatherRecord> records, const SeenLight& seen,
                                 const ReflectedAgain& again, int threads) {
    const std::size_t vertices = seen.illuminance.size();
    std::vector<double> variances(2 * vertices); // lm²/m⁴, of exitances
    for (std::size_t v = 0; v < vertices; ++v) {
        const double light = luminance(seen.illuminance[v].as<double>());
        if (light > 0.0) {
            const double reflected = square(photometric(seen.exitances[v]) / light);
            variances[vertices + v] = reflected * seen.joined[1]->variance[v];
            variances[v] = reflected * seen.joined[0]->variance[v] + variances[vertices + v];
        }
    }
    // What is seen was gathered off by it, too. After two reflections it is spread over whole
    // sides, whose light photons keep.
    const double by_reflections = square(1.0 + again.all + again.all * again.all);
    std::vector<double> out(records.size());
    const std::size_t grain = records.size() / kBlocks + 1; // each clears sums for all vertices
    parallel_blocks(
        threads, std::size_t{0}, records.size(), grain, [&](std::size_t begin, std::size_t end) {
            struct Sum {
                double weight, square;
            };
            std::vector<Sum> sums(variances.size()); // over rays that end in a bucket
            std::vector<std::size_t> met;
            for (std::size_t r = begin; r < end; ++r) {
                const double n = records[r].rays();
                for_each_lookup(records[r], sums.size(), [&](std::size_t i, double weight) {
                    Sum& sum = sums[i];
                    if (sum.weight == 0.0) {
                        met.push_back(i);
                    }
                    sum.weight += weight;
                    sum.square += square(weight);
                });
                // Of each two rays: what single ones tell is part of their noise.
                for (const std::size_t i : met) {
                    const auto [weight, own] = sums[i];
                    sums[i] = {};
                    out[r] += (weight * weight - own) * variances[i];
                }
                met.clear();
                out[r] *= by_reflections / (n > 1.0 ? n * (n - 1.0) : 1.0);
            }
        });
    // Few rays seldom end together: they are believed beside as many of the mean.
    double all = 0.0, squares = 0.0;
    for (std::size_t r = 0; r < records.size(); ++r) {
        all += out[r];
        squares += square(luminance(records[r].illuminance.as<double>()));
    }
    const double mean = squares > 0.0 ? all / squares : 0.0;
    for (std::size_t r = 0; r < records.size(); ++r) {
        const double n = records[r].rays();
        const double expected = mean * square(luminance(records[r].illuminance.as<double>()));
        out[r] = (n * out[r] + kRaysOfMean * expected) / (n + kRaysOfMean);
    }
    return out;
}

} // namespace

PhotonNoise photon_noise(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                         std::span<const GatherRecord> records, const SeenLight& seen,
                         const PhotonBuckets& buckets, double photon_flux, int threads) {
    const SideLight sides = side_light(mesh, receivers, seen.joined, buckets, photon_flux);
    const ReflectedAgain again = reflected_again(mesh, receivers, seen, sides);
    return {side_noise(receivers, records, seen, sides, again),
            bucket_noise(records, seen, again, threads)};
}

} // namespace isolux
