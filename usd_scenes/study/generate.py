"""Write a small furnished room under luminaires with photometric files.

    python -m usd_scenes.study.generate OUT.usda [--step METRES]

The room is 4.2 x 2.7 x 3.6 m: +X to the right, +Y up, the back wall at z = 0. Where furniture
stands or hangs, floor and wall are open: no mesh element lies partly in the dark.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Usd, UsdLux

from .. import stage_writing
from ..shapes import Shape, box, rectangle, with_opening
from ..stage_writing import Part, add_model

WIDTH, HEIGHT, DEPTH = 4.2, 2.7, 3.6  # m
STEP = 0.06  # m, edge length of a solution at vertices
COARSE_STEP = 1.2  # m, of the same surfaces in fewer than 500 polygons

DOWNWARD = (-90.0, 0.0, 0.0)  # nadir (local -Z) to -Y
TO_BACK_WALL = (-90.0, 90.0, 0.0)  # nadir down, C0 (local +X) to -Z

# Diffuse reflectance, linear Rec. 709.
REFLECTANCES = {
    "White": (0.76, 0.75, 0.72),
    "Oak": (0.44, 0.31, 0.18),
    "Blue": (0.12, 0.19, 0.40),
    "Grey": (0.45, 0.45, 0.44),
}


@dataclass(frozen=True, slots=True)
class Block:
    """A box along the axes, between two corners, m; it touches the floor or the back wall."""

    name: str
    material: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]


BLOCKS = (
    Block("Desk", "Oak", (2.4, 0.0, 0.9), (3.9, 0.74, 1.6)),
    Block("Sofa", "Blue", (0.5, 0.0, 1.5), (1.4, 0.42, 3.2)),
    Block("Cupboard", "Grey", (0.5, 0.0, 0.3), (1.3, 1.8, 0.75)),
    Block("LowShelf", "Oak", (1.8, 1.2, 0.0), (3.6, 1.26, 0.3)),
    Block("HighShelf", "Oak", (1.8, 1.62, 0.0), (3.6, 1.68, 0.3)),
)


def generate(path: str | Path, step: float = STEP) -> None:
    """Write the stage to `path` (.usda, .usdc).

    step : edge lengths, m; the surfaces are the same for any
    """
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    add_model(stage, "/World/Room", _room(step))
    for block in BLOCKS:
        shape = _open_box(block, step)
        add_model(stage, f"/World/{block.name}", [Part(block.name, shape, block.material)])
    _add_luminaires(stage)
    stage_writing.add_view(stage, eye=(3.9, 1.7, 3.5), target=(1.6, 0.8, 0.4), focal_length=22.0)
    stage.Save()


def _room(step: float) -> list[Part]:
    """Six walls seen from inside, open where a block touches."""
    x, y, z = (WIDTH, 0, 0), (0, HEIGHT, 0), (0, 0, DEPTH)
    standing = [block for block in BLOCKS if block.low[1] == 0]
    hanging = [block for block in BLOCKS if block.low[2] == 0]
    walls = {
        "Floor": (_with_footprints((z, x), step, standing), "Oak"),
        "Ceiling": (rectangle((0, HEIGHT, 0), x, z, step), "White"),
        "BackWall": (_with_footprints((x, y), step, hanging), "White"),
        "FrontWall": (rectangle((0, 0, DEPTH), y, x, step), "White"),
        "RightWall": (rectangle((WIDTH, 0, 0), z, y, step), "White"),
        "LeftWall": (rectangle((0, 0, 0), y, z, step), "White"),
    }
    return [Part(name, *surface, creased=False) for name, surface in walls.items()]


def _with_footprints(
    edges: tuple[Sequence[float], Sequence[float]], step: float, blocks: Sequence[Block]
) -> Shape:
    """A rectangle from the origin without what the blocks cover."""
    breaks = [
        sorted({corner[int(np.argmax(edge))] for b in blocks for corner in (b.low, b.high)})
        for edge in edges
    ]
    shape = rectangle((0, 0, 0), *edges, step, *breaks)
    for block in blocks:
        shape = with_opening(shape, np.subtract(block.low, 1e-3), np.add(block.high, 1e-3))
    return shape


def _open_box(block: Block, step: float) -> Shape:
    """Without the side that touches."""
    size = np.subtract(block.high, block.low)
    shape = box(size, step).moved(*np.add(block.low, block.high) / 2)
    axis = 1 if block.low[1] == 0 else 2
    low, high = np.subtract(block.low, 1e-3), np.add(block.high, 1e-3)
    high[axis] = 1e-3
    return with_opening(shape, low, high)


def _add_luminaires(stage: Usd.Stage) -> None:
    """A pendant over the desk, two wall washers, a downlight, and a ball beside the sofa."""
    under_ceiling = HEIGHT - 0.01
    light = stage_writing.add_light(
        stage, "/World/Pendant", UsdLux.SphereLight, {"radius": 0.05}, (3.15, 1.95, 1.9),
        turn=DOWNWARD, temperature=3500.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "pendant.ies")
    for number, x in enumerate((0.9, 2.7), start=1):
        light = stage_writing.add_light(
            stage, f"/World/WallWasher{number}", UsdLux.DiskLight, {"radius": 0.05},
            (x, under_ceiling, 1.1), turn=TO_BACK_WALL, temperature=4000.0,
        )  # fmt: skip
        stage_writing.add_photometric_file(light, "wall_washer.ies")
    light = stage_writing.add_light(
        stage, "/World/Downlight", UsdLux.RectLight, {"width": 0.30, "height": 0.10},
        (2.6, under_ceiling, 2.8), turn=DOWNWARD, temperature=4000.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "oblong.ldt", dimming=0.5)
    stage_writing.add_bulb(stage, "/World/Ball", (0.35, 1.3, 1.2), radius=0.08, luminous_flux=700.0)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write a small furnished room.")
    parser.add_argument("path", type=Path, metavar="OUT.usda")
    parser.add_argument("--step", type=float, default=STEP, help="edge lengths, m")
    arguments = parser.parse_args()
    generate(arguments.path, arguments.step)


if __name__ == "__main__":
    main()
