// A scene: meshes and luminaires taken from arrays, vertices and areas handed back.
#include <algorithm>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include "binding/arrays.h"
#include "core/enclosed_light.h"
#include "core/scene.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

// One that shines on the side from which its corners run counter-clockwise; none where there is no
// light or no area.
void add_triangle(std::vector<Luminaire>& luminaires, const std::array<Vec3d, 3>& corners,
                  const Vec3f& light, const std::shared_ptr<const MeshLinks>& links) {
    const Vec3d along = corners[1] - corners[0];
    const Vec3d across = cross(along, corners[2] - corners[0]);
    const double area = 0.5 * length(across), brightness = luminance(light);
    if (!(area > 0.0) || !(brightness > 0.0)) {
        return;
    }
    Luminaire out{{},
                  (corners[0] + corners[1] + corners[2]) * (1.0 / 3.0),
                  normalize(along),
                  {},
                  across * (-0.5 / area),
                  light * static_cast<float>(1.0 / brightness),
                  std::numbers::pi * brightness * area,
                  nullptr,
                  links};
    out.y = cross(out.z, out.x);
    const auto local = [&out](const Vec3d& p) {
        const Vec3d at = out.to_local(p - out.position);
        return Vec3d{at.x, at.y, 0.0};
    };
    out.shape = TriangleLuminaire{local(corners[0]), local(corners[1]), local(corners[2])};
    luminaires.push_back(out);
}

class SceneBuilder {
  public:
    explicit SceneBuilder(double crease_angle) : crease_angle_(crease_angle) {}

    void add_mesh(const In3<double>& points, const In1<std::int32_t>& face_vertex_counts,
                  const In1<std::int32_t>& face_vertex_indices,
                  const std::optional<In3<float>>& corner_normals,
                  const In1<std::int32_t>& hole_faces, const In3<float>& reflectance,
                  bool double_sided, bool flip_winding, const std::optional<In1<float>>& opacity,
                  std::int64_t copy_of, const std::optional<InMatrix>& matrix) {
        const auto normals = corner_normals ? view(*corner_normals) : std::span<const Vec3f>{};
        if (opacity && opacity->size() != 1 && opacity->size() != face_vertex_counts.size()) {
            throw std::invalid_argument("opacity wants one entry, or one a face");
        }
        mesh_.add({{view(points), view(face_vertex_counts), view(face_vertex_indices),
                    view(hole_faces), flip_winding},
                   normals,
                   view(reflectance),
                   double_sided,
                   opacity ? view(*opacity) : std::span<const float>{}},
                  crease_angle_);
        if (copy_of < 0) {
            return;
        }
        const std::size_t own = mesh_.meshes.size() - 1;
        if (!matrix || copy_of >= static_cast<std::int64_t>(own)) {
            throw std::invalid_argument("a copy wants an earlier mesh and a matrix");
        }
        const auto source = static_cast<std::size_t>(copy_of);
        if (std::ranges::find(copies_, source, &MeshCopy::mesh) != copies_.end()) {
            throw std::invalid_argument("a copy of a copy");
        }
        copies_.push_back({own, source, placement(*matrix)});
    }

    void add_luminaire(const std::string& shape, const In1<double>& origin, const In3<double>& axes,
                       const In1<double>& size, const In1<double>& colour, double luminous_flux,
                       const std::shared_ptr<const CandelaDistribution>& diagram,
                       const std::shared_ptr<const MeshLinks>& links) {
        const auto o = view(origin);
        const auto a = view(axes);
        const auto s = view(size);
        const auto c = view(colour);
        if (o.size() != 3 || a.size() != 3 || s.size() != 2 || c.size() != 3) {
            throw std::invalid_argument("a luminaire wants origin (3,), axes (3, 3), size (2,) and "
                                        "colour (3,)");
        }
        const auto make_shape = [&]() -> LuminaireShape {
            if (shape == "sphere") {
                return SphereLuminaire{s[0]};
            }
            if (shape == "disk") {
                return DiskLuminaire{s[0]};
            }
            if (shape == "rect") {
                return RectLuminaire{s[0], s[1]};
            }
            if (shape == "cylinder") {
                return CylinderLuminaire{s[0], s[1]};
            }
            if (shape == "distant") {
                return DistantLuminaire{s[0], luminous_flux, nullptr};
            }
            throw std::invalid_argument("no luminaire shape " + shape);
        };
        luminaires_.push_back({make_shape(),
                               {o[0], o[1], o[2]},
                               a[0],
                               a[1],
                               a[2],
                               Vec3d{c[0], c[1], c[2]}.as<float>(),
                               luminous_flux,
                               diagram,
                               links});
    }

