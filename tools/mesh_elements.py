"""Mesh elements that the adaptive mesh needs, by what its oracle knows of indirect light.

    python tools/mesh_elements.py [--threshold T] [--iterations N] [STAGE ...]

Without stages: the spot room and the office. The paper's room of 30,200 triangles [Volevich 2000,
§4] came to 121,000 with direct light alone, 97,000 with a constant ambient term and 86,000 with
photons' indirect light. Beside the elements stands what they leave: the share of the lit surfaces'
area where the picture under total light is off by more than the threshold.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usd_scenes.office.generate import generate as generate_office
from usd_scenes.spot_room.generate import generate as generate_spot_room

from isolux import _core
from isolux.core_scene import build_core_scene, mesh_triangles
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.stage_reader import read_stage

GENERATED = {"spot room": generate_spot_room, "office": generate_office}
PHOTONS = 1_000_000
CHECKED_POINTS = 100_000
DISPLAY_GAMMA = 2.2

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Row:
    """One oracle on one stage."""

    oracle: str
    elements: list[int]  # after each iteration
    samples: int
    shadow_rays: int
    left: float  # share of the area


class Stage:
    """A scene with its direct light at the vertices and its light by photons."""

    def __init__(self, scene: SceneDescription, threads: int) -> None:
        settings = SolverSettings()
        self.threads = threads
        self.core = build_core_scene(scene, settings, threads)
        self.reflectance = _element_reflectance(scene)
        self.lighting = _core.DirectLighting(self.core, settings.seed, 0.01)
        self.lit = self.illuminate(
            self.core.receiver_positions,
            self.core.vertex_normals,
            np.zeros(0, np.float32),
        )
        buckets = _core.PhotonBuckets(self.core)
        _core.trace_photons(self.core, buckets, settings.seed, 0, PHOTONS, threads)
        self.filtered = _core.IlluminationFilter(self.core).filter(
            self.core, buckets, settings.filter_accuracy, settings.filter_sharing, False, threads
        )
        refinement = _core.MeshRefinement(self.core)
        base = refinement.mesh()["elements"]
        total = self.lit["illuminance"] + self.filtered["indirect"]
        corners = self.core.vertex_positions[base]
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        luminance = (self.reflectance * total[base].mean(axis=1)) @ LUMINANCE_WEIGHTS / np.pi
        self.adaptation = _core.adaptation_luminance(luminance, areas / 2)

    def illuminate(
        self, positions: Array, normals: NDArray[np.float32], indirect: NDArray[np.float32]
    ) -> dict:
        """Direct light at receivers."""
        return self.lighting.illuminate(positions, normals, indirect, self.threads)

    def ambient(self) -> NDArray[np.float32]:
        """Mean indirect light, at all vertices [Gibson and Hubbold 1997]."""
        indirect = self.filtered["indirect"]
        mean = np.average(indirect, axis=0, weights=self.core.vertex_areas)
        return np.broadcast_to(mean, indirect.shape).astype(np.float32)

    def refine(
        self,
        oracle: str,
        indirect: NDArray[np.float32],
        threshold: float,
        iterations: int,
        *,
        regional: bool = False,
    ) -> Row:
        """A run of its own, without samples kept from others."""
        refinement = _core.MeshRefinement(self.core)
        direct, error = self.lit["illuminance"], self.lit["standard_error"]
        photons = self.filtered["direct"], self.filtered["direct_relative_deviation"]
        none = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        refinement.begin(
            direct,
            error,
            np.ascontiguousarray(indirect),
            self.adaptation,
            threshold,
            *(photons if regional else none),
        )
        elements, samples, rays = [], 0, 0
        for _ in range(iterations):
            while len((wanted := refinement.wanted_samples())["positions"]):
                lit = self.illuminate(**wanted)
                refinement.add_samples(lit["illuminance"], lit["standard_error"])
                samples += len(wanted["positions"])
                rays += lit["shadow_rays"]
            refinement.split()
            elements.append(refinement.element_count)
        return Row(oracle, elements, samples, rays, self.share_left(refinement.mesh(), threshold))

    def share_left(self, mesh: dict, threshold: float) -> float:
        """Share of the area where interpolated and true light differ in the picture."""
        rng = np.random.default_rng(1)
        corners = mesh["vertex_positions"][mesh["elements"]]
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        chosen = rng.choice(len(areas), CHECKED_POINTS, p=areas / areas.sum())
        u, v = rng.random((2, CHECKED_POINTS))
        weights = np.stack([1 - np.sqrt(u), np.sqrt(u) * (1 - v), np.sqrt(u) * v], axis=1)
        vertices, parents = mesh["elements"][chosen], mesh["element_parents"][chosen]

        def blended(values: Array, at: NDArray[np.int32], by: Array) -> Array:
            return np.einsum("nk,nkc->nc", by, values[at])

        # The indirect light is that of the scene's vertices, as it is on the refined mesh.
        in_parent = np.einsum("nk,nkw->nw", weights, mesh["barycentrics"][chosen])
        base = _core.MeshRefinement(self.core).mesh()["elements"]
        indirect = blended(self.filtered["indirect"], base[parents], in_parent)
        shown = blended(mesh["direct"], vertices, weights)
        normals = blended(mesh["vertex_normals"], vertices, weights)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        true = self.illuminate(
            blended(mesh["receiver_positions"], vertices, weights),
            normals.astype(np.float32),
            np.zeros(0, np.float32),
        )["illuminance"]
        pictures = [
            self.picture((light + indirect) * self.reflectance[parents] / np.pi)
            for light in (shown, true)
        ]
        return float((np.abs(pictures[0] - pictures[1]) > threshold).mean())

    def picture(self, luminance: Array) -> Array:
        """What the display shows of a luminance (n, 3), grey, after gamma."""
        grey = np.repeat((luminance @ LUMINANCE_WEIGHTS)[:, None], 3, axis=1).astype(np.float32)
        return _core.tone_map(grey, self.adaptation)[:, 0] ** (1 / DISPLAY_GAMMA)


def _element_reflectance(scene: SceneDescription) -> Array:
    """(T, 3) of each element of the scene."""
    parts = []
    for mesh in scene.meshes:
        _, faces = mesh_triangles(mesh)
        by_face = len(mesh.reflectance) > 1
        parts.append(mesh.reflectance[faces if by_face else np.zeros(len(faces), int)])
    return np.concatenate(parts).astype(float)


def measure(name: str, path: Path, threshold: float, iterations: int, threads: int) -> None:
    """A Markdown table of one stage."""
    stage = Stage(read_stage(str(path)), threads)
    indirect = stage.filtered["indirect"]
    oracles = {
        "direct": (np.zeros_like(indirect), False),
        "direct + constant ambient": (stage.ambient(), False),
        "direct + DEPT indirect": (indirect, False),
        "direct + DEPT indirect, against DDEPT": (indirect, True),
    }
    print(f"\n{name}: {stage.core.element_count:,} triangles, threshold {threshold:g}\n")
    columns = [f"elements after {i + 1}" for i in range(iterations)]
    print(" | ".join(["| oracle", *columns, "samples", "shadow rays", "area left |"]))
    print("|---" * (iterations + 4) + "|")
    for oracle, (light, regional) in oracles.items():
        row = stage.refine(oracle, light, threshold, iterations, regional=regional)
        counts = [f"{count:,}" for count in (*row.elements, row.samples, row.shadow_rays)]
        print(" | ".join([f"| {oracle}", *counts, f"{row.left:.2%} |"]), flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stages", nargs="*", type=Path, metavar="STAGE")
    parser.add_argument("--threshold", type=float, default=0.05, help="of displayed brightness")
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        stages = {path.stem: path for path in options.stages}
        if not stages:
            for name, generate in GENERATED.items():
                stages[name] = Path(folder) / f"{name.replace(' ', '_')}.usdc"
                generate(stages[name])
        for name, path in stages.items():
            measure(name, path, options.threshold, options.iterations, options.threads)


if __name__ == "__main__":
    main()
