"""The two API schemas as a host meets them: registered, applicable, documented, with defaults."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from pxr import Sdf, Usd, UsdLux

from isolux.plugin_registration import LUMINAIRE_API, SOLVER_API, plugin_folder, register_plugin

ROOT = Path(__file__).resolve().parents[1]
PRIM_TYPE = {LUMINAIRE_API: "SphereLight", SOLVER_API: "RenderSettings"}
LIGHTS = ("SphereLight", "DiskLight", "RectLight", "CylinderLight")


class Row(NamedTuple):
    """One attribute. limits: (minimum, maximum), None where unlimited; tokens: allowed ones."""

    api: str
    name: str
    type_name: str
    default: Any
    authored: Any
    limits: tuple[Any, Any] = (None, None)
    tokens: tuple[str, ...] = ()


METHODS = ("auto", "composite", "dept", "ddl+idept", "ddl+hpr")
OUTPUT_MODES = ("vertex", "refined")
INSTANCES = ("expand", "summary")
ATTRIBUTES = [
    Row(LUMINAIRE_API, "inputs:isolux:file", "asset", Sdf.AssetPath(), Sdf.AssetPath("a.ies")),
    Row(LUMINAIRE_API, "inputs:isolux:gammaAngles", "float[]", [], [0, 45, 90]),
    Row(LUMINAIRE_API, "inputs:isolux:cAngles", "float[]", [], [0, 90]),
    Row(LUMINAIRE_API, "inputs:isolux:candela", "float[]", [], [100, 50, 0, 100, 40, 0]),
    Row(LUMINAIRE_API, "inputs:isolux:luminousFlux", "float", 0, 850, (0, None)),
    Row(LUMINAIRE_API, "inputs:isolux:dimming", "float", 1, 0.5, (0, None)),
    Row(
        LUMINAIRE_API, "inputs:isolux:c0Axis", "token", "+X", "-Y", tokens=("+X", "-X", "+Y", "-Y")
    ),
    Row(SOLVER_API, "isolux:method", "token", "auto", "ddl+hpr", tokens=METHODS),
    Row(SOLVER_API, "isolux:outputMode", "token", "vertex", "refined", tokens=OUTPUT_MODES),
    Row(SOLVER_API, "isolux:instances", "token", "expand", "summary", tokens=INSTANCES),
    Row(SOLVER_API, "isolux:subdivisionThreshold", "double", 0.05, 0.02, (0.001, 1)),
    Row(SOLVER_API, "isolux:subdivisionIterations", "int", 3, 5, (0, 8)),
    Row(SOLVER_API, "isolux:targetError", "double", 0.05, 0.01, (0, 1)),
    Row(SOLVER_API, "isolux:timeBudget", "double", 0, 60, (0, None)),
    Row(SOLVER_API, "isolux:photons", "int64", 0, 10**10, (0, 2**53)),
    Row(SOLVER_API, "isolux:seed", "int", 0, 7, (0, 2**31 - 1)),
    Row(SOLVER_API, "isolux:stages", "int", 8, 16, (1, 64)),
    Row(SOLVER_API, "isolux:filterAccuracy", "double", 0.05, 0.1, (0.001, 1)),
    Row(SOLVER_API, "isolux:filterSharing", "double", 0.25, 0.0, (0, 1)),
    Row(
        SOLVER_API,
        "isolux:filterInterval",
        "token",
        "corrected",
        "paper",
        tokens=("corrected", "paper"),
    ),
    Row(SOLVER_API, "isolux:surfaceLevel", "int", 2, 4, (0, 6)),
    Row(SOLVER_API, "isolux:creaseAngle", "double", 40, 30, (0, 180)),
    Row(SOLVER_API, "isolux:displayView", "token", "tumblin-rushmeier", "sRGB - Display/Raw"),
    Row(SOLVER_API, "isolux:displayAdaptation", "double", 0, 20, (0, None)),
]
each_attribute = pytest.mark.parametrize("row", ATTRIBUTES, ids=lambda row: row.name)


def attribute(stage: Usd.Stage, row: Row) -> Usd.Attribute:
    prim = stage.DefinePrim("/Prim", PRIM_TYPE[row.api])
    assert prim.ApplyAPI(row.api)
    return prim.GetAttribute(row.name)


@pytest.fixture
def stage() -> Usd.Stage:
    return Usd.Stage.CreateInMemory()


@pytest.mark.parametrize("api", PRIM_TYPE)
def test_schema_is_registered_with_the_attributes_of_the_table(api: str) -> None:
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(api)
    assert set(definition.GetPropertyNames()) == {row.name for row in ATTRIBUTES if row.api == api}
    assert definition.GetDocumentation()


@pytest.mark.parametrize(
    ("api", "prim_type"),
    [(SOLVER_API, "RenderSettings"), *((LUMINAIRE_API, light) for light in LIGHTS)],
)
def test_schema_applies_to(stage: Usd.Stage, api: str, prim_type: str) -> None:
    assert stage.DefinePrim("/Prim", prim_type).CanApplyAPI(api)


def test_luminaire_applies_to_a_mesh_made_a_light(stage: Usd.Stage) -> None:
    mesh = stage.DefinePrim("/Panel", "Mesh")
    UsdLux.MeshLightAPI.Apply(mesh)
    assert mesh.CanApplyAPI(LUMINAIRE_API)


@pytest.mark.parametrize(
    ("api", "prim_type"),
    [
        (LUMINAIRE_API, "Mesh"),
        (LUMINAIRE_API, "Xform"),
        (LUMINAIRE_API, "Scope"),
        (LUMINAIRE_API, "RenderSettings"),
        (SOLVER_API, "RenderProduct"),
        (SOLVER_API, "Scope"),
        (SOLVER_API, "SphereLight"),
    ],
)
def test_schema_is_refused_on(stage: Usd.Stage, api: str, prim_type: str) -> None:
    answer = stage.DefinePrim("/Prim", prim_type).CanApplyAPI(api)
    assert not answer
    assert "can only be applied" in answer.whyNot


@each_attribute
def test_default_reads_through_a_prim(stage: Usd.Stage, row: Row) -> None:
    value = attribute(stage, row).Get()
    assert (list(value) if row.default == [] else value) == row.default
    assert attribute(stage, row).GetTypeName() == row.type_name


@each_attribute
def test_authored_value_survives_a_file(stage: Usd.Stage, row: Row, tmp_path: Path) -> None:
    assert attribute(stage, row).Set(row.authored)
    stage.Export(str(tmp_path / "authored.usda"))
    reopened = Usd.Stage.Open(str(tmp_path / "authored.usda"))
    read = reopened.GetPrimAtPath("/Prim")
    assert read.HasAPI(row.api)
    value = read.GetAttribute(row.name).Get()
    if isinstance(row.authored, Sdf.AssetPath):
        assert value.path == row.authored.path
    else:
        assert (list(value) if isinstance(row.authored, list) else value) == row.authored


@each_attribute
def test_limits_are_machine_readable(stage: Usd.Stage, row: Row) -> None:
    limits = attribute(stage, row).GetHardLimits()
    assert (limits.GetMinimum(), limits.GetMaximum()) == row.limits
    assert tuple(attribute(stage, row).GetMetadata("allowedTokens") or ()) == row.tokens


@each_attribute
def test_documentation_says_unit_range_and_default(row: Row) -> None:
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(row.api)
    text = definition.GetPropertyDocumentation(row.name)
    parts = re.fullmatch(r"[A-Z].+ \(Unit: (.+); Range: (.+); Default: (.+)\)\.", text)
    assert parts, text
    unit, interval, default = parts.groups()
    assert unit in {"1", "s", "lm", "cd", "cd/m^2", "degrees", "none"}
    if row.tokens:
        assert interval == ", ".join(row.tokens)
    elif row.limits != (None, None):
        minimum, maximum = row.limits
        assert interval == (f"[{minimum}, inf)" if maximum is None else f"[{minimum}, {maximum}]")
    assert default.startswith(
        "empty" if row.type_name in {"asset", "float[]"} else f"{row.default}"
    )


def test_generated_files_are_up_to_date() -> None:
    pytest.importorskip("jinja2")
    command = [sys.executable, str(ROOT / "tools" / "generate_schema.py"), "--check"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def run_host(script: str, **environment: str) -> str:
    """Output of a Python host that starts without isolux imported."""
    result = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


READ_DIMMING = """
import sys
from pxr import Usd
stage = Usd.Stage.CreateInMemory()
light = stage.DefinePrim("/Light", "SphereLight")
light.ApplyAPI("IsoluxLuminaireAPI")
print(light.GetAttribute("inputs:isolux:dimming").Get(), "isolux" in sys.modules)
"""


def test_child_process_knows_the_schema_without_import() -> None:
    assert run_host(READ_DIMMING) == "1.0 False"


@pytest.mark.parametrize("folder", [plugin_folder(), ROOT / "plugin"], ids=["installed", "source"])
def test_one_plugin_path_makes_schema_and_plugin_known(folder: Path) -> None:
    load = """
from pxr import Plug
plugin = Plug.Registry().GetPluginWithName("isolux")
print(plugin.Load(), sys.modules["isolux"].SolverSettings().stages)
"""
    assert run_host(READ_DIMMING + load, PXR_PLUGINPATH_NAME=str(folder)) == "1.0 False\nTrue 8"


def test_registering_again_adds_no_second_path() -> None:
    before = os.environ["PXR_PLUGINPATH_NAME"]
    register_plugin()
    assert os.environ["PXR_PLUGINPATH_NAME"] == before


def test_importing_too_late_is_a_clear_error() -> None:
    script = """
from pxr import Usd
stage = Usd.Stage.CreateInMemory()
stage.DefinePrim("/Light", "SphereLight").GetAttribute("inputs:radius").Get()
import isolux
try:
    isolux.settings_from_stage(stage)
except isolux.IsoluxError as error:
    print(error)
"""
    message = run_host(script, PXR_PLUGINPATH_NAME="")
    assert "before isolux was imported" in message
    assert "PXR_PLUGINPATH_NAME" in message
