"""Hard cases of faces, edges and surfaces: 1 to 4, 15, 22, 23."""

from __future__ import annotations

import numpy as np
import pytest
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
    findings_at,
    from_point,
    mean_everywhere,
    means,
    mesh,
    point_light,
    polygons,
    read,
    solved,
)
from no_division import no_division

LAMP = point_light(FLUX, (0.3, 0.2, 2.0))


@hard_case(
    1,
    "zero-area and repeated-index faces",
    "Topology is kept; such a face has no weight; a vertex of it alone takes the value of its "
    "surroundings; one finding a mesh.",
    "the floor without those faces, bit for bit by direct lighting; by photons I cosθ/d² at "
    "vertices that such faces alone use",
)
def faces_without_area() -> None:
    extra = [(0.1, -0.1, 0.0), (0.2, -0.1, 0.0), (0.3, -0.1, 0.0)]
    count, faces = len(FLOOR.points), FLOOR.indices.reshape(-1, 4).tolist()
    degenerate = [[0, 0, 1], [2, 2, 2], [0, 1, 2], [count, count + 1, count + 2]]
    broken = polygons([*map(tuple, FLOOR.points), *extra], faces + degenerate)
    scene = read(mesh("Floor", broken) + LAMP)
    assert [finding.action for finding in findings_at(scene, "/Floor")] == ["repaired"]
    values, clean = (
        at_corners(directly_lit(s), "/Floor") for s in (scene, mesh("Floor", FLOOR) + LAMP)
    )
    kept = len(FLOOR.indices)
    assert len(values) == len(broken.indices)
    assert np.array_equal(values[:kept], clean)
    shared = broken.indices[kept:-3]
    at_point = dict(zip(broken.indices[:kept].tolist(), clean, strict=True))
    assert values[kept:-3].tolist() == [at_point[point] for point in shared.tolist()]
    expected = from_point(CANDELA, (0.3, 0.2, 2.0), np.array(extra), UP)
    with no_division():
        whole = solved(scene, photons=400_000)
    divided = solved(scene, photons=6_000_000)  # its buckets are a fortieth of those
    for photons in (whole, divided):
        assert at_corners(photons, "/Floor")[-3:] == pytest.approx(expected, rel=0.1)


@hard_case(
    1,
    "a vertex of faces without area alone: direct lighting",
    "It takes the value of its surroundings.",
    "I cosθ/d²",
    part="b",
)
def vertex_of_no_area() -> None:
    extra = [(0.1, -0.1, 0.0), (0.2, -0.1, 0.0), (0.3, -0.1, 0.0)]
    count, faces = len(FLOOR.points), FLOOR.indices.reshape(-1, 4).tolist()
    broken = polygons([*map(tuple, FLOOR.points), *extra], [*faces, [count, count + 1, count + 2]])
    expected = from_point(CANDELA, (0.3, 0.2, 2.0), np.array(extra), UP)
    values = at_corners(directly_lit(mesh("Floor", broken) + LAMP), "/Floor")
    assert values[-3:] == pytest.approx(expected, rel=0.1)


@hard_case(
    2,
    "a needle of 10⁶ : 1",
    "It is not split by the adaptive mesh; its values are finite and right.",
    "a wide triangle under the same shadow border, which is split; I cosθ/d² at its corners",
)
def needle() -> None:
    def sliver(height: float, reflectance: float) -> str:
        points = [(-0.5, 0.0, 1.0), (0.5, 0.0, 1.0), (0.0, height, 1.0)]
        return mesh("Needle", polygons(points, [[0, 1, 2]]), reflectance)

    screen = mesh("Screen", rectangle((-2.1, -2, 1.5), (2.0, 0, 0), (0, 4, 0), 2.0))
    parts = [
        (
            directly_lit(
                sliver(height, 0.5) + screen + LAMP, output_mode="refined"
            ).refined.element_parents
            == 0
        ).sum()
        for height in (1.0, 1e-6)
    ]
    assert parts[0] > parts[1] == 1
    lit = directly_lit(sliver(1e-6, 0.0) + LAMP)
    values, places, _ = direct_at_receivers(lit, "/Needle")
    points = np.array([(-0.5, 0.0, 1.0), (0.5, 0.0, 1.0), (0.0, 1e-6, 1.0)])
    expected = from_point(CANDELA, (0.3, 0.2, 2.0), places, UP)
    assert values == pytest.approx(expected, rel=1e-4)
    assert places == pytest.approx(points, abs=0.01)


OVERHEAD = """def DistantLight "Sun" {
    float inputs:intensity = 1000
    float inputs:angle = 0
    bool inputs:normalize = true\n}\n"""


