"""Lights as luminaires: flux by closed forms, directions through transforms, what is refused."""

import numpy as np
import pytest
from isolux._core import CandelaDistribution
from scipy.integrate import quad

from isolux import PhotometryError, SceneError
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.stage_reader import read_stage
from usda_stage import METRES, found, open_usda, read_usda

SPHERE_AREA = 4 * np.pi * 0.5**2
DISK_AREA = np.pi * 0.5**2
CYLINDER_AREA = 2 * np.pi * 0.5 * 3.0
SIZED = {
    "SphereLight": "float inputs:radius = 0.5",
    "DiskLight": "float inputs:radius = 0.5",
    "RectLight": "float inputs:width = 2\n float inputs:height = 0.25",
    "CylinderLight": "float inputs:radius = 0.5\n float inputs:length = 3",
}
AREAS = {
    "SphereLight": SPHERE_AREA,
    "DiskLight": DISK_AREA,
    "RectLight": 0.5,
    "CylinderLight": CYLINDER_AREA,
}


def light(kind: str, inputs: str = "", transform: str = "", apis: str = "") -> str:
    order = 'uniform token[] xformOpOrder = ["xformOp:transform"]' if transform else ""
    matrix = f"matrix4d xformOp:transform = {transform}" if transform else ""
    applied = f"( prepend apiSchemas = [{apis}] )" if apis else ""
    return f'def {kind} "Lamp" {applied} {{\n{SIZED[kind]}\n{inputs}\n{matrix}\n{order}\n}}'


def shaped(kind: str, inputs: str, transform: str = "") -> str:
    return light(kind, inputs, transform, apis='"ShapingAPI"')


def only_light(text: str, metadata: str = METRES):
    scene = read_usda(text, metadata)
    assert len(scene.luminaires) == 1, scene.findings
    return scene.luminaires[0]


def scaled(x: float, y: float, z: float) -> str:
    return f"( ({x}, 0, 0, 0), (0, {y}, 0, 0), (0, 0, {z}, 0), (7, 8, 9, 1) )"


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize(
    ("inputs", "luminance"),
    [
        ("", 1.0),
        ("float inputs:intensity = 1000", 1000.0),
        ("float inputs:intensity = 10\n float inputs:exposure = 3", 80.0),
        ("color3f inputs:color = (0, 0.5, 0)", 0.7152 / 2),
    ],
)
def test_a_lambertian_source_emits_pi_times_luminance_times_area(kind, inputs, luminance):
    lamp = only_light(light(kind, inputs))
    assert lamp.luminous_flux == pytest.approx(np.pi * luminance * AREAS[kind], rel=1e-6)
    assert lamp.diagram is None
    assert lamp.colour @ LUMINANCE_WEIGHTS == pytest.approx(1.0)


@pytest.mark.parametrize("kind", SIZED)
def test_flux_grows_with_the_area_in_metres(kind):
    """A light in centimetres, doubled by its transform, has (2/100)² of the area."""
    lamp = only_light(light(kind, transform=scaled(2, 2, 2)), "( metersPerUnit = 0.01 )")
    assert lamp.luminous_flux == pytest.approx(np.pi * AREAS[kind] * 4e-4, rel=1e-6)
    np.testing.assert_allclose(lamp.origin, [0.07, 0.08, 0.09])


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_normalize_keeps_the_flux_whatever_the_size(kind, scale):
    """The luminance is divided by the area in stage units, here centimetres: π·I·(0.01 m)²."""
    text = light(kind, "bool inputs:normalize = 1", scaled(scale, scale, scale))
    lamp = only_light(text, "( metersPerUnit = 0.01 )")
    assert lamp.luminous_flux == pytest.approx(np.pi * 1e-4, rel=1e-6)


def test_uneven_scale_is_exact_for_a_rect_and_reported_for_a_round_light():
    rect = read_usda(light("RectLight", transform=scaled(3, 2, 5)))
    np.testing.assert_allclose(rect.luminaires[0].size, [6.0, 0.5])
    assert found(rect) == []
    sphere = read_usda(light("SphereLight", transform=scaled(3, 2, 1)))
    np.testing.assert_allclose(sphere.luminaires[0].size, [1.0, 0.0])
    assert found(sphere) == [("/Lamp", "SphereLight", "approximated")]
    disk = read_usda(light("DiskLight", transform=scaled(4, 1, 1)))
    assert disk.luminaires[0].luminous_flux == pytest.approx(np.pi * np.pi * 2.0 * 0.5)  # ellipse


