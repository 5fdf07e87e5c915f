"""Instances of what is no plain mesh: lit as the same stage with every copy written out by hand."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade
from typer.testing import CliRunner

import isolux
from cages import CUBE_FACES, CUBE_POINTS, mesh_usda
from instanced_stages import (
    LEAN,
    PLACES,
    SETTINGS,
    SHADE,
    SMALL_LAMP,
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
from isolux.cage_fit import BOUNDED_ACCURACY
from isolux.cage_results import CageFits, CageOutput
from isolux.cli import app
from isolux.preview_layer import write_preview
from isolux.scene_description import SceneDescription
from small_room import FLOOR, WALLS
from usda_stage import INFLUENCES, METRES, read_usda

MOVED = """double3 xformOp:translate = (0.2, 0.1, 0.8)
    uniform token[] xformOpOrder = ["xformOp:translate"]
"""
BALL = f'def Sphere "Ball" {{\ndouble radius = 0.15\n{MOVED}}}\n'
BOX = f"""def Cube "Box" {{
    double size = 0.3
    color3f[] primvars:displayColor = [(0.7, 0.4, 0.2)]
    {MOVED}}}
"""
CAGE = mesh_usda(0.2 * CUBE_POINTS * (1, 1.5, 1), CUBE_FACES, MOVED)
# Bent by 90 degrees at the elbow; its own transform has no part in the pose.
ARM = """def SkelRoot "Root" {
    float3 xformOp:rotateXYZ = (0, 0, 30)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    def Skeleton "Skeleton" ( prepend apiSchemas = ["SkelBindingAPI"] ) {
        uniform token[] joints = ["Arm", "Arm/Elbow"]
        uniform matrix4d[] bindTransforms = [
            ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0.2,0,0,1))]
        uniform matrix4d[] restTransforms = [
            ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0.2,0,0,1))]
        rel skel:animationSource = <Bend>
        double3 xformOp:translate = (0.1, 0, 0.9)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def SkelAnimation "Bend" {
            uniform token[] joints = ["Arm", "Arm/Elbow"]
            float3[] translations = [(0, 0, 0), (0.2, 0, 0)]
            half3[] scales = [(1, 1, 1), (1, 1, 1)]
            quatf[] rotations = [(1, 0, 0, 0), (0.70710678, 0, 0.70710678, 0)]
        }
    }
    def Mesh "Arm" ( prepend apiSchemas = ["SkelBindingAPI"] ) {
        rel skel:skeleton = <../Skeleton>
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
        point3f[] points = [(0,0,0), (0.2,0,0), (0.4,0,0), (0,0.1,0), (0.2,0.1,0), (0.4,0.1,0)]
        uniform token subdivisionScheme = "none"
        uniform bool doubleSided = 1
        double3 xformOp:translate = (7, 7, 7)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    <influences>
    }
}
""".replace("<influences>", INFLUENCES)
SMOOTH_ARM = ARM.replace('"none"', '"catmullClark"')
GLOWING = """def Mesh "Glowing" ( prepend apiSchemas = ["MeshLightAPI"] ) {
    float inputs:intensity = 40
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(-0.2, -0.2, 1.2), (0.3, -0.2, 1.25), (0, 0.3, 1.3)]
    uniform token subdivisionScheme = "none"
}
"""
GLASS = WEDGE.replace("color3f[]", "float[] primvars:displayOpacity = [0.4]\ncolor3f[]")
MOVES = [(-1, -1, 0), (1, 0.5, 0)]


def bulb_for(path: str) -> str:
    """A light that lights one prim alone."""
    return f"""def SphereLight "Bulb" ( prepend apiSchemas = ["CollectionAPI:lightLink"] ) {{
        uniform bool collection:lightLink:includeRoot = 0
        rel collection:lightLink:includes = <{path}>
        float inputs:intensity = 50
        bool inputs:normalize = true
        float inputs:radius = 1e-6
        double3 xformOp:translate = (0, 0, 1.6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    """


def as_instances(contents: str) -> tuple[str, str, str]:
    """Prototypes; instances of one with these contents; the same by hand."""
    return (
        prim("Model", contents, kind="class Xform"),
        "".join(instance(f"I{i}", "/Model", place) for i, place in enumerate(PLACES)),
        "".join(prim(f"I{i}", contents, place) for i, place in enumerate(PLACES)),
    )


def as_points(contents: str) -> tuple[str, str, str]:
    """The same of a point instancer whose prototype holds these."""
    return (
        prim("Group", contents, LEAN, kind="class Xform"),
        instancer("Field", "/Group", MOVES),
        prim("Field", by_hand(contents, MOVES, LEAN)),
    )


def as_prototype(gprim: str) -> tuple[str, str, str]:
    """The same of a point instancer whose prototype is this very prim, named Box."""
    copies = "".join(
        gprim.replace('"Box"', f'"Copy{i}"').replace(
            MOVED, f"matrix4d xformOp:transform = {matrix(move=(0.2, 0.1, 0.8)) * matrix(move=m)}\n"
            'uniform token[] xformOpOrder = ["xformOp:transform"]\n'
        )
        for i, m in enumerate(MOVES)
    )  # fmt: skip
    return (gprim, instancer("Field", "/Box", MOVES), prim("Field", copies))


# The skeleton beside the instances: what it poses stands where it does.
ROOT, POSED = ARM.split('    def Mesh "Arm"')
ROOT = ROOT.replace(
    'def SkelRoot "Root" {\n',
    """def SkelRoot "Root" ( prepend apiSchemas = ["SkelBindingAPI"] ) {
    rel skel:skeleton = </World/Root/Skeleton>\n""",
)
POSED = 'def Mesh "Arm"' + POSED.replace("rel skel:skeleton = <../Skeleton>", "")
POSED = POSED.rstrip().removesuffix("}")

FEATURES = {
    "linked lights in instances": as_instances(WEDGE + SHADE + bulb_for("../Wedge")),
    "linked lights in point instances": as_points(WEDGE + SHADE + bulb_for("../Wedge")),
    "a light linked to one instance": tuple(
        part + (bulb_for("/World/I1/Wedge") if part and i else "")
        for i, part in enumerate(as_instances(WEDGE + SHADE))
    ),
    "shapes in instances": as_instances(BALL + BOX + WEDGE),
    "shapes in point instances": as_points(BALL + BOX + WEDGE),
    "a shape as the prototype": as_prototype(BOX),
    "cages in instances": as_instances(CAGE),
    "cages in point instances": as_points(CAGE),
    "mesh lights in instances": as_instances(GLOWING + WEDGE),
    "mesh lights in point instances": as_points(GLOWING + WEDGE),
    "what light goes through, in instances": as_instances(GLASS),
    "what light goes through, in point instances": as_points(GLASS),
    "skinned meshes in instances, the skeleton beside them": tuple(
        part if i == 0 else ROOT + part + "}\n" for i, part in enumerate(as_instances(POSED))
    ),
    "skinned meshes in instances": as_instances(ARM),
    "skinned meshes in point instances": as_points(ARM),
}


def assert_same_description(scene: SceneDescription, other: SceneDescription) -> None:
    """What the solver sees of two stages is the same, but for rounding."""
    pairs = [*zip(scene.meshes, other.meshes, strict=True)]
    pairs += zip(scene.luminaires, other.luminaires, strict=True)
    for one, two in pairs:
        for name in (field.name for field in fields(one)):
            if name not in ("cage", "copy_of", "source_path"):
                found, wanted = getattr(one, name), getattr(two, name)
                if isinstance(wanted, np.ndarray | float):
                    found, wanted = np.asarray(found), pytest.approx(wanted, rel=1e-6, abs=1e-6)
                assert found == wanted, (one.path, name)


@pytest.mark.parametrize("case", FEATURES)
def test_features_in_instances_are_lit_as_by_hand(tmp_path: Path, case: str) -> None:
    near = 10 * BOUNDED_ACCURACY if "cages" in case else 1e-6
    _, scene = assert_lit_as_by_hand(tmp_path, *FEATURES[case], photons=False, near=near)
    by_hand = isolux.read_stage(tmp_path / "by_hand.usda")
    assert_same_description(scene, by_hand)


@pytest.mark.parametrize("case", [case for case in FEATURES if "skinned" not in case])
def test_the_written_points_of_each_copy_are_the_solvers(tmp_path: Path, case: str) -> None:
    prototypes, instanced, _ = FEATURES[case]
    stage, scene = baked(tmp_path, "instanced", prototypes, instanced)
    meshes = shown_meshes(stage)
    assert sum(mesh.copy_of is not None for mesh in scene.meshes) >= 1
    for mesh in scene.meshes:
        points = world_points(meshes[mesh.path])
        if mesh.cage is not None:
            points = mesh.cage.refine().limit_points(points)
        assert points == pytest.approx(mesh.points, abs=1e-6)


@pytest.mark.parametrize("as_copies", [as_instances, as_points])
@pytest.mark.parametrize("contents", [BALL + BOX, CAGE, ARM, SMOOTH_ARM])
def test_refined_copies_stand_where_the_solver_saw_them(
    tmp_path: Path, as_copies: Callable[[str], tuple[str, str, str]], contents: str
) -> None:
    """Shapes, limit surfaces, poses that are frozen: the polygons of each copy are its own."""
    prototypes, instanced, _ = as_copies(contents)
    settings = replace(
        SETTINGS, output_mode="refined", subdivision_iterations=2, subdivision_threshold=0.001
    )
    stage, scene = baked(tmp_path, "refined", prototypes, instanced, settings=settings)
    meshes = shown_meshes(stage)
    assert meshes.keys() == {mesh.path for mesh in scene.meshes}
    frozen = 0
    for mesh in scene.meshes:
        shown = meshes[mesh.path]
        primvars = UsdGeom.PrimvarsAPI(shown)
        assert primvars.GetPrimvar("isolux:illuminance").HasAuthoredValue()
        is_refined = primvars.HasPrimvar("isolux:sourceFace")
        frozen += is_refined and mesh.copy_of is not None
        if is_refined or not mesh.is_posed:  # else its skeleton is still at work
            points = world_points(shown)[: len(mesh.points)]
            assert points == pytest.approx(mesh.points, abs=1e-6)
    assert frozen


def test_copies_of_a_cage_are_fitted_by_one_set_of_equations() -> None:
    """One that is stretched weighs its places otherwise: its own equations, the same stencils."""
    prototypes, instanced, _ = as_instances(CAGE)
    scene = read_usda(prototypes + prim("World", FLOOR + WALLS + SMALL_LAMP + instanced))
    [solution, *_] = isolux.ProgressiveSolver(scene, SETTINGS).stages()
    fits = CageFits(solution.vertex_areas)
    cages = [mesh for mesh in scene.meshes if mesh.cage is not None]
    first, turned, stretched = (
        CageOutput(mesh, solution.layout(mesh.path), fits).fit("crease") for mesh in cages
    )
    assert turned is first
    assert stretched is not first and stretched.stencils is first.stencils


MOVES_INSTANCE = instance("Moving", "/Model").replace("{\n", """{
    double3 xformOp:translate.timeSamples = { 1: (-1, 0, 0), 3: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
""")  # fmt: skip
MOVES_POINTS = instancer("Moving", "/Model", MOVES).replace(
    f"positions = {MOVES}", "positions.timeSamples = { 1: [(-1, 0, 0), (0, 1, 0)], "
    "3: [(1, 0, 0), (0, 1, 0.5)] }"
)  # fmt: skip


@pytest.mark.parametrize("instances", ["expand", "summary"])
@pytest.mark.parametrize("moving", [MOVES_INSTANCE, MOVES_POINTS])
def test_each_frame_of_moving_instances_is_a_solve_at_its_time(
    tmp_path: Path, moving: str, instances: str
) -> None:
    source = tmp_path / "source.usda"
    world = prim("World", FLOOR + WALLS + SMALL_LAMP + moving)
    model = prim("Model", WEDGE + BALL, kind="class Xform")
    source.write_text(f"#usda 1.0\n{METRES}{model}{world}", encoding="utf-8")
    options = ["--method", "dept", "--photons", "4000", "--stages", "2", "--instances", instances]

    def bake(name: str, *times: str) -> Usd.Stage:
        output = tmp_path / f"{name}.usda"
        run = CliRunner().invoke(app, ["solve", str(source), "-o", str(output), *times, *options])
        assert run.exit_code == 0, run.stderr
        return Usd.Stage.Open(str(output))

    shot = bake("shot", "--frames", "1:3")
    assert not shot.GetCompositionErrors()
    for frame in (1, 2, 3):
        shown, wanted = (
            baked_values(*each)
            for each in ((shot, frame, frame), (bake(f"at{frame}", "--time", str(frame)), frame, 2))
        )
        assert shown.keys() == wanted.keys() and len(shown) > 2
        for path, (place, light) in wanted.items():
            assert shown[path][0] == pytest.approx(place, abs=1e-9)
            assert shown[path][1] == pytest.approx(light, rel=1e-6), path


def baked_values(
    stage: Usd.Stage, frame: float, time: float
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """World matrix and direct light, by corner, of every visible prim that has any."""
    found = {}
    for each in stage.Traverse(Usd.TraverseInstanceProxies()):
        primvar = UsdGeom.PrimvarsAPI(each).GetPrimvar("isolux:direct")
        hidden = UsdGeom.Imageable(each).ComputeVisibility(frame) == UsdGeom.Tokens.invisible
        if not hidden and each.HasAttribute("primvars:isolux:direct"):
            values = np.array(primvar.ComputeFlattened(time), float)
            if each.IsA(UsdGeom.Mesh) and primvar.GetInterpolation() == UsdGeom.Tokens.vertex:
                values = values[UsdGeom.Mesh(each).GetFaceVertexIndicesAttr().Get(frame)]
            place = UsdGeom.Imageable(each).ComputeLocalToWorldTransform(frame)
            found[str(each.GetPath())] = np.array(place), values
    return found


@pytest.mark.parametrize("case", ["instances", "points"])
def test_the_preview_shows_every_copy_in_its_baked_colour(tmp_path: Path, case: str) -> None:
    """Whatever material the prototype has bound, stronger than what is bound below it."""
    red = """rel material:binding = </Red> ( bindMaterialAs = "strongerThanDescendants" )
    """
    contents = WEDGE + BALL.replace("double radius", f"{red}double radius")
    prototypes, instanced, _ = (as_instances if case == "instances" else as_points)(contents)
    prototypes = prototypes.replace("class Xform", 'def Material "Red" {\n}\nclass Xform', 1)
    stage, scene = baked(tmp_path, "shown", prototypes, instanced)
    assert write_preview(tmp_path / "shown.isolux.usda") == []
    preview = Usd.Stage.Open(str(tmp_path / "shown.isolux.preview.usda"))
    meshes = shown_meshes(preview)
    assert meshes.keys() == shown_meshes(stage).keys() == {mesh.path for mesh in scene.meshes}
    for path, mesh in meshes.items():
        bound, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert bound.GetPath() == "/IsoluxPreview/Bake", path
        colour = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor")
        other = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("displayColor")
        assert colour.ComputeFlattened(3.0) == other.ComputeFlattened(3.0)
