"""Refined results: shadows finer than the mesh, and nothing else of the stage changed by them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from isolux._core import triangulate
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdValidation, Vt

from hand_built import solution_of
from isolux.errors import SceneError
from isolux.render import render_picture
from isolux.results import ResultsWriter
from isolux.stage_reader import read_stage
from split_edges import SplitMesh, every_edge, layouts_of, some_edges

# A linear function of local space, which every interpolation over triangles reproduces.
SLOPES = np.array([[0.3, -1.0, 0.2], [2.0, 0.1, 0.5], [-0.4, 0.7, 1.1]])
OFFSET = np.array([5.0, 6.0, 7.0])

# A pentagon with a dent, a quad and a triangle in one plane; a roof over the quad's edge.
POINTS = [
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1.2, 0), (0, 2, 0),
    (4, 0, 0.5), (4, 2, 0.5), (3, 3, 2),
]  # fmt: skip
FACES = [[0, 1, 2, 3, 4], [1, 5, 6, 2], [2, 6, 7], [3, 2, 7]]
TIME = 5.0


def linear(points):
    return np.asarray(points, float) @ SLOPES + OFFSET


def add_mesh(stage, path, points=POINTS, faces=FACES, **attributes):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.array(points, np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([point for face in faces for point in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))])
    for name, value in attributes.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    return mesh


def add_primvar(mesh, name, type_name, interpolation, values, indices=None, element_size=-1):
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        name, getattr(Sdf.ValueTypeNames, type_name), interpolation, element_size
    )
    primvar.Set(values)
    if indices is not None:
        primvar.SetIndices(indices)
    return primvar


def new_stage(folder, name="room.usda"):
    stage = Usd.Stage.CreateNew(str(folder / name))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


class Bake:
    """A source stage, its solution's refinements, and the results as usd-core reads them."""

    def __init__(self, source, output, *rounds, coarse_stages=1):
        source.GetRootLayer().Save()
        self.scene = read_stage(source)
        self.layouts = layouts_of(self.scene)
        self.split = SplitMesh(self.scene, self.layouts)
        self.meshes = [None] * coarse_stages
        self.writer = ResultsWriter(source, output, self.scene, {})
        self.solutions = []
        for refined in [None] * coarse_stages + [None if r is None else r for r in rounds]:
            self.add(self.split.split(**refined) if refined else None)
        self.stage = Usd.Stage.Open(str(output))

    def add(self, refined):
        index = len(self.solutions) + 1
        parts = [(mesh, self.layouts[mesh.path].corner_vertices) for mesh in self.scene.meshes]
        solution = solution_of(parts, index)
        if refined is not None:
            solution = replace(
                solution,
                refined=refined,
                direct=refined.interpolate(solution.direct),
                indirect=refined.interpolate(solution.indirect),
                relative_deviation=refined.interpolate(solution.relative_deviation),
            )
        self.writer.write(replace(solution, layouts=self.layouts, scene=self.scene))
        self.solutions.append(solution)

    def mesh(self, path="/World/Mesh"):
        return UsdGeom.Mesh(self.stage.GetPrimAtPath(path))


def bake(source, *rounds, name="baked", **options):
    output = Path(source.GetRootLayer().realPath).with_name(f"{name}.usda")
    return Bake(source, output, *(rounds or ALL_TWICE), **options)


ALL_TWICE = ({"choose": every_edge}, {"choose": every_edge})
SOME = ({"choose": some_edges(1), "fraction": 0.3}, {"choose": some_edges(2), "fraction": 0.6})


