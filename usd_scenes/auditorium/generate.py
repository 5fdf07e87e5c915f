"""Write an auditorium whose seats are instances: many copies of little.

python -m usd_scenes.auditorium.generate OUT.usda [--instancing HOW] [--rows N]

The hall is as deep as its rows: +X across, +Y up, the podium at z = 0.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt

from .. import stage_writing
from ..shapes import Shape, box, from_grid, merge
from ..stage_writing import Part, add_model

Instancing = Literal["scenegraph", "points", "none"]

SEATS_IN_ROW, SEAT_DISTANCE = 100, 0.56  # m between neighbours
ROW_DISTANCE, ROW_RISE = 0.95, 0.12  # m
WIDTH, PODIUM, HEADROOM = 60.0, 10.0, 9.0  # m; headroom over the last row
STEP = 1.0  # m, edge lengths of the hall
LUMINAIRES_IN_ROW, LUMINAIRE_ROWS = 4, 3
LUMINOUS_FLUX = 1_200_000.0  # lm, of all luminaires together
SIDE = 1.2  # m, of a luminaire
DOWNWARD = (-90.0, 0.0, 0.0)  # a light shines along local -Z
PROTOTYPES = ("Open", "Folded")

REFLECTANCES = {
    "Walls": (0.62, 0.55, 0.45),
    "Floor": (0.35, 0.30, 0.26),
    "Cloth": (0.45, 0.10, 0.08),
    "Wood": (0.40, 0.28, 0.17),
}


def generate(path: str | Path, instancing: Instancing = "scenegraph", rows: int = 102) -> None:
    """Write the stage to `path` (.usda, .usdc): 100 seats a row.

    instancing : a scenegraph instance a seat, one point instancer for all, or plain references
    """
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    depth, top = PODIUM + (rows + 1) * ROW_DISTANCE, rows * ROW_RISE + HEADROOM
    shell = box((WIDTH, top, depth), STEP).flipped().moved(0, top / 2, depth / 2)
    add_model(stage, "/World/Hall", [Part("Shell", shell, "Walls", creased=False)])
    add_model(stage, "/World/Steps", [Part("Steps", _steps(rows), "Floor", creased=False)])
    if instancing == "points":
        _add_points(stage, rows)
    else:
        _add_prims(stage, rows, instanceable=instancing == "scenegraph")
    number = LUMINAIRES_IN_ROW * LUMINAIRE_ROWS
    luminance = LUMINOUS_FLUX / number / (np.pi * SIDE**2)
    for i in range(number):
        column, row = i % LUMINAIRES_IN_ROW, i // LUMINAIRES_IN_ROW
        at = (
            WIDTH * ((column + 0.5) / LUMINAIRES_IN_ROW - 0.5),
            top - 0.05,
            depth * (row + 0.5) / LUMINAIRE_ROWS,
        )
        stage_writing.add_light(
            stage, f"/World/Luminaire{i + 1}", UsdLux.RectLight, {"width": SIDE, "height": SIDE},
            at, turn=DOWNWARD, luminance=luminance,
        )  # fmt: skip
    stage_writing.add_render_settings(stage)
    stage.Save()


def seats(rows: int) -> Iterator[tuple[str, int, NDArray[np.float64], float]]:
    """Name, prototype (every third seat is folded), place in m and turn about +Y in degrees."""
    for row in range(rows):
        for column in range(SEATS_IN_ROW):
            x = (column - (SEATS_IN_ROW - 1) / 2) * SEAT_DISTANCE
            z = PODIUM + (row + 0.5) * ROW_DISTANCE
            place = np.array([x, (row + 1) * ROW_RISE, z])
            turn = float(np.degrees(np.arctan2(x, z + 20.0)))  # to the speaker, nearly
            yield f"Seat{row + 1}_{column + 1}", int((row + column) % 3 == 0), place, turn


def _add_prims(stage: Usd.Stage, rows: int, *, instanceable: bool) -> None:
    for name in PROTOTYPES:
        stage.CreateClassPrim(f"/{name}Seat").SetTypeName("Xform")
        for part in _seat(name == "Folded"):
            stage_writing.add_mesh(stage, f"/{name}Seat/{part.name}", part)
    UsdGeom.Xform.Define(stage, "/World/Seats")
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        for name, prototype, place, turn in seats(rows):
            spec = Sdf.CreatePrimInLayer(layer, f"/World/Seats/{name}")
            spec.specifier = Sdf.SpecifierDef
            spec.typeName = "Xform"
            spec.inheritPathList.prependedItems = [f"/{PROTOTYPES[prototype]}Seat"]
            if instanceable:
                spec.SetInfo("instanceable", True)
            for attribute, kind, value in (
                ("xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(*place)),
                ("xformOp:rotateY", Sdf.ValueTypeNames.Float, turn),
            ):
                Sdf.AttributeSpec(spec, attribute, kind).default = value
            order = Sdf.AttributeSpec(
                spec, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform
            )
            order.default = Vt.TokenArray(["xformOp:translate", "xformOp:rotateY"])


def _add_points(stage: Usd.Stage, rows: int) -> None:
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Seats")
    for name in PROTOTYPES:
        UsdGeom.Xform.Define(stage, f"/World/Seats/{name}Seat")
        for part in _seat(name == "Folded"):
            stage_writing.add_mesh(stage, f"/World/Seats/{name}Seat/{part.name}", part)
    instancer.CreatePrototypesRel().SetTargets([f"/World/Seats/{name}Seat" for name in PROTOTYPES])
    _, prototypes, places, turns = zip(*seats(rows), strict=True)
    half = np.radians(turns) / 2
    quaternions = [Gf.Quath(float(np.cos(h)), 0.0, float(np.sin(h)), 0.0) for h in half]
    instancer.CreateProtoIndicesAttr(Vt.IntArray(prototypes))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(np.array(places, np.float32)))
    instancer.CreateOrientationsAttr(Vt.QuathArray(quaternions))
    instancer.CreateExtentAttr(instancer.ComputeExtentAtTime(0, 0))


def _seat(folded: bool) -> list[Part]:
    """Two meshes of 12 faces; the feet reach a little into the step."""
    back = box((0.50, 0.55, 0.06), STEP).turned(x=-10).moved(0, 0.68, 0.24)
    if folded:
        cushion = box((0.48, 0.45, 0.08), STEP).moved(0, 0.62, 0.14)
    else:
        cushion = box((0.48, 0.08, 0.45), STEP).moved(0, 0.44, 0.0)
    sides = [box((0.03, 0.66, 0.40), STEP).moved(x, 0.32, 0.02) for x in (-0.26, 0.26)]
    return [
        Part("Upholstery", merge(back, cushion), "Cloth"),
        Part("Frame", merge(*sides), "Wood"),
    ]


def _steps(rows: int) -> Shape:
    """Treads and risers from wall to wall, a little into both."""
    columns = np.linspace(-WIDTH / 2 - 0.05, WIDTH / 2 + 0.05, round(WIDTH / STEP) + 1)
    corners = [(0.0, PODIUM)]
    for row in range(1, rows + 1):
        z = PODIUM + (row - 1) * ROW_DISTANCE
        corners += [(row * ROW_RISE, z), (row * ROW_RISE, z + ROW_DISTANCE)]
    corners[-1] = (corners[-1][0], corners[-1][1] + ROW_DISTANCE + 0.05)
    return from_grid(np.array([[(x, y, z) for x in columns] for y, z in corners]))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write the auditorium of instanced seats.")
    parser.add_argument("path", type=Path, metavar="OUT.usda")
    parser.add_argument(
        "--instancing", choices=("scenegraph", "points", "none"), default="scenegraph"
    )
    parser.add_argument("--rows", type=int, default=102)
    arguments = parser.parse_args()
    generate(arguments.path, arguments.instancing, arguments.rows)


if __name__ == "__main__":
    main()
