// Tone mapping over arrays of vertices.
#include "core/tone_mapping.h"
#include "core/vec3.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <memory>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Colours = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using DisplayColours = nb::ndarray<nb::numpy, float, nb::shape<-1, 3>>;

// Values from which on filling the table, of some 2000 steps, takes less time than it saves.
constexpr std::size_t worth_a_table = 10'000;

DisplayColours tone_map(const Colours& luminance, double adaptation_luminance) {
    const isolux::ToneMapping mapping(adaptation_luminance);
    const std::size_t count = luminance.shape(0);
    auto values = std::make_unique<float[]>(3 * count);
    const auto show = [&](const auto& display_value) {
        for (std::size_t i = 0; i < count; ++i) {
            const float* rgb = luminance.data() + 3 * i;
            const float grey = isolux::luminance(isolux::Vec3f{rgb[0], rgb[1], rgb[2]});
            const float factor = grey > 0.0f ? display_value(grey) / grey : 0.0f;
            for (std::size_t c = 0; c < 3; ++c)
                values[3 * i + c] = std::clamp(factor * rgb[c], 0.0f, 1.0f);
        }
    };
    if (count < worth_a_table) {
        show([&](float grey) { return static_cast<float>(mapping.display_value(grey)); });
    } else {
        const isolux::ToneTable table(mapping);
        show([&](float grey) { return table.display_value(grey); });
    }
    float* released = values.release();
    nb::capsule owner(released, [](void* p) noexcept { delete[] static_cast<float*>(p); });
    return DisplayColours(released, {count, 3}, owner);
}

double adaptation_luminance(const Values& luminance, const Values& area) {
    if (luminance.size() != area.size())
        throw nb::value_error("luminance and area differ in length");
    return isolux::adaptation_luminance({luminance.data(), luminance.size()},
                                        {area.data(), area.size()});
}

} // namespace

void bind_tone_mapping(nb::module_& module) {
    module.def("tone_map", &tone_map, "luminance"_a, "adaptation_luminance"_a,
               "Linear display colour of each luminance [Tumblin and Rushmeier 1993].\n\n"
               "luminance : (n, 3) float32, cd/m^2 by channel, linear Rec. 709\n"
               "adaptation_luminance : of the scene's observer, cd/m^2\n"
               "returns : (n, 3) float32 in [0, 1], before gamma; the chromaticity is kept where "
               "no channel is clamped");
    module.def("adaptation_luminance", &adaptation_luminance, "luminance"_a, "area"_a,
               "Area-weighted log-average of the surfaces that are lit.\n\n"
               "luminance : (n,) float64, cd/m^2\n"
               "area : (n,) float64, m^2\n"
               "returns : cd/m^2; 0 where nothing is lit");
    module.def("dark_luminance", &isolux::dark_luminance, "adaptation_luminance"_a,
               "Greatest luminance, cd/m^2, that the display still shows as black.");
}
