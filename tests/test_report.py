"""The report as the results file tells it, and as JSON."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

from hand_built import cube, scene_of, solution_of, source_stage
from isolux.errors import SceneError
from isolux.report import PhaseSeconds, read_report, write_report
from isolux.results import ResultsWriter
from isolux.scene_description import Finding

PROVENANCE = {
    "version": "1.2.3",
    "seed": 2**53,
    "threads": 2,
    "settings": {"targetError": 0.05, "photons": None, "paper": False, "thresholds": [0.1, 2.0]},
}


@pytest.fixture
def baked(tmp_path):
    """The output of three stages, and the stages."""
    part = cube("/World/Mesh")
    source_stage(tmp_path / "room.usda", [part])
    output = tmp_path / "baked.usda"
    writer = ResultsWriter(tmp_path / "room.usda", output, scene_of([part[0]]), PROVENANCE)
    solutions = [solution_of([part], index) for index in (1, 2, 3)]
    solutions[1] = replace(
        solutions[1], stage=replace(solutions[1].stage, rms_error_indirect=math.inf)
    )
    for solution in solutions:
        writer.write(solution)
    return output, [solution.stage for solution in solutions]


@pytest.mark.parametrize("name", ["baked.usda", "baked.results.usdc"])
def test_the_file_tells_its_stages_exactly(baked, name):
    output, stages = baked
    provenance, found = read_report(output.with_name(name))
    assert found == stages
    assert provenance.pop("reportPrim") == "/Render/Isolux"
    assert provenance == {
        "version": "1.2.3",
        "seed": 2**53,
        "threads": 2,
        "settings": {"targetError": 0.05, "paper": False, "thresholds": [0.1, 2.0]},
        "sourceHash": "f00d",
        "steps": {name: [] for name in ("component", "photons", "rays", "iteration", "shown")},
    }


def test_the_report_needs_no_source(baked):
    output, stages = baked
    (output.parent / "room.usda").unlink()
    assert read_report(output)[1] == stages


def no_usd(path):
    path.write_text("#usda 1.0\n(")


def no_results(path):
    Usd.Stage.CreateNew(str(path)).Save()


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda path: None, "no such file"),
        (no_usd, "no USD file"),
        (no_results, "no Isolux results"),
    ],
)
def test_a_file_without_results_is_refused_by_name(tmp_path, make, found):
    path = tmp_path / "other.usda"
    make(path)
    with pytest.raises(SceneError, match=f"other.usda: found {found}"):
        read_report(path)


def test_the_json_report_tells_the_whole_run(tmp_path):
    stages = [solution_of([cube("/World/Mesh")], index).stage for index in (1, 2)]
    stages[0] = replace(stages[0], batch_rms_error=math.nan)
    finding = Finding("/World/Curve", "BasisCurves", "skipped", "curves have no surface")
    scene = replace(scene_of([cube("/World/Mesh")[0]]), findings=(finding,))
    write_report(tmp_path / "r.json", scene, stages, PROVENANCE, PhaseSeconds(0.1, 0.2, 30.0, 0.4))
    report = json.loads((tmp_path / "r.json").read_text())
    assert (report["version"], report["seed"], report["threads"]) == ("1.2.3", 2**53, 2)
    assert report["seconds"] == {"read": 0.1, "build": 0.2, "solve": 30.0, "write": 0.4}
    assert report["findings"][0]["path"] == "/World/Curve"
    assert report["findings"][0]["reason"] == "curves have no surface"
    first, second = report["stages"]
    assert first["component"] == "DEPT"
    assert second["photons"] == 2**40 + 2
    assert second["elapsed_seconds"] == 1.0
    assert first["batch_rms_error"] is None  # JSON has no NaN
    assert np.isclose(second["rms_error_indirect"], 0.1)


def test_a_report_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"missing/r\.json: found No such file"):
        write_report(
            tmp_path / "missing/r.json", scene_of([]), [], PROVENANCE, PhaseSeconds(0, 0, 0, 0)
        )