def test_colour_temperature_tints_without_a_change_of_normalisation():
    warm = "bool inputs:enableColorTemperature = 1\n float inputs:colorTemperature = 2700"
    lamp = only_light(light("SphereLight", warm))
    red, green, blue = lamp.colour
    assert red > green > blue
    plain = only_light(light("SphereLight")).luminous_flux
    assert lamp.luminous_flux == pytest.approx(plain, rel=0.02)


# ShapingAPI


@pytest.mark.parametrize("angle", [20.0, 60.0, 90.0, 135.0, 180.0])
def test_a_hard_cone_on_a_sphere_leaves_its_solid_angle(angle):
    """I = L·πr² inside the cone, so Φ = L·πr²·2π(1 − cos θ)."""
    lamp = only_light(shaped("SphereLight", f"float inputs:shaping:cone:angle = {angle}"))
    solid_angle = 2 * np.pi * (1 - np.cos(np.radians(angle)))
    assert lamp.luminous_flux == pytest.approx(SPHERE_AREA / 4 * solid_angle, rel=1e-6)


@pytest.mark.parametrize("kind", ["DiskLight", "RectLight"])
@pytest.mark.parametrize("angle", [20.0, 60.0, 90.0, 150.0])
def test_a_hard_cone_on_a_flat_light(kind, angle):
    """Φ = L·A·π·sin²θ up to the horizon."""
    lamp = only_light(shaped(kind, f"float inputs:shaping:cone:angle = {angle}"))
    share = np.sin(np.radians(min(angle, 90.0))) ** 2
    assert lamp.luminous_flux == pytest.approx(np.pi * AREAS[kind] * share, rel=1e-4)


def test_a_cylinder_under_a_half_space_cone_loses_half_its_flux():
    lamp = only_light(shaped("CylinderLight", "float inputs:shaping:cone:angle = 90"))
    assert lamp.luminous_flux == pytest.approx(np.pi * CYLINDER_AREA / 2, rel=1e-3)


@pytest.mark.parametrize("softness", [0.01, 0.3, 1.0])
def test_a_soft_cone_fades_by_smoothstep(softness):
    angle = np.radians(40.0)
    start = angle * (1 - softness)

    def emitted(theta):
        t = np.clip((theta - start) / (angle - start), 0, 1)
        return (1 - t * t * (3 - 2 * t)) * 2 * np.pi * np.sin(theta)

    expected = SPHERE_AREA / 4 * quad(emitted, 0, angle, points=[start], epsabs=1e-12)[0]
    inputs = (
        f"float inputs:shaping:cone:angle = 40\n float inputs:shaping:cone:softness = {softness}"
    )
    assert only_light(shaped("SphereLight", inputs)).luminous_flux == pytest.approx(
        expected, rel=1e-3
    )


@pytest.mark.parametrize("focus", [1.0, 10.0, 1000.0])
def test_focus_is_a_power_of_the_cosine(focus):
    """∫|cos|ⁿ dω = 4π/(n + 1) on a sphere, both ways; ∫ cosⁿ⁺¹ = 2π/(n + 2) on a rect."""
    inputs = f"float inputs:shaping:focus = {focus}\n float inputs:shaping:cone:angle = 180"
    sphere = only_light(shaped("SphereLight", inputs))
    assert sphere.luminous_flux == pytest.approx(np.pi * SPHERE_AREA / (focus + 1), rel=1e-3)
    rect = only_light(shaped("RectLight", inputs))
    assert rect.luminous_flux == pytest.approx(0.5 * 2 * np.pi / (focus + 2), rel=1e-3)


def ies(folder, gamma, candela, c_angles=(0,)):
    """Write an absolute type C photometric file; candela by C plane."""
    lines = ["IESNA:LM-63-2002", "TILT=NONE"]
    lines.append(f"1 -1 1 {len(gamma)} {len(c_angles)} 1 2 0 0 0")
    lines.append("1 1 100")
    for row in (gamma, c_angles, *np.atleast_2d(candela)):
        lines.append(" ".join(f"{value:g}" for value in row))
    (folder / "lamp.ies").write_text("\n".join(lines) + "\n")
    return f"asset inputs:shaping:ies:file = @{folder}/lamp.ies@"


def test_a_profile_of_ones_changes_nothing(tmp_path):
    profile = ies(tmp_path, [0, 90, 180], [1, 1, 1])
    for kind, area in AREAS.items():
        lamp = only_light(shaped(kind, profile))
        assert lamp.luminous_flux == pytest.approx(np.pi * area, rel=1e-3)


