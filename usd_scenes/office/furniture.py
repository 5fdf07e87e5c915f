"""The office's furniture: each model as parts around its own origin on the floor, +Y up, +Z front.

`step` is the edge length, m, to which surfaces are tessellated.
"""

from __future__ import annotations

import numpy as np

from ..shapes import (
    Shape,
    box,
    divided,
    from_grid,
    lathe,
    merge,
    polyline,
    slab,
    spline,
    superellipsoid,
    tube,
)
from ..stage_writing import Part


def desk(step: float) -> list[Part]:
    """1.6 m wide, 0.75 m deep, the top at 0.75 m; drawers on the left, a panel on the right."""
    top = box((1.60, 0.03, 0.75), step, 0.008).moved(y=0.735)
    panel = box((0.03, 0.72, 0.65), step).moved(x=0.74, y=0.36)
    case = box((0.42, 0.62, 0.62), step).moved(x=-0.53, y=0.41)
    fronts = [box((0.40, 0.19, 0.02), step).moved(x=-0.53, y=y, z=0.322) for y in (0.2, 0.41, 0.62)]
    handles = [
        tube(spline([[-0.6, y, 0.33], [-0.53, y, 0.36], [-0.46, y, 0.33]], 0.02), 0.006, step)
        for y in (0.24, 0.45, 0.66)
    ]
    feet = [
        box((0.03, 0.10, 0.03), step).moved(x, 0.05, z)
        for x in (-0.72, -0.34)
        for z in (-0.27, 0.27)
    ]
    return [
        Part("Top", top, "Oak"),
        Part("Panel", panel, "Oak"),
        Part("Drawers", merge(case, *fronts), "Walnut"),
        Part("Handles", merge(*handles), "Brass"),
        Part("Feet", merge(*feet), "Steel"),
    ]


def shell_chair(step: float, fabric: str) -> list[Part]:
    """Seat and back are one bent shell on four splayed legs."""
    profile = spline(  # height and depth along the middle line, from the front edge to the top
        [[0.42, 0.24], [0.445, 0.15], [0.43, -0.05], [0.46, -0.17], [0.60, -0.24], [0.83, -0.30]],
        step,
    )
    along = np.linspace(0, 1, len(profile))[:, None]
    across = np.linspace(-1, 1, max(6, round(0.5 / step)) + 1)[None]
    half_width = 0.235 + 0.015 * np.sin(np.pi * along) - 0.05 * along**4
    hollow = 0.045 * across**2  # the sides rise from the seat and come forward from the back
    lean = 0.5 - 0.5 * np.cos(np.pi * np.clip((along - 0.35) / 0.3, 0, 1))
    grid = np.stack(
        [
            half_width * across,
            profile[:, :1] + hollow * (1 - lean),
            profile[:, 1:] + 2.2 * hollow * lean,
        ],
        axis=-1,
    )
    legs = [
        tube(polyline([[0.6 * x, 0.42, z * 0.7], [x, 0.0, z]], step), 0.012, step)
        for x in (-0.24, 0.24)
        for z in (-0.22, 0.22)
    ]
    return [Part("Shell", slab(grid, 0.014), fabric), Part("Legs", merge(*legs), "Walnut")]


def round_table(step: float) -> list[Part]:
    """1.1 m across, 0.74 m high: foot, column and top are one surface of revolution."""
    profile = np.concatenate(
        [
            polyline([[0.0, 0.0], [0.30, 0.0]], step),
            spline(
                [[0.30, 0.0], [0.30, 0.015], [0.20, 0.035], [0.07, 0.07], [0.04, 0.16]], step / 2
            ),
            polyline([[0.04, 0.16], [0.04, 0.58]], step),
            spline([[0.04, 0.58], [0.06, 0.66], [0.16, 0.70]], step / 2),
            polyline([[0.16, 0.70], [0.52, 0.705]], step),
            spline([[0.52, 0.705], [0.55, 0.7225], [0.52, 0.74]], step / 2),
            polyline([[0.52, 0.74], [0.0, 0.74]], step),
        ]
    )
    return [Part("Table", lathe(profile, 1.5 * step, around=32), "Walnut")]


