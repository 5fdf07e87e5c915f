"""Hard cases of size, place, orientation and transforms: 5, 6, 14, 16, 17, 21, 28."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import Shape, box, face_area_normals, rectangle

from hard_cases.hard_case import hard_case
from hard_cases.luminaires import inline
from hard_cases.small_stages import (
    CANDELA,
    FLOOR,
    FLUX,
    at_corners,
    direct_at_receivers,
    directly_lit,
    findings_at,
    from_point,
    means,
    mesh,
    point_light,
    read,
    rect_light,
    solved,
    solver_of,
    sphere_light,
)
from no_division import no_division

ROOM = mesh("Room", box((4, 4, 4), 1.0).flipped(), 0.5)
BLOCK = mesh("Block", box((1, 0.5, 1.5), 0.5).turned(x=20, y=30).moved(x=0.75), 0.5)
# So small that it doesn't matter which of its points are sampled.
BULB = sphere_light(CANDELA, 1e-6, (-1, 0.5, 1), extra="bool inputs:normalize = true")
LAMP = point_light(FLUX, (-1, 0.5, 1))
WEDGE = Shape(
    np.array([(0, 0, 0.5), (0.4, 0, 0.7), (0.4, 0.3, 0.7), (0, 0.3, 0.5), (0.4, 0, 0.1)]),
    np.array([3, 3, 3], np.int32),
    np.array([0, 1, 2, 0, 2, 3, 0, 4, 1], np.int32),
)


def moved(body: str, operation: str, value: str, extra: str = "") -> str:
    """Prims under a transform."""
    return f"""def Xform "Moved" {{
        {operation} = {value}
        uniform token[] xformOpOrder = ["{operation.split()[1]}"]
        {extra}\n{body}\n}}\n"""


def black(text: str) -> str:
    """Without reflectance, so that direct light is all."""
    return text.replace("(0.5, 0.5, 0.5)", "(0, 0, 0)")


@hard_case(
    5,
    "millimetres to kilometres (10⁻⁶ … 10⁶)",
    "Illuminance from a given luminance does not change with the unit of length.",
    "the same stage in metres: bit for bit at powers of 2, direct light to 10⁻⁵ else",
)
def units() -> None:
    def metadata(unit: float) -> str:
        return f'(\n metersPerUnit = {unit!r}\n upAxis = "Z"\n)\n'

    text = ROOM + BLOCK + BULB
    for method in ("dept", "composite"):
        one = solved(read(text), method)
        for exponent in (-20, 20):
            solver = solver_of(read(text, metadata(2.0**exponent)), method)
            *_, other = solver.stages(replay=one.steps)
            assert np.array_equal(one.direct, other.direct)
            assert np.array_equal(one.indirect, other.indirect)
    dark = black(text)
    metres = means(directly_lit(read(dark)), "/Room")
    for unit in (1e-6, 1e-3, 1e3, 1e6):
        scaled = means(directly_lit(read(dark, metadata(unit))), "/Room")
        assert scaled == pytest.approx(metres, rel=1e-5)


@hard_case(
    6,
    "10⁷ units from the origin",
    "The same light to 10⁻⁴.",
    "the same stage at the origin",
)
def far_away() -> None:
    text = ROOM + mesh("Block", box((1, 0.5, 1.5), 0.5).moved(x=0.75)) + LAMP
    away = moved(text, "double3 xformOp:translate", "(10000000, -10000000, 10000000)")
    near, far = directly_lit(black(text)), directly_lit(black(away))
    for path in ("/Room", "/Block"):
        expected = means(near, path)[0]
        assert means(far, "/Moved" + path)[0] == pytest.approx(expected, rel=1e-4)
    with no_division():
        whole = [solved(each) for each in (text, away)]
    # Into the next of smaller buckets some fall by the last bits of their place.
    divided = [solved(each, photons=2_000_000) for each in (text, away)]
    for here, there in (whole, divided):
        assert means(there, "/Moved/Room") == pytest.approx(means(here, "/Room"), rel=1e-4)


@hard_case(
    14,
    "NaN or infinity in points and transforms",
    "The prim is skipped with a finding that names it; all else is lit as without it.",
    "the stage without that prim, bit for bit",
)
def not_a_number() -> None:
    clean = solved(ROOM + LAMP)
    body = mesh("Bad", rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0))
    for bad in ("nan", "inf", "-inf"):
        points = body.replace("(1.0, 1.0, 0.0)", f"(1, {bad}, 0)")
        place = moved(body, "double3 xformOp:translate", f"({bad}, 0, 0)")
        lamp = moved(LAMP, "double3 xformOp:translate", f"({bad}, 0, 0)")
        for text, path in ((points, "/Bad"), (place, "/Moved/Bad"), (lamp, "/Moved/Lamp")):
            scene = read(ROOM + LAMP + text)
            assert [finding.action for finding in findings_at(scene, path)] == ["skipped"]
            lit = solved(scene)
            assert np.array_equal(lit.direct, clean.direct)
            assert np.array_equal(lit.indirect, clean.indirect)


@hard_case(
    16,
    "inverted normals",
    "A one-sided room inside out takes no light and says so; doubleSided lights it; normals that "
    "all point inwards turn it.",
    "the same room with its front inside",
)
def inverted() -> None:
    outward = box((4, 4, 4), 1.0)
    wrong = solver_of(mesh("Room", outward, 0.5) + LAMP)
    *_, lit = wrong.stages()
    assert lit.stage.back_absorbed == lit.stage.photons
    assert not at_corners(lit, "/Room").any()
    (told,) = wrong.findings()
    assert (told.path, told.kind, told.action) == ("/Room", "orientation", "noted")

    right = means(solved(mesh("Room", outward.flipped(), 0.5) + LAMP), "/Room")
    both = solved(mesh("Room", outward, 0.5, "bool doubleSided = true") + LAMP)
    assert means(both, "/Room", back=True) == pytest.approx(right, rel=0.02)
    assert not means(both, "/Room").any()
    inwards = -np.repeat(face_area_normals(outward), 4, axis=0)
    normals = ", ".join(f"({x}, {y}, {z})" for x, y, z in inwards.tolist())
    extra = f'normal3f[] normals = [{normals}] ( interpolation = "faceVarying" )'
    turned = read(mesh("Room", outward, 0.5, extra) + LAMP)
    assert [finding.action for finding in findings_at(turned, "/Room")] == ["repaired"]
    assert means(solved(turned), "/Room") == pytest.approx(right, rel=0.02)


@hard_case(
    17,
    "a mirrored instance",
    "Its front is turned once: it faces as the mirror image of its prototype.",
    "the mirror image written out by hand; I cosθ/d²",
)
def mirrored_instance() -> None:
    prototype = f'class "Prototype" {{\n{mesh("Wedge", WEDGE)}}}\n'
    instance = """def Xform "Copy" ( instanceable = true\n references = </Prototype> ) {
        float3 xformOp:scale = (-1, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]\n}\n"""
    lamp = point_light(FLUX, (-0.3, -0.2, 2.0))
    mirror = Shape(WEDGE.points * [-1, 1, 1], WEDGE.counts, WEDGE.indices).flipped()
    copy = directly_lit(prototype + instance + lamp)
    (path,) = (m.path for m in copy.scene.meshes)
    by_hand = directly_lit(mesh("Wedge", mirror) + lamp)
    values, expected = at_corners(copy, path), at_corners(by_hand, "/Wedge")
    assert values.reshape(-1, 3) == pytest.approx(expected.reshape(-1, 3)[:, ::-1], rel=1e-5)
    values, places, _ = direct_at_receivers(copy, path)
    roof = places[:, 2] > 0.45
    normal = np.array([0.2, 0, 0.4]) / np.hypot(0.2, 0.4)  # rises along -X
    upwards = from_point(CANDELA, (-0.3, -0.2, 2.0), places, normal)
    assert np.isclose(values, upwards, rtol=1e-4)[roof].sum() == 4


@hard_case(
    21,
    "overlapping instances",
    "The flux on both is that on one; the same bits on any number of threads.",
    "the room with one instance",
)
def overlapping_instances() -> None:
    floor = rectangle((-1.5, -1.5, -1), (3, 0, 0), (0, 3, 0), 0.75)
    sided = mesh("Floor", floor, 0.7, "bool doubleSided = true")
    prototype = f'class "Prototype" {{\n{sided}}}\n'
    copies = [
        f'def Xform "Copy{i}" ( instanceable = true\n references = </Prototype> ) {{ }}\n'
        for i in range(2)
    ]
    once, twice = (ROOM + LAMP + prototype + "".join(copies[:n]) for n in (1, 2))
    one, two, again = solved(once), solved(twice), solved(twice, threads=1)
    assert means(two, "/Room") == pytest.approx(means(one, "/Room"), rel=0.03)
    assert np.array_equal(two.direct, again.direct)
    assert np.array_equal(two.indirect, again.indirect)


SINGULAR = "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 0), (0, 0, 0, 1))"


@hard_case(
    28,
    "singular transforms: meshes",
    "The mesh is culled, with a finding that names it.",
    "the stage without it, bit for bit",
)
def singular_mesh() -> None:
    flat = moved(BLOCK, "matrix4d xformOp:transform", SINGULAR)
    scene = read(ROOM + LAMP + flat)
    assert [finding.action for finding in findings_at(scene, "/Moved/Block")] == ["skipped"]
    assert np.array_equal(solved(scene).direct, solved(ROOM + LAMP).direct)


@hard_case(
    28,
    "singular transforms: lights",
    "A light of a given flux under a scale of 0 is a point or a line of light; without one it is "
    "left out, and so is one that faces nowhere, each with a finding.",
    "I cosθ/d² of a point, also of a diagram and of flat lights of which one scale is 0",
    part="b",
)
def singular_light() -> None:
    at = (0.3, 0.2, 2.0)
    normalised = "bool inputs:normalize = true"

    def scaled(lamp: str, scale: str) -> str:
        return moved(
            moved(lamp, "float3 xformOp:scale", scale), "double3 xformOp:translate", str(at)
        )

    bulb = point_light(FLUX, (0, 0, 0), radius=0.1)
    beam = inline([0, 90], [CANDELA, CANDELA], at=(0, 0, 0))
    panel = rect_light(CANDELA, (0.02, 0.02), (0, 0, 0), extra=normalised)
    towards = np.array(at)
    for lamp, scale, candela, power in (
        (bulb, "(0, 0, 0)", CANDELA, 0),
        (bulb, "(1, 1, 0)", CANDELA, 0),
        (beam, "(0, 1, 1)", CANDELA, 0),
        (beam, "(1, 0, 1)", CANDELA, 0),
        (panel, "(1, 1, 0)", CANDELA, 1),
        (panel, "(1, 0, 1)", CANDELA, 1),
        (panel, "(0, 1, 1)", CANDELA, 1),
    ):
        lit = directly_lit(mesh("Floor", FLOOR) + scaled(lamp, scale))
        values, places, normals = direct_at_receivers(lit, "/Floor")
        cosine = 2.0 / np.linalg.norm(towards - places, axis=1)
        expected = from_point(candela, at, places, normals) * cosine**power
        assert values == pytest.approx(expected, rel=1e-3), (lamp, scale)
    for lamp in (sphere_light(100.0, 0.1, (0, 0, 0)), beam, panel):
        scene = read(mesh("Floor", FLOOR) + scaled(lamp, "(0, 0, 0)"))
        assert scene.luminaires == ()
        told = findings_at(scene, "/Moved/Moved/Lamp")
        assert [finding.action for finding in told] == ["skipped"]
