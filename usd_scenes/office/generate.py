"""Write the demo: a small design office in the evening, lit by eight luminaires.

    python -m usd_scenes.office.generate OUT.usda [--density D]

The room is 6.0 x 2.8 x 4.5 m: +X to the right, +Y up, the back wall at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Usd, UsdLux

from .. import stage_writing
from ..shapes import Shape, box, merge, polyline, rectangle, tube, with_opening
from ..stage_writing import Part, add_model
from . import furniture

WIDTH, HEIGHT, DEPTH = 6.0, 2.8, 4.5  # m
WINDOW_Y, WINDOW_Z, WINDOW_DEPTH = (0.95, 2.15), (1.50, 3.00), 0.22  # m, in the left wall

WALL_STEP, FURNITURE_STEP = 0.085, 0.06  # m, edge lengths at density 1

DOWNWARD = (-90.0, 0.0, 0.0)  # nadir (local -Z) to -Y; C0 stays +X
TO_BACK_WALL = (-90.0, 90.0, 0.0)  # nadir to -Y, C0 to the back wall

# Diffuse reflectance, linear Rec. 709.
REFLECTANCES = {
    "WarmWhite": (0.76, 0.73, 0.67),
    "Ceiling": (0.82, 0.81, 0.78),
    "Terracotta": (0.50, 0.21, 0.13),
    "Floorboards": (0.40, 0.26, 0.15),
    "Oak": (0.48, 0.33, 0.19),
    "Walnut": (0.19, 0.10, 0.055),
    "Plaster": (0.66, 0.65, 0.62),
    "Linen": (0.68, 0.62, 0.50),
    "Teal": (0.04, 0.19, 0.25),
    "Ochre": (0.60, 0.36, 0.07),
    "Wine": (0.34, 0.045, 0.06),
    "Slate": (0.10, 0.12, 0.15),
    "Orange": (0.70, 0.24, 0.02),
    "Leaf": (0.07, 0.20, 0.035),
    "Brass": (0.55, 0.41, 0.17),
    "Steel": (0.42, 0.42, 0.42),
    "NightGlass": (0.03, 0.035, 0.05),
}


def generate(path: str | Path, density: float = 1.0) -> None:
    """Write the stage to `path` (.usda, .usdc); triangles grow with the square of `density`."""
    stage = stage_writing.new_stage(path, metres_per_unit=0.01, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    add_model(stage, "/World/Room", _room(WALL_STEP / density))
    add_model(stage, "/World/Window", _window(WALL_STEP / density))
    _add_furniture(stage, FURNITURE_STEP / density)
    _add_luminaires(stage, FURNITURE_STEP / density)
    stage_writing.add_view(
        stage, eye=(5.45, 1.40, 4.30), target=(2.35, 1.12, 1.05), focal_length=25.0
    )
    stage.Save()


def _room(step: float) -> list[Part]:
    """Six walls seen from inside, with an opening for the window, and skirting boards."""
    edges = {"x": (WIDTH, 0, 0), "y": (0, HEIGHT, 0), "z": (0, 0, DEPTH)}
    # All walls are divided alike, so that they meet without T-junctions, through which rays slip.
    breaks: dict[str, Sequence[float]] = {"x": (), "y": WINDOW_Y, "z": WINDOW_Z}

    def wall(corner: Sequence[float], u: str, v: str) -> Shape:
        return rectangle(corner, edges[u], edges[v], step, breaks[u], breaks[v])

    window = (-0.1, WINDOW_Y[0], WINDOW_Z[0]), (0.1, WINDOW_Y[1], WINDOW_Z[1])
    height, thickness = 0.08, 0.012
    along_x = box((WIDTH - 2 * thickness, height, thickness), step).moved(WIDTH / 2, height / 2)
    along_z = box((thickness, height, DEPTH), step).moved(0, height / 2, DEPTH / 2)
    skirting = merge(
        *(along_x.moved(z=z) for z in (thickness / 2, DEPTH - thickness / 2)),
        *(along_z.moved(x=x) for x in (thickness / 2, WIDTH - thickness / 2)),
    )
    walls = {
        "Floor": (wall((0, 0, 0), "z", "x"), "Floorboards"),
        "Ceiling": (wall((0, HEIGHT, 0), "x", "z"), "Ceiling"),
        "BackWall": (wall((0, 0, 0), "x", "y"), "WarmWhite"),
        "FrontWall": (wall((0, 0, DEPTH), "y", "x"), "WarmWhite"),
        "RightWall": (wall((WIDTH, 0, 0), "z", "y"), "WarmWhite"),
        "LeftWall": (with_opening(wall((0, 0, 0), "y", "z"), *window), "Terracotta"),
    }
    parts = [Part(name, *surface, creased=False) for name, surface in walls.items()]
    return [*parts, Part("Skirting", skirting, "Plaster")]


def _window(step: float) -> list[Part]:
    """Reveals, a frame with a mullion, and glass that shows the night: the room stays closed."""
    (y0, y1), (z0, z1), depth = WINDOW_Y, WINDOW_Z, WINDOW_DEPTH
    inward, up, along = (depth, 0, 0), (0, y1 - y0, 0), (0, 0, z1 - z0)
    reveals = merge(
        rectangle((-depth, y0, z0), along, inward, step),
        rectangle((-depth, y1, z0), inward, along, step),
        rectangle((-depth, y0, z0), inward, up, step),
        rectangle((-depth, y0, z1), up, inward, step),
    )
    middle_y, middle_z, bar = (y0 + y1) / 2, (z0 + z1) / 2, 0.05
    uprights = [
        box((0.04, y1 - y0, bar), step).moved(-depth + 0.02, middle_y, z)
        for z in (z0 + bar / 2, middle_z, z1 - bar / 2)
    ]
    rails = [
        box((0.04, bar, (z1 - z0 - 3 * bar) / 2), step).moved(-depth + 0.02, y, z)
        for y in (y0 + bar / 2, y1 - bar / 2)
        for z in ((z0 + middle_z + bar / 2) / 2, (z1 + middle_z - bar / 2) / 2)
    ]
    rod = tube(polyline([[0.09, 2.26, z0 - 0.25], [0.09, 2.26, z1 + 0.90]], step), 0.012, step)
    return [
        Part("CurtainRod", rod, "Brass"),
        Part("Reveals", reveals, "Plaster"),
        Part("Glass", rectangle((-depth, y0, z0), up, along, step), "NightGlass", creased=False),
        Part("Frame", merge(*uprights, *rails), "Plaster"),
    ]


def _add_furniture(stage: Usd.Stage, step: float) -> None:
    chair = furniture.shell_chair(0.7 * step, "Ochre")
    models = {
        "Sofa": (furniture.sofa(step, 3, "Teal", ("Ochre", "Wine")), (1.98, 0, 0.47), 0),
        "Armchair": (furniture.sofa(step, 1, "Wine"), (4.72, 0, 1.55), -62),
        "Bookshelf": (furniture.bookshelf(step, seed=7), (3.98, 0, 0.013), 0),
        "Desk": (furniture.desk(step), (0.42, 0, 2.25), 90),
        "DeskChair": (furniture.shell_chair(0.7 * step, "Slate"), (1.02, 0, 2.30), -112),
        "Rug": (furniture.round_rug(step, 1.25), (3.15, 0, 2.15), 0),
        "Table": (furniture.round_table(0.8 * step), (3.15, 0.012, 2.15), 0),
        "ChairBack": (chair, (2.95, 0.012, 1.38), 12),
        "ChairLeft": (chair, (2.40, 0.012, 2.42), 105),
        "ChairNear": (chair, (4.02, 0.012, 2.22), -97),
        "Vase": (furniture.vase(step / 2), (3.30, 0.752, 2.02), 0),
        "FruitBowl": (furniture.fruit_bowl(step / 2), (3.00, 0.752, 2.26), 0),
        "Plant": (furniture.plant(step, seed=3), (0.42, 0, 1.12), 0),
        "CurtainLeft": (furniture.curtain(step, 0.42, 2.2), (0.09, 0.03, 3.40), 90),
        "CurtainRight": (furniture.curtain(step, 0.42, 2.2), (0.09, 0.03, 1.52), 90),
        "PaintingLeft": (furniture.painting(step, 0.80, 0.62, seed=5), (1.42, 1.58, 0.016), 0),
        "PaintingRight": (furniture.painting(step, 0.80, 0.62, seed=11), (2.54, 1.58, 0.016), 0),
    }
    for name, (parts, at, turn) in models.items():
        add_model(stage, f"/World/{name}", parts, at, turn)


def _add_luminaires(stage: Usd.Stage, step: float) -> None:
    """Fixtures and their lights; each light starts outside its fixture's surfaces."""
    for number, x in enumerate((1.42, 2.54, 3.98), start=1):
        path, mouth = f"/World/WallWasher{number}", HEIGHT - 0.12
        add_model(stage, path, furniture.ceiling_can(step), (x, mouth, 0.80))
        light = stage_writing.add_light(
            stage, f"{path}/Light", UsdLux.DiskLight, {"radius": 0.05},
            (0, -0.005, 0), turn=TO_BACK_WALL, temperature=4000.0,
        )  # fmt: skip
        stage_writing.add_photometric_file(light, "wall_washer.ies", dimming=0.8)

    add_model(
        stage, "/World/Pendant", furniture.drum_pendant(step, HEIGHT - 1.95), (3.15, 1.95, 2.15)
    )
    light = stage_writing.add_light(
        stage, "/World/Pendant/Light", UsdLux.SphereLight, {"radius": 0.03}, (0, 0, 0),
        turn=DOWNWARD, temperature=3500.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "pendant.ies")

    light = stage_writing.add_light(
        stage, "/World/DownlightDoor", UsdLux.RectLight, {"width": 0.30, "height": 0.10},
        (4.75, HEIGHT - 0.005, 3.1), turn=DOWNWARD, temperature=4000.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "oblong.ldt", dimming=0.35)
    light = stage_writing.add_light(
        stage, "/World/DownlightWindow", UsdLux.DiskLight, {"radius": 0.06},
        (0.95, HEIGHT - 0.005, 3.55), turn=DOWNWARD, temperature=5000.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "downlight.ies", dimming=0.35)

    add_model(stage, "/World/DeskLamp", furniture.desk_lamp(step / 2), (0.22, 0.75, 2.90), 65)
    light = stage_writing.add_light(
        stage, "/World/DeskLamp/Light", UsdLux.DiskLight, {"radius": 0.06}, (0, 0.415, 0.20),
        turn=DOWNWARD, temperature=5000.0,
    )  # fmt: skip
    gamma = np.arange(0.0, 91.0, 10.0)
    stage_writing.add_diagram(
        light, gamma, [0.0], 160 * np.cos(np.radians(gamma)), luminous_flux=380.0
    )

    add_model(stage, "/World/FloorLamp", furniture.floor_lamp(step), (0.42, 0, 0.42))
    stage_writing.add_bulb(
        stage, "/World/FloorLamp/Light", (0, 1.60, 0), radius=0.04, luminous_flux=800.0
    )


def main() -> None:
    """Command line."""
    arguments = stage_writing.density_options("Write the demo stage.").parse_args()
    generate(arguments.path, arguments.density)


if __name__ == "__main__":
    main()