def values_at_corners(mesh, name, time=1.0):
    """A primvar at each face corner, as any reader expands it; its count is checked."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
    values = np.array(primvar.ComputeFlattened(time))
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    interpolation = primvar.GetInterpolation()
    points = len(mesh.GetPointsAttr().Get())
    wanted = {"constant": 1, "uniform": len(counts), "faceVarying": len(corners)}
    assert len(values) == wanted.get(interpolation, points) * primvar.GetElementSize()
    if primvar.GetElementSize() > 1:
        values = values.reshape(-1, primvar.GetElementSize(), *values.shape[1:])
    if interpolation == "constant":
        return np.repeat(values, len(corners), axis=0)
    if interpolation == "uniform":
        return np.repeat(values, counts, axis=0)
    return values if interpolation == "faceVarying" else values[corners]


def points_at_corners(mesh):
    return np.array(mesh.GetPointsAttr().Get())[mesh.GetFaceVertexIndicesAttr().Get()]


def assert_readable(stage):
    """What a reader relies on: sound faces; primvars as long as wanted, at all times; families."""
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    for mesh in meshes:
        counts = mesh.GetFaceVertexCountsAttr().Get()
        assert UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(), counts, len(mesh.GetPointsAttr().Get())
        )[0]
        for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
            for time in [Usd.TimeCode.Default(), *primvar.GetTimeSamples()]:
                values_at_corners(mesh, primvar.GetPrimvarName(), time)
        for family in UsdGeom.Subset.GetAllGeomSubsetFamilyNames(mesh):
            assert UsdGeom.Subset.ValidateFamily(mesh, "face", family) == (True, "")
    return len(meshes)


def area_vectors(points, counts, indices):
    """(F, 3) half the cross products of a fan: area times normal by the corner order."""
    corners = np.asarray(points, float)[indices]
    vectors, start = [], 0
    for count in counts:
        face = corners[start : start + count]
        vectors.append(np.cross(face[1:-1] - face[0], face[2:] - face[0]).sum(axis=0) / 2)
        start += count
    return np.array(vectors)


VARIANTS = {
    "as authored": {},
    "left-handed": {"orientation": "leftHanded"},
    "mirrored": {"mirrored": True},
    "left-handed and mirrored": {"orientation": "leftHanded", "mirrored": True},
    "double-sided": {"doubleSided": True},
    "subdivision surface": {"subdivisionScheme": "bilinear"},
}


def place(mesh, mirrored=False):
    """Somewhere else, turned, sheared by unequal scales, and mirrored if asked for."""
    turned = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 50.0))
    scaled = Gf.Matrix4d().SetScale(Gf.Vec3d(-2.0 if mirrored else 2.0, 0.7, 1.3))
    moved = Gf.Matrix4d().SetTranslate(Gf.Vec3d(10, 20, 30))
    mesh.AddTransformOp().Set(scaled * turned * moved)


@pytest.fixture(params=VARIANTS.values(), ids=VARIANTS.keys())
def variant(request, tmp_path):
    stage = new_stage(tmp_path)
    options = dict(request.param)
    mirrored = options.pop("mirrored", False)
    place(add_mesh(stage, "/World/Mesh", **options), mirrored)
    return stage


@pytest.mark.parametrize("rounds", [ALL_TWICE, SOME], ids=["all edges", "some edges"])
def test_faces_keep_their_area_and_their_side(variant, rounds):
    baked = bake(variant, *rounds)
    assert assert_readable(baked.stage) == 1
    mesh = baked.mesh()
    counts = mesh.GetFaceVertexCountsAttr().Get()
    assert set(counts) == {3}
    assert len(counts) > 2 * 8
    parts = area_vectors(mesh.GetPointsAttr().Get(), counts, mesh.GetFaceVertexIndicesAttr().Get())
    parents = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("isolux:sourceFace").Get())
    whole = area_vectors(POINTS, [len(face) for face in FACES], np.concatenate(FACES))
    for face, vector in enumerate(whole):
        assert parts[parents == face].sum(axis=0) == pytest.approx(vector, abs=1e-6)
        assert (parts[parents == face] @ vector > 0).all()  # none is turned over
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    extent = np.array(mesh.GetExtentAttr().Get())
    assert np.array_equal(extent, [np.min(POINTS, axis=0), np.max(POINTS, axis=0)])


def test_triangles_meet_edge_to_edge(variant):
    """Each directed edge once; those without a neighbour are as long as the outline was."""
    baked = bake(variant, *SOME)
    mesh = baked.mesh()
    points = np.array(mesh.GetPointsAttr().Get(), float)
    outlines = []
    for counts, indices in (
        (mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()),
        ([len(face) for face in FACES], np.concatenate(FACES)),
    ):
        edges, start = [], 0
        for count in counts:
            face = indices[start : start + count]
            edges += [(face[k], face[(k + 1) % count]) for k in range(count)]
            start += count
        assert len(set(edges)) == len(edges)
        outline = [(a, b) for a, b in edges if (b, a) not in set(edges)]
        outlines.append(sum(np.linalg.norm(points[a] - points[b]) for a, b in outline))
    assert outlines[0] == pytest.approx(outlines[1], rel=1e-6)


PRIMVAR_TYPES = {
    "vertex": ("Float3Array", "vertex"),
    "varying": ("Vector3fArray", "varying"),
    "face-varying": ("Color3fArray", "faceVarying"),
    "double precision": ("Double3Array", "vertex"),
    "half precision": ("Half3Array", "faceVarying"),
}


@pytest.mark.parametrize(("type_name", "interpolation"), PRIMVAR_TYPES.values(), ids=PRIMVAR_TYPES)
@pytest.mark.parametrize("indexed", [False, True], ids=["plain", "indexed"])
def test_linear_primvars_stay_what_they_were(tmp_path, type_name, interpolation, indexed):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    values = linear(POINTS)
    indices = np.concatenate(FACES) if interpolation == "faceVarying" else np.arange(len(POINTS))
    if indexed:  # in another order
        values, indices = values[::-1], len(POINTS) - 1 - indices
        picked = indices.tolist()
    else:
        values, picked = values[indices], None
    rows = [tuple(row) for row in values.tolist()]
    add_primvar(mesh, "place", type_name, interpolation, rows, picked)
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    found = values_at_corners(baked.mesh(), "place")
    tolerance = 1e-2 if type_name.startswith("Half") else 1e-5
    assert found == pytest.approx(linear(points_at_corners(baked.mesh())), abs=tolerance)
    assert UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("place").GetInterpolation() == interpolation


def test_a_seam_of_texture_coordinates_stays_a_seam(tmp_path):
    """Each face has its own chart: the face's number beside the place."""
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    st = [(10.0 * f + POINTS[p][0], POINTS[p][1]) for f, face in enumerate(FACES) for p in face]
    backwards = list(range(len(st)))[::-1]
    add_primvar(mesh, "st", "TexCoord2fArray", "faceVarying", st[::-1], backwards)
    baked = bake(stage, *SOME)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    found = values_at_corners(baked.mesh(), "st")
    places = points_at_corners(baked.mesh())
    expected = np.column_stack([10.0 * faces + places[:, 0], places[:, 1]])
    assert found == pytest.approx(expected, abs=1e-5)


