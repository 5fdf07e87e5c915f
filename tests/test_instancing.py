"""An instanced stage is lit as the same stage with every copy written out by hand.

The hand-written stage names its copies as the results do, so that prims pair up by path.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade

import isolux
from instanced_stages import (
    BULB,
    COS,
    LEAN,
    PLACES,
    SETTINGS,
    SHADE,
    SIN,
    SMALL_LAMP,
    SPREAD,
    WEDGE,
    assert_lit_as_by_hand,
    baked,
    by_hand,
    instance,
    instancer,
    matrix,
    prim,
    shown_meshes,
    world_points,
)
from isolux.baked_prims import BakedPrims
from isolux.render import render_picture
from isolux.results import ResultsWriter
from small_room import FLOOR, WALLS
from usda_stage import METRES, open_usda, read_usda

# The stage instanced; the same by hand. All below /World; prototypes beside it.
INSTANCES = (
    prim("Model", WEDGE + SHADE, kind="class Xform"),
    "".join(instance(f"I{i}", "/Model", place) for i, place in enumerate(PLACES)),
    "".join(prim(f"I{i}", WEDGE + SHADE, place) for i, place in enumerate(PLACES)),
)
NESTED_INSTANCES = (
    prim("Part", WEDGE + BULB, kind="class Xform")
    + prim("Model", SHADE + instance("P0", "/Part", LEAN), kind="class Xform"),
    "".join(instance(f"I{i}", "/Model", place) for i, place in enumerate(PLACES)),
    "".join(
        prim(f"I{i}", SHADE + prim("P0", WEDGE + BULB, LEAN), place)
        for i, place in enumerate(PLACES)
    ),
)
# Six instances: one masked by id, one by inactiveIds, one mirrored. All numbers are exact in
# single precision, in which an instancer stores them.
POINTS = f"""
    rel prototypes = [</World/Field/Protos/A>, </World/Field/B>]
    int[] protoIndices = [0, 1, 0, 1, 0, 1]
    int64[] ids = [10, 11, 12, 13, 14, 15]
    int64[] invisibleIds = [11]
    point3f[] positions = [(-1.5, -1.5, 0), (0, 0, 0), (1, 1, 0), (0.5, -1.25, 0), (9, 9, 9),
                           (-1, 1, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), ({COS}, 0, 0, {SIN}), (1, 0, 0, 0),
                            (1, 0, 0, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 2, 1), (-1, 1, 0.5), (1, 1, 1), (1, 1, 1)]
    vector3f[] velocities = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]
