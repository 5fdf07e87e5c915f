"""displayColor through each view, as it comes out of a viewer that encodes it for sRGB."""

from dataclasses import replace

import numpy as np
import PyOpenColorIO
import pytest
from isolux._core import adaptation_luminance, tone_map
from pxr import Sdf, Usd, UsdGeom
from typer.testing import CliRunner

from hand_built import cube, grid, scene_of, solution_of, source_stage
from isolux.cli import ExitCode, app
from isolux.colour import adapted_exposure, display_colours
from isolux.display_view import DisplayView
from isolux.errors import SettingsError
from isolux.report import read_report
from isolux.results import ResultsWriter
from isolux.settings import settings_from_stage
from small_room import FLOOR, LAMP, WALLS, write_room, write_stage
from usda_stage import METRES, open_usda

BUILTIN = PyOpenColorIO.Config.CreateFromFile("ocio://default")
SRGB = BUILTIN.getDefaultDisplay()
ACES = f"{SRGB}/{BUILTIN.getDefaultView(SRGB)}"
PARTS = [
    cube("/World/A", double_sided=True),
    grid("/World/B", reflectance=[[0.8, 0.1, 0.1], [0.4, 0.4, 0.4]] * 2),
]


def srgb_encoded(linear):
    """IEC 61966-2-1, as a stock Hydra encodes what it has drawn."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def room_luminances(adaptation):
    """Grey and coloured, from 8 stops below to 6 above, cd/m²."""
    grey = adaptation * 2.0 ** np.arange(-8, 7)
    tints = np.array([[1.0, 1.0, 1.0], [1.6, 0.8, 0.6], [0.7, 1.1, 1.3]])
    return (grey[:, None, None] * tints).reshape(-1, 3).astype(np.float32)


@pytest.mark.parametrize("adaptation", [0.3, 20.0, 5000.0])
def test_an_aces_view_on_screen_is_the_picture_that_opencolorio_makes(adaptation):
    luminance = room_luminances(adaptation)
    colours = DisplayView(ACES).adapted_to(adaptation)(luminance)
    assert colours.min() >= 0.0 and colours.max() <= 1.0
    picture = display_colours(luminance[None], adapted_exposure(adaptation))[0]
    assert 255 * srgb_encoded(colours) == pytest.approx(picture, abs=0.6)


@pytest.mark.parametrize("display", list(BUILTIN.getDisplays()))
def test_a_view_looks_alike_on_a_screen_whatever_display_encodes_it(display):
    """Colorimetry: the XYZ that its display makes of the view is that of the sRGB screen."""
    view = "Video (colorimetric)"  # scene colours as they are, up to the display's white
    luminance = np.array([[9.0, 9.0, 9.0], [5.0, 4.0, 3.0], [0.5, 0.6, 0.7]], np.float32)
    expected = luminance * 0.36 / 20.0  # the log-average at twice 18 %
    shown = DisplayView(f"{display}/{view}").adapted_to(20.0)(luminance)
    assert shown == pytest.approx(expected, abs=2e-3)


def test_the_default_is_tumblin_and_rushmeiers_operator():
    luminance = room_luminances(20.0)
    assert np.array_equal(DisplayView().adapted_to(20.0)(luminance), tone_map(luminance, 20.0))


@pytest.mark.parametrize("name", ["tumblin-rushmeier", ACES])
def test_a_fixed_adaptation_shows_shots_of_any_brightness_alike(name):
    luminance = room_luminances(20.0)
    fixed = DisplayView(name, adaptation=20.0)
    expected = DisplayView(name).adapted_to(20.0)(luminance)
    for log_average in (0.0, 3.0, 900.0):
        assert np.array_equal(fixed.adapted_to(log_average)(luminance), expected)


@pytest.mark.parametrize("name", ["tumblin-rushmeier", ACES])
def test_a_lamp_dimmed_over_a_shot_looks_dimmer(tmp_path, name):
    lamp = LAMP.replace("inputs:intensity = 1000", "inputs:intensity.timeSamples = {1: 900, 2: 90}")
    settings = f'uniform token isolux:displayView = "{name}"'
    source = write_stage(tmp_path / "shot.usda", FLOOR, WALLS, lamp, settings=settings)
    output = tmp_path / "out.usda"
    options = ["--frames", "1:2", "--method", "ddl+hpr", "--target-error", "0.2"]
    result = CliRunner().invoke(app, ["solve", str(source), "-o", str(output), *options])
    assert result.exit_code == ExitCode.DONE, result.stderr
    stage = Usd.Stage.Open(str(output))
    floor = stage.GetPrimAtPath("/World/Floor")
    bright, dim = (np.array(floor.GetAttribute("primvars:displayColor").Get(t)) for t in (1, 2))
    lux = [np.array(floor.GetAttribute("primvars:isolux:illuminance").Get(t)) for t in (1, 2)]
    assert lux[1] == pytest.approx(0.1 * lux[0], rel=1e-3)
    assert (dim < 0.5 * bright).all()


@pytest.mark.parametrize("name", ["tumblin-rushmeier", ACES])
def test_a_scene_without_light_is_black(name):
    adaptation = adaptation_luminance(np.zeros(2), np.ones(2))
    shown = DisplayView(name).adapted_to(adaptation)(np.zeros((2, 3), np.float32))
    assert not shown.any()


def test_a_view_that_is_none_is_refused_with_those_there_are():
    with pytest.raises(SettingsError) as caught:
        DisplayView("sRGB - Display/ACES 1.0")
    assert caught.value.subject == "display_view"
    for known in ("tumblin-rushmeier", ACES, f"{SRGB}/Raw"):
        assert f'"{known}"' in caught.value.wanted


def test_a_view_on_the_stage_that_is_none_is_told_by_its_attribute():
    settings = """def RenderSettings "Render" ( prepend apiSchemas = ["IsoluxSolverAPI"] ) {
        uniform token isolux:displayView = "NAME"
    }"""
    metadata = METRES.replace(")", '    renderSettingsPrimPath = "/Render"\n)')
    with pytest.raises(SettingsError, match=r"^/Render\.isolux:displayView: .*'film'.*sRGB"):
        settings_from_stage(open_usda(settings.replace("NAME", "film"), metadata))
    stage = open_usda(settings.replace("NAME", ACES), metadata)
    assert settings_from_stage(stage).display_view == ACES


def test_the_views_are_those_of_the_studios_own_configuration(tmp_path, monkeypatch):
    config = PyOpenColorIO.Config.CreateFromBuiltinConfig("cg-config-v2.1.0_aces-v1.3_ocio-v2.3")
    config.setActiveViews("Un-tone-mapped")
    (tmp_path / "config.ocio").write_text(config.serialize())
    monkeypatch.setenv("OCIO", str(tmp_path / "config.ocio"))
    view = DisplayView("sRGB - Display/Un-tone-mapped")
    grey = np.full((1, 3), 10.0, np.float32)
    assert view.adapted_to(20.0)(grey) == pytest.approx(0.18, abs=1e-4)
    with pytest.raises(SettingsError, match="Un-tone-mapped") as caught:
        DisplayView(ACES)
    assert ACES not in caught.value.wanted


def test_a_configuration_of_the_first_version_is_taken_to_be_made_for_srgb(tmp_path, monkeypatch):
    """Its views are colour spaces of the scene; nothing in it tells the display."""
    config = PyOpenColorIO.Config.CreateRaw()
    config.setVersion(2, 0)
    aces = PyOpenColorIO.ColorSpace(name="ACES2065-1")
    encoded = PyOpenColorIO.ColorSpace(name="Output - sRGB")
    to_srgb = PyOpenColorIO.GroupTransform()
    to_srgb.appendTransform(PyOpenColorIO.MatrixTransform(AP0_TO_REC709))
    to_srgb.appendTransform(
        PyOpenColorIO.ExponentWithLinearTransform(
            gamma=[2.4, 2.4, 2.4, 1],
            offset=[0.055, 0.055, 0.055, 0],
            direction=PyOpenColorIO.TRANSFORM_DIR_INVERSE,
        )
    )
    encoded.setTransform(to_srgb, PyOpenColorIO.COLORSPACE_DIR_FROM_REFERENCE)
    for space in (aces, encoded):
        config.addColorSpace(space)
    config.setRole("aces_interchange", "ACES2065-1")
    config.addDisplayView("screen", "film", "Output - sRGB")
    (tmp_path / "old.ocio").write_text(config.serialize())
    monkeypatch.setenv("OCIO", str(tmp_path / "old.ocio"))
    luminance = np.array([[9.0, 9.0, 9.0], [5.0, 4.0, 3.0]], np.float32)
    shown = DisplayView("screen/film").adapted_to(20.0)(luminance)
    assert shown == pytest.approx(luminance * 0.36 / 20.0, abs=2e-3)


# ACES2065-1 to linear Rec. 709 with Bradford adaptation [ACES, S-2014-004].
AP0_TO_REC709 = [
    2.52168618674388, -1.13413098823972, -0.387555198504164, 0.0,
    -0.276479914229922, 1.37271908766826, -0.096239173438334, 0.0,
    -0.0153780649660342, -0.152975335867399, 1.16835340083343, 0.0,
    0.0, 0.0, 0.0, 1.0,
]  # fmt: skip


def written(folder, display):
    """Attributes of the results layer, as stored."""
    folder.mkdir()
    source = source_stage(folder / "room.usda", PARTS)
    scene = scene_of(description for description, _ in PARTS)
    writer = ResultsWriter(source, folder / "out.usda", scene, {}, display)
    for index in (1, 2):
        writer.write(solution_of(PARTS, index))
    layer = Sdf.Layer.FindOrOpen(str(folder / "out.results.usdc"))
    values = {}

    def collect(path):
        if path.IsPrimPropertyPath():
            samples = layer.ListTimeSamplesForPath(path)
            stored = [layer.QueryTimeSample(path, time) for time in samples]
            stored.append(layer.GetAttributeAtPath(path).default)
            values[str(path)] = [
                v if isinstance(v, str | Sdf.ValueBlock) else np.array(v).tobytes()
                for v in stored
                if v is not None
            ]

    layer.Traverse(Sdf.Path.absoluteRootPath, collect)
    return values


def test_the_view_changes_display_colour_and_nothing_else(tmp_path):
    as_default = written(tmp_path / "default", None)
    as_aces = written(tmp_path / "aces", DisplayView(ACES))
    changed = {path for path in as_default if as_default[path] != as_aces[path]}
    assert changed == {f"/World/{name}.primvars:displayColor" for name in "AB"}
    assert as_default.keys() == as_aces.keys()
    assert len(as_default) > 10


@pytest.mark.parametrize(
    "emission",
    [
        [[30.0, 20.0, 10.0]],
        [[0.0, 0.0, 0.0], [30.0, 20.0, 10.0], [0.0, 0.0, 0.0], [5.0, 5.0, 5.0]],
    ],
    ids=["the whole mesh", "some faces"],
)
@pytest.mark.parametrize("by_face", [False, True])
def test_a_surface_that_shines_shows_its_own_luminance_too(tmp_path, emission, by_face):
    reflectance = [[0.5, 0.4, 0.3], [0.5, 0.4, 0.3], [0.1, 0.1, 0.1], [0.5, 0.4, 0.3]]
    mesh, corner_vertices = grid("/World/Mesh", reflectance=reflectance[: 4 if by_face else 1])
    mesh = replace(mesh, emission=np.array(emission, np.float32))
    part = (mesh, corner_vertices)
    source = source_stage(tmp_path / "room.usda", [part])
    display = DisplayView(adaptation=40.0)
    writer = ResultsWriter(source, tmp_path / "out.usda", scene_of([mesh]), {}, display)
    solution = solution_of([part])
    writer.write(solution)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    primvar = primvars.GetPrimvar("displayColor")
    stored = np.array(primvar.ComputeFlattened(1))
    if primvar.GetInterpolation() == "vertex":
        stored = stored[mesh.face_vertex_indices]
    faces = np.repeat(np.arange(4), 4)
    own = np.broadcast_to(mesh.emission, (4, 3))[faces]
    reflected = np.broadcast_to(mesh.reflectance, (4, 3))[faces] / np.pi
    luminance = solution.illuminance("/World/Mesh") * reflected + own
    assert stored == pytest.approx(tone_map(luminance.astype(np.float32), 40.0), abs=1e-5)


def test_a_hole_shows_no_emission(tmp_path):
    part = cube("/World/Mesh", holes=[2])
    mesh = replace(part[0], emission=np.full((1, 3), 50.0, np.float32))
    source = source_stage(tmp_path / "room.usda", [part])
    writer = ResultsWriter(source, tmp_path / "out.usda", scene_of([mesh]), {})
    writer.write(solution_of([(mesh, part[1])]))
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    shown = np.array(primvars.GetPrimvar("displayColor").ComputeFlattened(1))
    assert not shown[part[1] < 0].any()
    assert shown[part[1] >= 0].all()


def test_display_colour_is_the_view_of_the_surfaces_luminance(tmp_path):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    display = DisplayView(ACES, adaptation=40.0)
    writer = ResultsWriter(source, tmp_path / "out.usda", scene_of([part[0]]), {}, display)
    solution = solution_of([part])
    writer.write(solution)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Mesh"))
    stored = np.array(primvars.GetPrimvar("displayColor").Get(1))[part[0].face_vertex_indices]
    luminance = solution.illuminance("/World/Mesh") * part[0].reflectance / np.pi
    picture = display_colours(luminance.astype(np.float32)[None], adapted_exposure(40.0))[0]
    assert 255 * srgb_encoded(stored) == pytest.approx(picture, abs=0.6)


@pytest.mark.parametrize("where", ["option", "stage"])
def test_the_command_refuses_a_view_that_is_none_before_it_reads(tmp_path, monkeypatch, where):
    monkeypatch.chdir(tmp_path)
    on_stage = where == "stage"
    settings = 'uniform token isolux:displayView = "film"' if on_stage else ""
    write_room(tmp_path / "room.usda", settings)
    option = [] if on_stage else ["--display-view", "film"]
    result = CliRunner().invoke(app, ["solve", "room.usda", "--photons", "100", *option])
    assert result.exit_code == ExitCode.USAGE
    assert ACES in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["room.usda"]


def test_the_command_records_its_view(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_room(tmp_path / "room.usda")
    options = ["--photons", "1000", "--display-view", ACES, "-o", "out.usdc", "--preview"]
    result = CliRunner().invoke(app, ["solve", "room.usda", *options])
    assert result.exit_code == ExitCode.DONE, result.stderr
    provenance, _ = read_report(tmp_path / "out.usdc")
    assert provenance["settings"]["display_view"] == ACES
    assert "preview: out.preview.usdc\n" in result.stdout
    assert Usd.Stage.Open(str(tmp_path / "out.preview.usdc")).GetPrimAtPath("/World/Floor")
