"""Hard cases of whole stages that users make: odd scales, places, times and files."""

from __future__ import annotations

import tempfile
from pathlib import Path

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
    findings_at,
    from_point,
    mean_everywhere,
    means,
    mesh,
    point_light,
    polygons,
    read,
    rect_light,
    solved,
    sphere_light,
)
from isolux.errors import SettingsError
from isolux.stage_reader import read_stage
from no_division import no_division
from textured_stage import material, png, quad, read_at, texture
from usda_stage import METRES, open_usda

ROOM = box((4, 4, 4), 0.5).flipped()
AT = (0.3, 0.2, 2.0)


@hard_case(
    51,
    "a light left at the origin, on a floor in the plane of the origin",
    "It lights the walls down to their lower edges, and half of its photons stay above the floor.",
    "I cosθ/d²; half of the photons end in a closed room, where Z points up and where Y does",
)
def on_the_floor() -> None:
    for turn in ({}, {"x": -90}):
        room = mesh("Room", ROOM.moved(z=2).turned(**turn))
        lit = solved(room + point_light(FLUX, (0, 0, 0)))
        assert lit.stage.back_absorbed == 0
        share = lit.stage.absorbed / lit.stage.photons
        assert share == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(lit.stage.photons))
        values, places, normals = direct_at_receivers(
            directly_lit(room + point_light(FLUX, (0, 0, 0))), "/Room"
        )
        walls = np.abs((places * normals).sum(axis=1)) > 1e-6
        expected = from_point(CANDELA, (0, 0, 0), places[walls], normals[walls])
        assert values[walls] == pytest.approx(expected, rel=1e-3)
        assert not values[~walls].any()


@hard_case(
    52,
    "a room on a ground of 20 km",
    "It has the light that it has alone.",
    "the room alone: I cosθ/d² by direct lighting, ρΦ/(A(1−ρ)) by photons",
)
def on_a_wide_ground() -> None:
    ground = mesh("Ground", rectangle((-1e4, -1e4, -3), (2e4, 0, 0), (0, 2e4, 0), 1e4), 0.5)
    lamp = point_light(FLUX, (0.3, 0.2, 0.5))
    dark = directly_lit(mesh("Room", ROOM) + lamp + ground)
    values, places, normals = direct_at_receivers(dark, "/Room")
    expected = from_point(CANDELA, (0.3, 0.2, 0.5), places, normals)
    assert values == pytest.approx(expected, rel=1e-3)
    bright = solved(mesh("Room", ROOM, 0.5) + lamp + ground)
    assert bright.stage.escaped == bright.stage.back_absorbed == 0
    found = means(bright, "/Room")
    assert found == pytest.approx([FLUX / 96, FLUX / 96], rel=0.03)
    assert not at_corners(bright, "/Ground").any()


@hard_case(
    53,
    "a light that is larger than its room",
    "It shines outwards alone: nothing in the room, all around it.",
    "0 inside; πL R³/d³ on a floor outside",
)
def room_within_a_light() -> None:
    floor = mesh("Floor", rectangle((-20, -20, -6), (40, 0, 0), (0, 40, 0), 2.0))
    text = mesh("Room", ROOM, 0.5, "bool doubleSided = true") + sphere_light(100.0, 5.0, (0, 0, 0))
    for solve in (solved, directly_lit):
        lit = solve(text + floor)
        assert not at_corners(lit, "/Room").any()
        assert not at_corners(lit, "/Room", back=True).any()
    values, places, _ = direct_at_receivers(directly_lit(text + floor), "/Floor")
    distance = np.linalg.norm(places, axis=1)
    expected = np.pi * 100 * 25 / distance**2 * (6 / distance)
    whole = distance >= 5  # all of the sphere above the floor
    assert values[whole] == pytest.approx(expected[whole], rel=5e-3)