"""
HALF_TURN = Gf.Matrix4d().SetRotate(Gf.Quatd(Gf.Quath(COS, 0, 0, SIN)))  # as it is stored
POINT_INSTANCER = (
    "",
    prim(
        "Field",
        POINTS + prim("Protos", prim("A", WEDGE, LEAN), PLACES[1]) + prim("B", SHADE + BULB),
        SPREAD,
        kind="def PointInstancer",
        metadata="inactiveIds = [14]",
    ),
    prim(
        "Field",
        prim("Copy0", WEDGE, LEAN * matrix(move=(-1.5, -1.5, 0)))
        + prim(
            "Copy2",
            WEDGE,
            LEAN * matrix(scale=(1, 2, 1)) * HALF_TURN * matrix(move=(1, 1, 0)),
        )
        + prim("Copy3", SHADE + BULB, matrix(scale=(-1, 1, 0.5), move=(0.5, -1.25, 0)))
        + prim("Copy5", SHADE + BULB, matrix(move=(-1, 1, 0))),
        SPREAD,
    ),
)


INNER, OUTER = [(-0.5, 0, 0), (0.5, 0, 0.125)], [(-1, -1, 0), (1, 0.5, 0)]


NESTED_INSTANCERS = (
    "",
    instancer(
        "Outer", "/World/Outer/Group", OUTER,
        prim(
            "Group",
            SHADE + instancer("Inner", "/World/Outer/Group/Inner/Leaf", INNER, prim("Leaf", WEDGE)),
            LEAN,
        ),
    ),
    prim("Outer", by_hand(SHADE + prim("Inner", by_hand(WEDGE, INNER)), OUTER, LEAN)),
)  # fmt: skip
# The prototype of an instancer is an instancer.
INSTANCER_OF_INSTANCER = (
    instancer("Inner", "/Leaf", INNER, "", SPREAD) + prim("Leaf", WEDGE, LEAN, kind="over"),
    instancer("Outer", "/Inner", OUTER),
    prim("Outer", by_hand(by_hand(WEDGE, INNER), OUTER, SPREAD)),
)
# An instance of a model with an instancer whose prototypes are instances.
EVERYTHING_IN_EVERYTHING = (
    prim("Part", WEDGE + BULB, kind="class Xform")
    + prim(
        "Model",
        SHADE + instancer("Rows", "/Model/Rows/P", INNER, instance("P", "/Part", LEAN), SPREAD),
        kind="class Xform",
    ),
    "".join(instance(f"I{i}", "/Model", place) for i, place in enumerate(PLACES[:2])),
    "".join(
        prim(f"I{i}", SHADE + prim("Rows", by_hand(WEDGE + BULB, INNER, LEAN), SPREAD), place)
        for i, place in enumerate(PLACES[:2])
    ),
)
CASES = {
    "instances": INSTANCES,
    "instances in instances": NESTED_INSTANCES,
    "point instancer": POINT_INSTANCER,
    "point instancer in a prototype": NESTED_INSTANCERS,
    "point instancer as a prototype": INSTANCER_OF_INSTANCER,
    "instances in point instancers in instances": EVERYTHING_IN_EVERYTHING,
}


@pytest.mark.parametrize("case", CASES)
def test_instances_are_lit_as_their_copies_by_hand(tmp_path: Path, case: str) -> None:
    assert_lit_as_by_hand(tmp_path, *CASES[case])


def test_an_instancers_matrices_are_those_that_usd_computes() -> None:
    stage = open_usda(
        prim(
            "Field",
            POINTS.replace("/World", "") + prim("Protos", prim("A", WEDGE)) + prim("B", SHADE),
            kind="def PointInstancer",
            metadata="inactiveIds = [14]",
        )
    )
    half_precision = UsdGeom.PointInstancer(stage.GetPrimAtPath("/Field"))
    rng = np.random.default_rng(7)
    quaternions = [Gf.Quath(*map(float, q)) for q in rng.normal(size=(6, 4))]  # of any length
    half_precision.CreateOrientationsAttr(quaternions)
    for full_precision in (False, True):
        if full_precision:
            finer = [Gf.Quatf(*map(float, q)) for q in rng.uniform(-0.5, 0.5, (6, 4))]
            half_precision.CreateOrientationsfAttr(finer)
        [item] = isolux.read_stage(stage).instanced
        assert item.copies is not None
        time = Usd.TimeCode.Default()
        expected = half_precision.ComputeInstanceTransformsAtTime(time, time)
        assert item.copies.numbers.tolist() == [0, 2, 3, 5]
        assert item.copies.matrices == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_copies_share_what_does_not_move(case: str) -> None:
    prototypes, instanced, _ = CASES[case]
    scene = read_usda(prototypes + prim("World", instanced))
    meshes = {mesh.path: mesh for mesh in scene.meshes}
    copies = [mesh for mesh in scene.meshes if mesh.copy_of is not None]
    assert len(meshes) - len(copies) == len({path.split("/")[-1] for path in meshes})
    for mesh in copies:
        assert mesh.copy_of is not None
        first, to_copy = meshes[mesh.copy_of.path], mesh.copy_of.matrix
        assert first.copy_of is None and list(meshes).index(first.path) < list(meshes).index(
            mesh.path
        )
        assert mesh.face_vertex_indices is first.face_vertex_indices
        assert mesh.reflectance is first.reflectance
        moved = first.points @ to_copy[:3, :3] + to_copy[3, :3]
        assert mesh.points == pytest.approx(moved, abs=1e-12)


def test_instances_keep_what_reaches_them_from_above() -> None:
    """A colour on the instance itself: two prototypes' worth of reflectance, one of points."""
    bare = WEDGE.replace("color3f[] primvars:displayColor = [(0.7, 0.4, 0.2)]", "")
    colours = [(0.1, 0.2, 0.3), (0.6, 0.5, 0.4), (0.1, 0.2, 0.3)]
    scene = read_usda(
        prim("Model", bare, kind="class Xform")
        + "".join(
            prim(f"I{i}", f"color3f[] primvars:displayColor = [{colour}]\n", PLACES[i],
                 metadata="instanceable = true\n prepend references = </Model>")
            for i, colour in enumerate(colours)
        )
    )  # fmt: skip
    found_colours = [tuple(mesh.reflectance[0]) for mesh in scene.meshes]
    assert found_colours == [pytest.approx(colour) for colour in colours]
    assert [mesh.copy_of is None for mesh in scene.meshes] == [True, True, False]


