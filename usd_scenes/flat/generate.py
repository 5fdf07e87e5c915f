"""Write a furnished flat at dusk: six rooms on a corridor, lit by windows, lamps, and open doors.

    python -m usd_scenes.flat.generate OUT.usda [--density D]

The flat is 10.0 x 2.6 x 9.0 m: +X to the right, +Y up, the living room at the back left (z = 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pxr import Usd, UsdLux

from .. import stage_writing
from ..office import furniture
from ..shapes import Shape, box, merge
from ..stage_writing import Part, add_model

WIDTH, HEIGHT, DEPTH = 10.0, 2.6, 9.0  # m
WALL, DOOR_WIDTH, DOOR_HEIGHT, LEAF = 0.12, 0.9, 2.05, 0.04  # m; thickness of wall and door leaf
INTO = 0.03  # m, that walls and furniture reach into what they stand on
STEP, FURNITURE_STEP = 0.135, 0.08  # m, edge lengths at density 1
GAP = 0.01  # m, of a luminaire to its wall or ceiling

DOWNWARD = (-90.0, 0.0, 0.0)  # nadir (local -Z) to -Y; C0 stays +X

# Walls along X: z of the middle, doors by their middles in x. The corridor is between them.
CORRIDOR_WALLS = {4.4: (2.45, 6.45, 8.85), 5.7: (1.85, 5.3, 7.95)}
# Walls along Z: x of the middle, from z to z, doors by their middles in z.
CROSS_WALLS = (
    (5.2, 0.0, 4.4, (2.2,)),
    (7.6, 0.0, 4.4, ()),
    (4.2, 5.7, 9.0, ()),
    (6.4, 5.7, 9.0, ()),
)

# Diffuse reflectance, linear Rec. 709.
REFLECTANCES = {
    "Walls": (0.74, 0.72, 0.67),
    "Doors": (0.58, 0.55, 0.50),
    "Oak": (0.48, 0.33, 0.19),
    "Walnut": (0.19, 0.10, 0.055),
    "Plaster": (0.66, 0.65, 0.62),
    "Enamel": (0.80, 0.80, 0.79),
    "Linen": (0.68, 0.62, 0.50),
    "Teal": (0.04, 0.19, 0.25),
    "Ochre": (0.60, 0.36, 0.07),
    "Wine": (0.34, 0.045, 0.06),
    "Slate": (0.10, 0.12, 0.15),
    "Orange": (0.70, 0.24, 0.02),
    "Leaf": (0.07, 0.20, 0.035),
    "Brass": (0.55, 0.41, 0.17),
    "Steel": (0.42, 0.42, 0.42),
}

# Window panes that shine into a room: middle, turn about +Y, width and height (m), and cd/m².
WINDOWS = {
    "LivingRoom": ((2.4, 1.5, GAP), 180.0, (2.2, 1.4), 220.0),
    "Kitchen": ((6.4, 1.6, GAP), 180.0, (1.2, 1.0), 220.0),
    "Bedroom": ((2.1, 1.5, DEPTH - GAP), 0.0, (1.6, 1.3), 140.0),
    "Nursery": ((WIDTH - GAP, 1.5, 7.4), 90.0, (1.4, 1.3), 180.0),
}


def generate(path: str | Path, density: float = 1.0) -> None:
    """Write the stage to `path` (.usda, .usdc); triangles grow with the square of `density`."""
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    step = STEP / density
    envelope = box((WIDTH, HEIGHT, DEPTH), step).flipped().moved(WIDTH / 2, HEIGHT / 2, DEPTH / 2)
    add_model(stage, "/World/Rooms", [Part("Envelope", envelope, "Walls", creased=False)])
    add_model(stage, "/World/Partitions", _partitions(step))
    add_model(stage, "/World/Doors", _doors(step))
    _add_furniture(stage, FURNITURE_STEP / density)
    _add_luminaires(stage, FURNITURE_STEP / density)
    stage_writing.add_view(stage, eye=(4.95, 1.55, 4.15), target=(1.6, 1.0, 0.9), focal_length=20.0)
    stage.Save()


def _partitions(step: float) -> list[Part]:
    """Walls between the rooms: solids with doorways, a little into envelope and neighbours."""
    parts = []
    for number, (z, doors) in enumerate(CORRIDOR_WALLS.items()):
        wall = _wall(-INTO, WIDTH + INTO, doors, step).moved(z=z)
        parts.append(Part(f"Along{number}", wall, "Walls"))
    for number, (x, low, high, doors) in enumerate(CROSS_WALLS):
        # Turned by -90° about +Y, +X becomes +Z.
        wall = _wall(low - INTO, high + INTO, doors, step).turned(y=-90).moved(x=x)
        parts.append(Part(f"Across{number}", wall, "Walls"))
    return parts


def _wall(low: float, high: float, doors: Sequence[float], step: float) -> Shape:
    """A wall along X around z = 0: piers between the doors, and a lintel over each."""
    edges = [low, *(at + side * DOOR_WIDTH / 2 for at in doors for side in (-1, 1)), high]
    height = HEIGHT + 2 * INTO
    piers = [
        box((right - left, height, WALL), step).moved((left + right) / 2, HEIGHT / 2)
        for left, right in zip(edges[::2], edges[1::2], strict=True)
    ]
    above = HEIGHT + INTO - DOOR_HEIGHT
    lintels = [
        box((DOOR_WIDTH + 2 * INTO, above, WALL - 0.02), step).moved(at, DOOR_HEIGHT + above / 2)
        for at in doors
    ]
    return merge(*piers, *lintels)


def _doors(step: float) -> list[Part]:
    """Leaves that stand open into the rooms, ajar at the study's and the bathroom's."""
    leaf = box((DOOR_WIDTH - 0.02, DOOR_HEIGHT - 0.03, LEAF), step)
    leaf = leaf.moved((DOOR_WIDTH - 0.02) / 2, (DOOR_HEIGHT - 0.03) / 2 + 0.01)
    parts = []
    for (z, doors), side in zip(CORRIDOR_WALLS.items(), (1.0, -1.0), strict=True):
        for number, at in enumerate(doors):
            ajar = (z, number) in ((4.4, 2), (5.7, 1))
            opened = leaf.turned(y=side * (40.0 if ajar else 100.0))
            hinge = at - DOOR_WIDTH / 2 + 0.01, 0.0, z - side * (WALL / 2 + LEAF)
            name = f"{'Back' if side > 0 else 'Front'}{number}"
            parts.append(Part(name, opened.moved(*hinge), "Doors"))
    return parts


def _add_furniture(stage: Usd.Stage, step: float) -> None:
    chair = furniture.shell_chair(0.8 * step, "Ochre")
    models = {
        "Sofa": (furniture.sofa(step, 3, "Teal", ("Ochre", "Wine")), (1.05, 0, 2.2), 90),
        "Armchair": (furniture.sofa(step, 1, "Wine"), (3.4, 0, 0.9), -35),
        "Bookshelf": (furniture.bookshelf(step, seed=3), (4.3, 0, 0.02), 0),
        "Rug": (furniture.round_rug(step, 1.0), (2.6, 0, 2.2), 0),
        "Table": (furniture.round_table(step), (6.4, 0, 2.9), 0),
        "ChairLeft": (chair, (5.65, 0, 2.9), 90),
        "ChairRight": (chair, (7.1, 0, 2.75), -80),
        "FruitBowl": (furniture.fruit_bowl(step / 2), (6.4, 0.74, 2.95), 0),
        "Desk": (furniture.desk(step), (8.8, 0, 0.45), 180),
        "DeskChair": (furniture.shell_chair(0.8 * step, "Slate"), (8.75, 0, 1.2), 160),
        "StudyShelf": (furniture.bookshelf(step, seed=11), (9.98, 0, 2.4), -90),
        "Plant": (furniture.plant(step, seed=3), (0.45, 0, 0.45), 0),
        "Painting": (furniture.painting(step, 0.8, 0.62, seed=5), (1.1, 1.6, 4.32), 180),
        "CorridorPainting": (furniture.painting(step, 0.6, 0.5, seed=9), (3.9, 1.6, 5.62), 180),
        "NurseryShelf": (furniture.bookshelf(step, seed=5), (9.2, 0, 8.98), 180),
    }
    for name, (parts, at, turn) in models.items():
        add_model(stage, f"/World/{name}", parts, at, turn)
    for name, (material, blocks, rounding) in _BLOCKS.items():
        shapes = [
            box(size, step, rounding).moved(x, y + size[1] / 2, z) for size, (x, y, z) in blocks
        ]
        solids = [Part(f"Block{i}", shape, material) for i, shape in enumerate(shapes)]
        add_model(stage, f"/World/{name}", solids)


# Boxes with their material and rounding: sizes and the middles of their undersides, m.
_BLOCKS = {
    "KitchenUnits": (
        "Oak",
        (((2.2, 0.86, 0.6), (6.4, -INTO, 0.3 - INTO)), ((0.36, 0.7, 0.3), (5.5, 1.5, 0.15 - INTO))),
        0.0,
    ),
    "Worktop": ("Slate", (((2.24, 0.04, 0.64), (6.4, 0.82, 0.3 - INTO)),), 0.01),
    "Fridge": ("Enamel", (((0.6, 1.7, 0.6), (7.2, 0.01, 1.1)),), 0.03),
    "BedFrame": ("Walnut", (((1.7, 0.3, 2.1), (1.2, 0.02, 7.9)),), 0.02),
    "Mattress": ("Linen", (((1.6, 0.25, 2.0), (1.2, 0.33, 7.9)),), 0.08),
    "Pillows": (
        "Enamel",
        (((0.7, 0.14, 0.4), (0.8, 0.59, 8.6)), ((0.7, 0.14, 0.4), (1.6, 0.59, 8.6))),
        0.06,
    ),
    "Wardrobe": ("Doors", (((1.6, 2.1, 0.6), (3.3, 0.02, 6.12)),), 0.01),
    "Bath": ("Enamel", (((0.75, 0.55, 1.7), (4.7, 0.02, 8.05)),), 0.08),
    "Basin": (
        "Enamel",
        (((0.6, 0.18, 0.45), (6.08, 0.75, 7.0)), ((0.3, 0.8, 0.3), (6.15, -INTO, 7.0))),
        0.04,
    ),
    "Cot": ("Orange", (((0.7, 0.5, 1.4), (7.0, 0.02, 8.1)),), 0.03),
    "ToyBox": ("Ochre", (((0.6, 0.4, 0.4), (8.6, 0.02, 6.3)),), 0.02),
    "Bench": ("Oak", (((1.1, 0.42, 0.34), (0.75, 0.02, 5.4)),), 0.02),
}


def _add_luminaires(stage: Usd.Stage, step: float) -> None:
    """Windows in four rooms; lamps in living room, kitchen, corridor and bedroom."""
    for name, (at, turn, (width, height), luminance) in WINDOWS.items():
        stage_writing.add_light(
            stage, f"/World/{name}Window", UsdLux.RectLight, {"width": width, "height": height},
            at, turn=(0.0, turn, 0.0), luminance=luminance,
        )  # fmt: skip
    add_model(
        stage, "/World/Pendant", furniture.drum_pendant(step, HEIGHT - 1.85), (2.6, 1.85, 2.2)
    )
    light = stage_writing.add_light(
        stage, "/World/Pendant/Light", UsdLux.SphereLight, {"radius": 0.04}, (0, 0, 0),
        turn=DOWNWARD, temperature=3000.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "pendant.ies")
    light = stage_writing.add_light(
        stage, "/World/KitchenLight", UsdLux.RectLight, {"width": 0.6, "height": 0.15},
        (6.4, HEIGHT - GAP, 2.2), turn=DOWNWARD, temperature=4000.0,
    )  # fmt: skip
    stage_writing.add_photometric_file(light, "oblong.ldt")
    for number, x in enumerate((1.7, 5.0, 8.3)):
        light = stage_writing.add_light(
            stage, f"/World/Downlight{number}", UsdLux.DiskLight, {"radius": 0.08},
            (x, HEIGHT - GAP, 5.05), turn=DOWNWARD, temperature=3000.0,
        )  # fmt: skip
        stage_writing.add_photometric_file(light, "downlight.ies", dimming=0.6)
    add_model(stage, "/World/FloorLamp", furniture.floor_lamp(step), (2.6, 0, 8.6))
    stage_writing.add_bulb(
        stage, "/World/FloorLamp/Light", (0, 1.60, 0), radius=0.05, luminous_flux=700.0
    )


def main() -> None:
    """Command line."""
    arguments = stage_writing.density_options("Write the flat.").parse_args()
    generate(arguments.path, arguments.density)


if __name__ == "__main__":
    main()
