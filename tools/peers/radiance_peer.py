"""Radiance: `rtrace -I` at the vertices, with ambient caching and without.

Luminaires are `illum` without an alternate material: they stop no light. Their diagrams, and the
backs of one-sided surfaces, which absorb, are patterns of `PATTERNS`. Radiometric values are put in
as cd/m² and come out as lx.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pyradiance

from .peer_scene import C_COUNT, GAMMA_COUNT, Array, LackingError, PeerLuminaire, PeerScene

PROGRAMS = Path(pyradiance.__file__).parent / "bin"
LIBRARY = Path(pyradiance.__file__).parent / "lib"
PATTERNS = """{ of the luminaire's axes A1..A9, towards the point }
front = if(Rdot, 1, 0);
local(a, b, c) = -(Dx * a + Dy * b + Dz * c);
down = -local(arg(7), arg(8), arg(9));
gamma_of = Acos(down) * 180 / PI;
around = atan2(local(arg(4), arg(5), arg(6)), local(arg(1), arg(2), arg(3))) * 180 / PI;
c_of = if(around, around, around + 360);
over_area(v) = v * arg(10);
over_flat_area(v) = v * arg(10) / if(abs(down) - 1e-6, abs(down), 1e-6);
"""
# Every luminaire is tested, and its size sampled.
DIRECT = ("-dt", "0", "-dc", "1", "-ds", "0.1", "-dj", "0.9", "-dr", "0")
CACHE_ACCURACY = {64: 0.3, 256: 0.2, 1024: 0.12, 4096: 0.07}  # by ambient divisions


class RadiancePeer:
    """quality : ambient divisions

    mode : "cached" for ambient caching
    """

    def __init__(self, scene: PeerScene, threads: int, mode: str) -> None:
        self._threads, self._cached = threads, mode == "cached"
        self._folder = tempfile.TemporaryDirectory()
        self._path = Path(self._folder.name)
        self._environment = {**os.environ, "RAYPATH": f"{self._path}:{LIBRARY}"}
        (self._path / "patterns.cal").write_text(PATTERNS, encoding="ascii")
        text = [*_surfaces(scene)]
        for number, luminaire in enumerate(scene.luminaires):
            text += self._luminaire(f"luminaire{number}", luminaire)
        (self._path / "scene.rad").write_text("\n".join(text), encoding="ascii")
        with (self._path / "scene.oct").open("wb") as octree:
            subprocess.run(
                [PROGRAMS / "oconv", "-f", "scene.rad"],
                cwd=self._path, env=self._environment, stdout=octree, check=True,
            )  # fmt: skip
        self._rays = np.concatenate([scene.positions, scene.normals], axis=1)

    def illuminance(self, quality: int, seed: int) -> Array:
        """(N, 3) lx by channel."""
        # There is no seed; the order of the points stands for one.
        order = np.random.default_rng(seed).permutation(len(self._rays))
        found = subprocess.run(
            [
                PROGRAMS / "rtrace", "-I", "-h", "-fdf", "-n", str(self._threads), *DIRECT,
                *self._ambient(quality), "scene.oct",
            ],
            cwd=self._path, env=self._environment, input=self._rays[order].tobytes(),
            stdout=subprocess.PIPE, check=True,
        )  # fmt: skip
        values = np.empty((len(order), 3))
        values[order] = np.frombuffer(found.stdout, np.float32).reshape(-1, 3)
        return values

    def _ambient(self, divisions: int) -> list[str]:
        if not self._cached:
            # Without a limit of bounces, and about one ray for each that a hit weighs.
            return [
                "-u+", "-aa", "0", "-ab", "64", "-ad", str(divisions), "-as", "0",
                "-lr", "-64", "-lw", f"{1 / divisions:g}",
            ]  # fmt: skip
        (self._path / "cache.amb").unlink(missing_ok=True)
        return [
            "-u-", "-aa", str(CACHE_ACCURACY[divisions]), "-ar", "256", "-ab", "10",
            "-ad", str(divisions), "-as", str(divisions // 2), "-lr", "10", "-lw", "1e-4",
            "-af", "cache.amb",
        ]  # fmt: skip

    def _luminaire(self, name: str, luminaire: PeerLuminaire) -> list[str]:
        """Pattern, material and shape."""
        x, y, z = luminaire.axes
        width, height = luminaire.size
        colour, pattern, text = luminaire.luminance, "void", []
        if luminaire.candela is not None:
            flat = luminaire.shape in ("rect", "disk")
            if flat and luminaire.candela[:, GAMMA_COUNT // 2 + 2 :].any():
                raise LackingError("Radiance has no flat light that shines to both sides")
            table = self._path / f"{name}.dat"
            head = f"2\n0 360 {C_COUNT}\n0 180 {GAMMA_COUNT}\n"
            values = "\n".join(f"{value:.7g}" for value in luminaire.candela.ravel())
            table.write_text(head + values, encoding="ascii")
            area = luminaire.area if flat else luminaire.area / 4
            function = "over_flat_area" if flat else "over_area"
            pattern, colour = f"{name}_pattern", luminaire.colour
            numbers = [*luminaire.axes.ravel(), 1 / area]
            text.append(
                f"void brightdata {pattern}\n5 {function} {table.name} patterns.cal c_of gamma_of\n"
                f"0\n{_numbers(numbers)}"
            )
        text.append(f"{pattern} illum {name}_light\n1 void\n0\n{_numbers(colour)}")
        if luminaire.shape == "sphere":
            kind, numbers = "sphere", [*luminaire.origin, width]
        elif luminaire.shape == "disk":
            kind, numbers = "ring", [*luminaire.origin, *-z, 0.0, width]
        elif luminaire.shape == "cylinder":
            ends = (luminaire.origin + side * x * height / 2 for side in (-1, 1))
            kind, numbers = "cylinder", [*np.concatenate([*ends]), width]
        else:
            corners = [(-1, -1), (-1, 1), (1, 1), (1, -1)]  # seen from −Z
            at = [luminaire.origin + x * width / 2 * i + y * height / 2 * j for i, j in corners]
            kind, numbers = "polygon", [*np.concatenate(at)]
        text.append(f"{name}_light {kind} {name}\n0\n0\n{_numbers(numbers)}")
        return text


def _numbers(values: object) -> str:
    numbers = np.asarray(values, np.float64).ravel()
    return f"{len(numbers)} " + " ".join(f"{number:.9g}" for number in numbers)


def _surfaces(scene: PeerScene) -> list[str]:
    """A material for every reflectance, and the triangles."""
    text = ["void brightfunc one_sided\n2 front patterns.cal\n0\n0"]
    known = np.column_stack([scene.reflectance, scene.double_sided])
    materials, of = np.unique(known, axis=0, return_inverse=True)
    for number, (*reflectance, double_sided) in enumerate(materials):
        pattern = "void" if double_sided else "one_sided"
        text.append(
            f"{pattern} plastic surface{number}\n0\n0\n{_numbers([*reflectance, 0.0, 0.0])}"
        )
    for number, (material, corners) in enumerate(zip(of.ravel(), scene.corners, strict=True)):
        text.append(f"surface{material} polygon t{number}\n0\n0\n{_numbers(corners)}")
    return text
