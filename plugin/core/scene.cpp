#include "core/scene.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>

#include "core/touched_surfaces.h"

namespace isolux {
namespace {

bool grey(const Vec3f& c) { return c.x == c.y && c.y == c.z; }

bool is_grey(const Luminaire& luminaire) {
    const auto* dome = std::get_if<DomeLuminaire>(&luminaire.shape);
    return grey(luminaire.colour) && (dome == nullptr || dome->luminance->is_grey());
}

SceneBounds bounds_of(const IlluminationMesh& mesh) {
    SceneBounds out{mesh.positions.front(), mesh.positions.front()};
    for (const Vec3d& p : mesh.positions) {
        out.low = {std::min(out.low.x, p.x), std::min(out.low.y, p.y), std::min(out.low.z, p.z)};
        out.high = {std::max(out.high.x, p.x), std::max(out.high.y, p.y),
                    std::max(out.high.z, p.z)};
    }
    return out;
}

// Those infinitely far last, aimed at the mesh; without those of which no light arrives.
std::vector<Luminaire> aimed(std::vector<Luminaire> luminaires, const IlluminationMesh& mesh) {
    const auto infinite = std::ranges::stable_partition(
        luminaires, [](const Luminaire& l) { return !l.is_infinite(); });
    if (!infinite.empty() && !mesh.positions.empty()) {
        const SceneBounds bounds = bounds_of(mesh);
        for (Luminaire& luminaire : infinite) {
            luminaire.aim(bounds);
        }
    }
    std::erase_if(luminaires, [](const Luminaire& l) { return !(l.luminous_flux > 0.0); });
    return luminaires;
}

std::vector<std::array<std::int32_t, 3>> triangles_of(const IlluminationMesh& mesh) {
    std::vector<std::array<std::int32_t, 3>> out(mesh.elements.size());
    std::ranges::transform(mesh.elements, out.begin(), &MeshElement::vertices);
    return out;
}

// One an element; empty where all are opaque.
std::vector<float> opacities_of(const IlluminationMesh& mesh) {
    std::vector<float> out;
    if (!std::ranges::all_of(mesh.surfaces, [](const Surface& s) { return s.opacity == 1.0F; })) {
        out.resize(mesh.elements.size());
        std::ranges::transform(mesh.elements, out.begin(), [&](const MeshElement& element) {
            return mesh.surface(element).opacity;
        });
    }
    return out;
}

bool any_links(const std::vector<Luminaire>& luminaires) {
    return std::ranges::any_of(luminaires, [](const Luminaire& l) { return l.links != nullptr; });
}

// One an element; empty where no ray asks for them.
std::vector<std::int32_t> meshes_of(const IlluminationMesh& mesh,
                                    const std::vector<Luminaire>& luminaires) {
    std::vector<std::int32_t> out;
    if (any_links(luminaires)) {
        out.resize(mesh.elements.size());
        std::ranges::transform(mesh.elements, out.begin(), [&](const MeshElement& element) {
            return mesh.surface(element).mesh;
        });
    }
    return out;
}

// Bytes of the tree a triangle, measured in spheres of 80 to 80,000 triangles, with its points; and
// about those of a copy's place in the tree of all.
constexpr std::int64_t kTriangleBytes = 85, kCopyBytes = 950;

// Those copies for which one tree is worth while; none where they save less altogether.
std::vector<TriangleCopies> shared_copies(const IlluminationMesh& mesh,
                                          std::span<const std::array<std::int32_t, 3>> triangles,
                                          std::span<const MeshCopy> copies,
                                          std::int64_t worth_sharing) {
    std::vector<TriangleCopies> out;
    std::int64_t saved = 0;
    for (const MeshCopy& copy : copies) {
        const MeshRange &own = mesh.meshes[copy.mesh], &source = mesh.meshes[copy.source];
        const std::int32_t count = own.element_end - own.element_begin;
        const std::int64_t bytes = count * kTriangleBytes - kCopyBytes;
        if (bytes <= 0 || count != source.element_end - source.element_begin) {
            continue;
        }
        const auto matched = match_copies(mesh.positions, triangles, own.element_begin, count,
                                          source.element_begin, copy.placement);
        if (matched) {
            out.push_back(*matched);
            saved += bytes;
        }
    }
    return saved >= worth_sharing ? out : std::vector<TriangleCopies>{};
}

// One a mesh: whether it shares a tree with another.
std::vector<bool> sharing_meshes(const IlluminationMesh& mesh, std::span<const MeshCopy> copies,
                                 std::int64_t worth_sharing) {
    std::vector<bool> out(mesh.meshes.size(), false);
    if (!copies.empty() &&
        !shared_copies(mesh, triangles_of(mesh), copies, worth_sharing).empty()) {
        for (const MeshCopy& copy : copies) {
            out[copy.mesh] = out[copy.source] = true;
        }
    }
    return out;
}

RayTargets ray_targets(const IlluminationMesh& mesh, const std::vector<Luminaire>& luminaires,
                       std::span<const std::array<std::int32_t, 3>> triangles,
                       std::span<const MeshCopy> copies, std::int64_t worth_sharing) {
    return {mesh.positions, triangles, opacities_of(mesh), meshes_of(mesh, luminaires),
            shared_copies(mesh, triangles, copies, worth_sharing)};
}

} // namespace

Scene::Scene(IlluminationMesh mesh, std::vector<Luminaire> luminaires,
             std::span<const MeshCopy> copies, std::int64_t worth_sharing, int threads, bool divide)
    : mesh_(std::move(mesh)),
      division_(divide ? divide_large_elements(mesh_, sharing_meshes(mesh_, copies, worth_sharing))
                       : MeshDivision{}),
      luminaires_(aimed(std::move(luminaires), mesh_)), luminous_flux_(0.0),
      coloured_(!std::ranges::all_of(mesh_.surfaces, grey, &Surface::reflectance) ||
                !std::ranges::all_of(luminaires_, is_grey)),
      ray_caster_(ray_targets(mesh_, luminaires_, triangles_of(mesh_), copies, worth_sharing),
                  threads) {
    place_receivers(threads);
    for (auto& luminaire : luminaires_) {
        const Vec3f local = (luminaire.position - ray_caster_.origin()).as<float>();
        luminaire.touching = static_cast<double>(ray_caster_.offset(local, 0.0F));
        if (luminaire.is_point(luminaire.touching)) {
            luminaire.touched = touched_surfaces(ray_caster_, luminaire.position);
        }
        if (luminaire.links && luminaire.links->lit.size() != mesh_.meshes.size()) {
            throw std::invalid_argument("light links want one entry a mesh");
        }
        luminous_flux_ += luminaire.luminous_flux;
        cumulative_flux_.push_back(luminous_flux_);
    }
}

void Scene::place_receivers(int threads) {
    const bool divided = !division_.vertices.empty();
    const IlluminationMesh& former = divided ? division_.former : mesh_;
    const bool lit_from_afar = std::ranges::any_of(luminaires_, &Luminaire::is_infinite);
    buried_ = buried_receivers(former, mesh_, ray_caster_,
                               divided ? division_.receivers : vertex_receivers(mesh_),
                               lit_from_afar, threads);
    contacts_ = contact_receivers(former, mesh_, ray_caster_, threads);
    if (divided) {
        for (auto* vertices : {&buried_.placed.vertices, &buried_.lit, &contacts_.vertices}) {
            for (std::int32_t& v : *vertices) {
                v = division_.vertices[static_cast<std::size_t>(v)];
            }
        }
        division_.former = {};
    }
}

std::vector<Receiver> Scene::receivers() const {
    std::vector<Receiver> out = vertex_receivers(mesh_);
    for (std::size_t v = 0; v < division_.vertices.size(); ++v) {
        out[division_.vertices[v]] = division_.receivers[v];
    }
    for (const PlacedReceivers* placed : {&buried_.placed, &contacts_}) {
        for (std::size_t i = 0; i < placed->vertices.size(); ++i) {
            out[static_cast<std::size_t>(placed->vertices[i])] = placed->receivers[i];
        }
    }
    return out;
}

bool Scene::linked() const { return any_links(luminaires_); }

const Luminaire& Scene::choose_luminaire(double u) const {
    const auto at = std::ranges::upper_bound(cumulative_flux_, u * luminous_flux_);
    const auto last = std::prev(cumulative_flux_.end());
    return luminaires_[static_cast<std::size_t>(std::min(at, last) - cumulative_flux_.begin())];
}

} // namespace isolux