    void add_dome(const In3<double>& axes, const In3<float>& luminance, std::int32_t width,
                  const std::shared_ptr<const MeshLinks>& links) {
        const auto a = view(axes);
        const auto texels = view(luminance);
        if (a.size() != 3 || width < 1 || texels.empty() || texels.size() % width != 0) {
            throw std::invalid_argument("a dome wants axes (3, 3) and whole rows of texels");
        }
        auto map = std::make_shared<const DomeLuminance>(
            texels, width, static_cast<std::int32_t>(texels.size()) / width);
        const Vec3d mean = map->flux_density();
        luminaires_.push_back({DomeLuminaire{map, nullptr},
                               {},
                               a[0],
                               a[1],
                               a[2],
                               (mean * (1.0 / isolux::luminance(mean))).as<float>(),
                               isolux::luminance(mean),
                               nullptr,
                               links});
    }

    void add_mesh_luminaire(const In3<double>& points,
                            const nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::device::cpu,
                                              nb::c_contig>& triangles,
                            const In3<float>& luminance, bool double_sided,
                            const std::shared_ptr<const MeshLinks>& links) {
        const auto p = view(points);
        const auto l = view(luminance);
        if (l.size() != 1 && l.size() != triangles.shape(0)) {
            throw std::invalid_argument("one luminance, or one a triangle");
        }
        for (std::size_t t = 0; t < triangles.shape(0); ++t) {
            std::array<Vec3d, 3> corners;
            for (std::size_t k = 0; k < 3; ++k) {
                corners[k] = p[static_cast<std::size_t>(triangles.data()[3 * t + k])];
            }
            const Vec3f& light = l[l.size() == 1 ? 0 : t];
            add_triangle(luminaires_, corners, light, links);
            if (double_sided) {
                std::swap(corners[1], corners[2]);
                add_triangle(luminaires_, corners, light, links);
            }
        }
    }

    std::unique_ptr<Scene> build(int threads, std::int64_t worth_sharing, bool divide) {
        nb::gil_scoped_release release;
        return std::make_unique<Scene>(std::move(mesh_), std::move(luminaires_), copies_,
                                       worth_sharing, threads, divide);
    }

  private:
    double crease_angle_;
    IlluminationMesh mesh_;
    std::vector<Luminaire> luminaires_;
    std::vector<MeshCopy> copies_;
};

nb::list mesh_ranges(const Scene& scene) {
    nb::list out;
    for (const MeshRange& range : scene.mesh().meshes) {
        out.append(nb::make_tuple(range.front_begin, range.front_end, range.back_end,
                                  hand_over(std::vector(range.corner_vertices))));
    }
    return out;
}

nb::object division(const Scene& scene) {
    const MeshDivision& of = scene.division();
    if (of.vertices.empty()) {
        return nb::none();
    }
    nb::dict out;
    out["vertices"] = hand_over(std::vector(of.vertices));
    out["added"] = hand_over(std::vector(of.added));
    out["between"] = hand_over<std::int32_t>(std::vector(of.between), {of.between.size(), 2});
    out["twins"] = hand_over(std::vector(of.twins));
    std::vector<std::array<std::int32_t, 3>> elements;
    for (const MeshElement& element : scene.mesh().elements) {
        elements.push_back(element.vertices);
    }
    const std::size_t count = elements.size();
    out["elements"] = hand_over<std::int32_t>(std::move(elements), {count, 3});
    out["parts"] = hand_over(std::vector(of.parts));
    out["parents"] = hand_over(std::vector(of.parents));
    out["barycentrics"] =
        hand_over<double>(std::vector(of.barycentrics), {of.barycentrics.size(), 3, 3});
    return out;
}

} // namespace

