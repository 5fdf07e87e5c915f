"""Distant lights, domes and portals as UsdLux has them: brightness, directions, textures."""

from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from isolux import SceneError
from isolux.environment_map import as_latlong
from isolux.luminaire_shapes import dome_luminance
from isolux.radiance_hdr import read_radiance_hdr
from isolux.solution import LUMINANCE_WEIGHTS
from usda_stage import METRES, found, read_usda

Y_UP = METRES.replace('"Z"', '"Y"')


def light(kind: str, inputs: str = "", inside: str = "") -> str:
    return f'def {kind} "Lamp" {{\n{inputs}\n{inside}\n}}'


def only_light(text: str, metadata: str = METRES):
    scene = read_usda(text, metadata)
    assert len(scene.luminaires) == 1, scene.findings
    return scene.luminaires[0]


def illuminance_across(distant) -> float:
    """lx that a plane facing the light gets of it: π L sin² of its half-angle, or all of it."""
    half_angle = distant.size[0]
    if half_angle == 0:
        return distant.luminous_flux
    luminance = distant.luminous_flux / (2 * np.pi * (1 - np.cos(half_angle)))
    return luminance * np.pi * np.sin(min(half_angle, np.pi / 2)) ** 2


@pytest.mark.parametrize("angle", [0.0, 0.53, 10.0, 180.0])
def test_a_normalised_distant_light_has_its_intensity_for_illuminance(angle):
    inputs = (
        f"float inputs:intensity = 700\nfloat inputs:angle = {angle}\nbool inputs:normalize = 1"
    )
    distant = only_light(light("DistantLight", inputs))
    assert distant.shape == "distant"
    assert illuminance_across(distant) == pytest.approx(700, rel=1e-6)


@pytest.mark.parametrize(
    ("angle", "factor"),
    [(0.0, 1.0), (10.0, np.pi * np.sin(np.radians(5)) ** 2), (180.0, np.pi)],
)
def test_a_distant_lights_intensity_is_its_luminance_over_its_cone(angle, factor):
    """A parallel light has no cone: its intensity is its illuminance."""
    inputs = f"float inputs:intensity = 10\nfloat inputs:exposure = 3\nfloat inputs:angle = {angle}"
    assert illuminance_across(only_light(light("DistantLight", inputs))) == pytest.approx(
        80 * factor
    )


def test_a_normalised_cone_beyond_a_hemisphere_as_the_schema_has_it():
    """sizeFactor (2 − sin² θ) π at θ = 135°."""
    inputs = "float inputs:intensity = 1\nfloat inputs:angle = 270\nbool inputs:normalize = 1"
    distant = only_light(light("DistantLight", inputs))
    assert illuminance_across(distant) == pytest.approx(1 / (2 - 0.5))


def test_a_distant_light_shines_along_its_own_minus_z():
    turned = """float3 xformOp:rotateXYZ = (90, 0, 0)
        double3 xformOp:scale = (2, 3, 4)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ", "xformOp:scale"]"""
    distant = only_light(light("DistantLight", turned))
    np.testing.assert_allclose(distant.axes[2], [0, -1, 0], atol=1e-7)  # it comes from there
    np.testing.assert_allclose(distant.axes @ distant.axes.T, np.eye(3), atol=1e-12)


def test_a_plain_dome_is_its_luminance_all_around():
    dome = only_light(light("DomeLight", "float inputs:intensity = 5\nbool inputs:normalize = 1"))
    assert dome.environment.shape == (1, 1, 3)
    assert dome.environment == pytest.approx(5.0)
    assert dome.luminous_flux == pytest.approx(4 * np.pi * 5)


def to_world(dome, latlong):
    """A direction of the map, in world space."""
    return np.array(latlong, float) @ dome.axes


@pytest.mark.parametrize(
    ("kind", "inputs", "metadata", "pole", "middle"),
    [
        ("DomeLight", "", METRES, (0, 1, 0), (0, 0, 1)),
        ("DomeLight", "", Y_UP, (0, 1, 0), (0, 0, 1)),
        ("DomeLight_1", "", Y_UP, (0, 1, 0), (0, 0, 1)),
        ("DomeLight_1", "", METRES, (0, 0, 1), (0, -1, 0)),
        ("DomeLight_1", 'uniform token poleAxis = "Z"', Y_UP, (0, 0, 1), (0, -1, 0)),
        ("DomeLight_1", 'uniform token poleAxis = "Y"', METRES, (0, 1, 0), (0, 0, 1)),
    ],
)
def test_the_pole_and_the_middle_of_a_dome(kind, inputs, metadata, pole, middle):
    dome = only_light(light(kind, inputs), metadata)
    np.testing.assert_allclose(to_world(dome, [0, 1, 0]), pole, atol=1e-12)
    np.testing.assert_allclose(to_world(dome, [0, 0, 1]), middle, atol=1e-12)
    np.testing.assert_allclose(to_world(dome, [1, 0, 0]), [1, 0, 0], atol=1e-12)