def sofa(step: float, seats: int, fabric: str, pillows: tuple[str, ...] = ()) -> list[Part]:
    """Rounded cushions on a frame with rounded arms; 0.66 m a seat."""
    width = 0.66 * seats
    base = box((width + 0.30, 0.20, 0.80), step, 0.04).moved(y=0.20, z=0.02)
    back = box((width + 0.30, 0.46, 0.16), step, 0.07).moved(y=0.53, z=-0.32)
    arms = [
        box((0.16, 0.46, 0.82), step, 0.07).moved(x=side * (width / 2 + 0.08), y=0.36, z=0.01)
        for side in (-1, 1)
    ]
    feet = [
        tube([[x, 0.0, z], [x, 0.06, z], [x, 0.11, z]], 0.02, step)
        for x in (-width / 2, width / 2)
        for z in (-0.30, 0.34)
    ]
    middles = 0.66 * (np.arange(seats) - (seats - 1) / 2)
    cushions = []
    for x in middles:
        cushions.append(superellipsoid((0.67, 0.19, 0.66), 3.6, step).moved(x=x, y=0.375, z=0.10))
        upright = superellipsoid((0.64, 0.44, 0.20), 3.2, step).turned(x=-14)
        cushions.append(upright.moved(x=x, y=0.63, z=-0.17))
    parts = [
        Part("Frame", merge(base, back, *arms), fabric),
        Part("Cushions", merge(*cushions), fabric),
        Part("Feet", merge(*feet), "Walnut"),
    ]
    for number, pillow in enumerate(pillows):
        side = 1 - 2 * (number % 2)
        shape = superellipsoid((0.42, 0.42, 0.17), 2.7, step).turned(
            x=-24, y=-14 * side, z=10 * side
        )
        parts.append(
            Part(f"Pillow{number + 1}", shape.moved(0.40 * side * seats / 2, 0.67, 0.02), pillow)
        )
    return parts


def bookshelf(step: float, seed: int) -> list[Part]:
    """1.2 m wide, 2.0 m high, five boards, filled with books in five bindings."""
    width, height, depth, board = 1.2, 2.0, 0.30, 0.025
    step *= 1.5  # flat and mostly hidden
    upright = box((board, height, depth), step)
    boards = np.linspace(board / 2 + 0.06, height - board / 2, 6)
    frame = [
        upright.moved(x=side * (width - board) / 2, y=height / 2, z=depth / 2) for side in (-1, 1)
    ]
    frame += [box((width - 2 * board, board, depth), step).moved(y=y, z=depth / 2) for y in boards]
    frame.append(
        box((width - 2 * board, height - 0.06, 0.01), step).moved(y=height / 2 + 0.03, z=0.006)
    )
    bindings = ["Ochre", "Teal", "Wine", "Linen", "Slate"]
    books: dict[str, list[Shape]] = {binding: [] for binding in bindings}
    random = np.random.default_rng(seed)
    inner = width / 2 - board - 0.01
    for shelf in boards[:-1]:
        x, end = -inner, inner - random.uniform(0.05, 0.45)
        while x < end - 0.05:
            thick, tall, deep = random.uniform([0.018, 0.19, 0.15], [0.05, 0.30, 0.22])
            book = box((thick - 0.001, tall, deep), step)
            placed = book.moved(
                x + thick / 2, shelf + board / 2 + tall / 2 + 0.0005, 0.03 + deep / 2
            )
            books[bindings[random.integers(len(bindings))]].append(placed)
            x += thick
    return [Part("Frame", merge(*frame), "Oak")] + [
        Part(f"Books{binding}", merge(*shapes), binding)
        for binding, shapes in books.items()
        if shapes
    ]


def vase(step: float) -> list[Part]:
    """A turned vase, 0.3 m high, with an inside."""
    outside = [[0.0, 0.0], [0.045, 0.0], [0.085, 0.07], [0.08, 0.15], [0.035, 0.23], [0.05, 0.30]]
    inside = [
        [0.044, 0.30],
        [0.029, 0.23],
        [0.074, 0.15],
        [0.079, 0.07],
        [0.04, 0.01],
        [0.0, 0.008],
    ]
    profile = np.concatenate(
        [outside[:1], spline(outside[1:], step / 2), spline(inside[:-1], step / 2), inside[-1:]]
    )
    return [Part("Vase", lathe(profile, step, around=24), "Plaster")]


