"""Write a sports hall with balconies, lit by any number of small luminaires of one total flux.

python -m usd_scenes.hall.generate OUT.usda [--luminaires N] [--density D]

The hall is 40 x 8 x 24 m: +X along it, +Y up. Balconies run along both sides over colonnades.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import UsdLux

from .. import stage_writing
from ..shapes import box, merge
from ..stage_writing import Part, add_model

LENGTH, HEIGHT, WIDTH = 40.0, 8.0, 24.0  # m
BALCONY_DEPTH, BALCONY_HEIGHT, BALCONY_THICKNESS = 4.0, 3.2, 0.3  # m; height of its underside
PARAPET_HEIGHT, COLUMN, COLUMN_DISTANCE = 1.0, 0.4, 5.0  # m
STEP = 0.4  # m, edge lengths at density 1

LUMINOUS_FLUX = 260_000.0  # lm, of all luminaires together
RADIUS, GAP = 0.06, 0.01  # m, of a luminaire; below what it hangs from
DOWNWARD = (-90.0, 0.0, 0.0)  # nadir (local -Z) to -Y
# Luminaires under the ceiling, the rest in equal parts under the balconies.
CEILING_SHARE = 0.4

REFLECTANCES = {
    "Walls": (0.70, 0.68, 0.62),
    "Concrete": (0.45, 0.45, 0.44),
}


def generate(path: str | Path, luminaires: int = 1000, density: float = 1.0) -> None:
    """Write the stage to `path` (.usda, .usdc); triangles grow with the square of `density`."""
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    step = STEP / density
    hall = box((LENGTH, HEIGHT, WIDTH), step).flipped().moved(LENGTH / 2, HEIGHT / 2, WIDTH / 2)
    add_model(stage, "/World/Hall", [Part("Shell", hall, "Walls", creased=False)])
    add_model(stage, "/World/Balconies", _balconies(step))
    flux = LUMINOUS_FLUX / luminaires
    for number, at in enumerate(luminaire_positions(luminaires), start=1):
        stage_writing.add_light(
            stage, f"/World/Luminaire{number}", UsdLux.DiskLight, {"radius": RADIUS}, at,
            turn=DOWNWARD, luminance=flux / (np.pi**2 * RADIUS**2),
        )  # fmt: skip
    stage_writing.add_render_settings(stage)
    stage.Save()


def luminaire_positions(count: int) -> NDArray[np.float64]:
    """(count, 3) m: even rows under the ceiling and under both balconies."""
    on_ceiling = round(CEILING_SHARE * count)
    left = (count - on_ceiling) // 2
    below = BALCONY_HEIGHT - GAP
    return np.concatenate(
        [
            _rows(on_ceiling, HEIGHT - GAP, (0.0, WIDTH)),
            _rows(left, below, (0.0, BALCONY_DEPTH)),
            _rows(count - on_ceiling - left, below, (WIDTH - BALCONY_DEPTH, WIDTH)),
        ]
    )


def _rows(count: int, height: float, across: Sequence[float]) -> NDArray[np.float64]:
    """Points spread evenly along the hall, in rows about as far apart as their points."""
    low, high = across
    rows = max(1, round(np.sqrt(count * (high - low) / LENGTH)))
    in_row = np.diff(np.arange(rows + 1) * count // rows)
    return np.array(
        [
            ((i + 0.5) / n * LENGTH, height, low + (row + 0.5) / rows * (high - low))
            for row, n in enumerate(in_row)
            for i in range(n)
        ]
    ).reshape(-1, 3)


def _balconies(step: float) -> list[Part]:
    """Slabs with parapets, a little into the walls, on columns."""
    into = 0.05  # m
    depth, edge = BALCONY_DEPTH + into, BALCONY_DEPTH - COLUMN / 2
    slab = box((LENGTH + 2 * into, BALCONY_THICKNESS, depth), step)
    parapet = box((LENGTH + 2 * into, PARAPET_HEIGHT, 0.12), step)
    column = box((COLUMN, BALCONY_HEIGHT + 2 * into, COLUMN), step)
    top = BALCONY_HEIGHT + BALCONY_THICKNESS
    parts = []
    for name, side in (("Left", 1.0), ("Right", -1.0)):
        wall = 0.0 if side > 0 else WIDTH
        centre = LENGTH / 2
        columns = [
            column.moved(x, BALCONY_HEIGHT / 2, wall + side * edge)
            for x in np.arange(COLUMN_DISTANCE / 2, LENGTH, COLUMN_DISTANCE)
        ]
        parts += [
            Part(
                f"{name}Slab",
                slab.moved(
                    centre,
                    BALCONY_HEIGHT + BALCONY_THICKNESS / 2,
                    wall + side * (BALCONY_DEPTH - into) / 2,
                ),
                "Concrete",
            ),
            Part(
                f"{name}Parapet",
                parapet.moved(
                    centre, top + PARAPET_HEIGHT / 2 - into, wall + side * (BALCONY_DEPTH - 0.1)
                ),
                "Walls",
            ),
            Part(f"{name}Columns", merge(*columns), "Concrete"),
        ]
    return parts


def main() -> None:
    """Command line."""
    parser = stage_writing.density_options("Write the hall of many luminaires.")
    parser.add_argument("--luminaires", type=int, default=1000)
    arguments = parser.parse_args()
    generate(arguments.path, arguments.luminaires, arguments.density)


if __name__ == "__main__":
    main()
