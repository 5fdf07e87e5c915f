#include "core/subdivision.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include <opensubdiv/far/error.h>
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

namespace isolux {
namespace {

namespace Far = OpenSubdiv::Far;
namespace Sdc = OpenSubdiv::Sdc;
using PrimvarRefiner = Far::PrimvarRefinerReal<double>;
using RefinerPointer = std::unique_ptr<Far::TopologyRefiner>;

static_assert(sizeof(int) == sizeof(std::int32_t)); // Far::Index and the descriptor's counts

// What OpenSubdiv last complained of in this thread.
thread_local std::string complaint;

void note_error(Far::ErrorType, const char* message) { complaint = message; }
void note_warning(const char*) {} // edges and points that don't exist are told by the reader

Sdc::SchemeType osd_scheme(SubdivisionScheme scheme) {
    switch (scheme) {
    case SubdivisionScheme::bilinear:
        return Sdc::SCHEME_BILINEAR;
    case SubdivisionScheme::loop:
        return Sdc::SCHEME_LOOP;
    case SubdivisionScheme::catmull_clark:
        break;
    }
    return Sdc::SCHEME_CATMARK;
}

Sdc::Options osd_options(const SubdivisionRules& rules) {
    static constexpr std::array boundary{Sdc::Options::VTX_BOUNDARY_NONE,
                                         Sdc::Options::VTX_BOUNDARY_EDGE_ONLY,
                                         Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER};
    static constexpr std::array face_varying{
        Sdc::Options::FVAR_LINEAR_NONE,          Sdc::Options::FVAR_LINEAR_CORNERS_ONLY,
        Sdc::Options::FVAR_LINEAR_CORNERS_PLUS1, Sdc::Options::FVAR_LINEAR_CORNERS_PLUS2,
        Sdc::Options::FVAR_LINEAR_BOUNDARIES,    Sdc::Options::FVAR_LINEAR_ALL};
    Sdc::Options options;
    options.SetVtxBoundaryInterpolation(boundary[static_cast<std::size_t>(rules.boundary)]);
    options.SetFVarLinearInterpolation(face_varying[static_cast<std::size_t>(rules.face_varying)]);
    options.SetTriangleSubdivision(rules.smooth_triangles ? Sdc::Options::TRI_SUB_SMOOTH
                                                          : Sdc::Options::TRI_SUB_CATMARK);
    return options;
}

RefinerPointer make_refiner(const Far::TopologyDescriptor& descriptor, Sdc::SchemeType scheme,
                            Sdc::Options options) {
    using Factory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
    static const bool callbacks_set = [] {
        Far::SetErrorCallback(note_error);
        Far::SetWarningCallback(note_warning);
        return true;
    }();
    static_cast<void>(callbacks_set);
    complaint.clear();
    RefinerPointer refiner(Factory::Create(descriptor, Factory::Options(scheme, options)));
    if (!refiner) {
        throw std::invalid_argument(complaint.empty() ? "no reason given" : complaint);
    }
    return refiner;
}

// A point as OpenSubdiv sums it.
struct Place {
    Vec3d at;
    void Clear() { at = {}; }
    void AddWithWeight(const Place& other, double weight) { at += other.at * weight; }
};

std::vector<CageStencil> gathered(std::vector<CageStencil> stencils) {
    for (CageStencil& stencil : stencils) {
        stencil.gather();
    }
    return stencils;
}
std::vector<Place> gathered(std::vector<Place> places) { return places; }

std::int32_t place_in_face(Far::ConstIndexArray face, Far::Index point) {
    for (std::int32_t i = 0; i < face.size(); ++i) {
        if (face[i] == point) {
            return i;
        }
    }
    return 0;
}

} // namespace

struct SubdividedSurface::Refinement {
    RefinerPointer refiner;
    bool has_face_varying = false;

    const Far::TopologyLevel& last() const { return refiner->GetLevel(refiner->GetMaxLevel()); }
    const Far::TopologyLevel& level(std::int32_t i) const { return refiner->GetLevel(i); }