def fruit_bowl(step: float) -> list[Part]:
    """A shallow bowl, 0.32 m across, with oranges."""
    outside = spline([[0.05, 0.0], [0.06, 0.012], [0.12, 0.035], [0.16, 0.085]], step / 2)
    inside = spline([[0.154, 0.087], [0.115, 0.042], [0.055, 0.020]], step / 2)
    bowl = lathe(np.concatenate([[[0.0, 0.0]], outside, inside, [[0.0, 0.018]]]), step, around=24)
    orange = superellipsoid((0.078, 0.076, 0.078), 2.0, step)
    places = [(0.055, 0.072, 0.0), (-0.03, 0.072, 0.05), (-0.03, 0.072, -0.05), (0.0, 0.128, 0.0)]
    fruit = merge(*(orange.moved(*place) for place in places))
    return [Part("Bowl", bowl, "Linen"), Part("Oranges", fruit, "Orange")]


def plant(step: float, seed: int) -> list[Part]:
    """A pot with arching leaves, sheets of no thickness."""
    pot_profile = [[0.0, 0.0], [0.13, 0.0], [0.19, 0.36], [0.175, 0.36], [0.165, 0.31], [0.0, 0.31]]
    random = np.random.default_rng(seed)
    leaves = []
    for number in range(22):
        reach, rise = random.uniform(0.20, 0.45), random.uniform(0.45, 1.0)
        middle = spline([[0.02, 0.0], [0.3 * reach, 0.6 * rise], [reach, 0.85 * rise]], step)
        along = np.linspace(0, 1, len(middle))[:, None]
        across = np.linspace(-1, 1, max(2, 2 * round(0.06 / step)) + 1)[None]
        half_width = 0.004 + 0.062 * np.clip((along - 0.25) / 0.75, 0, 1) ** 0.6 * np.sqrt(
            np.clip(1 - along**3, 0, 1)
        )
        grid = np.stack(
            [
                middle[:, :1] + 0 * across,
                middle[:, 1:] + 0.25 * half_width * across**2,
                half_width * across,
            ],
            axis=-1,
        )
        leaves.append(from_grid(grid).turned(y=137.5 * number).moved(y=0.31))
    return [
        Part("Pot", lathe(polyline(pot_profile, step), step, around=24), "Plaster"),
        Part("Leaves", merge(*leaves), "Leaf", double_sided=True),
    ]


def curtain(step: float, width: float, height: float) -> list[Part]:
    """A pleated sheet that hangs in the XY plane, its lower left corner at the origin."""
    x = np.linspace(0, width, round(2.2 * width / step) + 1)
    y = np.linspace(0, height, round(height / step) + 1)
    x_grid, y_grid = np.meshgrid(x, y, indexing="ij")
    pleats = 0.035 * np.sin(2 * np.pi * x_grid / 0.14 + 0.4 * np.sin(2.5 * y_grid))
    grid = np.stack([x_grid, y_grid, pleats * (1 - 0.45 * y_grid / height)], axis=-1)
    return [Part("Curtain", from_grid(grid), "Linen", double_sided=True)]


def round_rug(step: float, radius: float) -> list[Part]:
    """A flat disc, 12 mm high, with rings in its own face colours."""
    profile = polyline([[radius, 0.0], [radius, 0.012], [0.0, 0.012]], step)
    shape = lathe(profile, 2 * step)
    starts = np.cumsum(shape.counts) - shape.counts
    at = shape.points[shape.indices[starts]]
    distance = np.hypot(at[:, 0], at[:, 2]) / radius
    wine, cream = np.array([0.36, 0.045, 0.05]), np.array([0.62, 0.52, 0.38])
    ring = ((distance > 0.78) & (distance < 0.88)) | ((distance > 0.36) & (distance < 0.42))
    return [Part("Rug", shape, None, face_colours=np.where(ring[:, None], cream, wine))]


