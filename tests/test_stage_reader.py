"""Whole stages: what is read, what is left out by name, what can't be opened at all."""

import gc
import time

import pytest
from pxr import Sdf, Usd

from isolux import IsoluxError, SceneError, stage_reader
from isolux.stage_reader import read_stage
from usda_stage import found, open_usda, read_usda

SQUARE = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def mesh(name: str, extra: str = "") -> str:
    return f'def Mesh "{name}" {{ {SQUARE} {extra}\n}}\n'


def group(body: str, extra: str = "", applied: str = "") -> str:
    return f'def Xform "Group" {applied} {{\n{extra}\n{body}\n}}\n'


LAMP = 'def SphereLight "Lamp" {\n}\n'
INVISIBLE = 'token visibility = "invisible"'


@pytest.mark.parametrize(
    ("stage", "paths", "findings"),
    [
        (mesh("A") + mesh("B"), ["/A", "/B"], []),
        (group(mesh("A"), INVISIBLE), [], [("/Group", "visibility", "skipped")]),
        (group(LAMP, INVISIBLE), [], [("/Group", "visibility", "skipped")]),
        (group(mesh("A"), applied="( active = false )"), [], []),
        (group(mesh("A")).replace("def Xform", "over"), [], []),
        (group(mesh("A")).replace("def Xform", "class Xform"), [], []),
        (
            mesh("A", 'uniform token purpose = "proxy"') + mesh("B", 'token purpose = "render"'),
            ["/B"],
            [("/A", "purpose proxy", "skipped")],
        ),
        (
            group(mesh("A"), 'uniform token purpose = "guide"'),
            [],
            [("/Group/A", "purpose guide", "skipped")],
        ),
        ('def Sphere "A" {\n}', ["/A"], [("/A", "Sphere", "approximated")]),
        ('def Cube "A" {\n}', ["/A"], [("/A", "Cube", "noted")]),
        ('def BasisCurves "A" {\n}', [], [("/A", "BasisCurves", "skipped")]),
        ('def Camera "A" {\n}', [], []),
        ('def MadeUpShape "A" {\n}', [], [("/A", "MadeUpShape", "skipped")]),
        (
            mesh("A").replace('"A"', '"A" ( prepend apiSchemas = ["MeshLightAPI"] )'),
            ["/A"],
            [],
        ),
    ],
)
def test_which_prims_are_read(stage, paths, findings):
    scene = read_usda(stage)
    assert [mesh.path for mesh in scene.meshes] == paths
    assert found(scene) == findings