    template <typename Value> std::vector<Value> refine(std::vector<Value> values) const {
        const PrimvarRefiner primvars(*refiner);
        for (std::int32_t i = 1; i <= refiner->GetMaxLevel(); ++i) {
            std::vector<Value> finer(level(i).GetNumVertices());
            primvars.Interpolate(i, values, finer);
            values = gathered(std::move(finer));
        }
        return values;
    }

    template <typename Value> std::vector<Value> limit(const std::vector<Value>& refined) const {
        std::vector<Value> limits(refined.size());
        PrimvarRefiner(*refiner).Limit(refined, limits);
        return gathered(std::move(limits));
    }

    std::vector<Place> refined_points(std::span<const Vec3d> cage_points) const {
        if (cage_points.size() != static_cast<std::size_t>(level(0).GetNumVertices())) {
            throw std::invalid_argument("not as many points as the cage has");
        }
        std::vector<Place> places(cage_points.size());
        std::ranges::transform(cage_points, places.begin(),
                               [](const Vec3d& p) { return Place{p}; });
        return refine(std::move(places));
    }
};

namespace {

// Area vector of the parallelogram that the limit surface's tangents span at each point.
std::vector<Vec3d> tangent_normals(const Far::TopologyRefiner& refiner,
                                   const std::vector<Place>& points) {
    std::vector<Place> limits(points.size()), along(points.size()), across(points.size());
    PrimvarRefiner(refiner).Limit(points, limits, along, across);
    std::vector<Vec3d> normals(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        normals[i] = cross(along[i].at, across[i].at);
    }
    return normals;
}

// The last level cut open along its sharp edges: what OpenSubdiv then calls a boundary has the
// tangents of its own side alone.
struct CutLevel {
    std::vector<Far::Index> corners;     // point of each corner, those of the cut ones anew
    std::vector<Far::Index> uncut_point; // of each new point
};

bool is_cut(const Far::TopologyLevel& level, Far::Index edge) {
    return level.GetEdgeSharpness(edge) > 0.0f && !level.IsEdgeBoundary(edge);
}

// Points on two sharp edges get a second one for the faces on their other side.
CutLevel cut_along_sharp_edges(const Far::TopologyLevel& level,
                               std::span<const std::int32_t> first_corners) {
    CutLevel cut;
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        const Far::ConstIndexArray face = level.GetFaceVertices(f);
        cut.corners.insert(cut.corners.end(), face.begin(), face.end());
    }
    std::vector<Far::Index> reached;
    for (Far::Index v = 0; v < level.GetNumVertices(); ++v) {
        const Far::ConstIndexArray edges = level.GetVertexEdges(v);
        const bool on_crease =
            level.GetVertexRule(v) == Sdc::Crease::RULE_CREASE &&
            std::any_of(edges.begin(), edges.end(), [&](Far::Index e) { return is_cut(level, e); });
        if (!on_crease || level.IsVertexNonManifold(v)) {
            continue;
        }
        const Far::ConstIndexArray faces = level.GetVertexFaces(v);
        reached.assign(1, faces[0]);
        for (std::size_t i = 0; i < reached.size(); ++i) {
            for (const Far::Index edge : edges) {
                const Far::ConstIndexArray sides = level.GetEdgeFaces(edge);
                if (is_cut(level, edge) || sides.size() != 2) {
                    continue;
                }
                for (const int side : {0, 1}) {
                    if (sides[side] == reached[i] &&
                        std::ranges::find(reached, sides[1 - side]) == reached.end()) {
                        reached.push_back(sides[1 - side]);
                    }
                }
            }
        }
        const Far::Index twin =
            level.GetNumVertices() + static_cast<Far::Index>(cut.uncut_point.size());
        cut.uncut_point.push_back(v);
        for (const Far::Index face : faces) {
            if (std::ranges::find(reached, face) == reached.end()) {
                cut.corners[first_corners[face] + place_in_face(level.GetFaceVertices(face), v)] =
                    twin;
            }
        }
    }
    return cut;
}

} // namespace

