"""Hard cases of luminaires that this project met itself."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from hard_cases.hard_case import hard_case
from hard_cases.luminaires import inline
from hard_cases.small_stages import (
    CANDELA,
    FLOOR,
    FLUX,
    UP,
    Array,
    at_corners,
    direct_at_receivers,
    directly_lit,
    from_point,
    mean_everywhere,
    means,
    mesh,
    photometric,
    point_light,
    polygons,
    read,
    rect_light,
    solved,
    sphere_light,
)

CORNERS = FLOOR.points[FLOOR.indices]


@hard_case(
    40,
    "an emissive mesh with faces without area",
    "They give no light and take none away.",
    "the same lamp without those faces; πL·r²/(r² + h²) of a disk",
)
def emissive_faces_without_area() -> None:
    n = 64
    turn = 2 * np.pi * np.arange(n) / n
    points = [*zip(0.3 * np.cos(turn), 0.3 * np.sin(turn), np.full(n, 2.0), strict=True), (0, 0, 2)]
    faces = [[n, (i + 1) % n, i] for i in range(n)]
    degenerate = [[0, 0, 1], [5, 5, 5], [n, 0, n]]
    target = rectangle((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0), 0.02)

    def lamp(faces: list[list[int]]) -> str:
        text = mesh("Lamp", polygons(points, faces), 0.0, "float inputs:intensity = 100")
        return text.replace(
            'def Mesh "Lamp"', 'def Mesh "Lamp" ( prepend apiSchemas = ["MeshLightAPI"] )'
        )

    clean, broken = (read(lamp(f) + mesh("Target", target)) for f in (faces, faces + degenerate))
    area = n / 2 * 0.09 * np.sin(2 * np.pi / n)
    assert broken.luminous_flux == pytest.approx(clean.luminous_flux, rel=1e-12)
    assert clean.luminous_flux == pytest.approx(np.pi * 100 * area, rel=1e-6)
    expected = 100 * area / (4 + 0.09)
    for scene in (clean, broken):
        assert at_corners(directly_lit(scene), "/Target") == pytest.approx(expected, rel=5e-3)
        assert solved(scene).stage.photons == 40_000


TURNED = {"x": 17, "y": 31, "z": 53}


def corner_room(turn: dict[str, float]) -> str:
    """A room and a light in its corner, where the origin is."""
    room = box((2, 2, 2), 0.5).moved(1, 1, 1).flipped().turned(**turn)
    return mesh("Room", room) + point_light(FLUX, (0, 0, 0))


def assert_lit_from_its_corner(least: float, below: float) -> None:
    """Vertices whose least coordinate is in this range."""
    values, places, normals = direct_at_receivers(directly_lit(corner_room({})), "/Room")
    expected = from_point(CANDELA, (0, 0, 0), places, normals)
    expected[places.max(axis=1) < 2] = 0.0  # beside the light
    chosen = (places.min(axis=1) >= least) & (places.min(axis=1) < below)
    assert expected[chosen].any()
    assert values[chosen] == pytest.approx(expected[chosen], rel=1e-3)
    turned = photometric(directly_lit(corner_room(TURNED)).direct)
    assert turned[chosen] == pytest.approx(expected[chosen], rel=1e-3, abs=1e-2)


@hard_case(
    41,
    "a light exactly in a corner: next to the walls that it lies in",
    "It lights the edges of the opposite walls, too.",
    "I cosθ/d²; an eighth of the photons end in the room, none of them at a back, also where the "
    "room is turned in space",
    part="b",
)
def edges_from_a_corner() -> None:
    for turn in ({}, TURNED):
        stage = solved(corner_room(turn)).stage
        share = stage.absorbed / stage.photons
        assert share == pytest.approx(1 / 8, abs=4 * np.sqrt(1 / 8 * 7 / 8 / stage.photons))
        assert stage.back_absorbed == 0
    assert_lit_from_its_corner(1e-9, 0.01)


@hard_case(
    41,
    "a light exactly in a corner",
    "It lights the three opposite walls, and not those that it lies in.",
    "I cosθ/d² and 0 by direct lighting",
)
def in_a_corner() -> None:
    assert_lit_from_its_corner(0.01, 2.0)


@hard_case(
    42,
    "luminaires of 10⁶ : 1 in flux, in rooms of their own",
    "The dim room is as right as the bright one once direct lighting has run.",
    "Φ/A in the mean of each black room, 10⁶ : 1",
)
def bright_and_dim() -> None:
    room = box((2, 2, 2), 0.25).flipped()
    text = mesh("Bright", room) + mesh("Dim", room.moved(x=5))
    text += point_light(1e6, (0.2, 0.1, 0.3), "A") + point_light(1.0, (5.2, 0.1, 0.3), "B")
    lit = directly_lit(text)
    bright, dim = (at_corners(lit, path) for path in ("/Bright", "/Dim"))
    assert dim == pytest.approx(bright / 1e6, rel=1e-4)
    assert means(lit, "/Dim")[0] == pytest.approx(1 / 24, rel=0.02)


@hard_case(
    43,
    "luminaires of 10⁶ : 1 in flux, in one room",
    "Light adds: the dim one is in the sum.",
    "each alone, added, to 10⁻⁵; the dim one alone by I cosθ/d²",
)
def bright_beside_dim() -> None:
    bright = point_light(FLUX * 1e6, (0, 0, 1000.0), "Bright")
    dim = point_light(FLUX, (0.3, 0.2, 0.5), "Dim")
    floor = mesh("Floor", FLOOR)
    one, two, both = (
        at_corners(directly_lit(floor + t), "/Floor") for t in (bright, dim, bright + dim)
    )
    assert both == pytest.approx(one + two, rel=1e-5)
    values, places, normals = direct_at_receivers(directly_lit(floor + dim), "/Floor")
    assert values == pytest.approx(from_point(CANDELA, (0.3, 0.2, 0.5), places, normals), rel=1e-3)


DOME = 'def DomeLight "Sky" {\n    float inputs:intensity = 100\n}\n'


@hard_case(
    44,
    "a dome over a closed room",
    "None of it gets in.",
    "exactly 0 inside; πL on the roof",
)
def dome_outside() -> None:
    room = mesh("Room", box((4, 4, 4), 1.0), 0.5, "bool doubleSided = true")
    for method in ("dept", "composite", "ddl+hpr"):
        lit = solved(room + DOME, method)
        assert not at_corners(lit, "/Room", back=True).any(), method
        assert means(lit, "/Room").sum() == pytest.approx(np.pi * 100, rel=0.03), method


@hard_case(
    45,
    "distant light at 89.99°",
    "E falls with the cosine to the end; beyond 90° it is 0.",
    "E₀ cos 89.99°, to 10⁻³",
)
def grazing() -> None:
    for angle, expected in ((89.99, 1000 * np.sin(np.radians(0.01))), (90.01, 0.0)):
        sun = f"""def DistantLight "Sun" {{
            float inputs:intensity = 1000
            float inputs:angle = 0
            bool inputs:normalize = true
            double xformOp:rotateX = {angle}
            uniform token[] xformOpOrder = ["xformOp:rotateX"]\n}}\n"""
        lit = directly_lit(mesh("Floor", FLOOR) + sun)
        overhead = directly_lit(mesh("Floor", FLOOR) + sun.replace(str(angle), "0.0"))
        scale = means(overhead, "/Floor")[0] / 1000
        assert scale > 0
        assert at_corners(lit, "/Floor") == pytest.approx(scale * expected, rel=1e-3, abs=1e-12)


@hard_case(
    46,
    "a diagram that is 0 in most directions",
    "Nothing outside of the beam, I cosθ/d² inside.",
    "0 beyond 10°; the diagram's candela by d² below; all photons on a floor that holds the beam",
)
def narrow_beam() -> None:
    gamma, candela = [0.0, 10.0, 10.001, 90.0, 180.0], [1000.0, 1000.0, 0.0, 0.0, 0.0]
    text = mesh("Floor", rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.125))
    text += inline(gamma, candela)
    shape = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.125)
    points = shape.points[shape.indices]
    angle = np.degrees(np.arctan2(np.hypot(points[:, 0], points[:, 1]), 2.0))
    values = at_corners(directly_lit(text), "/Floor")
    expected = from_point(1000.0, (0, 0, 2), points, UP)
    assert values[angle < 9.9] == pytest.approx(expected[angle < 9.9], rel=1e-3)
    assert not values[angle > 10.1].any()
    stage = solved(text).stage
    assert stage.absorbed == stage.photons


@hard_case(
    47,
    "a lamp half sunk in the floor",
    "Its upper half lights the floor around it, its lower half the floor's back as much.",
    "L(asin(R/d) − (R/d)√(1 − (R/d)²)) at a distance d from its centre; the integral of that is "
    "the share of the photons on either side",
)
def half_sunk() -> None:
    radius, luminance = 0.3, 100.0
    text = mesh("Floor", FLOOR) + sphere_light(luminance, radius, (0, 0, 0))

    def expected(distance: Array) -> Array:
        ratio = radius / np.maximum(distance, radius)
        lit = luminance * (np.arcsin(ratio) - ratio * np.sqrt(1 - ratio**2))
        return np.where(distance > radius, lit, 0.0)

    values, places, _ = direct_at_receivers(directly_lit(text), "/Floor")
    assert values == pytest.approx(expected(np.linalg.norm(places, axis=1)), rel=0.01)
    middles = (np.arange(2000) + 0.5) / 500 - 2
    flux = expected(np.hypot(middles, middles[:, None])).mean() * 16
    share = flux / (np.pi * luminance * 4 * np.pi * radius**2)
    stage = solved(text).stage
    for count in (stage.absorbed, stage.back_absorbed):
        sigma = np.sqrt(share / stage.photons)
        assert count / stage.photons == pytest.approx(share, abs=4 * sigma)


@hard_case(
    48,
    "a luminous line: a rectangle of 10⁶ : 1",
    "Its flux and its light are those of a line.",
    "Lw/h · ½(atan(l/h) + (l/h)/(1 + (l/h)²)) below one end",
)
def luminous_line() -> None:
    width, length, height = 2e-6, 2.0, 1.0
    target = rectangle((-1e-3, -1e-3, 0), (2e-3, 0, 0), (0, 2e-3, 0), 2e-3)
    text = mesh("Target", target) + rect_light(1e6, (length, width), (1.0, 0, height))
    q = length / height
    expected = 1e6 * width / height * 0.5 * (np.arctan(q) + q / (1 + q * q))
    assert at_corners(directly_lit(text), "/Target").mean() == pytest.approx(expected, rel=5e-3)


@hard_case(
    49,
    "a luminaire of one colour channel",
    "The other channels are exactly 0, after all bounces, too.",
    "0; ρΦ/(A(1−ρ)) in the mean",
)
def one_channel() -> None:
    room = mesh("Room", box((4, 4, 4), 1.0).flipped(), 0.5)
    red = sphere_light(1000.0, 0.1, (0.3, 0.2, 0.1), extra="color3f inputs:color = (1, 0, 0)")
    for method in ("dept", "composite", "ddl+hpr"):
        lit = solved(room + red, method)
        for light in (lit.direct, lit.indirect):
            assert (light[:, 0] > 0).all()
            assert not light[:, 1:].any()
        flux = lit.scene.luminous_flux
        assert mean_everywhere(lit)[1] == pytest.approx(flux / 96, rel=0.05), method


@hard_case(
    50,
    "a light within its own closed emissive mesh",
    "The mesh's front alone shines: nothing comes back to it, and nothing is counted twice.",
    "Φ = πLA all escapes a convex emissive body in the open",
)
def emissive_body() -> None:
    body = box((1, 1, 1), 0.5)
    lamp = mesh("Lamp", body, 0.0, "float inputs:intensity = 100").replace(
        'def Mesh "Lamp"', 'def Mesh "Lamp" ( prepend apiSchemas = ["MeshLightAPI"] )'
    )
    scene = read(lamp)
    assert scene.luminous_flux == pytest.approx(np.pi * 100 * 6, rel=1e-6)
    for solve in (solved, directly_lit):
        lit = solve(scene)
        assert not lit.direct.any()
    assert solved(scene).stage.escaped == 40_000