@pytest.mark.parametrize("case", CASES)
def test_a_summary_is_the_mean_over_each_outermost_instance(tmp_path: Path, case: str) -> None:
    prototypes, instanced, _ = CASES[case]
    stage, scene = baked(tmp_path, "summed", prototypes, instanced, "summary")
    solution = list(isolux.ProgressiveSolver(scene, SETTINGS).stages())[-1]
    sums: dict[tuple[str, int], list[float]] = {}
    in_world = [mesh for mesh in scene.meshes if mesh.path.startswith("/World/")]
    for mesh in in_world:
        front = solution.layout(mesh.path).front
        parts = mesh.path.split("/")  # /World/I0/..., /World/Field/Copy3/...
        owner = stage.GetPrimAtPath("/".join(parts[:3]))
        if owner.IsA(UsdGeom.Mesh):
            continue
        number = -1 if owner.IsInstance() else int(parts[3].removeprefix("Copy"))
        area = float(solution.vertex_areas[front].sum())
        total = sums.setdefault((str(owner.GetPath()), number), [0.0, 0.0])
        total[0] += solution.mean_illuminance(mesh.path) * area
        total[1] += area
    assert sums
    weights = np.array([0.2126, 0.7152, 0.0722])
    for (owner, number), (total, area) in sums.items():
        primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(owner)).GetPrimvar("isolux:illuminance")
        values = np.array(primvar.Get(3.0), float) @ weights
        assert values[max(number, 0)] == pytest.approx(total / area, rel=1e-5)
        assert primvar.GetInterpolation() == ("constant" if number < 0 else "vertex")
        if number >= 0:
            instancer_prim = UsdGeom.PointInstancer(stage.GetPrimAtPath(owner))
            assert len(values) == len(instancer_prim.GetProtoIndicesAttr().Get())
            drawn = [n for path, n in sums if path == owner]
            assert not np.delete(values, drawn).any()


@pytest.mark.parametrize("instances", ["expand", "summary"])
def test_a_picture_of_the_results_shows_the_instances(tmp_path: Path, instances: str) -> None:
    """From where a camera sees nothing but the wedges and shades of nested instances."""
    prototypes, instanced, _ = EVERYTHING_IN_EVERYTHING
    stage, scene = baked(tmp_path, "seen", prototypes, instanced, instances)
    picture = render_picture(stage, width=64, samples=1)
    assert picture.time == 3.0
    without = [mesh for mesh in scene.meshes if mesh.path in ("/World/Floor", "/World/Walls")]
    for mesh in scene.meshes:
        found_values = BakedPrims(stage, scene).values(mesh.path, "isolux:illuminance", 3.0)
        assert found_values is not None
        values, interpolation = found_values
        assert np.isfinite(values).all() and values.max() > 0
        kept = instances == "summary" and mesh not in without
        assert (interpolation == "constant") == kept


