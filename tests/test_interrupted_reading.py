"""Ctrl-C while a large stage is read: exit code 130, a word, and no file."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pxr import Sdf

from small_room import FLOOR, LAMP


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thousands of meshes: seconds of reading."""
    path = tmp_path_factory.mktemp("large") / "large.usdc"
    floors = "".join(FLOOR.replace("Floor", f"Floor{number}") for number in range(5000))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(f"#usda 1.0\n{floors}{LAMP}")
    assert layer.Export(str(path))
    return path


@pytest.mark.parametrize("command", ["solve", "check"])
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_reading_ends_the_command(tmp_path, large, command, sent):
    run = subprocess.Popen(
        [sys.executable, "-m", "isolux", command, str(large)],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    opened = str(large)
    until = time.monotonic() + 60
    while opened not in open_files(run.pid) and time.monotonic() < until:
        time.sleep(0.005)
    time.sleep(0.1)
    run.send_signal(sent)
    _, messages = run.communicate(timeout=60)
    assert "Traceback" not in messages
    assert run.returncode == (130 if sent == signal.SIGINT else -signal.SIGTERM), messages
    assert list(tmp_path.iterdir()) == []


def open_files(pid: int) -> str:
    """Files that a process has mapped into its memory."""
    try:
        return Path(f"/proc/{pid}/maps").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return ""
