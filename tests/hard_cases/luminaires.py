"""Hard cases of luminaires: 7 to 9, 18 to 20."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from hard_cases.hard_case import hard_case
from hard_cases.small_stages import (
    CANDELA,
    FLOOR,
    FLUX,
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
    "a vertex exactly where a sphere touches its floor",
    "The limit from outside.",
    "πL",
    part="b",
    fails="0 there: a point on the sphere counts as inside of it; 10⁻² R beside it the light is "
    "right (case 7)",
)
def point_of_touch() -> None:
    lit = directly_lit(mesh("Floor", FLOOR) + sphere_light(100.0, 0.5, (0, 0, 0.5)))
    values, places, _ = direct_at_receivers(lit, "/Floor")
    middle = np.linalg.norm(places, axis=1).argmin()
    assert values[middle] == pytest.approx(np.pi * 100, rel=0.01)


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
    "a finding at the fixture or its light",
    part="b",
    fails="the light is right, but no finding tells of it: the solver does not know which surfaces "
    "a luminaire was meant to light",
)
def told_of_a_closed_fixture() -> None:
    _, findings = in_a_fixture("bool doubleSided = true")
    assert any(finding.path in ("/Fixture", "/Lamp") for finding in findings)


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
