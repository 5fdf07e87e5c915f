"""Hard cases of luminaires: 7 to 9, 18 to 20."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import Shape, box, rectangle

from hard_cases.hard_case import hard_case
from hard_cases.small_stages import (
    CANDELA,
    FLOOR,
    FLUX,
    Array,
    at_corners,
    direct_at_receivers,
    directly_lit,
    findings_at,
    from_point,
    mesh,
    point_light,
    read,
    rect_light,
    solved,
    solver_of,
    sphere_light,
)

ROOM = box((4, 4, 4), 1.0).flipped()
LONG = 1000.0  # times the radius and more: an endless tube


def along_x(head: str, body: str, at: Array, axis: Array) -> str:
    """A light whose local X lies along an axis, unit."""
    x = np.asarray(axis, float)
    y = np.cross(np.eye(3)[np.abs(x).argmin()], x)
    y /= np.linalg.norm(y)
    rows = [(*row, 0.0) for row in (x, y, np.cross(x, y))] + [(*at, 1.0)]
    matrix = ", ".join(str(tuple(map(float, row))) for row in rows)
    return f"""{head} {{\n{body}
        matrix4d xformOp:transform = ({matrix})
        uniform token[] xformOpOrder = ["xformOp:transform"]\n}}\n"""


@hard_case(
    7,
    "a light that touches a surface",
    "Finite and right up to the point of touch; no flux is lost.",
    "πL R³/d³ around a sphere of radius R on a floor; all photons of a rectangle flush with a "
    "ceiling meet the other walls",
)
def touching() -> None:
    radius, luminance = 0.5, 100.0
    lit = directly_lit(mesh("Floor", FLOOR) + sphere_light(luminance, radius, (0, 0, radius)))
    values, places, _ = direct_at_receivers(lit, "/Floor")
    distance = np.hypot(np.hypot(places[:, 0], places[:, 1]), radius)
    aside = distance > radius
    expected = np.pi * luminance * (radius / distance) ** 3
    assert values[aside] == pytest.approx(expected[aside], rel=5e-3)
    near = mesh("Floor", rectangle((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0), 0.02))
    lit = directly_lit(near + sphere_light(luminance, radius, (0, 0, radius)))
    assert at_corners(lit, "/Floor") == pytest.approx(np.pi * luminance, rel=2e-3)
    flush = solved(mesh("Room", ROOM) + rect_light(luminance, (1.0, 1.0), (0.3, 0.4, 2.0)))
    assert flush.stage.absorbed == flush.stage.photons
    on_ceiling = ROOM.points[ROOM.indices].reshape(-1, 4, 3)[:, :, 2].min(axis=1) == 2.0
    assert not at_corners(flush, "/Room").reshape(-1, 4)[on_ceiling].any()


@hard_case(
    7,
    "a vertex exactly where a sphere or a tube touches its floor",
    "The limit from outside.",
    "πL, on the level and where rounding puts the vertex inside or outside; 0 within the sphere",
    part="b",
)
def point_of_touch() -> None:
    tube = f"""float inputs:intensity = 100\nfloat inputs:radius = 0.5
        float inputs:length = {LONG}"""
    for head, body in (
        ('def SphereLight "Lamp"', "float inputs:intensity = 100\nfloat inputs:radius = 0.5"),
        ('def CylinderLight "Lamp"', tube),
    ):
        for turn in ({}, {"x": 17, "y": 31}, {"x": 40, "y": 10}):
            # The tube is so long that it may point anywhere along the floor.
            up = Shape(np.array([(0, 0, 0.5), (1, 0, 0)]), FLOOR.counts, FLOOR.indices)
            above, along = up.turned(**turn).points
            lit = directly_lit(
                mesh("Floor", FLOOR.turned(**turn)) + along_x(head, body, above, along)
            )
            values, places, _ = direct_at_receivers(lit, "/Floor")
            middle = np.linalg.norm(places, axis=1).argmin()
            assert values[middle] == pytest.approx(np.pi * 100, rel=0.01)
    sunk = directly_lit(mesh("Floor", FLOOR) + sphere_light(100.0, 0.5, (0, 0, 0.499)))
    values, places, _ = direct_at_receivers(sunk, "/Floor")
    assert values[np.linalg.norm(places, axis=1).argmin()] == 0


@hard_case(
    8,
    "a receiver on the emitter's plane",
    "0, not NaN.",
    "0 by the cosine at the emitter",
)
def coplanar_receiver() -> None:
    level = rect_light(100.0, (1.0, 1.0), (0, 0, 0))
    table = mesh("Table", FLOOR.moved(x=2.5), 0.0, "bool doubleSided = true")
    for solve in (solved, directly_lit):
        lit = solve(table + level + mesh("Ground", FLOOR.moved(z=-1)))
        assert not at_corners(lit, "/Table").any()
        assert not at_corners(lit, "/Table", back=True).any()
        assert at_corners(lit, "/Ground").any()


def in_a_fixture(extra: str):
    """A lamp in a closed box within a room."""
    fixture = mesh("Fixture", box((0.5, 0.5, 0.5), 0.25), 0.5, extra)
    solver = solver_of(mesh("Room", ROOM, 0.5) + fixture + point_light(FLUX, (0, 0, 0)))
    *_, lit = solver.stages()
    assert not at_corners(lit, "/Room").any()
    assert lit.stage.escaped == 0
    assert lit.stage.absorbed + lit.stage.back_absorbed == lit.stage.photons
    return lit, solver.findings()


@hard_case(
    9,
    "a source inside a closed fixture",
    "All flux stays in it; a finding names a one-sided fixture and says which share of the "
    "photons met its back.",
    "0 lx outside; Φ/(A(1−ρ)) inside of a double-sided one",
)
def closed_fixture() -> None:
    trapped, findings = in_a_fixture("")
    assert trapped.stage.back_absorbed == trapped.stage.photons
    (told,) = findings
    assert told.path == "/Fixture"
    assert told.reason.startswith("100% of the photons")
    lit, _ = in_a_fixture("bool doubleSided = true")
    inside = at_corners(lit, "/Fixture", back=True)
    assert inside.mean() == pytest.approx(FLUX / (1.5 * 0.5), rel=0.15)


@hard_case(
    9,
    "a source inside a closed double-sided fixture",
    "A finding says that its light does not get out.",
    "a finding at the light that names the fixture; none for a lamp in an open fixture, in a "
    "closed room, over a black table, or in a stage that is the fixture alone",
    part="b",
)
def told_of_a_closed_fixture() -> None:
    sided = "bool doubleSided = true"
    _, (told,) = in_a_fixture(sided)
    assert told.path == "/Lamp"
    assert "none of its light gets out" in told.reason
    assert "/Fixture" in told.reason
    room, lamp = mesh("Room", ROOM, 0.5), point_light(FLUX, (0, 0, 0))
    closed = box((0.5, 0.5, 0.5), 0.25)
    faces = closed.indices.reshape(-1, 4)
    slit = mesh("Fixture", Shape(closed.points, closed.counts[1:], faces[1:].ravel()), 0.0, sided)
    far = mesh("Far", FLOOR.moved(z=9))
    table = mesh("Table", rectangle((-1, -1, -1), (2, 0, 0), (0, 2, 0), 1.0))
    beam = inline([0, 3, 4], [CANDELA, CANDELA, 0], at=(0, 0, 0))
    for text in (
        room + slit + lamp,
        room + far + lamp,
        room + table + beam,
        mesh("Fixture", closed, 0.5, sided) + lamp,
    ):
        solver = solver_of(text, photons=1000)
        list(solver.stages())
        assert solver.findings() == ()


@hard_case(
    18,
    "a light without area",
    "A point of light where its flux is given; else it is left out, with a finding.",
    "Φ/4π · cosθ/d²",
)
def no_area() -> None:
    at = (0.3, 0.2, 2.0)
    absolute = point_light(FLUX, at)
    normalised = sphere_light(CANDELA, 0.0, at, extra="bool inputs:normalize = true")
    for lamp in (absolute, normalised):
        lit = directly_lit(mesh("Floor", FLOOR) + lamp)
        flux = lit.scene.luminous_flux
        values, places, normals = direct_at_receivers(lit, "/Floor")
        expected = from_point(flux / (4 * np.pi), at, places, normals)
        assert values == pytest.approx(expected, rel=1e-4)
    assert flux == pytest.approx(np.pi * CANDELA)  # L over 1 m², as UsdLux has it
    refused = read(mesh("Floor", FLOOR) + sphere_light(100.0, 0.0, at))
    assert refused.luminaires == ()
    assert [finding.action for finding in findings_at(refused, "/Lamp")] == ["skipped"]


def inline(gamma, candela, name: str = "Lamp", at=(0, 0, 2)) -> str:
    """A luminaire of a diagram that is alike in all half planes. gamma : degrees"""
    diagram = f"""float[] inputs:isolux:gammaAngles = {list(map(float, gamma))}
        float[] inputs:isolux:cAngles = [0]
        float[] inputs:isolux:candela = {list(map(float, candela))}"""
    return point_light(0.0, at, name, diagram)


@hard_case(
    19,
    "a candela peak of 10⁶ : 1",
    "The flux is exact to 0.1 %, and photons go where it is.",
    "∫I dΩ of the interpolated diagram by quadrature; the beam's share of the photons on a small "
    "disk below; I/d² in the beam",
)
def candela_peak() -> None:
    gamma = [0.0, 0.5, 1.0, 90.0, 180.0]
    candela = [1e6, 1e6, 1.0, 1.0, 1.0]
    fine = np.radians(np.concatenate([np.linspace(0, 2, 400_001), np.linspace(2, 180, 400_001)]))
    intensity = np.interp(fine, np.radians(gamma), candela) * np.sin(fine)
    flux = 2 * np.pi * np.trapezoid(intensity, fine)
    beam = 2 * np.pi * np.trapezoid(intensity[:400_001], fine[:400_001])
    scene = read(mesh("Floor", FLOOR) + inline(gamma, candela))
    assert scene.luminous_flux == pytest.approx(flux, rel=1e-3)
    # A square of half side 4 cm at 2 m holds the beam of 1°, and next to nothing else.
    target = rectangle((-0.04, -0.04, 0), (0.08, 0, 0), (0, 0.08, 0), 0.08)
    lit = solved(mesh("Floor", target) + inline(gamma, candela))
    share = lit.stage.absorbed / lit.stage.photons
    assert share == pytest.approx(beam / flux, abs=4 * np.sqrt(0.25 / lit.stage.photons))
    below = mesh("Floor", rectangle((-0.001, -0.001, 0), (0.002, 0, 0), (0, 0.002, 0), 0.002))
    values = at_corners(directly_lit(below + inline(gamma, candela)), "/Floor")
    assert values == pytest.approx(1e6 / 4, rel=1e-3)


@hard_case(
    20,
    "no candela in any direction, or no flux",
    "The light is left out with a finding; nothing is divided by 0.",
    "the stage without it, bit for bit",
)
def no_flux() -> None:
    clean = solved(mesh("Room", ROOM, 0.5) + point_light(FLUX, (0.3, 0.2, 0.1)))
    off = "float inputs:isolux:dimming = 0"
    for dark in (
        inline([0, 90], [0, 0], "Dark", (0, 0, 1)),
        point_light(FLUX, (0, 0, 1), "Dark", off),
        sphere_light(0.0, 0.1, (0, 0, 1), "Dark"),
        sphere_light(1.0, 0.1, (0, 0, 1), "Dark", "color3f inputs:color = (0, 0, 0)"),
    ):
        scene = read(mesh("Room", ROOM, 0.5) + point_light(FLUX, (0.3, 0.2, 0.1)) + dark)
        assert [finding.action for finding in findings_at(scene, "/Dark")] == ["skipped"]
        lit = solved(scene)
        assert np.array_equal(lit.direct, clean.direct)
        assert np.array_equal(lit.indirect, clean.indirect)
