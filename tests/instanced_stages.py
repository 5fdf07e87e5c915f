"""Stages with instances, the same written out by hand, and a comparison of their bakes."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

import isolux
from isolux.output_fields import OUTPUT_FIELDS
from isolux.results import ResultsWriter
from small_room import FLOOR, WALLS
from usda_stage import METRES

# Radiosity is left out: which of two equal clusters it takes first hangs on the last bit.
SETTINGS = isolux.SolverSettings(
    method="ddl+idept", target_error=0.0, photons=50_000, stages=3, threads=1
)

# A wedge without symmetry, so that a mirrored or turned copy can't pass for another.
WEDGE = """def Mesh "Wedge" {
    int[] faceVertexCounts = [4, 3, 3, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 4, 1, 3, 2, 5, 1, 4, 5, 2]
    point3f[] points = [(0, 0, 0.5), (0.4, 0, 0.7), (0.4, 0.3, 0.7), (0, 0.3, 0.5),
                        (0.4, 0, 0.1), (0.4, 0.3, 0.1)]
    color3f[] primvars:displayColor = [(0.7, 0.4, 0.2)]
    uniform token subdivisionScheme = "none"
    double3 xformOp:translate = (0.1, 0.2, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
SHADE = """def Mesh "Shade" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-0.2, -0.2, 1), (0.2, -0.2, 1), (0.3, 0.2, 1), (-0.2, 0.2, 1.1)]
    normal3f[] normals = [(0, 0, 1)] ( interpolation = "constant" )
    bool doubleSided = true
    uniform token subdivisionScheme = "none"
}
"""
# So small that it doesn't matter which of its points are sampled: that hangs on the last bits of
# the lit point.
BULB = """def SphereLight "Bulb" {
    float inputs:intensity = 1
    bool inputs:normalize = true
    float inputs:radius = 1e-6
    double3 xformOp:translate = (0, 0, 1.6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


SMALL_LAMP = BULB.replace("Bulb", "Lamp").replace("intensity = 1", "intensity = 100")


def matrix(*, scale=(1, 1, 1), turn=None, move=(0, 0, 0)):
    """Of row vectors: scale, then turn about an axis by degrees, then move."""
    axis, degrees = turn or ((0, 0, 1), 0)
    turned = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(axis), degrees))
    return Gf.Matrix4d().SetScale(Gf.Vec3d(scale)) * turned * Gf.Matrix4d().SetTranslate(move)


def prim(name, contents="", place=None, *, kind="def Xform", metadata=""):
    """A prim, moved by a matrix."""
    moved = ""
    if place is not None:
        moved = f"""matrix4d xformOp:transform = {place}
            uniform token[] xformOpOrder = ["xformOp:transform"]\n"""
    about = f" ( {metadata} )" if metadata else ""
    return f'{kind} "{name}"{about} {{\n{moved}{contents}}}\n'


def instance(name, of, place=None):
    metadata = f"instanceable = true\n prepend references = <{of}>"
    return prim(name, "", place, metadata=metadata)


def half(degrees):
    return np.cos(np.radians(degrees / 2)), np.sin(np.radians(degrees / 2))


PLACES = [
    matrix(move=(-1.5, -1.5, 0)),
    matrix(scale=(-1, 1, 1), turn=((0, 0, 1), 30), move=(1, 1, 0)),
    matrix(scale=(1.5, 0.5, 1), turn=((1, 1, 0), 40), move=(0.5, -1.2, 0.3)),
]
LEAN = matrix(turn=((0, 1, 0), 15), move=(0, 0.1, 0))
SPREAD = matrix(scale=(1, 1, 0.8), move=(0.1, 0, 0.2))
COS, SIN = half(90)


def instancer(name, prototype, moves, contents="", place=None):
    arrays = f"""
        rel prototypes = <{prototype}>
        int[] protoIndices = {[0] * len(moves)}
        point3f[] positions = {moves}
    """
    return prim(name, arrays + contents, place, kind="def PointInstancer")


def by_hand(contents, moves, place=None):
    return "".join(
        prim(f"Copy{i}", contents, (place or matrix()) * matrix(move=move))
        for i, move in enumerate(moves)
    )


def baked(folder, name, prototypes, contents, instances="expand", settings=SETTINGS):
    """The reopened results of a lit room with these prims in it, and what was read of it."""
    source = folder / f"{name}.usda"
    world = prim("World", FLOOR + WALLS + SMALL_LAMP + contents)
    source.write_text(f"#usda 1.0\n{METRES}{prototypes}{world}", encoding="utf-8")
    stage = Usd.Stage.Open(str(source))
    scene = isolux.read_stage(stage, settings=settings)
    output = folder / f"{name}.isolux.usda"
    writer = ResultsWriter(stage, output, scene, {}, None, settings.output_mode, instances)
    for solution in isolux.ProgressiveSolver(scene, settings).stages():
        writer.write(solution)
    return Usd.Stage.Open(str(output)), scene


def shown_meshes(stage):
    """Every mesh that a renderer would draw, by path."""
    meshes = [each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh)]
    return {
        str(each.GetPath()): UsdGeom.Mesh(each)
        for each in meshes
        if UsdGeom.Imageable(each).ComputeVisibility() != UsdGeom.Tokens.invisible
    }


def world_points(mesh):
    to_world = np.array(UsdGeom.Imageable(mesh).ComputeLocalToWorldTransform(1.0))
    return np.array(mesh.GetPointsAttr().Get(), float) @ to_world[:3, :3] + to_world[3, :3]


def assert_lit_as_by_hand(folder, prototypes, instanced, written_out, photons=True, near=1e-6):
    """The bake of an instanced stage is that of its copies by hand, under the same names.

    photons : compare also what they brought, and not the last stage's direct light alone: which of
        two small faces takes a photon near their edge hangs on the last bit
    near : of each value, or of the floor's greatest one
    returns : the results of the instanced stage, and what was read of it
    """
    stage, scene = baked(folder, "instanced", prototypes, instanced)
    plain, by_hand = baked(folder, "by_hand", prototypes, written_out)
    assert not stage.GetCompositionErrors()
    meshes, wanted = shown_meshes(stage), shown_meshes(plain)
    assert [light.path for light in scene.luminaires] == [
        light.path for light in by_hand.luminaires
    ]
    assert meshes.keys() == wanted.keys() == {mesh.path for mesh in scene.meshes}
    times = (
        stage.GetPrimAtPath("/World/Floor")
        .GetAttribute("primvars:isolux:illuminance")
        .GetTimeSamples()
    )
    assert len(times) >= 2
    fields = OUTPUT_FIELDS
    if not photons:
        times = times[-1:]
        fields = [field for field in OUTPUT_FIELDS if field.name == "isolux:direct"]
    floor = UsdGeom.PrimvarsAPI(plain.GetPrimAtPath("/World/Floor"))
    for path, mesh in meshes.items():
        assert world_points(mesh) == pytest.approx(world_points(wanted[path]), abs=1e-6)
        for field in fields:
            primvar, other = (
                UsdGeom.PrimvarsAPI(each).GetPrimvar(field.name) for each in (mesh, wanted[path])
            )
            assert primvar.HasValue() == other.HasValue()
            for time in times if other.HasValue() else ():
                values = np.array(primvar.ComputeFlattened(time), float)
                expected = np.array(other.ComputeFlattened(time), float)
                greatest = np.abs(expected).max(initial=0.0)
                if floor.HasPrimvar(field.name):
                    on_floor = np.array(floor.GetPrimvar(field.name).Get(time), float)
                    greatest = max(greatest, on_floor.max())
                assert values == pytest.approx(expected, rel=near, abs=near * greatest), (
                    path,
                    field.name,
                )
    return stage, scene