@pytest.mark.parametrize("case", CASES)
def test_a_stage_in_memory_is_expanded_in_its_flattened_copy(tmp_path: Path, case: str) -> None:
    prototypes, instanced, _ = CASES[case]
    stage = open_usda(prototypes + prim("World", FLOOR + WALLS + SMALL_LAMP + instanced))
    scene = isolux.read_stage(stage)
    writer = ResultsWriter(stage, tmp_path / "out.usda", scene, {})
    for solution in isolux.ProgressiveSolver(scene, SETTINGS).stages():
        writer.write(solution)
    results = Usd.Stage.Open(str(tmp_path / "out.usda"))
    meshes = shown_meshes(results)
    assert meshes.keys() == {mesh.path for mesh in scene.meshes}
    for mesh in scene.meshes:
        points = world_points(meshes[mesh.path])
        assert points == pytest.approx(mesh.points, abs=1e-6)
        assert meshes[mesh.path].GetPrim().HasAttribute("primvars:isolux:illuminance")


def test_a_copy_keeps_what_its_prototype_inherits(tmp_path: Path) -> None:
    """A material bound, and a colour authored, above the prototype and beside the instancer."""
    material = """def Material "Red" {
        token outputs:surface.connect = </Looks/Red/S.outputs:surface>
        def Shader "S" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.5, 0.1, 0.1)
            token outputs:surface
        }
    }
    """
    bare = WEDGE.replace("color3f[] primvars:displayColor = [(0.7, 0.4, 0.2)]", "")
    library = prim("Looks", material, kind="def Scope") + prim(
        "Library",
        """rel material:binding = </Looks/Red>
        color3f[] primvars:displayColor = [(0.1, 0.2, 0.3)]\n"""
        + prim("Leaf", bare),
        kind="over",
        metadata='prepend apiSchemas = ["MaterialBindingAPI"]',
    )
    stage, scene = baked(tmp_path, "inherited", library, instancer("Field", "/Library/Leaf", INNER))
    copies = [mesh for mesh in scene.meshes if mesh.path.startswith("/World/Field")]
    assert [mesh.path for mesh in copies] == [f"/World/Field/Copy{i}/Wedge" for i in (0, 1)]
    for mesh in copies:
        assert mesh.reflectance[0] == pytest.approx((0.5, 0.1, 0.1))
        shown = stage.GetPrimAtPath(mesh.path)
        bound, _ = UsdShade.MaterialBindingAPI(shown).ComputeBoundMaterial()
        assert bound.GetPath() == "/Looks/Red"
        copy = UsdGeom.PrimvarsAPI(shown.GetParent()).GetPrimvar("displayColor")
        assert np.array(copy.Get()) == pytest.approx(np.array([(0.1, 0.2, 0.3)]))