def test_a_moving_prim_is_reported_once_at_the_prim_that_moves():
    moving = """double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (2, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    stage = group(mesh("A") + mesh("B"), moving)
    scene = read_usda(stage, time_code=2.0)
    assert scene.meshes[1].points[0, 0] == 1.0
    assert found(scene) == [("/Group", "animation", "noted")]


@pytest.mark.parametrize(
    ("metadata", "asked", "read", "x"),
    [
        ("( startTimeCode = 3\n metersPerUnit = 1 )", None, 3.0, 2.0),
        ("( startTimeCode = 3\n metersPerUnit = 1 )", 2.0, 2.0, 1.0),
        ("( metersPerUnit = 1 )", None, None, 0.0),  # the earliest sample
    ],
)
def test_time_code(metadata, asked, read, x):
    moving = """double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (2, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    scene = read_usda(group(mesh("A"), moving), metadata, asked)
    assert scene.time_code == read
    assert scene.meshes[0].points[0, 0] == x


def test_units_and_up_axis_are_the_stages_own():
    scene = read_usda(mesh("A"), '( metersPerUnit = 0.01\n upAxis = "Z" )')
    assert (scene.meters_per_unit, scene.up_axis) == (0.01, "Z")
    assert scene.meshes[0].points.max() == pytest.approx(0.01)


def test_an_empty_stage_is_no_error_yet():
    scene = read_usda("")
    assert (scene.meshes, scene.luminaires, scene.findings) == ((), (), ())


def test_references_that_lead_nowhere_are_findings_and_not_noise(tmp_path, capfd):
    stage = tmp_path / "room.usda"
    stage.write_text(
        "#usda 1.0\n"
        'def "Chair" ( references = @chair.usd@ ) {\n}\n'
        'def "Table" ( payload = @table.usd@</Top> ) {\n}\n'
        'def "Lamp" ( references = </Nowhere> ) {\n}\n' + mesh("Floor")
    )
    scene = read_stage(stage)
    gc.collect()
    assert [mesh.path for mesh in scene.meshes] == ["/Floor"]
    expected = [(f"/{name}", "composition", "skipped") for name in ("Chair", "Lamp", "Table")]
    assert sorted(found(scene)) == expected
    assert capfd.readouterr() == ("", "")


def test_references_in_a_circle_are_findings_in_a_line(tmp_path):
    stage = tmp_path / "circle.usda"
    stage.write_text(
        "#usda 1.0\n"
        'def "A" ( references = </B> ) {\n}\n'
        'def "B" ( references = </A> ) {\n}\n'
        'def "Self" ( references = @./circle.usda@</Self> ) {\n}\n' + mesh("Floor")
    )
    scene = read_stage(stage)
    assert [mesh.path for mesh in scene.meshes] == ["/Floor"]
    assert {path for path, kind, _ in found(scene) if kind == "composition"} == {
        "/A",
        "/B",
        "/Self",
    }
    assert not any("\n" in finding.reason for finding in scene.findings)


def test_payloads_left_unloaded_are_named(tmp_path):
    Sdf.Layer.CreateNew(str(tmp_path / "room.usda")).Save()
    (tmp_path / "room.usda").write_text("#usda 1.0\n" + group(mesh("A")))
    (tmp_path / "house.usda").write_text(
        '#usda 1.0\ndef "Room" ( payload = @room.usda@</Group> ) {\n}\n'
    )
    stage = Usd.Stage.Open(str(tmp_path / "house.usda"), Usd.Stage.LoadNone)
    assert found(read_stage(stage)) == [("/Room", "payload", "skipped")]


@pytest.mark.parametrize(
    ("name", "contents"),
    [
        ("missing.usda", None),
        ("text.usda", b"no stage at all"),
        ("noise.usd", bytes(range(256))),
        ("empty.usda", b""),
        ("picture.png", b"\x89PNG"),
        ("truncated.usdc", b"PXR-USDC" + bytes(80)),
        ("half.usda", b'#usda 1.0\ndef Mesh "A" {\n    int[] faceVertexCounts = [4'),
        ("fake.usdz", b"PK\x03\x04"),
    ],
)
def test_what_is_no_stage_is_said_without_noise(tmp_path, capfd, name, contents):
    path = tmp_path / name
    if contents is not None:
        path.write_bytes(contents)
    with pytest.raises(SceneError) as error:
        read_stage(path)
    gc.collect()
    assert error.value.subject == str(path)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_a_folder_is_no_stage(tmp_path):
    with pytest.raises(SceneError):
        read_stage(tmp_path)


def test_the_source_hash_follows_contents_and_nothing_else(tmp_path):
    text = "#usda 1.0\n" + mesh("A")
    for name, contents in {
        "a": text,
        "b": text,
        "c": text.replace("(1, 1, 0)", "(1, 2, 0)"),
    }.items():
        (tmp_path / f"{name}.usda").write_text(contents)
    a, b, c = (read_stage(tmp_path / f"{name}.usda").source_hash for name in "abc")
    assert a == b != c
    in_memory = [read_usda(mesh("A")).source_hash for _ in range(2)]
    assert in_memory[0] == in_memory[1]


def test_layers_of_a_stage_that_cannot_be_read_outlive_their_hashing(tmp_path, monkeypatch):
    """Found by fuzzing: a crash, as they went while another thread still looked at them."""
    alive = []

    def slow_digest(layer: Sdf.Layer) -> bytes:
        time.sleep(0.3)
        alive.append(not layer.expired)
        return b""

    monkeypatch.setattr(stage_reader, "_layer_digest", slow_digest)
    too_white = "color3f[] primvars:displayColor = [(1.2, 1.2, 1.2)]"
    stage = tmp_path / "stage.usda"
    stage.write_text(f"#usda 1.0\n{mesh('A', too_white)}", encoding="utf-8")
    with pytest.raises(SceneError, match=r"1\.2"):
        read_stage(stage)
    assert alive and all(alive)


def test_the_source_hash_sees_unsaved_edits(tmp_path):
    (tmp_path / "a.usda").write_text("#usda 1.0\n" + mesh("A"))
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    saved = read_stage(stage).source_hash
    stage.GetPrimAtPath("/A").GetAttribute("doubleSided").Set(True)
    assert read_stage(stage).source_hash != saved


def test_a_stage_is_left_as_it_was():
    stage = open_usda(group(mesh("A") + LAMP))
    before = stage.GetRootLayer().ExportToString(), stage.GetSessionLayer().ExportToString()
    read_stage(stage)
    after = stage.GetRootLayer().ExportToString(), stage.GetSessionLayer().ExportToString()
    assert after == before


# Meshes and lights by the inputs' own table, less invisible, proxy and guide ones, and with the
# meshes that shine by their material. Each instance counts.
REAL_STAGES = {
    "pablode+usd-assets/cornell-box/usdpreviewsurface/cornell-box.usda": (16, 1),
    "nhaflinger+anacapa/scenes/cornell_box.usda": (8, 2),
    "dw218192+diffpt-warp/stages/cornell_sphere.usda": (9, 1),
    "pmolodo+luxtest/usd/iesDown.usda": (2, 1),
    "Autodesk+arnold-usd/testsuite/test_0140/data/test.usda": (2, 1),
    "Autodesk+arnold-usd/testsuite/test_0206/data/scene.usda": (9, 0),
    "usd-wg+assets/intent-vfx/scenes/teapotScene_layout.usd": (1000, 0),
    "PixarAnimationStudios+OpenUSD/pxr/usdImaging/usdImagingGL/testenv/"
    "testUsdImagingGLPointInstancer/pi_pi_xform.usda": (4, 1),
    "PixarAnimationStudios+OpenUSD/pxr/usd/usdLux/testenv/testUsdLuxLightListAPI/"
    "root_with_instances.usda": (3, 3),
    "NVIDIA-Omniverse+usd-optimize/source/tests/data/maxDataVolumePartial.usdc": (51, 0),
    "NVIDIA-Omniverse+usd-optimize/source/tests/data/purpose.usda": (6, 0),
    "OndrejSzekely+openusd_learning_path/nvidia_learning_path/composition_arcs/inherits/activity/"
    "main_street.usd": (30, 12),
}


@pytest.mark.parametrize("path", REAL_STAGES)
def test_real_stages_hold_what_they_hold(inputs, path):
    scene = read_stage(inputs / "usd" / path)
    assert (len(scene.meshes), len(scene.luminaires)) == REAL_STAGES[path]


def test_every_real_stage_reads_or_says_why_not(inputs, capfd):
    stages = sorted(path for path in (inputs / "usd").rglob("*.usd*") if path.is_file())
    assert len(stages) >= 28
    for path in stages:
        try:
            scene = read_stage(path)
        except IsoluxError:
            continue
        assert len({mesh.path for mesh in scene.meshes}) == len(scene.meshes)
        assert all(mesh.reflectance.max() < 1 for mesh in scene.meshes)
        assert len(set(scene.findings)) == len(scene.findings), path
    gc.collect()
    assert capfd.readouterr() == ("", "")
