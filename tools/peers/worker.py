"""One peer in a process of its own: python -m peers.worker PEER SCENE.npz FOLDER [--threads N]

Reads runs as lines `quality seed` and answers each with a line of JSON once its illuminance is in
FOLDER/QUALITY_SEED.npy.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np

from .peer_scene import LackingError, PeerScene

# Module and class, and the mode in which it is run.
PEERS = {
    "mitsuba": ("mitsuba_peer", "MitsubaPeer", ""),
    "cycles": ("cycles_peer", "CyclesPeer", ""),
    "luxcore": ("luxcore_peer", "LuxCorePeer", ""),
    "radiance": ("radiance_peer", "RadiancePeer", ""),
    "radiance-cached": ("radiance_peer", "RadiancePeer", "cached"),
}


def processor_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def main() -> None:
    started = time.perf_counter()
    parser = argparse.ArgumentParser()
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("scene", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # some peers talk
    module, name, mode = PEERS[options.peer]
    peer_type = getattr(importlib.import_module(f".{module}", __package__), name)
    scene = PeerScene.load(options.scene)
    read, read_cpu = time.perf_counter(), processor_seconds()

    def answer(**values: float | str) -> None:
        print(json.dumps(values), file=answers, flush=True)

    try:
        peer = peer_type(scene, options.threads, mode)
    except LackingError as error:
        answer(lacking=str(error))
        return
    answer(
        start=read - started,
        start_cpu=read_cpu,
        build=time.perf_counter() - read,
        build_cpu=processor_seconds() - read_cpu,
    )
    for line in sys.stdin:
        quality, seed = map(int, line.split())
        began, began_cpu = time.perf_counter(), processor_seconds()
        values = peer.illuminance(quality, seed)
        seconds, cpu = time.perf_counter() - began, processor_seconds() - began_cpu
        np.save(options.folder / f"{quality}_{seed}.npy", values)
        answer(solve=seconds, solve_cpu=cpu)


if __name__ == "__main__":
    main()
