"""`isolux check` beside USD's own validators: all that is wrong, each kind once, with its prims."""

import pytest
from pxr import UsdGeom
from typer.testing import CliRunner

from isolux.cli import ExitCode, app
from isolux.stage_check import check_stage
from isolux.stage_opening import open_stage
from small_room import FLOOR, LAMP, WALLS, write_room, write_stage
from usda_stage import open_usda

UNBOUND = """def Mesh "{name}" {{
    rel material:binding = </World/Red>
    float3[] extent = [(0, 0, 0), (1, 1, 0)]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
}}
"""
UNKNOWN_SHADER = """def Material "Red" {
    token outputs:surface.connect = </World/Red/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "studio_plastic"
        token outputs:surface
    }
}
"""
JOINT = """def PhysicsFixedJoint "Joint" {
    rel physics:body0 = </World/Nothing>
}
"""


def isolux(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_sound_room_has_no_complaints(tmp_path):
    checked = check_stage(open_stage(write_room(tmp_path / "room.usda")))
    # Its file leaves the default prim away.
    assert [row.name for row in checked.complaints] == [
        "usdValidation:StageMetadataChecker.MissingDefaultPrim"
    ]
    assert checked.left_out == {}


def test_repeated_complaints_are_one_row_with_all_prims():
    names = ["Chair", "Desk", "Lamp", "Wall"]
    checked = check_stage(open_usda("".join(UNBOUND.format(name=name) for name in names)))
    rows = {row.name: row for row in checked.complaints}
    row = rows["usdShadeValidators:MaterialBindingApiAppliedValidator.MissingMaterialBindingAPI"]
    assert row.severity == "error"
    assert row.paths == tuple(f"/{name}" for name in names)
    assert "/Chair" in row.message


def test_messages_that_say_different_things_are_not_one():
    lamp = """def SphereLight "Lamp{0}" ( prepend apiSchemas = ["IsoluxLuminaireAPI"] ) {{
        float inputs:isolux:luminousFlux = 800
        float inputs:isolux:dimming = {1}
    }}
    """
    lamps = [(0, -1), (1, -2), (2, -1), (3, 1)]
    checked = check_stage(open_usda("".join(lamp.format(*row) for row in lamps)))
    rows = [row for row in checked.complaints if "AttributeRange" in row.name]
    assert [row.message for row in rows] == [
        "-1 lies outside [0.0, inf)",
        "-2 lies outside [0.0, inf)",
    ]
    assert rows[0].paths == tuple(f"/Lamp{i}.inputs:isolux:dimming" for i in (0, 2))


def test_errors_come_before_warnings():
    mesh = UNBOUND.format(name="Chair").replace("1, 1, 0)]", "1000, 1000, 0)]", 1)
    checked = check_stage(open_usda(mesh))
    severities = [row.severity for row in checked.complaints]
    assert severities == sorted(severities, key=["error", "warning", "note"].index)
    assert set(severities) == {"error", "warning"}


def test_what_says_nothing_of_light_is_left_out_and_told():
    stage = open_usda(f'def Scope "World" {{\n{UNKNOWN_SHADER}{JOINT}}}')
    checked = check_stage(stage)
    assert not [row for row in checked.complaints if "Sdr" in row.name or "Physics" in row.name]
    assert checked.left_out == {"shaders of renderers that are not installed here": 1}


def test_a_validator_that_breaks_on_a_broken_stage_leaves_the_others_their_say(tmp_path):
    """A layer that can't be parsed: validators that open it again fail on it."""
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef Mesh {")
    room = write_room(tmp_path / "room.usda")
    room.write_text(room.read_text().replace("metersPerUnit = 1", "subLayers = [@broken.usda@]"))
    checked = check_stage(open_stage(room))
    messages = [row.message for row in checked.complaints]
    assert any("broken.usda" in message for message in messages)
    names = {row.name.partition(".")[2] for row in checked.complaints}
    assert "MissingMetersPerUnitMetadata" in names


def test_an_unsuitable_bound_is_no_crash():
    stage = open_usda(UNBOUND.format(name="Chair").replace("(1, 1, 0)]", "(inf, nan, 0)]"))
    UsdGeom.Boundable(stage.GetPrimAtPath("/Chair"))
    check_stage(stage)


def test_check_tells_what_validators_say_and_ends_as_solve_would(tmp_path):
    settings = "uniform double isolux:targetError = 0.1"
    sound = write_stage(tmp_path / "sound.usda", WALLS, FLOOR, LAMP, settings=settings)
    result = isolux("check", sound)
    assert result.exit_code == ExitCode.DONE
    assert "usdValidation:StageMetadataChecker.MissingDefaultPrim" in result.stdout
    assert "2 meshes, 6 faces" in result.stdout

    doubted = tmp_path / "doubted.usda"
    doubted.write_text(sound.read_text().replace("metersPerUnit = 1", "metersPerUnit = 100"))
    result = isolux("check", doubted)
    assert result.exit_code == ExitCode.DONE
    (line,) = [row for row in result.stdout.splitlines() if "ImplausibleSize" in row]
    assert line.split()[:3] == ["warning", "isolux.validators:SceneScale.ImplausibleSize", "1"]
    assert "400 x 400 x 300 m" in line


@pytest.mark.parametrize(
    ("lamp", "code"),
    [
        ("asset inputs:isolux:file = @nowhere.ies@", ExitCode.PHOTOMETRY),
        ("float inputs:isolux:dimming = -1", ExitCode.STAGE),
    ],
)
def test_where_solve_would_refuse_the_validators_are_heard_first(tmp_path, lamp, code):
    api = '"Lamp" ( prepend apiSchemas = ["IsoluxLuminaireAPI"] ) {\n' + lamp
    stage = write_stage(tmp_path / "room.usda", WALLS, FLOOR, LAMP.replace('"Lamp" {', api))
    result = isolux("check", stage)
    assert result.exit_code == code
    assert "isolux.validators:PhotometricFile." in result.stdout
    assert "error: " in result.stderr