def uneven_room():
    """A closed box of 4 m turned in space, each wall divided in its own way."""
    walls = []
    for axis in range(3):
        for end in (0, 1):
            corner, u, v = np.full(3, -2.0), np.zeros(3), np.zeros(3)
            corner[axis] = 2.0 if end else -2.0
            u[(axis + 1) % 3] = v[(axis + 2) % 3] = 4.0
            step = 4 / (3, 7, 4, 9, 5, 11)[2 * axis + end]
            walls.append(rectangle(corner, v, u, step) if end else rectangle(corner, u, v, step))
    return merge(*walls).turned(x=17, y=31, z=53)


@hard_case(
    3,
    "T-junctions",
    "No light leaks through them; filtered values go on across them.",
    "0 escaped photons and ρΦ/(A(1−ρ)) in a closed box whose walls are all divided unlike; the "
    "illuminance of distant light all over a floor of two halves divided unlike, within its error",
)
def t_junctions() -> None:
    reflectance, photons = 0.8, 100_000
    room = uneven_room()
    stage = mesh("Room", room, reflectance) + point_light(FLUX, (0.1, 0.2, 0.3))
    lit = solved(stage, photons=photons)
    assert lit.stage.escaped == lit.stage.back_absorbed == 0
    indirect = reflectance * FLUX / (96 * (1 - reflectance))
    assert mean_everywhere(lit)[1] == pytest.approx(
        indirect, rel=4 / np.sqrt(reflectance * photons)
    )

    halves = [
        rectangle((-2, -2, 0), (2, 0, 0), (0, 4, 0), 4 / 24),
        rectangle((0, -2, 0), (2, 0, 0), (0, 4, 0), 4 / 31),
    ]
    floor = solved(mesh("Floor", merge(*halves)) + OVERHEAD, photons=200_000)
    values, places, _ = direct_at_receivers(floor, "/Floor")
    deviations = (values / 1000 - 1) / floor.relative_deviation
    on_seam = np.abs(places[:, 0]) < 0.01
    assert on_seam.sum() > 50
    assert deviations.std() < 1.2
    assert deviations[on_seam].std() < 1.2


@hard_case(
    4,
    "coplanar duplicates",
    "The first one owns the photons; what both reflect is not doubled; the same from run to run.",
    "the same room with one floor, by photons and by gather",
)
def coplanar_duplicates() -> None:
    once, twice = floors(1), floors(2)
    for method in ("dept", "composite"):
        one, two = (solved(text, method) for text in (once, twice))
        assert means(two, "/Walls") == pytest.approx(means(one, "/Walls"), rel=0.03), method
    one, two = (solved(twice, threads=threads) for threads in (1, 2))
    assert np.array_equal(one.direct, two.direct)
    assert means(two, "/Floor0")[0] > 0
    assert not means(two, "/Floor1").any()


@hard_case(
    4,
    "coplanar duplicates: radiosity",
    "What both reflect is not doubled.",
    "the same room with one floor, also where the copy is divided unlike or is in the same mesh",
    part="b",
)
def coplanar_duplicates_in_radiosity() -> None:
    one = means(directly_lit(floors(1)), "/Walls")
    for others in (floors(2), floors(2, 3 / 7), floors(3), doubled_floor()):
        assert means(directly_lit(others), "/Walls") == pytest.approx(one, rel=0.03)


WALLS = mesh("Walls", box((4, 4, 3), 1.0).moved(z=1.5).flipped(), 0.5)
WALLS += point_light(FLUX, (0, 0, 2.0), radius=0.05)


def floor_in_air(step: float = 0.75) -> Shape:
    return rectangle((-1.5, -1.5, 0.3), (3, 0, 0), (0, 3, 0), step)


def floors(count: int, step: float = 0.75) -> str:
    """A room with so many floors in one place, the first in steps of 0.75 m."""
    shapes = [floor_in_air()] + [floor_in_air(step)] * (count - 1)
    return WALLS + "".join(
        mesh(f"Floor{i}", shape, 0.7, "bool doubleSided = true") for i, shape in enumerate(shapes)
    )


def doubled_floor() -> str:
    """A room with a floor that has each of its faces twice."""
    twice = merge(floor_in_air(), floor_in_air())
    return WALLS + mesh("Floor", twice, 0.7, "bool doubleSided = true")