@hard_case(
    54,
    "a rectangle without width",
    "A luminous line where the flux is given; else it is left out, with a finding.",
    "Φ/(πlh) · ½(atan(l/h) + (l/h)/(1 + (l/h)²)) below one end",
)
def line() -> None:
    length, height = 2.0, 1.5
    target = mesh("Floor", rectangle((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0), 0.02))
    at, slope = (0, length / 2, height), length / height
    per_length = CANDELA / length / height
    expected = per_length * 0.5 * (np.arctan(slope) + slope / (1 + slope**2))
    normalised = "bool inputs:normalize = true"
    rect = rect_light(CANDELA, (0.0, length), at, extra=normalised)
    assert at_corners(directly_lit(target + rect), "/Floor") == pytest.approx(expected, rel=0.02)
    dark = read(target + rect_light(CANDELA, (0.0, length), at))
    assert dark.luminaires == ()
    assert [finding.action for finding in findings_at(dark, "/Lamp")] == ["skipped"]


@hard_case(
    55,
    "all flux in one direction",
    "A diagram of candela at the pole alone is a beam: its flux is exact, nothing is beside it; a "
    "cone of 0° gives no light and a finding.",
    "∫I dΩ of the interpolated diagram by quadrature; I/d² below, 0 aside; the stage without it",
)
def pole() -> None:
    for step in (10.0, 1.0, 0.01):
        gamma, candela = [0.0, step, 90.0], [CANDELA, 0.0, 0.0]
        fine = np.radians(np.linspace(0, step, 200_001))
        profile = np.interp(np.degrees(fine), gamma, candela) * np.sin(fine)
        scene = read(mesh("Floor", FLOOR) + inline(gamma, candela))
        assert scene.luminous_flux == pytest.approx(
            2 * np.pi * np.trapezoid(profile, fine), rel=1e-3
        )
        lit = solved(scene, photons=1000)
        assert lit.stage.absorbed == lit.stage.photons
        values, places, _ = direct_at_receivers(directly_lit(scene), "/Floor")
        away = np.degrees(np.arctan2(np.hypot(places[:, 0], places[:, 1]), 2.0))
        assert values[away.argmin()] == pytest.approx(CANDELA / 4, rel=1e-3)
        assert not values[away > step].any()
    clean = solved(mesh("Room", ROOM, 0.5) + point_light(FLUX, (*AT[:2], 1.0)))
    closed = sphere_light(
        100.0, 0.1, (0, 0, 1), "Closed", "float inputs:shaping:cone:angle = 0"
    ).replace('"Closed"', '"Closed" ( prepend apiSchemas = ["ShapingAPI"] )')
    scene = read(mesh("Room", ROOM, 0.5) + point_light(FLUX, (*AT[:2], 1.0)) + closed)
    assert [finding.action for finding in findings_at(scene, "/Closed")] == ["skipped"]
    assert np.array_equal(solved(scene).direct, clean.direct)


@hard_case(
    56,
    "lights in one place, 2 and 100 of them",
    "Their light adds up.",
    "I cosθ/d² of one as strong as all",
)
def lights_in_one_place() -> None:
    for count in (2, 100):
        lamps = "".join(point_light(FLUX / count, AT, f"Lamp{i}") for i in range(count))
        values, places, normals = direct_at_receivers(
            directly_lit(mesh("Floor", FLOOR) + lamps), "/Floor"
        )
        expected = from_point(CANDELA, AT, places, normals)
        assert values == pytest.approx(expected, rel=1e-4)