def test_a_profile_scales_the_luminance_and_the_cone_fallback_leaves_its_uplight(tmp_path):
    lamp = only_light(shaped("SphereLight", ies(tmp_path, [90, 180], [30, 30])))
    assert lamp.luminous_flux == pytest.approx(30 * SPHERE_AREA / 4 * 2 * np.pi, rel=1e-6)
    assert lamp.diagram.gamma[0] == pytest.approx(np.pi / 2)


def test_a_normalised_profile_keeps_the_output(tmp_path):
    profile = ies(tmp_path, [0, 20, 50], [900, 700, 10])
    lamp = only_light(shaped("SphereLight", profile + "\n bool inputs:shaping:ies:normalize = 1"))
    assert lamp.luminous_flux == pytest.approx(np.pi * SPHERE_AREA, rel=1e-6)


@pytest.mark.parametrize(
    ("gamma", "scale", "lit"),
    [
        ([0, 30], 2.0, (0, 60)),
        ([0, 30], 0.5, (0, 15)),
        ([0, 30], 10.0, (0, 180)),
        ([150, 180], -2.0, (120, 180)),
        ([150, 180], -0.5, (165, 180)),
        ([0, 180], 0.5, (0, 90)),
    ],
)
def test_angle_scale_opens_a_beam_from_its_pole(tmp_path, gamma, scale, lit):
    profile = ies(tmp_path, gamma, [1, 1])
    inputs = f"{profile}\n float inputs:shaping:ies:angleScale = {scale}"
    lamp = only_light(shaped("SphereLight", inputs))
    np.testing.assert_allclose(np.degrees(lamp.diagram.gamma[[0, -1]]), lit, atol=1e-6)
    solid_angle = 2 * np.pi * -np.diff(np.cos(np.radians(lit)))[0]
    assert lamp.luminous_flux == pytest.approx(SPHERE_AREA / 4 * solid_angle, rel=1e-6)


# Absolute photometry

FOUR_PLANES = """
    float[] inputs:isolux:gammaAngles = [0, 90, 180]
    float[] inputs:isolux:cAngles = [0, 90, 180, 270, 360]
    float[] inputs:isolux:candela = [50, 10, 50,  50, 20, 50,  50, 30, 50,  50, 40, 50,  50, 10, 50]
"""
ISOTROPIC = """
    float[] inputs:isolux:gammaAngles = [0, 180]
    float[] inputs:isolux:cAngles = [0]
    float[] inputs:isolux:candela = [100, 100]
"""


def absolute(kind: str, inputs: str, transform: str = "") -> str:
    return light(kind, inputs, transform, apis='"IsoluxLuminaireAPI"')


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize(
    ("inputs", "flux"),
    [
        ("", 400 * np.pi),
        ("float inputs:isolux:luminousFlux = 800", 800.0),
        ("float inputs:isolux:dimming = 0.25", 100 * np.pi),
        ("float inputs:isolux:luminousFlux = 800\n float inputs:isolux:dimming = 0.5", 400.0),
        ("color3f inputs:color = (0.5, 0.1, 0.1)", 400 * np.pi),
    ],
)
@pytest.mark.parametrize("unit", [0.01, 1.0])
def test_absolute_candela_depend_on_no_size_unit_or_colour(kind, inputs, flux, unit):
    lamp = only_light(absolute(kind, ISOTROPIC + inputs), f"( metersPerUnit = {unit} )")
    assert lamp.luminous_flux == pytest.approx(flux, rel=1e-6)
    assert lamp.colour @ LUMINANCE_WEIGHTS == pytest.approx(1.0)


def test_intensity_and_exposure_have_no_part_in_absolute_photometry_and_it_says_so():
    scene = read_usda(absolute("SphereLight", ISOTROPIC + "float inputs:intensity = 5000"))
    assert scene.luminaires[0].luminous_flux == pytest.approx(400 * np.pi)
    assert found(scene) == [("/Lamp", "inputs:intensity", "noted")]


def test_a_point_with_absolute_photometry_needs_no_area():
    lamp = only_light(absolute("SphereLight", ISOTROPIC).replace("radius = 0.5", "radius = 0"))
    assert lamp.luminous_flux == pytest.approx(400 * np.pi)
    np.testing.assert_array_equal(lamp.size, [0, 0])


