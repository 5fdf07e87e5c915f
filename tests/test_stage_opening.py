"""Stages as studios compose them: what is read, and whether the results show the same stage."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdUtils
from typer.testing import CliRunner

from isolux import ProgressiveSolver, SettingsError, SolverSettings, read_stage
from isolux.cli import ExitCode, app
from isolux.report import read_report
from isolux.results import ResultsWriter
from isolux.stage_opening import StageOpening, open_stage
from usda_stage import METRES, found, open_usda, read_usda

LAMP = """def SphereLight "Lamp" {
    double3 xformOp:translate = (0, 0, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
HEADER = "#usda 1.0\n" + METRES


def square(name, x=0.0, extra="", over="def Mesh"):
    """A unit square at x."""
    return f"""{over} "{name}" {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [({x}, 0, 0), ({x + 1}, 0, 0), ({x + 1}, 1, 0), ({x}, 1, 0)]
        uniform token subdivisionScheme = "none"
        {extra}
    }}
    """


def write(path, text):
    path.write_text(HEADER + text, encoding="utf-8")
    return path


def bake(source, output, **read):
    """Solve a stage and write its results; gives what was read."""
    scene = read_stage(source, **read)
    writer = ResultsWriter(source, output, scene, {})
    settings = SolverSettings(method="dept", stages=1).with_budget(photons=2000)
    for solution in ProgressiveSolver(scene, settings).stages():
        writer.write(solution)
    return scene


def places(scene):
    """Where each mesh begins along x."""
    return {mesh.path: mesh.points[:, 0].min() for mesh in scene.meshes}


def assert_shows(output, scene):
    """The results, opened by USD alone, hold the meshes that were read, lit, at their places."""
    stage = Usd.Stage.Open(str(output))
    time = Usd.TimeCode.EarliestTime() if scene.time_code is None else scene.time_code
    transforms = UsdGeom.XformCache(time)
    assert scene.meshes
    for mesh in scene.meshes:
        prim = stage.GetPrimAtPath(mesh.path)
        assert prim.IsA(UsdGeom.Mesh) and prim.IsDefined(), mesh.path
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(time), float)
        matrix = np.array(transforms.GetLocalToWorldTransform(prim))
        world = (points @ matrix[:3, :3] + matrix[3, :3]) * UsdGeom.GetStageMetersPerUnit(stage)
        np.testing.assert_allclose(world, mesh.points, atol=1e-6)
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("isolux:illuminance")
        values = np.array(primvar.ComputeFlattened(1.0))
        assert (
            len(values)
            == {
                "vertex": len(points),
                "faceVarying": len(mesh.face_vertex_indices),
            }[primvar.GetInterpolation()]
        )
        assert values.max() > 0
    assert stage.GetCompositionErrors() == []


def in_memory(folder):
    return open_usda(square("A", 4) + LAMP), {"/A": 4}


def session_opinions(folder):
    stage = Usd.Stage.Open(str(write(folder / "a.usda", square("A") + square("B", 2) + LAMP)))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetPrimAtPath("/A").SetActive(False)
        UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/B")).SetTranslate((5, 0, 0))
    return stage, {"/B": 7}


def muted_layer(folder):
    write(folder / "shift.usda", square("A", 9, over="over"))
    root = write(folder / "a.usda", square("A") + LAMP)
    layer = Sdf.Layer.FindOrOpen(str(root))
    layer.subLayerPaths = ["./shift.usda"]
    layer.Save()
    write(folder / "strong.usda", "")
    strong = Sdf.Layer.FindOrOpen(str(folder / "strong.usda"))
    strong.subLayerPaths = ["./shift.usda", "./a.usda"]
    strong.Save()
    stage = Usd.Stage.Open(strong)
    stage.MuteLayer(str(folder / "shift.usda"))
    return stage, {"/A": 0}


def offset_sublayer(folder):
    """Frame 2 of the sublayer, at twice the speed, ten frames later: frame 11 of the stage."""
    moving = """double3 xformOp:translate.timeSamples = { 1: (1, 0, 0), 2: (2, 0, 0), 3: (9, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    write(folder / "anim.usda", square("A", 0, moving) + LAMP)
    root = write(folder / "a.usda", "")
    layer = Sdf.Layer.FindOrOpen(str(root))
    layer.subLayerPaths = ["./anim.usda"]
    layer.subLayerOffsets[0] = Sdf.LayerOffset(10, 0.5)
    layer.startTimeCode, layer.endTimeCode = 11, 12
    layer.Save()
    return root, {"/A": 2}


def other_time_rate(folder):
    """48 codes a second below 24: code 4 of the sublayer is code 2 of the stage."""
    moving = """double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 4: (4, 0, 0), 8: (5, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    fast = write(folder / "fast.usda", square("A", 0, moving) + LAMP)
    layer = Sdf.Layer.FindOrOpen(str(fast))
    layer.timeCodesPerSecond = 48
    layer.Save()
    root = folder / "a.usda"
    root.write_text(
        '#usda 1.0\n(\n subLayers = [@./fast.usda@]\n metersPerUnit = 1\n upAxis = "Z"\n'
        " startTimeCode = 2\n timeCodesPerSecond = 24\n)\n"
    )
    return root, {"/A": 4}


def relocated(folder):
    write(folder / "room.usda", f'def Xform "Room" {{\n{square("Chair", 3)}\n}}\n')
    root = folder / "a.usda"
    root.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Z"\n'
        " relocates = { </Set/Chair>: </Set/Corner/Seat> }\n)\n"
        'def Xform "Set" ( references = @./room.usda@</Room> ) {\n def Xform "Corner" {\n }\n}\n'
        + LAMP
    )
    return root, {"/Set/Corner/Seat": 3}


def package(folder):
    write(folder / "a.usda", square("A", 6) + LAMP)
    assert UsdUtils.CreateNewUsdzPackage(str(folder / "a.usda"), str(folder / "a.usdz"))
    return folder / "a.usdz", {"/A": 6}


def root_inside_a_package(folder):
    path, expected = package(folder)
    return f"{path}[a.usda]", expected


def payload(folder):
    write(folder / "chair.usda", square("Chair", 5))
    return write(folder / "a.usda", 'def "C" ( payload = @./chair.usda@</Chair> ) {\n}\n' + LAMP), {
        "/C": 5
    }


def expression_variables(folder):
    write(folder / "tall.usda", square("A", 7))
    root = folder / "a.usda"
    root.write_text(
        "#usda 1.0\n(\n"
        ' expressionVariables = { string SIZE = "tall" }\n metersPerUnit = 1\n upAxis = "Z"\n)\n'
        'def "A" ( references = @`"./${SIZE}.usda"`@</A> ) {\n}\n' + LAMP
    )
    return root, {"/A": 7}


@pytest.mark.parametrize(
    "compose",
    [
        in_memory,
        session_opinions,
        muted_layer,
        offset_sublayer,
        other_time_rate,
        relocated,
        package,
        root_inside_a_package,
        payload,
        expression_variables,
    ],
    ids=lambda compose: compose.__name__,
)
def test_however_a_stage_is_composed_its_results_show_what_was_read(tmp_path, compose):
    source, expected = compose(tmp_path)
    scene = bake(source, tmp_path / "out.usda")
    assert places(scene) == expected
    assert_shows(tmp_path / "out.usda", scene)


@pytest.mark.parametrize(
    "prims",
    [
        square("A", over="over Mesh"),
        square("A").replace("def Mesh", "class Mesh"),
        square("A").replace('"A" {', '"A" ( active = false ) {'),
        f'class Xform "Base" {{\n{square("A")}\n}}\n',
    ],
)
def test_overs_classes_and_inactive_prims_are_not_there(prims):
    scene = read_usda(prims + square("B"))
    assert list(places(scene)) == ["/B"]
    assert found(scene) == []


# Variants -------------------------------------------------------------------------------------

CHAIR = f"""def Xform "Chair" (
    variants = {{ string lod = "low" }}
    prepend variantSets = ["lod", "side"]
) {{
    variantSet "lod" = {{
        "low" {{ {square("Seat", 1)} }}
        "high" {{
            {square("Seat", 2)}
            def Xform "Legs" ( prepend variantSets = "count" ) {{
                variantSet "count" = {{
                    "three" {{ {square("Leg", 3)} }}
                    "four" {{ {square("Leg", 4)} }}
                }}
            }}
        }}
    }}
    variantSet "side" = {{ "left" {{ }} "right" {{ }} }}
}}
"""


@pytest.mark.parametrize(
    ("variants", "expected"),
    [
        ([], {"/Chair/Seat": 1}),
        (["/Chair:lod=high"], {"/Chair/Seat": 2}),
        (["/Chair:lod=high", "/Chair/Legs:count=four"], {"/Chair/Seat": 2, "/Chair/Legs/Leg": 4}),
    ],
)
def test_variants_are_chosen_without_editing_the_source(tmp_path, monkeypatch, variants, expected):
    source = write(tmp_path / "a.usda", CHAIR + LAMP)
    before = source.read_bytes()
    monkeypatch.chdir(tmp_path)
    options = [option for variant in variants for option in ("--variant", variant)]
    result = CliRunner().invoke(app, ["solve", "a.usda", "--photons", "2000", *options])
    assert result.exit_code == ExitCode.DONE, result.stderr
    assert source.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a.isolux.results.usdc",
        "a.isolux.usda",
        "a.usda",
    ]
    scene = read_stage(open_stage(source, StageOpening.parse(variants, None, ())))
    assert places(scene) == expected
    assert_shows(tmp_path / "a.isolux.usda", scene)
    provenance, _ = read_report("a.isolux.usda")
    assert provenance.get("variants", []) == variants


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--variant", "Chair:lod=high"], "'Chair:lod=high'"),
        (["--variant", "/Chair=high"], "wanted /Prim:set=variant"),
        (["--variant", "/Table:lod=high"], "no prim /Table"),
        (["--variant", "/Chair:level=high"], "no variant set level; wanted one of lod, side"),
        (["--variant", "/Chair:lod=best"], "no variant best; wanted one of high, low"),
        (["--load", "some"], "'some'; wanted all or none"),
        (["--mask", "Chair"], "wanted the absolute path of a prim"),
        (["--mask", "/Table"], "no prim /Table"),
    ],
)
def test_what_the_stage_has_not_is_a_wrong_option(tmp_path, arguments, message):
    source = write(tmp_path / "a.usda", CHAIR + LAMP)
    result = CliRunner().invoke(app, ["check", str(source), *arguments])
    assert result.exit_code == ExitCode.USAGE
    assert message in result.stderr


