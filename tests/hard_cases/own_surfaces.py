"""Hard cases of surfaces that this project met itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike
from usd_scenes.shapes import Shape, box, merge, rectangle

from hard_cases.hard_case import hard_case
from hard_cases.small_stages import (
    CANDELA,
    FLOOR,
    FLUX,
    UP,
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
    solved,
)
from isolux.solution import Solution
from no_division import no_division

AT = (0.3, 0.2, 2.0)
LAMP = point_light(FLUX, AT)
SIDED = "bool doubleSided = true"


def assert_lit_by_a_point(
    solution: Solution, path: str, at: ArrayLike = AT, share: float = 1.0
) -> None:
    """share · I cosθ/d²."""
    values, places, _ = direct_at_receivers(solution, path)
    expected = share * from_point(CANDELA, at, places, UP)
    assert values == pytest.approx(expected, rel=1e-4)


@hard_case(
    29,
    "nested closed boxes, the light in the inner one",
    "Nothing gets out, however many bounces.",
    "Φ/(A(1−ρ)) inside of the inner box, exactly 0 on its outside and in the outer box",
)
def nested_boxes() -> None:
    inner, outer = box((1, 1, 1), 0.125), box((2, 2, 2), 1.0).flipped()
    text = mesh("Inner", inner, 0.8, SIDED) + mesh("Outer", outer, 0.8)
    for method in ("dept", "composite", "ddl+hpr"):
        lit = solved(text + point_light(FLUX, (0.1, 0.05, 0.2)), method)
        inside = means(lit, "/Inner", back=True)
        assert inside[1] == pytest.approx(0.8 * FLUX / (6 * 0.2), rel=0.05), method
        assert not at_corners(lit, "/Inner").any()
        assert not at_corners(lit, "/Outer").any()
        assert lit.stage.escaped == 0


@hard_case(
    30,
    "two coincident one-sided sheets, back to back: photons",
    "Each side has its own light, whichever sheet comes first and however each is divided.",
    "a sixth of the flux over the sheet's area, tilted in space, too; in a room the light of the "
    "room with one double-sided sheet, by photons, gather and radiosity",
    part="b",
)
def back_to_back() -> None:
    other = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 4 / 7).flipped()
    for bottom, turn in ((FLOOR.flipped(), {}), (other, {}), (other, {"x": 17, "y": 31})):
        lamp = Shape(np.array([(0.0, 0, 2)]), FLOOR.counts, FLOOR.indices).turned(**turn).points[0]
        sheets = mesh("Top", FLOOR.turned(**turn)), mesh("Bottom", bottom.turned(**turn))
        for first, second in (sheets, sheets[::-1]):
            lit = solved(first + second + point_light(FLUX, lamp))
            assert means(lit, "/Top")[0] == pytest.approx(FLUX / 6 / 16, rel=0.03)
            assert lit.stage.back_absorbed == 0
    around = mesh("Room", box((5, 5, 5), 1.0).flipped(), 0.5) + LAMP
    one = around + mesh("Top", FLOOR, 0.7, "bool doubleSided = true")
    two = around + mesh("Bottom", other, 0.7) + mesh("Top", FLOOR, 0.7)
    for method in ("dept", "composite", "ddl+hpr"):
        settings = {"photons": 0} if method == "ddl+hpr" else {}
        expected, found = (means(solved(s, method, **settings), "/Room") for s in (one, two))
        assert found == pytest.approx(expected, rel=0.03), method


@hard_case(
    30,
    "two coincident one-sided sheets, back to back",
    "Each side has its own light by direct lighting.",
    "I cosθ/d² above; 0 below",
)
def back_to_back_directly() -> None:
    lit = directly_lit(mesh("Top", FLOOR) + mesh("Bottom", FLOOR.flipped()) + LAMP)
    assert_lit_by_a_point(lit, "/Top")
    assert not at_corners(lit, "/Bottom").any()


@hard_case(
    31,
    "a mesh of one triangle",
    "Every method and output mode has its light.",
    "I cosθ/d² at its corners; the mean of photons by quadrature",
)
def one_triangle() -> None:
    points = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], float)
    text = mesh("Triangle", polygons(points, [[0, 1, 2]])) + LAMP
    for mode in ("vertex", "refined"):
        assert_lit_by_a_point(directly_lit(text, output_mode=mode), "/Triangle")
    n = 60
    weights = np.array(
        [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
        + [(3 * i + 2, 3 * j + 2) for i in range(n) for j in range(n - i - 1)]
    )
    weights = np.column_stack([weights, 3 * n - weights.sum(axis=1)]) / (3 * n)
    mean = from_point(CANDELA, AT, weights @ points, UP).mean()
    lit = solved(text, photons=400_000)
    hits = mean * 2.0 / FLUX * 400_000
    assert means(lit, "/Triangle")[0] == pytest.approx(mean, rel=4 / np.sqrt(hits))


@hard_case(
    32,
    "a subdivided cage with infinite creases all round",
    "It is the polygon mesh of its cage.",
    "the same cube with subdivisionScheme none",
)
def creased_all_round() -> None:
    cube = box((1, 1, 1), 1.0)
    quads = cube.indices.reshape(-1, 4)
    neighbours = np.stack([quads, np.roll(quads, 1, axis=1)], axis=-1).reshape(-1, 2)
    edges = np.unique(np.sort(neighbours, axis=1), axis=0)
    creased = f"""uniform token subdivisionScheme = "catmullClark"
        int[] creaseIndices = {edges.reshape(-1).tolist()}
        int[] creaseLengths = {[2] * len(edges)}
        float[] creaseSharpnesses = {[10] * len(edges)}
        int[] cornerIndices = {list(range(8))}
        float[] cornerSharpnesses = {[10] * 8}"""
    subdivided, plain = read(mesh("Cube", cube, extra=creased) + LAMP), mesh("Cube", cube) + LAMP
    body = subdivided.meshes[0]
    on_faces = np.abs(body.points).max(axis=1)
    assert on_faces == pytest.approx(0.5, abs=1e-6)
    flux_of_both = [means(solved(s, photons=400_000), "/Cube")[0] for s in (subdivided, plain)]
    assert flux_of_both[0] == pytest.approx(flux_of_both[1], rel=1e-3)


@hard_case(
    33,
    "opacity 0",
    "As if the surface were not there.",
    "the stage without it, bit for bit",
)
def clear() -> None:
    sheet = glass(0.0)
    for method in ("dept", "composite"):
        with_sheet, without = solved(floor() + sheet, method), solved(floor(), method)
        expected = at_corners(without, "/Floor")
        assert np.array_equal(at_corners(with_sheet, "/Floor"), expected)


@hard_case(
    34,
    "opacity 10⁻³",
    "It stops a thousandth of the light, by photons and by shadow rays.",
    "0.999 I cosθ/d² below; the sheet's share of absorbed photons",
)
def nearly_clear() -> None:
    assert_lit_by_a_point(directly_lit(floor() + glass(1e-3)), "/Floor", share=0.999)
    with no_division():  # on smaller buckets the two are filtered otherwise
        dense = solved(floor() + glass(1e-3), photons=1_000_000)
        clean = solved(floor(), photons=1_000_000)
    lost = 1 - means(dense, "/Floor")[0] / means(clean, "/Floor")[0]
    hits = 1_000_000 * means(clean, "/Floor")[0] * 16 / FLUX
    # The same photons: only those that the sheet stops make a difference.
    assert lost == pytest.approx(1e-3, abs=4 * np.sqrt(1e-3 / hits))


def floor() -> str:
    return mesh("Floor", FLOOR) + LAMP


def glass(opacity: float) -> str:
    """A sheet between lamp and floor."""
    sheet = mesh("Sheet", FLOOR.moved(z=1), 0.0, f"{SIDED}\nrel material:binding = </Glass>")
    sheet = sheet.replace(
        'def Mesh "Sheet"', 'def Mesh "Sheet" ( prepend apiSchemas = ["MaterialBindingAPI"] )'
    )
    return (
        sheet
        + f"""def Material "Glass" {{
        token outputs:surface.connect = </Glass/Surface.outputs:surface>
        def Shader "Surface" {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            float inputs:opacity = {opacity}
            token outputs:surface\n}}\n}}\n"""
    )


@hard_case(
    35,
    "a face of 10,000 corners",
    "Triangulated without loss of area; lit as a disk.",
    "½ n r² sin(2π/n); I cosθ/d² at its corners; its share of the photons, (1 − cos 45°)/2",
)
def polygon_of_10000() -> None:
    n = 10_000
    turn = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    disk = Shape(points, np.array([n], np.int32), np.arange(n, dtype=np.int32))
    text = mesh("Disk", disk) + point_light(FLUX, (0, 0, 1))
    lit = solved(text, "composite")  # nothing reflects: direct lighting
    assert lit.vertex_areas.sum() == pytest.approx(n / 2 * np.sin(2 * np.pi / n), rel=1e-6)
    assert_lit_by_a_point(lit, "/Disk", (0, 0, 1))
    traced = solved(text)
    share = (1 - np.sqrt(0.5)) / 2
    found = traced.stage.absorbed / traced.stage.photons
    assert found == pytest.approx(share, abs=4 * np.sqrt(share / traced.stage.photons))


@hard_case(
    36,
    "a flat mesh seen edge-on by the light",
    "0 on both sides, not NaN, and no photon counted twice.",
    "0 by the cosine",
)
def edge_on() -> None:
    sheet = mesh("Sheet", FLOOR, 0.5, SIDED)
    for lamp in (point_light(FLUX, (3, 0, 0)), point_light(FLUX, (0.3, 0.2, 0.0), radius=0.0)):
        for method in ("dept", "ddl+hpr"):
            lit = solved(sheet + lamp, method)
            for back in (False, True):
                assert not photometric(lit.direct[lit.layout("/Sheet").front]).any(), back
                assert not at_corners(lit, "/Sheet", back=back).any(), method


@hard_case(
    37,
    "the refined mesh over a T-junction",
    "Split vertices have the direct light of their place on either side of the junction.",
    "I cosθ/d² at each vertex of the adaptive mesh",
)
def refined_t_junction() -> None:
    halves = merge(
        rectangle((-2, -2, 0), (2, 0, 0), (0, 4, 0), 1.0),
        rectangle((0, -2, 0), (2, 0, 0), (0, 4, 0), 4 / 3),
    )
    near = 0.3, 0.2, 0.8
    text = mesh("Floor", halves, 0.5) + point_light(FLUX, near)
    lit = directly_lit(text, output_mode="refined")
    count = lit.refined.vertex_count
    assert len(lit.direct) > count
    points = np.zeros((count, 3), np.float32)
    points[lit.layout("/Floor").corner_vertices] = halves.points[halves.indices]
    everywhere = lit.refined.interpolate(points).astype(float)
    expected = from_point(CANDELA, near, everywhere, UP)
    # Each receives its light a little inside of the border: by a 64th of an element.
    assert photometric(lit.direct) == pytest.approx(expected, rel=0.02)


@hard_case(
    38,
    "a closed room of reflectance 0.99",
    "No bounce is left out: a hundred count.",
    "ρΦ/(A(1−ρ)) in the mean, by photons, gather and radiosity",
)
def white_room() -> None:
    text = mesh("Room", box((4, 4, 4), 2.0).flipped(), 0.99) + point_light(FLUX, (0.3, 0.2, 0.1))
    expected = 0.99 * FLUX / (96 * 0.01)
    for method in ("dept", "composite", "ddl+hpr"):
        photons = 0 if method == "ddl+hpr" else 20_000
        lit = solved(text, method, photons=photons)
        assert mean_everywhere(lit)[1] == pytest.approx(expected, rel=0.03), method


@hard_case(
    39,
    "boxes that run into each other",
    "What lies wholly inside of another box is dark; the rest is lit as their union.",
    "0 inside, an element from the border on; I cosθ/d² outside",
)
def interpenetrating() -> None:
    one, two = box((1, 1, 1), 0.25), box((1, 1, 1), 0.25).moved(x=0.6, y=0.1, z=-0.1)
    lit = directly_lit(mesh("A", one) + mesh("B", two) + point_light(FLUX, (0.2, 0.1, 3)))
    corners = two.points[two.indices]
    inside = (np.abs(corners) < 0.5 - 0.25).all(axis=1)
    values = at_corners(lit, "/B")
    assert inside.sum() >= 16
    assert not values[inside].any()
    values, places, normals = direct_at_receivers(lit, "/B")
    top = (normals[:, 2] > 0.5) & (places[:, 0] > 0.7)  # past the shadow of the other box
    assert top.sum() > 5
    assert values[top] == pytest.approx(
        from_point(CANDELA, (0.2, 0.1, 3), places[top], UP), rel=1e-4
    )


@hard_case(
    39,
    "a box that stands along rows of its floor's vertices",
    "Vertices on its outline have the light of the side that light can reach.",
    "I cosθ/d² along the lit side, 0 along the other, on the level and where rounding puts the "
    "vertices inside or outside",
    part="b",
)
def standing_on_vertices() -> None:
    floor = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25)
    for turn in ({}, {"x": 17, "y": 31}, {"x": 40, "y": 10}):
        axes = Shape(np.vstack([np.eye(3), (-2.0, 0.1, 1.5)]), floor.counts, floor.indices)
        *axes, lamp = axes.turned(**turn).points
        for off in (0.0, 1e-6, -1e-6):
            block = box((1, 1, 0.6), 0.5).moved(x=off, z=0.28)  # 2 cm in the floor
            lit = directly_lit(
                mesh("Floor", floor.turned(**turn))
                + mesh("Block", block.turned(**turn), 0.0, SIDED)
                + point_light(FLUX, tuple(lamp))
            )
            values, places, _ = direct_at_receivers(lit, "/Floor")
            x, y, _ = (places @ np.transpose(axes)).T
            for row, light in ((-0.5, 1.0), (0.5, 0.0)):
                along = (abs(x - row) < 0.01) & (abs(y) < 0.45)
                assert along.sum() >= 3
                expected = light * from_point(CANDELA, lamp, places[along], axes[2])
                assert values[along] == pytest.approx(expected, rel=1e-3)


@hard_case(
    39,
    "a column whose foot is below the floor",
    "Vertices in the floor have the light of where their edges come out: no shade all over the "
    "elements that can be seen.",
    "I cosθ/d² there",
    part="c",
)
def buried_foot() -> None:
    for turn in ({}, {"x": 17, "y": 31}):
        column = box((0.2, 0.2, 1.05), 0.3).moved(z=0.475)  # 5 cm in the floor
        values, places, normals, lamp, up = on_a_floor(column, 0.3, turn)
        sides = abs(normals @ up) < 0.5
        assert (places[sides] @ up > 0).all()
        expected = from_point(CANDELA, lamp, places[sides], normals[sides])
        assert values[sides] == pytest.approx(expected, rel=1e-3, abs=1e-9)


@hard_case(
    39,
    "a ramp that goes down from the plane of the floor",
    "Its vertices below have the light of its upper edge, where the floor begins to cover them.",
    "I cosθ/d² there",
    part="d",
)
def ramp_into_the_floor() -> None:
    for turn in ({}, {"x": 17, "y": 31}, {"x": 40, "y": 10}):
        ramp = merge(
            rectangle((-0.77, -0.31, 0), (0.4, 0, 0), (0, 0.6, 0), 0.8),
            rectangle((-0.37, -0.31, 0), (0.8, 0, -0.05), (0, 0.6, 0), 0.8),
        )
        values, places, normals, lamp, _ = on_a_floor(ramp, 4.0, turn)
        assert values == pytest.approx(from_point(CANDELA, lamp, places, normals), rel=1e-3)


def on_a_floor(body: Shape, step: float, turn: dict[str, float]) -> tuple[np.ndarray, ...]:
    """Direct light on a body, lx, its places and normals; where the lamp is, and up."""
    axes = Shape(np.array([(0.7, 0.4, 1.5), UP]), FLOOR.counts, FLOOR.indices)
    lamp, up = axes.turned(**turn).points
    floor = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), step)
    lit = directly_lit(
        mesh("Floor", floor.turned(**turn))
        + mesh("Body", body.turned(**turn))
        + point_light(FLUX, tuple(lamp))
    )
    return *direct_at_receivers(lit, "/Body"), lamp, up