def test_its_own_file_goes_before_the_usdlux_profile(tmp_path):
    (tmp_path / "usdlux").mkdir()
    profile = ies(tmp_path / "usdlux", [0, 180], [7, 7])
    assert only_light(absolute("SphereLight", profile)).luminous_flux == pytest.approx(28 * np.pi)
    own = ies(tmp_path, [0, 180], [5, 5]).replace("shaping:ies", "isolux")
    lamp = only_light(absolute("SphereLight", profile + "\n" + own))
    assert lamp.luminous_flux == pytest.approx(20 * np.pi)


def candela_towards(lamp, world_direction):
    """Intensity of a luminaire in a world direction, by its own axes and diagram."""
    distribution = CandelaDistribution(
        lamp.diagram.gamma, lamp.diagram.c_angles, lamp.diagram.candela
    )
    local = np.atleast_2d(world_direction) @ lamp.axes.T
    return distribution.intensity(np.ascontiguousarray(local / np.linalg.norm(local)))[0]


HORIZON = {"+X": (1, 0, 0), "+Y": (0, 1, 0), "-X": (-1, 0, 0), "-Y": (0, -1, 0)}
# By C0 axis: candela along local +X, +Y, -X, -Y, from C = 0, 90, 180, 270: 10, 20, 30, 40.
TURNED = {
    "+X": [10, 20, 30, 40],
    "+Y": [40, 10, 20, 30],
    "-X": [30, 40, 10, 20],
    "-Y": [20, 30, 40, 10],
}
PLACEMENTS = {
    "as it stands": np.eye(3),
    "turned": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "mirrored in X": np.diag([-1.0, 1, 1]),
    "mirrored in Y": np.diag([1.0, -1, 1]),
    "mirrored in Z": np.diag([1.0, 1, -1]),
    "turned and mirrored": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]),
}


@pytest.mark.parametrize("c0_axis", TURNED)
@pytest.mark.parametrize("placement", PLACEMENTS)
def test_a_diagram_follows_its_light_through_turns_and_mirrors(c0_axis, placement):
    rows = PLACEMENTS[placement]
    matrix = ", ".join(f"({x}, {y}, {z}, 0)" for x, y, z in rows)
    inputs = f'{FOUR_PLANES} token inputs:isolux:c0Axis = "{c0_axis}"'
    lamp = only_light(absolute("RectLight", inputs, f"( {matrix}, (0, 0, 0, 1) )"))
    np.testing.assert_allclose(lamp.axes @ lamp.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(lamp.axes) == pytest.approx(1.0)
    np.testing.assert_allclose(-lamp.axes[2], -rows[2], atol=1e-12)
    for local, candela in zip(HORIZON.values(), TURNED[c0_axis], strict=True):
        assert candela_towards(lamp, np.array(local) @ rows) == pytest.approx(candela)


def test_a_sheared_rect_shines_along_its_normal_with_its_own_area():
    sheared = "( (1, 0, 0, 0), (1, 2, 0, 0), (1, 1, 1, 0), (0, 0, 0, 1) )"
    scene = read_usda(light("RectLight", transform=sheared))
    lamp = scene.luminaires[0]
    np.testing.assert_allclose(lamp.axes[2], [0, 0, 1], atol=1e-12)
    assert lamp.size.prod() == pytest.approx(0.5 * 2)
    assert found(scene) == [("/Lamp", "RectLight", "approximated")]


# What is refused, dropped or left out


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (light("SphereLight").replace("radius = 0.5", "radius = 0"), "SphereLight"),
        (light("RectLight").replace("width = 2", "width = 0"), "RectLight"),
        (light("SphereLight", "float inputs:intensity = 0"), "SphereLight"),
        (light("SphereLight", "float inputs:intensity = -3"), "SphereLight"),
        (light("SphereLight", "color3f inputs:color = (0, 0, 0)"), "SphereLight"),
        (light("SphereLight", transform=scaled(0, 0, 0)), "SphereLight"),
        (shaped("DiskLight", "float inputs:shaping:cone:angle = 0"), "DiskLight"),
        (absolute("SphereLight", ISOTROPIC + "float inputs:isolux:dimming = 0"), "SphereLight"),
        ('def DistantLight "Lamp" {\nfloat inputs:intensity = 0\n}', "DistantLight"),
        ('def DomeLight "Lamp" {\ncolor3f inputs:color = (0, 0, 0)\n}', "DomeLight"),
        ('def PortalLight "Lamp" {\n}', "PortalLight"),
        ('def GeometryLight "Lamp" {\n}', "GeometryLight"),
    ],
)
def test_a_light_without_a_part_is_dropped_by_name(text, kind):
    scene = read_usda(text)
    assert scene.luminaires == ()
    assert found(scene) == [("/Lamp", kind, "skipped")]
    assert scene.luminous_flux == 0.0


