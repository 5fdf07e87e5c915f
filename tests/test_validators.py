"""Isolux's validators, as any host of UsdValidation runs them."""

import os
import subprocess
import sys

import pytest
from pxr import UsdValidation

from isolux.plugin_registration import plugin_folder
from usda_stage import METRES, open_usda

ROOM = """def Xform "World" {
    def Mesh "Room" {
        float3[] extent = [(-2, -2, 0), (2, 2, 3)]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 3)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
    }
    PRIM
}
"""
LUMINAIRE = """def SphereLight "Lamp" ( prepend apiSchemas = ["IsoluxLuminaireAPI"] ) {
        INPUT
    }"""
PLAIN = """def SphereLight "Lamp" ( prepend apiSchemas = ["ShapingAPI"] ) {
        INPUT
    }"""
SETTINGS = """def RenderSettings "Settings" ( prepend apiSchemas = ["IsoluxSolverAPI"] ) {
        INPUT
    }"""
IN_USE = METRES.replace(")", '    renderSettingsPrimPath = "/World/Settings"\n)')
GOOD_IES = """IESNA:LM-63-2002
TILT=NONE
1 1000 1 3 1 1 2 0.1 0.1 0
1 1 30
0 45 90
0
300 200 0
"""
# An axially symmetric diagram of 100 cd all around: 1257 lm.
SPHERE = """float[] inputs:isolux:gammaAngles = [0, 90, 180]
        float[] inputs:isolux:cAngles = [0]
        float[] inputs:isolux:candela = [{0}, {0}, {0}]"""


def complaints(text, metadata=METRES):
    """(severity, validator.message, path) of what Isolux's validators say of a stage."""
    registry = UsdValidation.ValidationRegistry()
    names = [m.name for m in registry.GetValidatorMetadataForKeyword("IsoluxValidators")]
    context = UsdValidation.ValidationContext(registry.GetOrLoadValidatorsByName(names))
    found = []
    stage = open_usda(text, metadata)
    for error in context.Validate(stage):
        (site,) = error.GetSites()
        place = site.GetProperty() if site.IsProperty() else site.GetPrim()
        severity = str(error.GetType()).rsplit(".", maxsplit=1)[-1]
        name = str(error.GetIdentifier()).removeprefix("isolux.validators:")
        assert error.GetMessage().startswith(f"<{place.GetPath()}>: ")
        found.append((severity, name, str(place.GetPath()).removeprefix("/World/")))
    return sorted(found)


def lit(prim, text):
    return ROOM.replace("PRIM", prim.replace("INPUT", text))


@pytest.mark.parametrize(
    ("text", "metadata"),
    [
        (lit(PLAIN, ""), METRES),
        (lit(PLAIN, "float inputs:intensity = 5000"), METRES),
        (lit(LUMINAIRE, "float inputs:isolux:luminousFlux = 800"), METRES),
        (lit(LUMINAIRE, SPHERE.format(100)), METRES),
        (lit(SETTINGS, "uniform double isolux:targetError = 0.01"), IN_USE),
        (lit("", "").replace("-2", "-200").replace("2)", "200)"), METRES.replace("1\n", "0.01\n")),
    ],
    ids=["plain light", "bright light", "flux", "diagram", "settings", "room in centimetres"],
)
def test_a_sound_stage_is_left_alone(text, metadata):
    assert complaints(text, metadata) == []


