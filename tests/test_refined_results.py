"""Refined results: shadows finer than the mesh, and nothing else of the stage changed by them."""

from dataclasses import replace

import numpy as np
import pytest
from isolux._core import triangulate
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdValidation

from isolux.errors import SceneError
from isolux.render import render_picture
from isolux.results import ResultsWriter
from refined_bakes import (
    ALL_TWICE,
    FACES,
    POINTS,
    SOME,
    add_mesh,
    add_primvar,
    area_vectors,
    assert_readable,
    bake,
    linear,
    new_stage,
    points_at_corners,
    values_at_corners,
)
from split_edges import every_edge

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