SubdividedSurface::SubdividedSurface(const ControlCage& cage, const SubdivisionRules& rules,
                                     std::int32_t level)
    : refinement_(std::make_unique<Refinement>()) {
    Far::TopologyDescriptor descriptor;
    descriptor.numVertices = cage.point_count;
    descriptor.numFaces = static_cast<int>(cage.face_vertex_counts.size());
    descriptor.numVertsPerFace = cage.face_vertex_counts.data();
    descriptor.vertIndicesPerFace = cage.face_vertex_indices.data();
    descriptor.numCreases = static_cast<int>(cage.sharp_edges.size());
    descriptor.creaseVertexIndexPairs =
        cage.sharp_edges.empty() ? nullptr : cage.sharp_edges.front().data();
    descriptor.creaseWeights = cage.edge_sharpness.data();
    descriptor.numCorners = static_cast<int>(cage.sharp_points.size());
    descriptor.cornerVertexIndices = cage.sharp_points.data();
    descriptor.cornerWeights = cage.point_sharpness.data();
    descriptor.numHoles = static_cast<int>(cage.hole_faces.size());
    descriptor.holeIndices = cage.hole_faces.data();
    Far::TopologyDescriptor::FVarChannel channel;
    refinement_->has_face_varying = !cage.face_varying_indices.empty();
    if (refinement_->has_face_varying) {
        channel.numValues = 1 + *std::ranges::max_element(cage.face_varying_indices);
        channel.valueIndices = cage.face_varying_indices.data();
        descriptor.numFVarChannels = 1;
        descriptor.fvarChannels = &channel;
    }
    refinement_->refiner = make_refiner(descriptor, osd_scheme(rules.scheme), osd_options(rules));
    Far::TopologyRefiner::UniformOptions options(level);
    options.fullTopologyInLastLevel = true; // limit points want the neighbours of each point
    refinement_->refiner->RefineUniform(options);
}

SubdividedSurface::~SubdividedSurface() = default;
SubdividedSurface::SubdividedSurface(SubdividedSurface&&) noexcept = default;
SubdividedSurface& SubdividedSurface::operator=(SubdividedSurface&&) noexcept = default;

std::int32_t SubdividedSurface::point_count() const { return refinement_->last().GetNumVertices(); }

std::vector<std::int32_t> SubdividedSurface::face_vertex_counts() const {
    const Far::TopologyLevel& level = refinement_->last();
    std::vector<std::int32_t> counts(level.GetNumFaces());
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        counts[f] = level.GetFaceVertices(f).size();
    }
    return counts;
}

std::vector<std::int32_t> SubdividedSurface::face_vertex_indices() const {
    const Far::TopologyLevel& level = refinement_->last();
    std::vector<std::int32_t> indices;
    indices.reserve(level.GetNumFaceVertices());
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        const Far::ConstIndexArray face = level.GetFaceVertices(f);
        indices.insert(indices.end(), face.begin(), face.end());
    }
    return indices;
}

std::vector<std::int32_t> SubdividedSurface::cage_faces() const {
    std::vector<std::int32_t> faces(refinement_->level(0).GetNumFaces());
    for (std::size_t f = 0; f < faces.size(); ++f) {
        faces[f] = static_cast<std::int32_t>(f);
    }
    for (std::int32_t i = 1; i <= refinement_->refiner->GetMaxLevel(); ++i) {
        const Far::TopologyLevel& level = refinement_->level(i);
        std::vector<std::int32_t> finer(level.GetNumFaces());
        for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
            finer[f] = faces[level.GetFaceParentFace(f)];
        }
        faces = std::move(finer);
    }
    return faces;
}

std::vector<std::int32_t> SubdividedSurface::hole_faces() const {
    const Far::TopologyLevel& level = refinement_->last();
    std::vector<std::int32_t> holes;
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        if (level.IsFaceHole(f)) {
            holes.push_back(f);
        }
    }
    return holes;
}

std::vector<std::int32_t> SubdividedSurface::corners_of_cage() const {
    const std::int32_t last = refinement_->refiner->GetMaxLevel();
    std::vector<std::int32_t> first(refinement_->last().GetNumFaces());
    for (Far::Index f = 0, corner = 0; f < refinement_->last().GetNumFaces(); ++f) {
        first[f] = corner;
        corner += refinement_->last().GetFaceVertices(f).size();
    }
    const Far::TopologyLevel& cage = refinement_->level(0);
    std::vector<std::int32_t> corners;
    corners.reserve(cage.GetNumFaceVertices());
    for (Far::Index cage_face = 0; cage_face < cage.GetNumFaces(); ++cage_face) {
        for (std::int32_t i = 0; i < cage.GetFaceVertices(cage_face).size(); ++i) {
            Far::Index face = cage_face;
            std::int32_t place = i;
            for (std::int32_t l = 0; l < last; ++l) {
                const Far::TopologyLevel& level = refinement_->level(l);
                const Far::Index point = level.GetFaceVertices(face)[place];
                face = level.GetFaceChildFaces(face)[place];
                place = place_in_face(refinement_->level(l + 1).GetFaceVertices(face),
                                      level.GetVertexChildVertex(point));
            }
            corners.push_back(first[face] + place);
        }
    }
    return corners;
}

std::vector<std::int32_t> SubdividedSurface::face_varying_indices() const {
    if (!refinement_->has_face_varying) {
        return {};
    }
    const Far::TopologyLevel& level = refinement_->last();
    std::vector<std::int32_t> indices;
    indices.reserve(level.GetNumFaceVertices());
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        const Far::ConstIndexArray face = level.GetFaceFVarValues(f);
        indices.insert(indices.end(), face.begin(), face.end());
    }
    return indices;
}

std::vector<Vec3d> SubdividedSurface::limit_points(std::span<const Vec3d> cage_points) const {
    const auto limits = refinement_->limit(refinement_->refined_points(cage_points));
    std::vector<Vec3d> points(limits.size());
    std::ranges::transform(limits, points.begin(), &Place::at);
    return points;
}

std::vector<Vec3f> SubdividedSurface::limit_normals(std::span<const Vec3d> cage_points) const {
    const Far::TopologyLevel& level = refinement_->last();
    std::vector<Place> points = refinement_->refined_points(cage_points);
    std::vector<Vec3d> smooth = tangent_normals(*refinement_->refiner, points);

    const std::vector<std::int32_t> counts = face_vertex_counts();
    std::vector<std::int32_t> first_corners(counts.size());
    for (std::size_t f = 1; f < counts.size(); ++f) {
        first_corners[f] = first_corners[f - 1] + counts[f - 1];
    }
    const CutLevel cut = cut_along_sharp_edges(level, first_corners);
    std::vector<Vec3d> sided = smooth;
    if (!cut.uncut_point.empty()) {
        std::vector<Place> cut_points = points;
        for (const Far::Index v : cut.uncut_point) {
            cut_points.push_back(points[v]);
        }
        Far::TopologyDescriptor descriptor;
        descriptor.numVertices = static_cast<int>(cut_points.size());
        descriptor.numFaces = level.GetNumFaces();
        descriptor.numVertsPerFace = counts.data();
        descriptor.vertIndicesPerFace = cut.corners.data();
        Sdc::Options options;
        options.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_ONLY);
        const RefinerPointer open =
            make_refiner(descriptor, refinement_->refiner->GetSchemeType(), options);
        sided = tangent_normals(*open, cut_points);
        // Elsewhere the cut may run into a point that is smooth.
        std::vector<bool> is_sided(sided.size(), false);
        for (std::size_t i = 0; i < cut.uncut_point.size(); ++i) {
            is_sided[cut.uncut_point[i]] = is_sided[smooth.size() + i] = true;
        }
        for (std::size_t v = 0; v < smooth.size(); ++v) {
            if (!is_sided[v]) {
                sided[v] = smooth[v];
            }
        }
    }

    std::vector<Vec3f> normals;
    normals.reserve(cut.corners.size());
    for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
        const Far::ConstIndexArray face = level.GetFaceVertices(f);
        for (std::int32_t i = 0; i < face.size(); ++i) {
            Vec3d normal = sided[cut.corners[first_corners[f] + i]];
            if (level.GetVertexRule(face[i]) == Sdc::Crease::RULE_CORNER ||
                !(dot(normal, normal) > 0.0)) {
                // A tip has no tangent plane: each face there has the one of its own edges.
                const Vec3d& tip = points[face[i]].at;
                normal = cross(points[face[(i + 1) % face.size()]].at - tip,
                               points[face[(i + face.size() - 1) % face.size()]].at - tip);
            }
            normals.push_back(normalize(normal).as<float>());
        }
    }
    return normals;
}

double SubdividedSurface::chord_error(std::span<const Vec3d> cage_points) const {
    const std::int32_t last = refinement_->refiner->GetMaxLevel();
    if (last < 1) {
        throw std::invalid_argument("no level before the last");
    }
    const std::vector<Vec3d> limits = limit_points(cage_points);
    const Far::TopologyLevel& level = refinement_->level(last - 1);
    const auto deviation = [&](Far::ConstIndexArray points, Far::Index added) {
        Vec3d middle;
        for (const Far::Index point : points) {
            middle += limits[level.GetVertexChildVertex(point)];
        }
        return length(middle * (1.0 / points.size()) - limits[added]);
    };
    double greatest = 0.0;
    for (Far::Index e = 0; e < level.GetNumEdges(); ++e) {
        greatest =
            std::max(greatest, deviation(level.GetEdgeVertices(e), level.GetEdgeChildVertex(e)));
    }
    if (refinement_->refiner->GetSchemeType() != Sdc::SCHEME_LOOP) {
        for (Far::Index f = 0; f < level.GetNumFaces(); ++f) {
            greatest = std::max(greatest,
                                deviation(level.GetFaceVertices(f), level.GetFaceChildVertex(f)));
        }
    }
    return greatest;
}

SparseRows SubdividedSurface::limit_stencils() const {
    auto stencils = unit_stencils(refinement_->level(0).GetNumVertices());
    return sparse_rows(refinement_->limit(refinement_->refine(std::move(stencils))));
}

SparseRows SubdividedSurface::varying_stencils() const {
    const PrimvarRefiner primvars(*refinement_->refiner);
    auto stencils = unit_stencils(refinement_->level(0).GetNumVertices());
    for (std::int32_t i = 1; i <= refinement_->refiner->GetMaxLevel(); ++i) {
        std::vector<CageStencil> finer(refinement_->level(i).GetNumVertices());
        primvars.InterpolateVarying(i, stencils, finer);
        stencils = gathered(std::move(finer));
    }
    return sparse_rows(stencils);
}

SparseRows SubdividedSurface::face_varying_stencils() const {
    if (!refinement_->has_face_varying) {
        throw std::invalid_argument("the cage has no face-varying indices");
    }
    const PrimvarRefiner primvars(*refinement_->refiner);
    auto stencils = unit_stencils(refinement_->level(0).GetNumFVarValues());
    for (std::int32_t i = 1; i <= refinement_->refiner->GetMaxLevel(); ++i) {
        std::vector<CageStencil> finer(refinement_->level(i).GetNumFVarValues());
        primvars.InterpolateFaceVarying(i, stencils, finer);
        stencils = gathered(std::move(finer));
    }
    std::vector<CageStencil> limits(stencils.size());
    primvars.LimitFaceVarying(stencils, limits);
    for (std::size_t i = 0; i < limits.size(); ++i) {
        if (limits[i].empty()) { // OpenSubdiv passes over some values at non-manifold points
            limits[i] = stencils[i];
        }
    }
    return sparse_rows(gathered(std::move(limits)));
}

} // namespace isolux
