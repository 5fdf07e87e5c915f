"""Results opened by a process that has usd-core alone: all prims there, all our primvars valid."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Usd, UsdGeom
from typer.testing import CliRunner
from usd_scenes.hills.generate import generate as generate_hills
from usd_scenes.spot_room.generate import generate as generate_spot_room

from isolux.cli import app

# What a reader without Isolux sees, as JSON: no line of it imports isolux.
READER = """
import json, sys
import numpy as np
from pxr import Usd, UsdGeom

source, results = (Usd.Stage.Open(path) for path in sys.argv[1:])
assert "isolux" not in sys.modules
faults = [
    f"{prim.GetPath()} is gone"
    for prim in source.TraverseAll()
    if prim.IsDefined() and not results.GetPrimAtPath(prim.GetPath()).IsDefined()
]
stages, primvars = set(), 0
for prim in results.Traverse():
    for name in prim.GetPropertyNames():
        attribute = prim.GetAttribute(name)
        for time in attribute.GetTimeSamples() if attribute else ():
            if attribute.Get(time) is None:
                faults.append(f"{attribute.GetPath()} holds nothing at {time}")
    if not prim.IsA(UsdGeom.Mesh):
        continue
    mesh = UsdGeom.Mesh(prim)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    points = len(mesh.GetPointsAttr().Get())
    if counts.sum() != len(indices) or indices.min() < 0 or indices.max() >= points:
        faults.append(f"{prim.GetPath()} has no sound topology")
    wanted = {"constant": 1, "uniform": len(counts), "vertex": points, "varying": points,
              "faceVarying": len(indices)}
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvars():
        ours = primvar.GetPrimvarName().startswith("isolux:") or (
            primvar.GetPrimvarName() == "displayColor" and primvar.GetTimeSamples())
        if not (ours and primvar.HasAuthoredValue()):
            continue
        primvars += 1
        stages.add(tuple(primvar.GetTimeSamples()))
        path = primvar.GetAttr().GetPath()
        for time in primvar.GetTimeSamples():
            values = np.asarray(primvar.ComputeFlattened(time), float)
            listed = primvar.GetIndices(time)
            stored = len(primvar.Get(time))
            if listed and not (0 <= min(listed) and max(listed) < stored):
                faults.append(f"{path} at {time}: an index out of range")
            kind = primvar.GetInterpolation()
            if len(values) != wanted[kind]:
                faults.append(f"{path} at {time}: {len(values)} {kind} values")
            if not (np.isfinite(values).all() and values.min() >= 0):
                faults.append(f"{path} at {time}: a value that is none")
print(json.dumps({"faults": faults, "primvars": primvars, "stages": sorted(stages)}))
"""


def seen_by_usd_core(source: Path, results: Path) -> dict:
    done = subprocess.run(
        [sys.executable, "-c", READER, str(source), str(results)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("generate", "suffix", "mode"),
    [
        pytest.param(generate_spot_room, ".usda", "refined", id="spot_room, refined"),
        pytest.param(
            lambda path: generate_hills(path, 100, 4, normals=True), ".usdc", "vertex", id="hills"
        ),
    ],
)
def test_results_are_whole_without_isolux(tmp_path: Path, generate, suffix: str, mode: str) -> None:
    source, results = tmp_path / f"source{suffix}", tmp_path / f"out{suffix}"
    generate(source)
    options = ["--photons", "2000", "--stages", "3", "--output-mode", mode, "-o", str(results)]
    solved = CliRunner().invoke(app, ["solve", str(source), *options])
    assert solved.exit_code == 0, solved.stderr
    seen = seen_by_usd_core(source, results)
    assert seen["faults"] == []
    opened = Usd.Stage.Open(str(source))
    meshes = [prim for prim in opened.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert seen["primvars"] >= 4 * len(meshes)
    (times,) = [times for times in seen["stages"] if times]  # the same of all that have any
    assert times == [float(index) for index in range(1, len(times) + 1)]
