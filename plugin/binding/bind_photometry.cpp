// Candela distributions over arrays of directions.
#include <algorithm>
#include <stdexcept>

#include "binding/arrays.h"
#include "core/candela_distribution.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

using Candela = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void construct(CandelaDistribution* self, const In1<double>& gamma, const In1<double>& c_angles,
               const Candela& candela) {
    if (candela.shape(0) != c_angles.size() || candela.shape(1) != gamma.size()) {
        throw std::invalid_argument("candela of shape (C-angles, gamma angles)");
    }
    new (self) CandelaDistribution(view(gamma), view(c_angles), {candela.data(), candela.size()});
}

Out<double> intensity(const CandelaDistribution& self, const In3<double>& directions) {
    std::vector<double> candela;
    for (const Vec3d& direction : view(directions)) {
        candela.push_back(self.intensity(direction));
    }
    return hand_over(std::move(candela));
}

Out<double> sample(const CandelaDistribution& self, const In3<double>& u) {
    if (self.luminous_flux() == 0.0) {
        throw std::invalid_argument("a distribution that gives light");
    }
    std::vector<Vec3d> directions;
    for (const Vec3d& numbers : view(u)) {
        directions.push_back(self.sample(numbers.x, numbers.y, numbers.z));
    }
    return hand_over(std::move(directions));
}

} // namespace

void bind_photometry(nb::module_& module) {
    nb::class_<CandelaDistribution>(
        module, "CandelaDistribution",
        "Luminous intensity over direction: bilinear in (gamma, C), zero outside the angles.\n\n"
        "gamma : (G,) float64, rad, strictly increasing in [0, pi]\n"
        "c_angles : (H,) float64, rad, one angle (axially symmetric) or strictly increasing in\n"
        "    [0, 2 pi]\n"
        "candela : (H, G) float64, cd, >= 0\n"
        "Local axes: nadir is -Z, C0 is +X, C90 is +Y. Raises ValueError naming what it wanted.")
        .def("__init__", &construct, "gamma"_a, "c_angles"_a, "candela"_a)
        .def_prop_ro("luminous_flux", &CandelaDistribution::luminous_flux, "float, lm")
        .def("intensity", &intensity, "directions"_a,
             "directions : (n, 3) float64, local, of any length; returns (n,) float64, cd")
        .def(
            "sample", &sample, "u"_a,
            "u : (n, 3) float64 in [0, 1); returns (n, 3) float64, unit local directions with the\n"
            "density intensity / luminous_flux, 1/sr. Raises ValueError where the flux is zero.");
}