@hard_case(
    15,
    "non-manifold edges and vertices",
    "Three sheets on one edge keep a light of their own each.",
    "the same sheets as three meshes",
)
def non_manifold() -> None:
    angles = np.radians([0, 120, 240])
    along = np.linspace(0, 1, 5)
    sheets = []
    for angle in angles:
        u = np.array([0, np.cos(angle), np.sin(angle)])
        sheets.append(rectangle((0, 0, 0), (1, 0, 0), u, along[1]))
    joined, sided = merge(*sheets), "bool doubleSided = true"
    lamp = point_light(FLUX, (0.4, 0.6, 0.5))
    one = mesh("Fan", joined, 0.0, sided) + lamp
    three = "".join(mesh(f"Sheet{i}", s, 0.0, sided) for i, s in enumerate(sheets)) + lamp
    together, apart = directly_lit(one), directly_lit(three)
    for back in (False, True):
        values = at_corners(together, "/Fan", back=back).reshape(3, -1)
        for i in range(3):
            expected = at_corners(apart, f"/Sheet{i}", back=back)
            # On the edge itself, a receiver of no extent, either side of the neighbour is right.
            inner = np.linalg.norm(sheets[i].points[sheets[i].indices][:, 1:], axis=1) > 0
            assert values[i][inner] == pytest.approx(expected[inner], rel=1e-4, abs=1e-4)
    assert solved(one).stage.back_absorbed == 0


@hard_case(
    22,
    "extraordinary points, creases, holes of a subdivision surface",
    "Points and normals are those of the limit surface; light goes through holes.",
    "(n²v + 4Σe + Σf)/(n(n+5)) at a corner of a Catmull-Clark cube, n = 3; by symmetry its "
    "normal; I cosθ/d² below a hole",
)
def subdivision() -> None:
    points = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cube = polygons(points, faces)
    smooth = 'uniform token subdivisionScheme = "catmullClark"'
    body = read(mesh("Cube", cube, extra=smooth) + LAMP).meshes[0]
    at = np.linalg.norm(body.points - 0.5, axis=1).argmin()
    assert body.points[at] == pytest.approx([0.5] * 3, abs=1e-6)  # (9 + 4 - 1) / 24
    corner = np.flatnonzero(body.face_vertex_indices == at)
    assert body.corner_normals[corner] == pytest.approx(3**-0.5, abs=1e-5)

    # The top is a hole between infinite creases, the bottom a hole without any.
    creased = f"""{smooth}
        int[] holeIndices = [4, 5]
        int[] creaseIndices = [1, 5, 7, 3, 1]
        int[] creaseLengths = [5]
        float[] creaseSharpnesses = [10]"""
    holed = mesh("Cube", cube, extra=creased)
    target = rectangle((-0.05, -0.05, -2), (0.1, 0, 0), (0, 0.1, 0), 0.1)
    lit = directly_lit(holed + mesh("Target", target) + point_light(FLUX, (0, 0, 2.0)))
    expected = from_point(CANDELA, (0, 0, 2), target.points[target.indices], UP)
    assert at_corners(lit, "/Target") == pytest.approx(expected, rel=1e-4)
    closed = directly_lit(
        mesh("Cube", cube, extra=smooth) + mesh("Target", target) + point_light(FLUX, (0, 0, 2.0))
    )
    assert not at_corners(closed, "/Target").any()


@hard_case(
    23,
    "a thin wall lit on both sides",
    "The filter never takes light from the other side.",
    "lamps of 1000 : 1 on either side, each side by I cosθ/d² in the mean",
)
def thin_wall() -> None:
    sheet = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25)
    lamps = point_light(1000 * FLUX, (0, 0, 1), "Bright"), point_light(FLUX, (0, 0, -1), "Dim")
    share = np.arcsin(0.8) / np.pi  # of all directions: asin(a²/(a² + h²))/π, a = 2 h
    one_sheet = mesh("Wall", sheet, 0.0, "bool doubleSided = true")
    slab = mesh("Top", sheet.moved(z=5e-4)) + mesh("Bottom", sheet.flipped().moved(z=-5e-4))
    for text, sides in (
        (one_sheet, (("/Wall", False), ("/Wall", True))),
        (slab, (("/Top", False), ("/Bottom", False))),
    ):
        lit = solved(text + "".join(lamps), photons=1_000_000)
        for (path, back), flux in zip(sides, (1000 * FLUX, FLUX), strict=True):
            sigma = 1 / np.sqrt(1_000_000 * share * flux / (1001 * FLUX))
            expected = flux * share / 16
            # By the mean over the filtered values: what crossed would be a multiple of it.
            assert means(lit, path, back=back)[0] == pytest.approx(expected, rel=0.03 + 4 * sigma)