def painting(step: float, width: float, height: float, seed: int) -> list[Part]:
    """A framed picture in the XY plane around the origin: blocks in its own face colours."""
    bar = 0.03
    rails = [
        box((width + 2 * bar, bar, 0.03), step).moved(y=side * (height + bar) / 2)
        for side in (-1, 1)
    ]
    stiles = [box((bar, height, 0.03), step).moved(x=side * (width + bar) / 2) for side in (-1, 1)]
    palette = np.array(
        [
            [0.52, 0.45, 0.33],
            [0.50, 0.14, 0.04],
            [0.05, 0.19, 0.24],
            [0.52, 0.29, 0.04],
            [0.25, 0.07, 0.06],
        ]
    )
    random = np.random.default_rng(seed)
    x_cuts = (np.cumsum([0, *random.uniform(0.6, 1.6, 4)])) * width
    y_cuts = (np.cumsum([0, *random.uniform(0.6, 1.6, 3)])) * height
    x_cuts = x_cuts / x_cuts[-1] * width - width / 2
    y_cuts = y_cuts / y_cuts[-1] * height - height / 2
    x, y = np.meshgrid(divided(x_cuts, step / 2), divided(y_cuts, step / 2), indexing="ij")
    canvas = from_grid(np.stack([x, y, 0 * x], axis=-1))
    centre = canvas.points[canvas.indices.reshape(-1, 4)].mean(axis=1)
    column, row = np.searchsorted(x_cuts, centre[:, 0]), np.searchsorted(y_cuts, centre[:, 1])
    block_colours = random.choice(len(palette), (len(x_cuts) + 1, len(y_cuts) + 1))
    return [
        Part("Frame", merge(*rails, *stiles), "Walnut"),
        Part(
            "Canvas", canvas, None, creased=False, face_colours=palette[block_colours[column, row]]
        ),
    ]


def drum_pendant(step: float, ceiling: float) -> list[Part]:
    """An open drum, 0.46 m across, around the origin; its cord reaches `ceiling` m higher."""
    shade = lathe(polyline([[0.23, -0.09], [0.23, 0.09]], step / 2), step, around=32)
    spokes = [
        tube(
            polyline([[0.0, 0.085, 0.0], [0.23 * np.cos(a), 0.085, 0.23 * np.sin(a)]], step),
            0.003,
            step,
            6,
        )
        for a in np.radians([0, 120, 240])
    ]
    cord = tube(polyline([[0, 0.085, 0], [0, ceiling - 0.002, 0]], step), 0.004, step, 6)
    return [
        Part("Shade", shade, "Linen", double_sided=True),
        Part("Suspension", merge(cord, *spokes), "Steel"),
    ]


def floor_lamp(step: float) -> list[Part]:
    """A shade open at both ends at 1.45 to 1.75 m on a thin stem."""
    foot = lathe(
        polyline(
            [[0.0, 0.0], [0.15, 0.0], [0.15, 0.015], [0.012, 0.03], [0.012, 1.50], [0.0, 1.50]],
            step,
        ),
        step,
    )
    shade = lathe(polyline([[0.22, 1.45], [0.15, 1.75]], step / 2), step, around=32)
    return [Part("Stem", foot, "Brass"), Part("Shade", shade, "Linen", double_sided=True)]


def desk_lamp(step: float) -> list[Part]:
    """A bent arm that carries a bell, whose opening is 0.42 m up and 0.2 m in front of the foot."""
    foot = lathe(
        polyline([[0.0, 0.0], [0.08, 0.0], [0.08, 0.012], [0.0, 0.018]], step / 2), step, 20
    )
    arm = tube(
        spline(
            [[0, 0.012, 0], [0, 0.25, -0.05], [0, 0.47, 0.02], [0, 0.53, 0.13], [0, 0.505, 0.20]],
            step,
        ),
        0.007,
        step,
    )
    bell = lathe(
        spline([[0.09, 0.42], [0.082, 0.47], [0.04, 0.505], [0.0, 0.51]], step / 3), step / 2, 24
    )
    return [
        Part("Stand", merge(foot, arm), "Brass"),
        Part("Bell", bell.moved(z=0.20), "Brass", double_sided=True),
    ]


def ceiling_can(step: float) -> list[Part]:
    """A closed can under the ceiling, 0.12 m across, 0.12 m high, its mouth at the origin."""
    profile = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.12], [0.0, 0.12]]
    return [Part("Can", lathe(polyline(profile, step / 2), step, around=24), "Steel")]