void bind_scene(nb::module_& module) {
    nb::class_<Scene>(module, "Scene", "An immutable scene, its ray tracing tree built.")
        .def_prop_ro("luminous_flux", &Scene::luminous_flux, "lm, of all luminaires")
        .def_prop_ro("coloured", &Scene::coloured)
        .def_prop_ro(
            "tree_bytes", [](const Scene& s) { return s.ray_caster().tree_bytes(); },
            "bytes of the ray tracing tree")
        .def_prop_ro("linked", &Scene::linked, "whether some luminaire has light links")
        .def_prop_ro("element_count", [](const Scene& s) { return s.mesh().elements.size(); })
        .def_prop_ro("vertex_count", [](const Scene& s) { return s.mesh().positions.size(); })
        .def_prop_ro(
            "vertex_areas", [](const Scene& s) { return hand_over(std::vector(s.mesh().areas)); },
            nb::rv_policy::automatic,
            "(V,) float64, m^2 that each illumination vertex stands for; of a surface of opacity a "
            "the share a")
        .def_prop_ro(
            "vertex_positions",
            [](const Scene& s) { return hand_over(std::vector(s.mesh().positions)); },
            nb::rv_policy::automatic, "(V, 3) float64, metres, world space")
        .def_prop_ro(
            "receiver_positions",
            [](const Scene& s) {
                const auto receivers = s.receivers();
                std::vector<Vec3d> positions(receivers.size());
                std::ranges::transform(receivers, positions.begin(), &Receiver::position);
                return hand_over(std::move(positions));
            },
            nb::rv_policy::automatic,
            "(V, 3) float64, metres: where each illumination vertex samples light, a little off "
            "its element's edges; its normal is that of vertex_normals")
        .def_prop_ro(
            "vertex_normals",
            [](const Scene& s) { return hand_over(std::vector(s.mesh().normals)); },
            nb::rv_policy::automatic,
            "(V, 3) float32, unit, on the side that the vertex stands for")
        .def_prop_ro(
            "vertex_meshes",
            [](const Scene& s) {
                std::vector<std::int32_t> out(s.mesh().positions.size());
                for (std::size_t m = 0; m < s.mesh().meshes.size(); ++m) {
                    const MeshRange& range = s.mesh().meshes[m];
                    std::fill(out.begin() + range.front_begin, out.begin() + range.back_end,
                              static_cast<std::int32_t>(m));
                }
                return hand_over(std::move(out));
            },
            nb::rv_policy::automatic, "(V,) int32, number of each vertex's mesh")
        .def_prop_ro(
            "told_areas", [](const Scene& s) { return hand_over(std::vector(s.told_areas())); },
            nb::rv_policy::automatic,
            "(V,) float64, m^2 of which each vertex tells the light: vertex_areas without division")
        .def_prop_ro("division", &division,
                     "The arrays of isolux.mesh_division.MeshDivision by name; None: no element "
                     "was divided")
        .def_prop_ro("mesh_ranges", &mesh_ranges,
                     "of each mesh: (front begin, front end = back begin, back end, "
                     "corner_vertices (C,) int32 from the range's begin, -1 at holes)");

    nb::class_<MeshLinks>(module, "MeshLinks", "Light and shadow links of a luminaire.")
        .def(
            "__init__",
            [](MeshLinks* self, const In1<std::uint8_t>& lit, const In1<std::uint8_t>& shadow) {
                const auto l = view(lit), s = view(shadow);
                new (self) MeshLinks({l.begin(), l.end()}, {s.begin(), s.end()});
            },
            "lit"_a, "shadow"_a,
            "lit, shadow : (M,) uint8, of each mesh whether it receives the luminaire's light and "
            "whether it stands in it");

    module.attr("WORTH_SHARING") = kWorthSharing;
    nb::class_<SceneBuilder>(module, "SceneBuilder", "Takes meshes and luminaires, gives a Scene.")
        .def(nb::init<double>(), "crease_angle"_a, "crease_angle : rad")
        .def("add_mesh", &SceneBuilder::add_mesh, "points"_a, "face_vertex_counts"_a,
             "face_vertex_indices"_a, "corner_normals"_a.none(), "hole_faces"_a, "reflectance"_a,
             "double_sided"_a, "flip_winding"_a, "opacity"_a.none() = nb::none(), "copy_of"_a = -1,
             "matrix"_a.none() = nb::none(),
             "As isolux.scene_description.MeshDescription; opacity in (0, 1].")
        .def("add_luminaire", &SceneBuilder::add_luminaire, "shape"_a, "origin"_a, "axes"_a,
             "size"_a, "colour"_a, "luminous_flux"_a, "diagram"_a.none(),
             "links"_a.none() = nb::none(), "As isolux.scene_description.LuminaireDescription.")
        .def("add_dome", &SceneBuilder::add_dome, "axes"_a, "luminance"_a, "width"_a,
             "links"_a.none() = nb::none(),
             "luminance : (H * width, 3) float32, cd/m^2 by channel, a latitude-longitude map as "
             "isolux.scene_description.LuminaireDescription has it")
        .def("add_mesh_luminaire", &SceneBuilder::add_mesh_luminaire, "points"_a, "triangles"_a,
             "luminance"_a, "double_sided"_a, "links"_a.none() = nb::none(),
             "points : (P, 3) float64, metres\n"
             "triangles : (T, 3) int32, counter-clockwise seen from where they shine\n"
             "luminance : (T, 3) or (1, 3) float32, cd/m^2 by channel")
        .def("build", &SceneBuilder::build, "threads"_a, "worth_sharing"_a = kWorthSharing,
             "divide"_a = false,
             "Once; the builder is empty afterwards.\n\n"
             "worth_sharing : bytes; where copies of meshes save as many, they share a tree\n"
             "divide : large elements; see `Scene.division`");

    module.def(
        "enclosed_lights",
        [](const Scene& scene) {
            std::vector<EnclosedLight> found;
            {
                nb::gil_scoped_release release;
                found = enclosed_lights(scene);
            }
            nb::list out;
            for (const EnclosedLight& light : found) {
                const auto triple = [](const Vec3d& v) { return nb::make_tuple(v.x, v.y, v.z); };
                out.append(nb::make_tuple(triple(light.position), triple(light.size), light.mesh));
            }
            return out;
        },
        "scene"_a,
        "Luminaires of which no light gets out of a small closed part of the scene: their "
        "position and that part's size, m, and the mesh that most of it meets.");
}