# Parts of a stage -----------------------------------------------------------------------------


def test_payloads_can_be_left_out_and_are_named(tmp_path):
    source, _ = payload(tmp_path)
    write(tmp_path / "a.usda", source.read_text().removeprefix(HEADER) + square("Floor"))
    stage = open_stage(source, StageOpening.parse((), "none", ()))
    scene = read_stage(stage)
    assert list(places(scene)) == ["/Floor"]
    assert found(scene) == [("/C", "payload", "skipped")]


def test_a_part_of_a_stage_takes_its_materials_along(tmp_path):
    red = """def Scope "Looks" {
        def Material "Red" {
            token outputs:surface.connect = </Looks/Red/S.outputs:surface>
            def Shader "S" {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.5, 0.1, 0.1)
                token outputs:surface
            }
        }
    }
    """
    bound = square("A", extra="rel material:binding = </Looks/Red>").replace(
        '"A" {', '"A" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {'
    )
    source = write(tmp_path / "a.usda", bound + square("B", 2) + LAMP + red)
    opening = StageOpening.parse((), None, ["/A", "/Lamp"])
    scene = bake(open_stage(source, opening), tmp_path / "out.usda")
    assert places(scene) == {"/A": 0}
    assert len(scene.luminaires) == 1
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.5, 0.1, 0.1]])
    assert ("/", "population mask", "skipped") in found(scene)
    assert_shows(tmp_path / "out.usda", scene)


def test_a_muted_layer_is_named(tmp_path):
    stage, _ = muted_layer(tmp_path)
    assert ("/", "muted layer", "skipped") in found(read_stage(stage))


@pytest.mark.parametrize("variant", ["", "/", "a", "/A:x", "/A:=b", "/A.b:c=d", "/A B:c=d"])
def test_no_variant_is_made_of_other_text(variant):
    with pytest.raises(SettingsError):
        StageOpening.parse([variant], None, ())