@pytest.mark.parametrize(
    ("prim", "text", "expected"),
    [
        # The API on the right prim.
        (
            'def Xform "Lamp" ( prepend apiSchemas = ["IsoluxLuminaireAPI"] ) {\n    }',
            "",
            ("Error", "LuminairePrim.NotALight", "Lamp"),
        ),
        (
            'def Scope "Settings" ( prepend apiSchemas = ["IsoluxSolverAPI"] ) {\n    }',
            "",
            ("Error", "SolverPrim.NotRenderSettings", "Settings"),
        ),
        (SETTINGS, "", ("Warn", "SolverPrim.NotInUse", "Settings")),
        (
            PLAIN,
            "float inputs:isolux:luminousFlux = 800",
            ("Error", "AttributeRange.MissingAPI", "Lamp.inputs:isolux:luminousFlux"),
        ),
        # Values.
        (
            LUMINAIRE,
            "float inputs:isolux:luminousFlux = 800\n float inputs:isolux:dimming = -0.5",
            ("Error", "AttributeRange.OutOfRange", "Lamp.inputs:isolux:dimming"),
        ),
        (
            LUMINAIRE,
            "float inputs:isolux:luminousFlux = 800\n float inputs:isolux:dimming = inf",
            ("Error", "AttributeRange.OutOfRange", "Lamp.inputs:isolux:dimming"),
        ),
        (
            LUMINAIRE,
            'float inputs:isolux:luminousFlux = 800\n token inputs:isolux:c0Axis = "north"',
            ("Error", "AttributeRange.OutOfRange", "Lamp.inputs:isolux:c0Axis"),
        ),
        # Files and diagrams.
        (
            LUMINAIRE,
            "asset inputs:isolux:file = @nowhere.ies@",
            ("Error", "PhotometricFile.MissingFile", "Lamp.inputs:isolux:file"),
        ),
        (
            PLAIN,
            "asset inputs:shaping:ies:file = @nowhere.ies@",
            ("Error", "PhotometricFile.MissingFile", "Lamp.inputs:shaping:ies:file"),
        ),
        (
            LUMINAIRE,
            "float[] inputs:isolux:gammaAngles = [0, 90]",
            ("Error", "PhotometricFile.UnusableDiagram", "Lamp.inputs:isolux:candela"),
        ),
        (LUMINAIRE, "", ("Error", "PhotometricFile.NoPhotometry", "Lamp")),
        # Amounts of light.
        (
            LUMINAIRE,
            "float inputs:isolux:luminousFlux = 1e9",
            ("Warn", "LuminaireFlux.ImplausibleFlux", "Lamp.inputs:isolux:luminousFlux"),
        ),
        (LUMINAIRE, SPHERE.format(1e-3), ("Warn", "LuminaireFlux.ImplausibleFlux", "Lamp")),
        (LUMINAIRE, SPHERE.format(1e8), ("Warn", "LuminaireFlux.ImplausibleFlux", "Lamp")),
        (
            PLAIN,
            "float inputs:intensity = 100\n float inputs:exposure = 30",
            ("Warn", "LuminaireFlux.ImplausibleLuminance", "Lamp.inputs:intensity"),
        ),
        (
            PLAIN,
            "float inputs:intensity = 1e9\n bool inputs:normalize = true",
            ("Warn", "LuminaireFlux.ImplausibleFlux", "Lamp.inputs:intensity"),
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_place(prim, text, expected):
    assert complaints(lit(prim, text)) == [expected]


@pytest.mark.parametrize("path", ["/World/Nothing", "/World/Room"])
def test_settings_that_lead_nowhere_are_an_error(path):
    metadata = METRES.replace(")", f'    renderSettingsPrimPath = "{path}"\n)')
    expected = [("Error", "RenderSettings.NoRenderSettings", "/")]
    assert complaints(lit(PLAIN, ""), metadata) == expected


@pytest.mark.parametrize(
    "setting",
    [
        "uniform double isolux:targetError = 0",  # and no other budget
        'uniform token isolux:displayView = "film"',
    ],
)
def test_settings_that_the_solver_refuses_are_an_error(setting):
    expected = [("Error", "RenderSettings.UnusableSettings", "/")]
    assert complaints(lit(SETTINGS, setting), IN_USE) == expected


@pytest.mark.parametrize("metres_per_unit", ["0.01", "100"])
def test_a_room_of_centimetres_or_of_hundreds_of_metres_is_doubted(metres_per_unit):
    metadata = METRES.replace("1\n", f"{metres_per_unit}\n")
    assert complaints(lit(PLAIN, ""), metadata) == [("Warn", "SceneScale.ImplausibleSize", "/")]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (GOOD_IES, []),
        (GOOD_IES.replace("300 200 0", "300"), ["UnreadableFile"]),
        ("no photometry at all", ["UnreadableFile"]),
        (GOOD_IES.replace("1 1000 1 3", "1 100 1 3"), ["DoubtfulFile"]),
    ],
    ids=["sound", "cut short", "no photometry", "flux that its candela do not give"],
)
@pytest.mark.parametrize(
    ("prim", "name"), [(LUMINAIRE, "inputs:isolux:file"), (PLAIN, "inputs:shaping:ies:file")]
)
def test_photometric_files_are_read(tmp_path, content, expected, prim, name):
    file = tmp_path / "lamp.ies"
    file.write_text(content)
    found = complaints(lit(prim, f"asset {name} = @{file}@"))
    assert [row[1] for row in found] == [f"PhotometricFile.{row}" for row in expected]
    assert {row[2] for row in found} <= {f"Lamp.{name}"}


HOST = """
from pxr import Usd, UsdGeom, UsdLux, UsdValidation
registry = UsdValidation.ValidationRegistry()
validators = registry.GetOrLoadAllValidators()
stage = Usd.Stage.CreateInMemory()
lamp = UsdLux.SphereLight.Define(stage, "/Lamp").GetPrim()
lamp.ApplyAPI("IsoluxLuminaireAPI")
UsdGeom.SetStageMetersPerUnit(stage, 1)
errors = UsdValidation.ValidationContext(validators).Validate(stage)
print(sorted(str(e.GetIdentifier()) for e in errors if "isolux" in str(e.GetIdentifier())))
"""


def run_host(script, plugin_path):
    """Output of a Python host that starts without isolux imported."""
    result = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PXR_PLUGINPATH_NAME": str(plugin_path)},
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@pytest.mark.parametrize(
    ("first", "plugin_path"),
    [("", plugin_folder()), ("import isolux", plugin_folder()), ("import isolux", "")],
    ids=["plugin path", "both", "import"],
)
def test_a_host_that_knows_the_plugin_runs_them(first, plugin_path):
    assert (
        run_host(first + HOST, plugin_path) == "['isolux.validators:PhotometricFile.NoPhotometry']"
    )


def test_packages_that_bring_validators_after_isolux_are_not_shut_out(tmp_path):
    info = """{"Plugins": [{"Type": "python", "Name": "studio", "Root": ".", "ResourcePath": ".",
        "Info": {"Validators": {"Naming": {"doc": "Names are names."}}}}]}"""
    (tmp_path / "plugInfo.json").write_text(info)
    script = f"""
import isolux
from pxr import Plug, UsdValidation
Plug.Registry().RegisterPlugins({str(tmp_path)!r})
registry = UsdValidation.ValidationRegistry()
print(registry.GetValidatorMetadata("studio:Naming").doc)
"""
    assert run_host(script, "") == "Names are names."


def test_importing_too_late_is_a_clear_error_and_stops_no_solve():
    script = """
from pxr import UsdValidation
UsdValidation.ValidationRegistry().GetAllValidatorMetadata()
import isolux
try:
    import isolux.validators
except isolux.IsoluxError as error:
    print(error)
"""
    message = run_host(script, "")
    assert "used before isolux was imported" in message
    assert "PXR_PLUGINPATH_NAME" in message
