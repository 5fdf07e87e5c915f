"""Stages that no exporter should write: solved with findings, or refused in one line; never more.

Each of `hostile_stages.CASES` runs through the whole command. None may end in a traceback, hang, or
leave a number in its results that is none.
"""

import signal
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd
from typer.testing import CliRunner

from hostile_stages import CASES
from isolux.cli import ExitCode, app
from isolux.stage_reader import read_stage

SECONDS = 30  # what no stage of a few prims may take, however slow the machine


@pytest.fixture
def bounded_time():
    def give_up(number, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("error")  # of NumPy, which would reach the user's terminal
def test_no_stage_gets_past_its_message(tmp_path: Path, bounded_time, name: str) -> None:
    case = CASES[name]
    for file, contents in case.files.items():
        (tmp_path / file).write_bytes(
            contents if isinstance(contents, bytes) else contents.encode()
        )
    source, output = tmp_path / "stage.usda", tmp_path / "results" / "out.usda"
    output.parent.mkdir()
    options = ["--photons", "500", "--stages", "1", "--method", "dept", "-o", str(output)]
    result = CliRunner().invoke(app, ["solve", str(source), *options])

    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == case.code, result.stderr
    if case.code:
        error = result.stderr.splitlines()[-1]
        assert error.startswith("error: ")
        assert all(words in error for words in case.error), error
        assert list(output.parent.iterdir()) == []
        return
    findings = {(finding.path, finding.action) for finding in read_stage(source).findings}
    assert set(case.findings) <= findings
    assert case.dark in result.stderr
    values = all_values(output)
    assert np.isfinite(values).all()
    assert (values.size > 0) != bool(case.dark)


@pytest.mark.parametrize("share", [0.02, 0.2, 0.4, 0.6, 0.8, 0.99])
def test_a_crate_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(CASES["100 meshes"].files["stage.usda"])
    whole, cut = tmp_path / "whole.usdc", tmp_path / "cut.usdc"
    assert layer.Export(str(whole))
    cut.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
    result = CliRunner().invoke(app, ["check", str(cut)])
    assert result.exit_code == ExitCode.STAGE
    assert "cut.usdc" in result.stderr.splitlines()[-1]


def all_values(results: Path) -> np.ndarray:
    """Every illuminance of a results layer."""
    stage = Usd.Stage.Open(str(results))
    attributes = (prim.GetAttribute("primvars:isolux:illuminance") for prim in stage.Traverse())
    found = [np.ravel(attribute.Get(1.0)) for attribute in attributes if attribute.HasValue()]
    return np.concatenate([np.zeros(0), *found])