@pytest.mark.parametrize("case", CASES)
def test_each_copy_gets_a_refined_mesh_of_its_own(tmp_path: Path, case: str) -> None:
    prototypes, instanced, _ = CASES[case]
    source = tmp_path / "refined.usda"
    world = prim("World", FLOOR + WALLS + SMALL_LAMP + instanced)
    source.write_text(f"#usda 1.0\n{METRES}{prototypes}{world}", encoding="utf-8")
    stage = Usd.Stage.Open(str(source))
    scene = isolux.read_stage(stage)
    settings = replace(
        SETTINGS, output_mode="refined", subdivision_iterations=2, subdivision_threshold=0.004
    )
    writer = ResultsWriter(stage, tmp_path / "out.usda", scene, {})
    solutions = list(isolux.ProgressiveSolver(scene, settings).stages())
    for solution in solutions:
        writer.write(solution)
    refined = solutions[-1].refined
    assert refined is not None
    results = Usd.Stage.Open(str(tmp_path / "out.usda"))
    meshes = shown_meshes(results)
    assert meshes.keys() == {mesh.path for mesh in scene.meshes}
    split = []
    for mesh in scene.meshes:
        shown = meshes[mesh.path]
        counts = np.array(shown.GetFaceVertexCountsAttr().Get())
        if len(counts) > 2 * len(mesh.face_vertex_counts):
            split.append(mesh.path)
        primvar = UsdGeom.PrimvarsAPI(shown).GetPrimvar("isolux:illuminance")
        wanted = {"vertex": len(shown.GetPointsAttr().Get()), "faceVarying": counts.sum()}
        assert len(primvar.ComputeFlattened(3.0)) == wanted[primvar.GetInterpolation()]
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        points = world_points(shown)
        assert points.min(axis=0) == pytest.approx(low, abs=1e-6)
        assert points.max(axis=0) == pytest.approx(high, abs=1e-6)
    assert {"/World/Floor", "/World/Walls"} < set(split)


REAL = (
    "Autodesk+arnold-usd/testsuite/test_0206/data/scene.usda",
    "PixarAnimationStudios+OpenUSD/pxr/usdImaging/usdImagingGL/testenv/"
    "testUsdImagingGLPointInstancer/pi_pi_xform.usda",
    "PixarAnimationStudios+OpenUSD/pxr/usd/usdLux/testenv/testUsdLuxLightListAPI/"
    "root_with_instances.usda",
)


@pytest.mark.parametrize("instances", ["expand", "summary"])
@pytest.mark.parametrize("path", REAL)
def test_a_real_stage_lit_in_memory_is_baked(
    tmp_path: Path, inputs: Path, path: str, instances: str
) -> None:
    source = inputs / "usd" / path
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths = [str(source)]
    up = UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(source)))
    UsdGeom.SetStageUpAxis(stage, up)
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), ["default", "render"])
    box = bounds.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    lamp = UsdLux.SphereLight.Define(stage, "/IsoluxLamp")
    lamp.CreateRadiusAttr(0.05 * box.GetSize().GetLength())
    lamp.AddTranslateOp().Set(box.GetMax() + 0.2 * box.GetSize())
    scene = isolux.read_stage(stage)
    writer = ResultsWriter(stage, tmp_path / "out.usda", scene, {}, instances=instances)
    settings = replace(SETTINGS, method="dept", photons=20_000, stages=2)
    for solution in isolux.ProgressiveSolver(scene, settings).stages():
        writer.write(solution)
    results = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert not results.GetCompositionErrors()
    found_light = BakedPrims(results, scene)
    for mesh in scene.meshes:
        values = found_light.values(mesh.path, "isolux:illuminance", 2.0)
        assert values is not None and np.isfinite(values[0]).all()
        if instances == "expand":
            shown = UsdGeom.Mesh(results.GetPrimAtPath(mesh.path))
            to_world = np.array(UsdGeom.Imageable(shown).ComputeLocalToWorldTransform(0.0))
            points = np.array(shown.GetPointsAttr().Get(Usd.TimeCode.EarliestTime()), float)
            points = (points @ to_world[:3, :3] + to_world[3, :3]) * scene.meters_per_unit
            wanted = {
                "vertex": len(points),
                "faceVarying": len(
                    shown.GetFaceVertexIndicesAttr().Get(Usd.TimeCode.EarliestTime())
                ),
            }
            assert len(values[0]) == wanted[values[1]]
            if mesh.cage is not None:  # the prim keeps its cage, whose limit was solved
                assert shown.GetSubdivisionSchemeAttr().Get() == mesh.cage.scheme
                points = mesh.cage.refine().limit_points(points)
            assert points == pytest.approx(mesh.points, rel=1e-6, abs=1e-5)