def test_a_zero_area_light_with_normalize_is_a_point_of_known_flux():
    text = light("SphereLight", "bool inputs:normalize = 1").replace("radius = 0.5", "radius = 0")
    assert only_light(text).luminous_flux == pytest.approx(np.pi)


@pytest.mark.parametrize(
    ("kind", "hint", "size", "area"),
    [
        ("SphereLight", "treatAsPoint", (0, 0), SPHERE_AREA),
        ("CylinderLight", "treatAsLine", (0, 3), CYLINDER_AREA),
    ],
)
def test_a_light_treated_as_thin_keeps_its_flux(kind, hint, size, area):
    lamp = only_light(light(kind, f"bool {hint} = 1"))
    np.testing.assert_allclose(lamp.size, size)
    assert lamp.luminous_flux == pytest.approx(np.pi * area)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (light("SphereLight", "float inputs:intensity = nan"), SceneError),
        (light("SphereLight", "float inputs:intensity = inf"), SceneError),
        (light("SphereLight", "float inputs:exposure = 5000"), SceneError),
        (light("SphereLight").replace("radius = 0.5", "radius = -1"), SceneError),
        (light("SphereLight", "color3f inputs:color = (1, -1, 1)"), SceneError),
        (shaped("SphereLight", "float inputs:shaping:cone:angle = nan"), SceneError),
        (shaped("SphereLight", "asset inputs:shaping:ies:file = @no.ies@"), PhotometryError),
        (absolute("SphereLight", ""), PhotometryError),
        (absolute("SphereLight", "asset inputs:isolux:file = @no.ies@"), PhotometryError),
        (absolute("SphereLight", ISOTROPIC.replace("[0, 180]", "[0]")), PhotometryError),
        (absolute("SphereLight", ISOTROPIC + "float inputs:isolux:dimming = -1"), SceneError),
        (absolute("SphereLight", ISOTROPIC + 'token inputs:isolux:c0Axis = "up"'), SceneError),
    ],
)
def test_what_makes_no_light_stops_and_names_the_prim(text, error):
    with pytest.raises(error) as raised:
        read_usda(text)
    assert raised.value.subject.startswith("/Lamp")


def test_a_broken_photometric_file_is_named_beside_its_prim(tmp_path):
    profile = ies(tmp_path, [0, 90, 180], [1, 1])
    with pytest.raises(PhotometryError) as raised:
        read_usda(shaped("SphereLight", profile))
    assert "/Lamp" in raised.value.subject and "lamp.ies" in raised.value.subject


@pytest.mark.parametrize(
    ("inputs", "kind"),
    [
        ("float inputs:diffuse = 0.5", "inputs:diffuse"),
        ("color3f inputs:shadow:color = (0, 0, 1)", "inputs:shadow:color"),
        ("asset inputs:texture:file = @map.png@", "inputs:texture:file"),
        ("rel light:filters = </Gobo>", "light:filters"),
    ],
)
def test_unphysical_controls_are_reported(inputs, kind):
    scene = read_usda(light("RectLight", inputs))
    assert len(scene.luminaires) == 1
    assert found(scene) == [("/Lamp", kind, "approximated")]


def test_a_tint_by_direction_is_taken_by_its_luminance():
    """f = t + (1 − t)·|cos θ|: 4π·(t + (1 − t)/2) over the sphere, t = 0.7152 for pure green."""
    inputs = """float inputs:shaping:focus = 1
        color3f inputs:shaping:focusTint = (0, 1, 0)
        float inputs:shaping:cone:angle = 180"""
    scene = read_usda(shaped("SphereLight", inputs))
    expected = np.pi * SPHERE_AREA * (0.7152 + (1 - 0.7152) / 2)
    assert scene.luminous_flux == pytest.approx(expected, rel=1e-3)
    assert found(scene) == [("/Lamp", "shaping:focusTint", "approximated")]


def test_a_light_reads_at_the_asked_time():
    blink = "float inputs:intensity.timeSamples = { 1: 10, 2: 30 }"
    stage = open_usda(light("RectLight", blink))
    fluxes = [read_stage(stage, time).luminous_flux for time in (1.0, 1.5, 2.0)]
    np.testing.assert_allclose(fluxes, np.pi * 0.5 * np.array([10, 20, 30]), rtol=1e-6)