def test_a_mirrored_dome_stays_mirrored():
    flip = """double3 xformOp:scale = (-1, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]"""
    dome = only_light(light("DomeLight", flip))
    np.testing.assert_allclose(dome.axes, np.diag([-1.0, 1, 1]), atol=1e-12)


TEXELS = np.arange(4 * 8 * 3, dtype=np.float32).reshape(4, 8, 3)


def write_exr(path, texels):
    OpenEXR.File({}, {"RGB": texels}).write(str(path))


def rgbe(texels, packed=True):
    """A Radiance picture of powers of two, whose mantissas are exact but for half a step."""
    height, width = texels.shape[:2]
    exponent = np.frexp(texels.max(axis=2))[1]
    mantissa = (texels * np.exp2(8.0 - exponent)[..., None]).astype(np.uint8)
    rows = np.concatenate([mantissa, (exponent + 128).astype(np.uint8)[..., None]], axis=2)
    body = b""
    for row in rows:
        if not packed:
            body += row.tobytes()
            continue
        body += bytes([2, 2, width >> 8, width & 255])
        for channel in row.T:
            if (channel == channel[0]).all():
                body += bytes([128 + width, channel[0]])
            else:
                body += bytes([width]) + channel.tobytes()
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + body


def test_textures_of_each_kind_of_file(tmp_path):
    """OpenEXR and Radiance as they are, 8 bits as sRGB."""
    write_exr(tmp_path / "a.exr", TEXELS)
    (tmp_path / "a.hdr").write_bytes(rgbe(TEXELS + 1))
    Image.fromarray(np.full((4, 8, 3), 128, np.uint8)).save(tmp_path / "a.png")
    scale = "color3f inputs:color = (2, 2, 2)\n"

    def read(name):
        inputs = scale + f"asset inputs:texture:file = @{tmp_path / name}@"
        return only_light(light("DomeLight", inputs)).environment

    assert read("a.exr") == pytest.approx(2 * TEXELS)
    assert read("a.hdr") == pytest.approx(2 * (TEXELS + 1), rel=0.02)
    assert read("a.png") == pytest.approx(2 * 0.2158605, rel=1e-5)


@pytest.mark.parametrize("packed", [True, False])
def test_a_radiance_picture_packed_and_plain(packed):
    texels = np.ones((4, 16, 3), np.float32)
    texels[1, :, 0] = np.exp2(np.arange(16) - 8.0)
    texels[1, :, 1:] = texels[1, :, :1]
    read = read_radiance_hdr(rgbe(texels, packed), "a.hdr", 1000)
    np.testing.assert_allclose(read, texels, rtol=1 / 250)


@pytest.mark.parametrize(
    "contents",
    [
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 999999999 +X 999999999\n",
        b"#?RADIANCE\n",
        rgbe(np.ones((4, 16, 3), np.float32))[:-3],
        rgbe(np.ones((4, 16, 3), np.float32), packed=False)[:-3],
        rgbe(np.ones((4, 16, 3), np.float32)).replace(b"\x90", b"\xff"),
        rgbe(np.ones((4, 16, 3), np.float32)).replace(b"\x90", b"\x00"),
    ],
)
def test_a_broken_radiance_picture_is_refused(contents):
    with pytest.raises(SceneError, match=r"a\.hdr"):
        read_radiance_hdr(contents, "a.hdr", 1 << 20)


def test_a_texture_that_is_not_there_leaves_the_colour_and_says_so():
    scene = read_usda(light("DomeLight", "asset inputs:texture:file = @no.exr@"))
    assert scene.luminaires[0].environment == pytest.approx(1.0)
    assert found(scene) == [("/Lamp", "inputs:texture:file", "approximated")]


@pytest.mark.parametrize("layout", ["angular", "mirroredBall"])
def test_a_balls_picture_becomes_a_map(layout):
    """A picture of the height above the horizon, (1 + y)/2, has it in each direction."""
    side = 256
    x, y = np.meshgrid(
        2 * (np.arange(side) + 0.5) / side - 1, 1 - 2 * (np.arange(side) + 0.5) / side
    )
    radius = np.minimum(np.hypot(x, y), 1)
    angle = np.pi * radius if layout == "angular" else 2 * np.arcsin(radius)
    height = np.sin(angle) * y / np.maximum(radius, 1e-9)
    picture = np.repeat((0.5 + 0.5 * height)[..., None], 3, axis=2).astype(np.float32)
    map_ = as_latlong(picture, layout)
    rows, columns = map_.shape[:2]
    expected = 0.5 + 0.5 * np.sin(np.pi * (0.5 - (np.arange(rows) + 0.5) / rows))
    middle = slice(columns // 8, -columns // 8)  # a ball says little of what is behind it
    off = map_[:, middle, 0] - expected[:, None]
    assert np.abs(off).max() < 0.05


def test_a_large_map_keeps_its_light():
    texels = np.random.default_rng(1).random((1500, 3000, 3), np.float32)
    map_ = as_latlong(texels, "latlong")
    assert map_.shape == (1024, 2048, 3)
    assert map_.mean() == pytest.approx(texels.mean(), rel=1e-3)


PORTAL = """def PortalLight "Portal" {
    float inputs:width = 2
    float inputs:height = 3
    float3 xformOp:rotateXYZ = (90, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}"""


@pytest.mark.parametrize(
    "text",
    [
        light("DomeLight", "float inputs:intensity = 5", PORTAL),
        light("DomeLight", "float inputs:intensity = 5\nrel portals = </Portal>") + "\n" + PORTAL,
    ],
    ids=["below it", "named"],
)
def test_a_portal_is_a_rectangle_as_bright_as_its_dome(text):
    """And the dome shines through nothing else."""
    portal = only_light(text)
    assert portal.path.endswith("Portal")
    assert portal.shape == "rect"
    assert portal.size == pytest.approx([2, 3])
    assert portal.luminous_flux == pytest.approx(np.pi * 5 * 6)
    assert portal.diagram is None
    np.testing.assert_allclose(portal.axes[2], [0, -1, 0], atol=1e-7)


def test_through_a_portal_light_goes_as_the_dome_behind_it_shines(tmp_path):
    """Above the horizon 100 cd/m², below 20: a level portal sees as much of either."""
    texels = np.full((90, 180, 3), 20.0, np.float32)
    texels[:45] = 100.0
    write_exr(tmp_path / "sky.exr", texels)
    file = f"asset inputs:texture:file = @{tmp_path / 'sky.exr'}@"
    portal = only_light(light("DomeLight", file, PORTAL.replace("(90, 0, 0)", "(0, 0, 0)")))
    assert portal.luminous_flux == pytest.approx(6 * np.pi * 60, rel=0.01)
    diagram = portal.diagram
    gamma = np.searchsorted(diagram.gamma, np.radians(45) - 1e-9)
    down, up = (np.searchsorted(diagram.c_angles, np.radians(c) - 1e-9) for c in (270, 90))
    ratio = diagram.candela[down, gamma] / diagram.candela[up, gamma]
    assert ratio == pytest.approx(5)  # light from above goes down


def test_shaping_has_no_part_in_light_from_afar():
    shaped = 'def DistantLight "Lamp" ( prepend apiSchemas = ["ShapingAPI"] ) {\n%s\n}'
    assert found(read_usda(shaped % "")) == []
    focus = read_usda(shaped % "float inputs:shaping:focus = 2")
    assert found(focus) == [("/Lamp", "shaping:focus", "approximated")]


def test_a_rect_lights_texture_counts_by_its_mean(tmp_path):
    write_exr(tmp_path / "a.exr", TEXELS)
    rect = light("RectLight", f"asset inputs:texture:file = @{tmp_path / 'a.exr'}@")
    scene = read_usda(rect)
    mean = TEXELS.mean(axis=(0, 1)) @ LUMINANCE_WEIGHTS
    assert scene.luminaires[0].luminous_flux == pytest.approx(np.pi * mean)
    assert found(scene) == [("/Lamp", "inputs:texture:file", "approximated")]


def test_texels_that_are_no_light_are_refused(tmp_path):
    texels = TEXELS.copy()
    texels[0, 0, 0] = np.nan
    write_exr(tmp_path / "a.exr", texels)
    scene = read_usda(light("DomeLight", f"asset inputs:texture:file = @{tmp_path / 'a.exr'}@"))
    assert found(scene) == [("/Lamp", "inputs:texture:file", "approximated")]


def test_a_picture_sees_the_dome_as_its_map_has_it():
    dome = only_light(light("DomeLight_1", "float inputs:intensity = 2"))
    sky = replace(dome, environment=np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3))
    # Stage +Z is the pole and -Y the middle; to the left of it is +X.
    seen = np.array([[0.1, -0.2, 0.9], [0.9, -0.2, 0.3], [-0.9, -0.2, -0.3]], np.float32)
    expected = sky.environment[[0, 0, 1], [1, 0, 2]]
    expected[1] = sky.environment[0, 1]
    np.testing.assert_array_equal(dome_luminance([sky], seen), expected)