def test_points_at_the_same_place_stay_apart(tmp_path):
    """Two quads side by side, unwelded: left of the seam the mesh is cold, right of it hot."""
    stage = new_stage(tmp_path)
    left = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    points = np.concatenate([left, left + np.array([1, 0, 0])])
    mesh = add_mesh(stage, "/World/Mesh", points, [[0, 1, 2, 3], [4, 5, 6, 7]])
    add_primvar(mesh, "heat", "FloatArray", "vertex", [0.0] * 4 + [100.0] * 4)
    baked = bake(stage)
    assert_readable(baked.stage)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    assert np.array_equal(values_at_corners(baked.mesh(), "heat"), 100.0 * faces)
    # A grid of five by five points on each, with the two that are shared by position apart.
    assert len(baked.mesh().GetPointsAttr().Get()) == 2 * 25


def test_values_of_faces_go_to_their_parts(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    add_primvar(mesh, "number", "IntArray", "uniform", [0, 10, 20, 30])
    add_primvar(mesh, "name", "StringArray", "uniform", ["wall", "floor"], [1, 0, 0, 1])
    add_primvar(mesh, "pair", "FloatArray", "uniform", [0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5], None, 2)
    add_primvar(mesh, "all", "Float3Array", "constant", [(1, 2, 3)])
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    assert np.array_equal(values_at_corners(baked.mesh(), "number"), 10 * faces)
    names = np.array(["floor", "wall", "wall", "floor"])
    assert np.array_equal(values_at_corners(baked.mesh(), "name"), names[faces])
    pairs = np.column_stack([faces, faces + 0.5])
    assert np.array_equal(values_at_corners(baked.mesh(), "pair"), pairs)
    assert not baked.writer.findings


def test_what_cannot_be_blended_takes_the_nearest_and_says_so(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    joints = np.repeat(np.arange(8), 2).tolist()
    add_primvar(mesh, "skel:jointIndices", "IntArray", "vertex", joints, None, 2)
    weights = [x for p in range(8) for x in (1 - p / 8, p / 8)]
    add_primvar(mesh, "skel:jointWeights", "FloatArray", "vertex", weights, None, 2)
    baked = bake(stage, {"choose": every_edge, "fraction": 0.3})
    assert_readable(baked.stage)
    found = values_at_corners(baked.mesh(), "skel:jointIndices")[:, 0]
    places = points_at_corners(baked.mesh())
    distance = np.linalg.norm(places[:, None] - np.array(POINTS), axis=2)
    on_its_edge = distance[np.arange(len(found)), found]
    assert (on_its_edge <= 0.3 * np.linalg.norm([3, 3, 2]) + 1e-6).all()
    assert np.array_equal(
        found[distance.min(axis=1) == 0], distance.argmin(axis=1)[distance.min(axis=1) == 0]
    )
    shares = values_at_corners(baked.mesh(), "skel:jointWeights")
    assert shares == pytest.approx(np.column_stack([1 - found / 8, found / 8]))
    kinds = {(f.path, f.kind, f.action) for f in baked.writer.findings}
    assert kinds == {
        ("/World/Mesh", "primvars:skel:jointIndices", "approximated"),
        ("/World/Mesh", "primvars:skel:jointWeights", "approximated"),
    }


BROKEN = {
    "too few": (["vertex", [1.0, 2.0]], "2 vertex values, 8 wanted"),
    "not whole elements": (["vertex", [1.0] * 17, None, 2], "17 vertex values, 8 of 2 each wanted"),
    "indices to nowhere": (["vertex", [1.0], [0, 9] * 4], "0 vertex values, 8 wanted"),
}


@pytest.mark.parametrize(("values", "found"), BROKEN.values(), ids=BROKEN.keys())
def test_a_primvar_that_never_fitted_is_left_out_and_named(tmp_path, capfd, values, found):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    add_primvar(mesh, "broken", "FloatArray", *values)
    baked = bake(stage)
    assert_readable(baked.stage)
    assert not UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("broken").HasValue()
    (finding,) = baked.writer.findings
    assert (finding.kind, finding.action) == ("primvars:broken", "skipped")
    assert found in finding.reason
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("as_primvar", [False, True], ids=["attribute", "primvar"])
def test_normals_stay_of_unit_length_and_between_their_neighbours(tmp_path, as_primvar):
    """Of a half tube, where the normals turn by 60 degrees from edge to edge."""
    angles = np.radians([0.0, 60.0, 120.0, 180.0])
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    points = np.concatenate([ring, ring + np.array([0, 0, 1])])
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", points, [[i, i + 1, i + 5, i + 4] for i in range(3)])
    outward = Vt.Vec3fArray.FromNumpy(np.concatenate([ring, ring]).astype(np.float32))
    if as_primvar:
        add_primvar(mesh, "normals", "Normal3fArray", "vertex", outward)
    else:
        mesh.CreateNormalsAttr(outward)
        mesh.SetNormalsInterpolation("vertex")
    baked = bake(stage, {"choose": every_edge})
    refined = baked.mesh()
    if as_primvar:
        found = np.array(UsdGeom.PrimvarsAPI(refined).GetPrimvar("normals").Get())
    else:
        found = np.array(refined.GetNormalsAttr().Get())
        assert refined.GetNormalsInterpolation() == "vertex"
    # At the middle of a chord the outward direction is that of the point itself.
    places = np.array(refined.GetPointsAttr().Get()) * (1, 1, 0)
    assert len(found) == len(places) > 8
    assert found == pytest.approx(places / np.linalg.norm(places, axis=1, keepdims=True), abs=1e-6)


def test_velocities_go_along(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    mesh.CreateVelocitiesAttr([Gf.Vec3f(*row) for row in linear(POINTS)])
    baked = bake(stage, *SOME)
    refined = baked.mesh()
    found = np.array(refined.GetVelocitiesAttr().Get())
    assert found == pytest.approx(linear(refined.GetPointsAttr().Get()), abs=1e-5)


def test_animated_meshes_are_refined_as_they_were_when_read(tmp_path):
    stage = new_stage(tmp_path)
    stage.SetStartTimeCode(TIME)
    stage.SetEndTimeCode(TIME + 10)
    mesh = add_mesh(stage, "/World/Mesh")
    primvar = add_primvar(mesh, "heat", "FloatArray", "vertex", [0.0] * 8)
    faces = add_primvar(mesh, "number", "IntArray", "uniform", [0] * 4)
    for frame in (TIME, TIME + 1):
        later = np.array(POINTS) + (frame - TIME)
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(later.astype(np.float32)), frame)
        primvar.Set(linear(POINTS)[:, 0] + (frame - TIME), frame)
        faces.Set([int(frame)] * (4 if frame == TIME else 3), frame)
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    for frame in (Usd.TimeCode.Default(), TIME, TIME + 1):
        points = np.array(baked.mesh().GetPointsAttr().Get(frame))
        assert np.array_equal(points[:8], np.array(POINTS, np.float32))
        found = np.array(UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("heat").Get(frame))
        assert found == pytest.approx(linear(points)[:, 0], abs=1e-5)


def test_materials_stay_bound_to_the_parts_of_their_faces(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    for name, faces in (("Wood", [0, 2]), ("Steel", [1]), ("Glass", [3])):
        material = UsdShade.Material.Define(stage, f"/World/{name}")
        subset = UsdShade.MaterialBindingAPI(mesh).CreateMaterialBindSubset(name, faces)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    binding = UsdShade.MaterialBindingAPI(mesh)
    binding.SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)
    UsdGeom.Subset.CreateGeomSubset(mesh, "Corner", "point", [0, 7])
    baked = bake(stage, *SOME)
    assert assert_readable(baked.stage) == 1
    refined = baked.mesh()
    parents = np.array(UsdGeom.PrimvarsAPI(refined).GetPrimvar("isolux:sourceFace").Get())
    bound = {}
    for subset in UsdShade.MaterialBindingAPI(refined).GetMaterialBindSubsets():
        material, _ = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()
        bound[material.GetPrim().GetName()] = set(parents[list(subset.GetIndicesAttr().Get())])
    # A partition, as was validated: then no part of another face is among them.
    assert bound == {"Wood": {0, 2}, "Steel": {1}, "Glass": {3}}
    family = UsdShade.MaterialBindingAPI(refined).GetMaterialBindSubsetsFamilyType()
    assert family == UsdGeom.Tokens.partition
    corner = UsdGeom.Subset(baked.stage.GetPrimAtPath("/World/Mesh/Corner"))
    assert {0, 7} <= set(corner.GetIndicesAttr().Get())


def test_holes_stay_open_and_creases_of_subdivision_go(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", subdivisionScheme="catmullClark")
    mesh.CreateHoleIndicesAttr([1])
    mesh.CreateCreaseIndicesAttr([1, 2])
    mesh.CreateCreaseLengthsAttr([2])
    mesh.CreateCreaseSharpnessesAttr([3.0])
    mesh.CreateCornerIndicesAttr([0])
    mesh.CreateCornerSharpnessesAttr([10.0])
    baked = bake(stage, *SOME)
    refined = baked.mesh()
    parents = UsdGeom.PrimvarsAPI(refined).GetPrimvar("isolux:sourceFace").Get()
    assert set(parents) == {0, 2, 3}
    for name in ("holeIndices", "creaseIndices", "creaseLengths", "cornerIndices"):
        assert refined.GetPrim().GetAttribute(name).Get() is None


def test_a_mesh_without_a_split_keeps_its_faces(tmp_path):
    stage = new_stage(tmp_path)
    add_mesh(stage, "/World/Mesh")
    add_mesh(stage, "/World/Other", np.array(POINTS) + np.array([9, 0, 0]))
    first_edges = {"choose": lambda count: np.arange(count) == 0}  # between the first points
    baked = bake(stage, first_edges)
    assert assert_readable(baked.stage) == 2
    assert len(baked.mesh("/World/Other").GetFaceVertexCountsAttr().Get()) == len(FACES)
    assert len(baked.mesh().GetPointsAttr().Get()) == len(POINTS) + 1


@pytest.mark.parametrize("double_sided", [False, True], ids=["one-sided", "double-sided"])
def test_all_stages_share_the_last_topology_and_stay_the_same_functions(tmp_path, double_sided):
    """Coarse, refined, refined further, and one more that comes without the refined mesh."""
    stage = new_stage(tmp_path)
    add_mesh(stage, "/World/Mesh", doubleSided=double_sided)
    baked = bake(stage, *SOME, None, coarse_stages=2)
    assert assert_readable(baked.stage) == 1
    refined, mesh, layout = baked.mesh(), baked.scene.meshes[0], baked.layouts["/World/Mesh"]
    places = points_at_corners(refined).astype(float)
    parents = values_at_corners(refined, "isolux:sourceFace")
    weights, corners = barycentrics(places, parents, mesh)
    for time, solution in enumerate(baked.solutions, start=1):
        total = (solution.direct + solution.indirect)[: baked.split.mesh.vertex_count]
        for name, side in (("illuminance", layout.front), ("backIlluminance", layout.back)):
            if name == "backIlluminance" and not double_sided:
                assert not UsdGeom.PrimvarsAPI(refined).GetPrimvar(f"isolux:{name}").HasValue()
                continue
            found = values_at_corners(refined, f"isolux:{name}", time)
            expected = np.einsum(
                "nk,nkc->nc", weights, total[side][layout.corner_vertices[corners]]
            )
            assert found == pytest.approx(expected, rel=1e-4)


def barycentrics(places, faces, mesh):
    """Weights (n, 3) of places on faces of a mesh, and the face corners (n, 3) that they weigh."""
    triangles, of_face = triangulate(
        mesh.points,
        mesh.face_vertex_counts,
        mesh.face_vertex_indices,
        mesh.hole_faces,
        mesh.flip_winding,
    )
    ends = mesh.points[mesh.face_vertex_indices[triangles]]  # (T, 3, 3)
    systems = np.concatenate([ends.transpose(0, 2, 1), np.ones((len(ends), 1, 3))], axis=1)
    one = np.ones((len(places), 1))
    weights = np.einsum("tkr,nr->ntk", np.linalg.pinv(systems), np.append(places, one, axis=1))
    # Within the triangle where the smallest weight is largest, of those of the face itself.
    depth = np.where(of_face == faces[:, None], weights.min(axis=2), -np.inf)
    triangle = depth.argmax(axis=1)
    assert depth.max(axis=1).min() > -1e-5
    return weights[np.arange(len(places)), triangle], triangles[triangle]


def test_a_mesh_that_references_a_refined_one_keeps_its_own_faces(tmp_path):
    """The results' opinions about /World/Room/Mesh reach what references it within the stage."""
    asset = new_stage(tmp_path, "asset.usda")
    mesh = add_mesh(asset, "/World/Mesh")
    add_primvar(mesh, "place", "Float3Array", "vertex", [tuple(r) for r in linear(POINTS).tolist()])
    UsdGeom.Subset.CreateGeomSubset(mesh, "Front", "face", [0, 1])
    asset.Save()
    stage = new_stage(tmp_path)
    room = stage.DefinePrim("/World/Room", "Xform")
    room.GetReferences().AddReference("./asset.usda")
    twin = UsdGeom.Xform.Define(stage, "/World/Twin")
    twin.GetPrim().GetReferences().AddInternalReference("/World/Room")
    twin.AddTranslateOp().Set((20.0, 0.0, 0.0))
    alone = add_mesh(stage, "/World/Alone", np.array(POINTS) + np.array([0, 20, 0]))
    assert alone
    first_edges = {"choose": lambda count: np.arange(count) < 3}
    baked = bake(stage, first_edges)
    assert assert_readable(baked.stage) == 3
    room, twin, alone = (
        baked.mesh(f"/World/{name}") for name in ("Room/Mesh", "Twin/Mesh", "Alone")
    )
    assert len(room.GetPointsAttr().Get()) == len(POINTS) + 3
    assert len(twin.GetPointsAttr().Get()) == len(POINTS)
    assert len(alone.GetFaceVertexCountsAttr().Get()) == len(FACES)
    for shown in (room, twin):
        found = values_at_corners(shown, "place")
        assert found == pytest.approx(linear(points_at_corners(shown)), abs=1e-5)
    solution = baked.solutions[-1]
    total = solution.direct + solution.indirect
    vertices = baked.split.mesh.elements[np.isin(baked.split.mesh.element_parents, range(7, 14))]
    layout = baked.layouts["/World/Twin/Mesh"]
    assert layout.front.start <= vertices.min() <= vertices.max() < layout.front.stop
    found = values_at_corners(twin, "isolux:illuminance", 2)
    assert np.array_equal(found, total[vertices.ravel()])


def add_camera(stage, target, place):
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*place), Gf.Vec3d(*target), Gf.Vec3d(0, 0, 1))
    camera.AddTransformOp().Set(look.GetInverse())


COLOURS = [(0.8, 0.1, 0.1), (0.2, 0.7, 0.2), (0.1, 0.1, 0.9), (0.5, 0.5, 0.5)]


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("side", ["front", "back"])
def test_the_same_light_makes_the_same_picture_on_a_finer_mesh(tmp_path, orientation, side):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", orientation=orientation, doubleSided=True)
    add_primvar(mesh, "displayColor", "Color3fArray", "uniform", COLOURS)
    add_camera(stage, (2, 1.5, 0.5), (2, 1, 12 if side == "front" else -12))
    coarse = bake(stage, None, name="coarse")
    before = render_picture(coarse.stage, time=1, width=64)
    baked = bake(stage, *SOME)
    after = render_picture(baked.stage, time=1, width=64)
    assert len(baked.mesh().GetPointsAttr().Get()) > len(POINTS)
    assert after.coverage.mean() == before.coverage.mean() > 0.1
    assert after.rgb == pytest.approx(before.rgb, rel=1e-4, abs=1e-4)


def test_each_part_has_the_display_colour_of_its_face(tmp_path):
    """At the authored points nothing changes, between faces of unlike colours as well."""
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", doubleSided=True)
    add_primvar(mesh, "displayColor", "Color3fArray", "uniform", COLOURS)
    coarse, baked = bake(stage, None, name="coarse"), bake(stage, *SOME)
    shown = []
    for result in (coarse, baked):
        mesh = result.mesh()
        faces = np.repeat(range(4), [len(face) for face in FACES])
        if result is baked:
            faces = values_at_corners(mesh, "isolux:sourceFace")
        places = zip(faces, mesh.GetFaceVertexIndicesAttr().Get(), strict=True)
        colours = values_at_corners(mesh, "displayColor").tolist()
        shown.append({place: c for place, c in zip(places, colours, strict=True) if place[1] < 8})
    assert shown[0] == shown[1]


def test_a_shadow_finer_than_the_mesh_shows_in_the_picture(tmp_path):
    """A quad of 2 m, lit for x <= 1: the vertices at its corners alone know of no such edge."""
    stage = new_stage(tmp_path)
    points = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)])
    mesh = add_mesh(stage, "/World/Mesh", points, [[0, 1, 2, 3]])
    mesh.CreateDisplayColorAttr([(0.5, 0.5, 0.5)])
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(20.0)  # tenths of a metre
    camera.CreateVerticalApertureAttr(20.0)
    camera.AddTranslateOp().Set((1.0, 1.0, 5.0))
    baked = bake(stage, None)
    for _ in range(4):
        refined = baked.split.split(every_edge)
    layout = baked.layouts["/World/Mesh"]
    places = np.zeros((4, 3))
    places[layout.corner_vertices] = points
    lit = (refined.interpolate(places)[:, 0] <= 1.0).astype(np.float32)
    light = np.repeat(1000 * lit[:, None], 3, axis=1)
    solution = replace(
        baked.solutions[0],
        direct=light,
        indirect=0 * light,
        relative_deviation=lit,
        refined=refined,
        layouts=baked.layouts,
    )
    writer = ResultsWriter(stage, tmp_path / "shadow.usda", baked.scene, {})
    writer.write(solution)
    picture = render_picture(Usd.Stage.Open(str(tmp_path / "shadow.usda")), width=32, samples=1)
    # Cells of 2 m / 16 are two pixels wide: the light falls off within one of them.
    assert picture.rgb[:, :16] == pytest.approx(500 / np.pi, rel=1e-5)
    assert (picture.rgb[:, 18:] == 0).all()


def test_a_stage_that_changed_after_the_bake_is_named(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    add_primvar(mesh, "displayColor", "Color3fArray", "uniform", COLOURS)
    baked = bake(stage, *SOME)
    mesh.GetFaceVertexCountsAttr().Set([5])
    mesh.GetFaceVertexIndicesAttr().Set(FACES[0])
    UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Set(COLOURS[:1])
    stage.GetRootLayer().Save()
    with pytest.raises(SceneError, match="/World/Mesh: found a refinement of face 3"):
        render_picture(baked.stage, width=8)


def test_refined_results_pass_every_validator_of_usd(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", doubleSided=True)
    material = UsdShade.Material.Define(stage, "/World/Wood")
    subset = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).CreateMaterialBindSubset(
        "Wood", [0, 2]
    )
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(material)
    mesh.CreateNormalsAttr([(0, 0, 1)] * 8)
    backwards = [point for face in FACES for point in face]
    add_primvar(mesh, "st", "TexCoord2fArray", "faceVarying", [p[:2] for p in POINTS], backwards)
    baked = bake(stage, *SOME)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(baked.stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []
