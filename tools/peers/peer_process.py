"""A peer at work in a process of its own."""

from __future__ import annotations

import json
import select
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from .peer_scene import Array, LackingError, PeerScene

# Qualities that differ by about four in time; what they count is said in each peer's module.
QUALITIES: dict[str, tuple[int, ...]] = {
    "mitsuba": (4, 16, 64, 256, 1024, 4096),
    "cycles": (4, 16, 64, 256, 1024, 4096),
    "luxcore": (4, 16, 64, 256, 1024, 4096),
    "radiance": (4, 16, 64, 256, 1024, 4096),
    "radiance-cached": (64, 256, 1024, 4096),
}
NAMES = {
    "mitsuba": "Mitsuba 3",
    "cycles": "Cycles",
    "luxcore": "LuxCore",
    "radiance": "Radiance, no cache",
    "radiance-cached": "Radiance, ambient cache",
}


@dataclass(frozen=True, slots=True)
class Seconds:
    """wall, processor : of one piece of work, all threads together in the latter"""

    wall: float
    processor: float


class PeerProcess:
    """Starts one peer, builds the scene there, and asks it for illuminance.

    python : an interpreter that has the peer
    start : imports and reading the arrays
    build : of what the peer needs before the first ray, kernels included
    raises : LackingError where the peer can't do the scene
    """

    def __init__(self, peer: str, scene: PeerScene, threads: int, python: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name)
        scene.save(path / "scene.npz")
        self._count = len(scene.positions)
        self._process = subprocess.Popen(
            [
                Path(python).absolute(), "-m", "peers.worker", peer, path / "scene.npz", path,
                "--threads", str(threads),
            ],
            cwd=Path(__file__).parents[1], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        first = self._answer()
        if "lacking" in first:
            self._close()
            raise LackingError(first["lacking"])
        self.start = Seconds(first["start"], first["start_cpu"])
        self.build = Seconds(first["build"], first["build_cpu"])

    def illuminance(
        self, quality: int, seed: int, longest: float | None = None
    ) -> tuple[Array, Seconds]:
        """(N, 3) lx by channel at the scene's points, and how long it took.

        longest : s to wait
        raises : LackingError where it takes longer; the peer is ended
        """
        assert self._process.stdin is not None
        self._process.stdin.write(f"{quality} {seed}\n")
        self._process.stdin.flush()
        if not select.select([self._process.stdout], [], [], longest)[0]:
            self._process.kill()
            raise LackingError(f"quality {quality} takes over {longest:.0f} s")
        answer = self._answer()
        file = Path(self._folder.name) / f"{quality}_{seed}.npy"
        values = np.load(file)
        file.unlink()
        assert values.shape == (self._count, 3)
        return values, Seconds(answer["solve"], answer["solve_cpu"])

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"the peer ended with {self._process.wait()}")
        return json.loads(line)  # type: ignore[no-any-return]

    def __enter__(self) -> PeerProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    def _close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._folder.cleanup()
