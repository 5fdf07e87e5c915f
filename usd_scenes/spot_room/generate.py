"""Write a gallery lit by narrow spotlights, for the adaptive mesh: shadows with hard borders.

    python -m usd_scenes.spot_room.generate OUT.usda [--density D]

The room is 7.2 x 3.0 x 5.4 m: +X to the right, +Y up, the back wall at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import UsdLux

from .. import stage_writing
from ..shapes import Shape, box, lathe, merge, polyline, rectangle, superellipsoid
from ..stage_writing import Part, add_model

WIDTH, HEIGHT, DEPTH = 7.2, 3.0, 5.4  # m
STEP = 0.1068  # m, edge length at density 1, of all surfaces

# Diffuse reflectance, linear Rec. 709.
REFLECTANCES = {
    "White": (0.75, 0.74, 0.71),
    "Boards": (0.42, 0.31, 0.20),
    "Plinth": (0.62, 0.61, 0.60),
    "Bronze": (0.30, 0.19, 0.09),
    "Marble": (0.70, 0.68, 0.64),
    "Red": (0.50, 0.08, 0.06),
}

# Where each spotlight hangs and where it aims, m.
SPOTLIGHTS = (
    ((1.2, 2.9, 3.4), (1.4, 1.1, 1.3)),
    ((3.6, 2.9, 4.2), (3.6, 0.9, 2.4)),
    ((6.2, 2.9, 3.6), (5.6, 1.0, 1.5)),
    ((2.4, 2.9, 1.2), (3.6, 0.6, 2.4)),
    ((4.8, 2.9, 1.0), (4.8, 1.4, 0.0)),
    ((0.8, 2.9, 4.6), (2.0, 0.3, 4.0)),
    ((6.4, 2.9, 4.8), (5.2, 0.2, 4.0)),
    ((2.4, 2.9, 2.0), (2.2, 1.5, 0.0)),
)
BEAM, CUTOFF = 24.0, 24.5  # degrees off the axis: full intensity up to, nothing from
LUMINOUS_FLUX = 450.0  # lm each


def generate(path: str | Path, density: float = 1.0) -> None:
    """Write the stage to `path` (.usda, .usdc); triangles grow with the square of `density`."""
    step = STEP / density
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    add_model(stage, "/World/Room", _room(step))
    for number, (x, z, top) in enumerate(((1.4, 1.3, 0.9), (3.6, 2.4, 0.7), (5.6, 1.5, 1.0)), 1):
        plinth = box((0.45, top, 0.45), step).moved(y=top / 2)
        add_model(stage, f"/World/Plinth{number}", [Part("Body", plinth, "Plinth")], (x, 0, z))
    add_model(stage, "/World/Vase", [Part("Body", _vase(step), "Bronze")], (1.4, 0.9, 1.3))
    cube = box((0.3, 0.3, 0.3), step).moved(y=0.15)
    add_model(stage, "/World/Cube", [Part("Body", cube, "Red")], (3.6, 0.7, 2.4), turn=30.0)
    stone = superellipsoid((0.36, 0.44, 0.3), 2.5, step / 2).moved(y=0.22)
    add_model(stage, "/World/Stone", [Part("Body", stone, "Marble")], (5.6, 1.0, 1.5))
    slats = merge(*(box((0.04, 2.0, 0.12), step).moved(x=0.22 * i, y=1.0) for i in range(5)))
    add_model(stage, "/World/Screen", [Part("Slats", slats, "Boards")], (5.0, 0, 3.7))
    bench = merge(
        box((1.4, 0.06, 0.4), step).moved(y=0.45),
        *(box((0.06, 0.42, 0.36), step).moved(x=x, y=0.21) for x in (-0.6, 0.6)),
    )
    add_model(stage, "/World/Bench", [Part("Body", bench, "Boards")], (2.0, 0, 4.0), turn=12.0)
    gamma = [0.0, BEAM, CUTOFF, 180.0]
    for number, (at, aim) in enumerate(SPOTLIGHTS, start=1):
        light = stage_writing.add_light(
            stage, f"/World/Spotlight{number}", UsdLux.SphereLight, {"radius": 0.004}, at,
            turn=_aimed(at, aim),
        )  # fmt: skip
        stage_writing.add_diagram(light, gamma, [0.0], [1.0, 1.0, 0.0, 0.0], LUMINOUS_FLUX)
    stage_writing.add_view(stage, eye=(6.8, 1.9, 5.2), target=(3.0, 0.8, 1.2), focal_length=24.0)
    stage.Save()


def _room(step: float) -> list[Part]:
    """Six walls seen from inside."""
    x, y, z = (WIDTH, 0, 0), (0, HEIGHT, 0), (0, 0, DEPTH)

    def wall(corner: Sequence[float], u: Sequence[float], v: Sequence[float]) -> Shape:
        return rectangle(corner, u, v, step)

    walls = {
        "Floor": (wall((0, 0, 0), z, x), "Boards"),
        "Ceiling": (wall((0, HEIGHT, 0), x, z), "White"),
        "BackWall": (wall((0, 0, 0), x, y), "White"),
        "FrontWall": (wall((0, 0, DEPTH), y, x), "White"),
        "RightWall": (wall((WIDTH, 0, 0), z, y), "White"),
        "LeftWall": (wall((0, 0, 0), y, z), "White"),
    }
    return [Part(name, *surface, creased=False) for name, surface in walls.items()]


def _vase(step: float) -> Shape:
    """A closed body of revolution on y = 0."""
    profile = [(0, 0), (0.10, 0), (0.16, 0.14), (0.13, 0.28), (0.06, 0.38), (0.09, 0.46), (0, 0.46)]
    return lathe(polyline(profile, step / 2), step / 2)


def _aimed(at: Sequence[float], aim: Sequence[float]) -> tuple[float, float, float]:
    """Rotation about X, then Y, then Z, degrees, that turns -Z towards a point."""
    x, y, z = np.subtract(aim, at)
    return (
        float(np.degrees(np.arctan2(y, np.hypot(x, z)))),
        float(np.degrees(np.arctan2(-x, -z))),
        0.0,
    )


def main() -> None:
    """Command line."""
    parser = stage_writing.density_options("Write a gallery lit by narrow spotlights.")
    arguments = parser.parse_args()
    generate(arguments.path, arguments.density)


if __name__ == "__main__":
    main()
