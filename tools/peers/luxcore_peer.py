"""LuxCore: its BAKECPU engine bakes a light map, with the path tracer behind it.

Every vertex has a black triangle of its own, some 10⁻⁵ of the scene's size, over one texel: LuxCore
picks triangles by area and points on them by chance, so vertices get as many samples as each other
but for chance. No filter, nothing clamped, 1000 bounces; the photon caches are off, as they are
biased. Luminaires are transparent triangles, which paths meet by luminaire samples alone: one that
shines on a surface 1 cm off costs LuxCore thousands of samples (cornell_sphere). Those with a
goniometric diagram are not translated.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pyluxcore

from .peer_scene import TEXEL_TRIANGLE, Array, LackingError, PeerLuminaire, PeerScene

BOUNCES = 1000
TRIANGLE = 2e-5  # size of a vertex's triangle, of the scene's size
SEGMENTS = 16  # of a disk's rim


class LuxCorePeer:
    """quality : samples a vertex, on average"""

    def __init__(self, scene: PeerScene, threads: int, mode: str) -> None:
        pyluxcore.Init(lambda line: None)
        self._threads = threads
        self._count = len(scene.positions)
        self._count_across = int(np.ceil(np.sqrt(self._count)))
        self._side = self._count_across + 1  # of the map, texels
        self._scene = pyluxcore.Scene()
        self._set(
            {
                "scene.camera.type": "perspective",
                "scene.textures.reflectance.type": "hitpointcolor",
                "scene.materials.black.type": "matte",
                "scene.materials.black.kd": [0.0, 0.0, 0.0],
                "scene.materials.both.type": "matte",
                "scene.materials.both.kd": "reflectance",
                "scene.materials.front.type": "twosided",
                "scene.materials.front.frontmaterial": "both",
                "scene.materials.front.backmaterial": "black",
            }
        )
        for double_sided, material in ((False, "front"), (True, "both")):
            of = scene.double_sided == double_sided
            if of.any():
                colours = np.repeat(scene.reflectance[of], 3, axis=0)
                self._add(material, scene.corners[of], material, colours=colours)
        for number, luminaire in enumerate(scene.luminaires):
            self._add_luminaire(f"luminaire{number}", luminaire)
        self._add_receivers(scene)

    def illuminance(self, quality: int, seed: int) -> Array:
        """(N, 3) lx by channel."""
        with tempfile.TemporaryDirectory() as folder:
            baked = Path(folder) / "baked.exr"
            session = pyluxcore.RenderSession(
                pyluxcore.RenderConfig(
                    _properties(self._settings(quality, seed, baked)), self._scene
                )
            )
            session.Start()
            while not session.HasDone():
                time.sleep(0.02)
                session.UpdateStats()  # where it looks whether it has samples enough
            session.Stop()
            with OpenEXR.File(str(baked)) as file:
                texels = file.channels()["RGB"].pixels[::-1]
            texels = texels[: self._count_across, : self._count_across].reshape(-1, 3)
        return np.pi * texels[: self._count].astype(np.float64)

    def _settings(self, quality: int, seed: int, baked: Path) -> dict[str, Any]:
        return {
            "renderengine.type": "BAKECPU",
            "renderengine.seed": seed + 1,
            "native.threads.count": self._threads,
            "sampler.type": "SOBOL",
            "film.width": self._side,
            "film.height": self._side,
            "film.filter.type": "NONE",
            "film.imagepipelines.0.0.type": "NOP",
            "path.pathdepth.total": BOUNCES,
            "path.pathdepth.diffuse": BOUNCES,
            "path.clamping.variance.maxvalue": 0.0,
            "batch.haltspp": quality,
            "bake.maps.0.type": "LIGHTMAP",
            "bake.maps.0.filename": str(baked),
            "bake.maps.0.imagepipelineindex": 0,
            "bake.maps.0.width": self._side,
            "bake.maps.0.height": self._side,
            "bake.maps.0.objectnames": "receivers",
        }

    def _add_receivers(self, scene: PeerScene) -> None:
        """The vertices' triangles, each over a texel of its own."""
        number = np.arange(self._count)
        texels = np.stack([number % self._count_across, number // self._count_across], axis=1)
        # Pixels begin half a texel late, so the last ones would come round to the first.
        uvs = (texels[:, None] + 1.0 + TEXEL_TRIANGLE) / self._side
        uvs[..., 1] = 1.0 - uvs[..., 1]
        self._add("receivers", scene.receiver_triangles(TRIANGLE), "black", uvs=uvs.reshape(-1, 2))

    def _add_luminaire(self, name: str, luminaire: PeerLuminaire) -> None:
        if luminaire.candela is not None or luminaire.shape not in ("rect", "disk"):
            raise LackingError("LuxCore is given rectangles and disks without a diagram")
        self._set(
            {
                f"scene.materials.{name}.type": "matte",
                f"scene.materials.{name}.kd": [0.0, 0.0, 0.0],
                f"scene.materials.{name}.transparency": 0.0,
                f"scene.materials.{name}.emission": luminaire.luminance.tolist(),
            }
        )
        width, height = luminaire.size
        if luminaire.shape == "rect":
            rim = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (width / 2, height / 2)
        else:
            turn = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
            # Of the disk's area.
            radius = width / np.sqrt(np.sin(2 * np.pi / SEGMENTS) * SEGMENTS / (2 * np.pi))
            rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        x, y, _ = luminaire.axes
        outline = luminaire.origin + rim[:, :1] * x - rim[:, 1:] * y  # it shines to its −Z
        fan = [
            np.stack([outline[0], outline[k], outline[k + 1]]) for k in range(1, len(outline) - 1)
        ]
        self._add(name, np.array(fan), name)

    def _add(
        self, name: str, corners: Array, material: str,
        colours: Array | None = None, uvs: Array | None = None,
    ) -> None:  # fmt: skip
        """An object of triangles that share no corner."""
        points = corners.reshape(-1, 3)
        triangles = np.arange(len(points)).reshape(-1, 3)
        self._scene.DefineMesh(
            name, _tuples(points), _tuples(triangles), None,
            None if uvs is None else _tuples(uvs),
            None if colours is None else _tuples(colours), None,
        )  # fmt: skip
        self._set({f"scene.objects.{name}.shape": name, f"scene.objects.{name}.material": material})

    def _set(self, values: dict[str, Any]) -> None:
        self._scene.Parse(_properties(values))


def _tuples(rows: Array) -> list[tuple[float, ...]]:
    return [tuple(row) for row in rows.tolist()]


def _properties(values: dict[str, Any]) -> Any:
    properties = pyluxcore.Properties()
    for name, value in values.items():
        properties.Set(pyluxcore.Property(name, value))
    return properties