@hard_case(
    57,
    "textures of one texel, of zeros, and of no file",
    "One texel is the colour all over; zeros reflect nothing; what can't be read leaves the "
    "fallback, with a finding.",
    "the texel; exactly 0; a finding at the material",
)
def textures() -> None:
    text = material(texture()) + quad() + point_light(FLUX, (0.5, 0.5, 1.0))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        one = read_at(folder, text, texture=png(np.full((1, 1, 3), 51)))
        assert one.meshes[0].reflectance == pytest.approx(np.full((1, 3), 0.2), abs=1e-6)
        black = read_at(folder, text, texture=png(np.zeros((4, 4, 3))))
        assert not black.meshes[0].reflectance.any()
        assert not solved(black).indirect.any()
        for contents in (b"", png(np.zeros((4, 4, 3)))[:40]):
            broken = read_at(folder, text, texture=contents)
            assert any(f.path.startswith("/Paint") for f in broken.findings)
            assert np.isfinite(broken.meshes[0].reflectance).all()


@hard_case(
    58,
    "a vertex that a thousand faces share",
    "It has the light of its place.",
    "I cosθ/d² by direct lighting; by photons within their noise",
)
def hub() -> None:
    count = 1000
    turn = 2 * np.pi * np.arange(count) / count
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    fan = polygons(
        np.vstack([[0, 0, 0], rim]), [[0, i + 1, (i + 1) % count + 1] for i in range(count)]
    )
    text = mesh("Fan", fan) + point_light(FLUX, AT)
    values, places, _ = direct_at_receivers(directly_lit(text), "/Fan")
    assert values == pytest.approx(from_point(CANDELA, AT, places, UP), rel=1e-3)
    with no_division():
        whole = solved(text, photons=400_000)
    divided = solved(text, photons=4_000_000)  # smaller buckets
    expected: Array = from_point(CANDELA, AT, np.zeros((1, 3)), UP)
    for lit in (whole, divided):
        at_hub = at_corners(lit, "/Fan").reshape(-1, 3)[:, 0]
        assert np.ptp(at_hub) == 0
        assert at_hub[0] == pytest.approx(expected[0], rel=0.1)


@hard_case(
    59,
    "a time that is no number",
    "A time code that is asked for has to be finite: to USD, NaN means no time sample at all. A "
    "stage that starts at NaN is read at its earliest time, with a finding.",
    "SettingsError; I cosθ/d² from where the light is at its first sample",
)
def no_time() -> None:
    lamp = point_light(FLUX, (9, 9, 9)).replace(
        "translate = (9.0, 9.0, 9.0)",
        "translate.timeSamples = { 1: (0.3, 0.2, 2), 5: (1, 1, 1) }",
    )
    text = mesh("Floor", FLOOR) + lamp
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(SettingsError, match="time"):
            read_stage(open_usda(text), bad)
    for start in ("nan", "inf"):
        metadata = METRES.replace("(\n", f"(\n    startTimeCode = {start}\n", 1)
        scene = read(text, metadata)
        assert [f.action for f in findings_at(scene, "/")] == ["repaired"]
        values, places, normals = direct_at_receivers(directly_lit(scene), "/Floor")
        assert values == pytest.approx(from_point(CANDELA, AT, places, normals), rel=1e-4)


@hard_case(
    60,
    "a light in a room whose mesh is inside out and double-sided",
    "The back has the light, the front nothing.",
    "Φ/(A(1−ρ)) on the back in the mean, by photons and gather; by radiosity as in the "
    "room with its front inside; 0 on the front",
)
def inside_out() -> None:
    room = mesh("Room", ROOM.flipped(), 0.5, "bool doubleSided = true")
    text = room + point_light(FLUX, (0.3, 0.2, 0.1))
    for method in ("dept", "composite"):
        lit = solved(text, method)
        assert means(lit, "/Room", back=True).sum() == pytest.approx(FLUX / 48, rel=0.03), method
        assert not at_corners(lit, "/Room").any()
        assert mean_everywhere(lit).sum() == pytest.approx(FLUX / 96, rel=0.03)
    right = mesh("Room", ROOM, 0.5) + point_light(FLUX, (0.3, 0.2, 0.1))
    back = means(directly_lit(text), "/Room", back=True)
    assert back == pytest.approx(means(directly_lit(right), "/Room"), rel=1e-3)
