"""Colours of named spaces in linear Rec. 709, against the primaries' own arithmetic."""

import numpy as np
import pytest

from isolux.colour_space import UnknownColourSpaceError, to_linear_rec709
from textured_stage import material, png, quad, read_at, texture
from usda_stage import found

# Chromaticities of red, green, blue and white [ITU-R BT.709, BT.2020; ACES S-2014-004; P3-D65].
D65, D60 = (0.3127, 0.3290), (0.32168, 0.33767)
REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65)
REC2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65)
AP1 = ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), D60)
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def xyz(x, y):
    return np.array([x / y, 1.0, (1 - x - y) / y])


def to_xyz(primaries):
    columns = np.stack([xyz(*p) for p in primaries[:3]], axis=1)
    return columns * np.linalg.solve(columns, xyz(*primaries[3]))


def expected(colour, primaries):
    """By way of XYZ, the white adapted after Bradford."""
    from_white, to_white = BRADFORD @ xyz(*primaries[3]), BRADFORD @ xyz(*D65)
    adapt = np.linalg.inv(BRADFORD) @ np.diag(to_white / from_white) @ BRADFORD
    return np.linalg.solve(to_xyz(REC709), adapt @ to_xyz(primaries) @ colour)


def srgb(encoded):
    encoded = np.asarray(encoded)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


COLOUR = np.array([0.5, 0.4, 0.3])


@pytest.mark.parametrize(
    ("space", "reference"),
    [
        ("", COLOUR),
        ("raw", COLOUR),
        ("lin_rec709_scene", COLOUR),
        ("sRGB", srgb(COLOUR)),
        ("srgb_texture", srgb(COLOUR)),
        ("g22_rec709_scene", COLOUR**2.2),
        ("lin_rec2020_scene", expected(COLOUR, REC2020)),
        ("lin_p3d65_scene", expected(COLOUR, P3)),
        ("srgb_p3d65_scene", expected(srgb(COLOUR), P3)),
        ("ACEScg", expected(COLOUR, AP1)),
        ("acescg", expected(COLOUR, AP1)),
        ("lin_ap1_scene", expected(COLOUR, AP1)),
    ],
)
def test_named_spaces(space, reference):
    converted, is_clipped = to_linear_rec709(COLOUR[None], space)
    np.testing.assert_allclose(converted[0], reference, atol=2e-4)
    assert not is_clipped


def test_colours_outside_of_rec709_are_clipped_and_light_may_exceed_one():
    converted, is_clipped = to_linear_rec709(np.array([[0.0, 1.0, 0.0]]), "lin_rec2020_scene")
    np.testing.assert_array_equal(converted, [[0, 1, 0]])
    assert is_clipped
    converted, is_clipped = to_linear_rec709(np.array([[20.0, 20.0, 20.0]]), "lin_rec2020_scene")
    np.testing.assert_allclose(converted, 20, rtol=1e-4)
    assert not is_clipped


def test_an_unknown_name_is_an_error():
    with pytest.raises(UnknownColourSpaceError):
        to_linear_rec709(COLOUR[None], "sepia")


CONFIG = """ocio_profile_version: 2
roles: {aces_interchange: ACES2065-1, default: ACES2065-1, scene_linear: ACES2065-1}
displays:
  none:
    - !<View> {name: Raw, colorspace: ACES2065-1}
colorspaces:
  - !<ColorSpace> {name: ACES2065-1, encoding: scene-linear}
  - !<ColorSpace>
    name: studio_half
    to_scene_reference: !<GroupTransform>
      children:
        - !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}
        - !<BuiltinTransform> {style: "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", direction: inverse}
        - !<BuiltinTransform> {style: ACEScg_to_ACES2065-1}
"""


def test_a_studios_own_configuration_knows_its_own_names(tmp_path, monkeypatch):
    config = tmp_path / "config.ocio"
    config.write_text(CONFIG)
    monkeypatch.setenv("OCIO", str(config))
    converted, _ = to_linear_rec709(COLOUR[None], "studio_half")
    np.testing.assert_allclose(converted[0], COLOUR / 2, atol=2e-4)
    converted, _ = to_linear_rec709(COLOUR[None], "lin_p3d65_scene")  # by the built-in one
    np.testing.assert_allclose(converted[0], expected(COLOUR, P3), atol=2e-4)


def flat(space: str) -> str:
    metadata = f'( colorSpace = "{space}" )' if space else ""
    return f"color3f inputs:diffuseColor = (0.5, 0.4, 0.3) {metadata}"


@pytest.mark.parametrize(
    ("surface", "reference", "actions"),
    [
        (flat(""), COLOUR, []),
        (flat("lin_ap1_scene"), expected(COLOUR, AP1), []),
        (flat("sepia"), COLOUR, ["approximated"]),
        (
            'color3f inputs:diffuseColor = (0, 1, 0) ( colorSpace = "lin_ap1_scene" )',
            (0, 1, 0),
            ["repaired", "repaired"],  # clipped, and 1 taken down to 0.99
        ),
    ],
)
def test_colours_of_attributes(tmp_path, surface, reference, actions):
    scene = read_at(tmp_path, quad() + material("", surface))
    np.testing.assert_allclose(
        scene.meshes[0].reflectance[0], np.minimum(reference, 0.99), atol=2e-4
    )
    assert [action for *_, action in found(scene)] == actions


def test_the_colour_space_of_an_ancestor_and_of_a_primvar(tmp_path):
    inherited = material("", flat("")).replace(
        'def Material "Paint" {',
        """def Material "Paint" ( prepend apiSchemas = ["ColorSpaceAPI"] ) {
        uniform token colorSpace:name = "lin_rec2020_scene" """,
    )
    scene = read_at(tmp_path, quad() + inherited)
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], expected(COLOUR, REC2020), atol=2e-4)
    primvar = """color3f[] primvars:displayColor = [(0.5, 0.4, 0.3)] (
        interpolation = "constant"\ncolorSpace = "lin_rec2020_scene" )"""
    scene = read_at(tmp_path, quad(extra=primvar))
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], expected(COLOUR, REC2020), atol=2e-4)


@pytest.mark.parametrize(
    ("inputs", "reference", "actions"),
    [
        ('token inputs:sourceColorSpace = "lin_ap1_scene"', expected(COLOUR, AP1), []),
        ('token inputs:sourceColorSpace = "sepia"', COLOUR, ["approximated"]),
    ],
)
def test_colours_of_textures(tmp_path, inputs, reference, actions):
    texels = np.full((2, 2, 3), COLOUR * 250)
    scene = read_at(tmp_path, quad() + material(texture(inputs)), texture=png(texels))
    np.testing.assert_allclose(
        scene.meshes[0].reflectance[0], np.array(reference) * 250 / 255, atol=1e-3
    )
    assert [action for *_, action in found(scene)] == [*actions, "approximated"]
    by_file = texture('token inputs:sourceColorSpace = "auto"').replace(
        "@texture.png@", '@texture.png@ ( colorSpace = "lin_ap1_scene" )'
    )
    scene = read_at(tmp_path, quad() + material(by_file), texture=png(texels))
    np.testing.assert_allclose(
        scene.meshes[0].reflectance[0], expected(COLOUR, AP1) * 250 / 255, atol=1e-3
    )
