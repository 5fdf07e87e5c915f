"""Results in the hands of a program that has usd-core and nothing of Isolux."""

import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from isolux.cli import ExitCode, app
from small_room import FLOOR, LAMP, WALLS, write_stage

# As a stranger reads primvars: what USD's documentation asks of them, and its validators.
STRANGER = """
import json, math, sys
from pxr import Usd, UsdGeom, UsdRender, UsdValidation

assert "isolux" not in sys.modules
stage = Usd.Stage.Open(sys.argv[1])
stages = int(stage.GetEndTimeCode())
times = [float(time) for time in range(1, stages + 1)]
seen = {}
for prim in stage.Traverse():
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvars():
        name = primvar.GetPrimvarName()
        if not primvar.HasAuthoredValue():
            continue
        mesh = UsdGeom.Mesh(prim)
        counts = mesh.GetFaceVertexCountsAttr().Get()
        indices = mesh.GetFaceVertexIndicesAttr().Get()
        points = len(mesh.GetPointsAttr().Get())
        assert sum(counts) == len(indices) and 0 <= min(indices) and max(indices) < points
        wanted = {"constant": 1, "uniform": len(counts), "varying": points, "vertex": points,
                  "faceVarying": len(indices)}[primvar.GetInterpolation()]
        ours = name.startswith("isolux:") and name != "isolux:sourceFace" or name == "displayColor"
        if ours:
            assert primvar.GetTimeSamples() == times, (name, primvar.GetTimeSamples())
        for time in [Usd.TimeCode.Default(), *primvar.GetTimeSamples()]:
            stored = primvar.Get(time)
            assert stored is not None, name
            if primvar.IsIndexed():
                used = primvar.GetIndices(time)
                assert len(used) == wanted and 0 <= min(used) and max(used) < len(stored)
                assert set(used) == set(range(len(stored))) or not ours
            else:
                assert len(stored) == wanted * primvar.GetElementSize(), (name, time)
            flat = primvar.ComputeFlattened(time)
            assert len(flat) == wanted * primvar.GetElementSize()
            numbers = [c for v in stored for c in (v if hasattr(v, "__len__") else [v])]
            assert all(math.isfinite(number) for number in numbers), name
            if name == "displayColor":
                assert min(numbers) >= 0 and max(numbers) <= 1
        seen.setdefault(str(prim.GetPath()), []).append(name)
settings = UsdRender.Settings.GetStageRenderSettings(stage)
report = settings.GetPrim().GetAttribute("isolux:report:rmsError")
assert report.GetTimeSamples() == times
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(validators).Validate(stage)
print(json.dumps([seen, [e.GetErrorAsString() for e in errors]]))
"""
WITH_UV = FLOOR.replace(
    '"none"',
    '"none"\n        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] '
    '( interpolation = "vertex" )',
)
LOOKS = """    def Scope "Looks" {
        def Material "Grey" {
            token outputs:surface.connect = </World/Looks/Grey/Surface.outputs:surface>
            def Shader "Surface" {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.5, 0.5, 0.5)
                token outputs:surface
            }
        }
    }
"""
SUBSETS = """
        uniform token subsetFamily:materialBind:familyType = "partition"
        def GeomSubset "North" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </World/Looks/Grey>
        }
        def GeomSubset "Others" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1, 2, 3, 4]
            rel material:binding = </World/Looks/Grey>
        }
    }
"""
FIELDS = ["displayColor", "isolux:direct", "isolux:illuminance", "isolux:indirect"]


def extent(mesh, low, high):
    return mesh.replace("{\n", f"{{\n        float3[] extent = [{low}, {high}]\n", 1)


@pytest.mark.parametrize("mode", ["vertex", "refined"])
@pytest.mark.parametrize("preview", [False, True], ids=["results", "preview"])
def test_a_baked_room_is_valid_usd_to_a_stranger(tmp_path, mode, preview):
    low, high = "(-2, -2, 0)", "(2, 2, 3)"
    walls = extent(WALLS, low, high).rstrip().removesuffix("}") + SUBSETS
    stool = FLOOR.replace("Floor", "Stool").replace("2, 0)", "0.4, 1)").replace("2, ", "0.4, ")
    source = write_stage(
        tmp_path / "room.usda",
        extent(WITH_UV, low, "(2, 2, 0)"),
        walls,
        extent(stool, "(-0.4, -0.4, 1)", "(0.4, 0.4, 1)"),
        LAMP,
        LOOKS,
    )
    source.write_text(
        source.read_text().replace("metersPerUnit", 'defaultPrim = "World"\n    metersPerUnit', 1)
    )
    output = tmp_path / "room.isolux.usda"
    options = ["--output-mode", mode, "--photons", "30000", "--stages", "3"]
    options += ["--method", "ddl+idept", "-o", str(output)] + ["--preview"] * preview
    result = CliRunner().invoke(app, ["solve", str(source), *options])
    assert result.exit_code == ExitCode.DONE, result.stderr
    if preview:
        output = tmp_path / "room.isolux.preview.usda"

    environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
    stranger = subprocess.run(
        [sys.executable, "-c", STRANGER, str(output)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert stranger.returncode == 0, stranger.stderr
    seen, errors = json.loads(stranger.stdout)
    assert errors == []
    for mesh in ("Floor", "Walls", "Stool"):
        names = seen[f"/World/{mesh}"]
        assert set(FIELDS) <= set(names)
    # The stool's shadow splits the floor, which keeps its texture coordinates.
    assert ("isolux:sourceFace" in seen["/World/Floor"]) == (mode == "refined")
    assert "st" in seen["/World/Floor"]
