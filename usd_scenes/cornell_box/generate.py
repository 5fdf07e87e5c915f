"""Write a box in the manner of Cornell's: five walls, two of them coloured, and two boxes.

    python -m usd_scenes.cornell_box.generate OUT.usda [--density D]

2.75 x 2.75 x 2.8 m, open at the front: +X to the right, +Y up, the back wall at z = 0.
"""

from __future__ import annotations

import math
from pathlib import Path

from pxr import Usd, UsdLux

from .. import stage_writing
from ..shapes import Shape, box, rectangle, with_opening
from ..stage_writing import Part, add_model

WIDTH, HEIGHT, DEPTH = 2.75, 2.75, 2.80  # m
LIGHT_SIZE = (0.65, 0.53)  # m, along X and Z
LUMINOUS_FLUX = 3000.0  # lm
STEP = 0.056  # m, edge length at density 1

DOWNWARD = (-90.0, 0.0, 0.0)  # from local -Z to -Y

# Diffuse reflectance, linear Rec. 709.
REFLECTANCES = {
    "White": (0.74, 0.73, 0.68),
    "Red": (0.58, 0.06, 0.05),
    "Green": (0.12, 0.42, 0.10),
}


def generate(path: str | Path, density: float = 1.0) -> None:
    """Write the stage to `path` (.usda, .usdc); triangles grow with the square of `density`."""
    step = STEP / density
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    add_model(stage, "/World/Room", _room(step))
    for name, size, at, turn in (
        ("ShortBox", (0.82, 0.82, 0.82), (1.85, 0, 1.90), -17),
        ("TallBox", (0.82, 1.65, 0.82), (0.92, 0, 1.05), 18),
    ):
        add_model(stage, f"/World/{name}", [Part(name, _box(size, step), "White")], at, turn)
    _add_light(stage)
    stage_writing.add_view(
        stage,
        eye=(WIDTH / 2, HEIGHT / 2, DEPTH + 4.0),
        target=(WIDTH / 2, HEIGHT / 2, 0),
        focal_length=50.0,
        aspect=1.0,
    )
    stage.Save()


def _room(step: float) -> list[Part]:
    x, y, z = (WIDTH, 0, 0), (0, HEIGHT, 0), (0, 0, DEPTH)
    walls = {
        "Floor": (rectangle((0, 0, 0), z, x, step), "White"),
        "Ceiling": (rectangle((0, HEIGHT, 0), x, z, step), "White"),
        "BackWall": (rectangle((0, 0, 0), x, y, step), "White"),
        "LeftWall": (rectangle((0, 0, 0), y, z, step), "Red"),
        "RightWall": (rectangle((WIDTH, 0, 0), z, y, step), "Green"),
    }
    return [Part(name, *surface, creased=False) for name, surface in walls.items()]


def _box(size: tuple[float, float, float], step: float) -> Shape:
    """Standing on the floor, without the side that nobody sees."""
    width, height, depth = size
    bottom = (-width, -step / 10, -depth), (width, step / 10, depth)
    return with_opening(box(size, step).moved(y=height / 2), *bottom)


def _add_light(stage: Usd.Stage) -> None:
    """A square in the ceiling, clear of it."""
    width, height = LIGHT_SIZE
    stage_writing.add_light(
        stage, "/World/Light", UsdLux.RectLight, {"width": width, "height": height},
        (WIDTH / 2, HEIGHT - 0.005, DEPTH / 2), turn=DOWNWARD, temperature=4000.0,
        luminance=LUMINOUS_FLUX / (math.pi * width * height),
    )  # fmt: skip


def main() -> None:
    """Command line."""
    arguments = stage_writing.density_options("Write the box with two boxes.").parse_args()
    generate(arguments.path, arguments.density)


if __name__ == "__main__":
    main()
