"""Textures on the faces of meshes: the mean of the texels that a face covers."""

import struct
import zlib

import numpy as np
import OpenEXR
import pytest
from pxr import Sdf, Usd

from isolux.stage_reader import read_stage
from isolux.textures import read_texture
from textured_stage import FLAT, grid, material, mesh, png, quad, read_at, texture, values
from usda_stage import found

SRGB_188 = ((188 / 255 + 0.055) / 1.055) ** 2.4  # 0.5029, by IEC 61966-2-1
# Eight by eight greys unlike each other, the first row on top.
GREYS = (np.arange(64).reshape(8, 8) * 37 + 11) % 251
TEXTURE_READ = ("/Paint/Texture", "UsdUVTexture", "approximated")


def reflectance_of(folder, floor, nodes, **files):
    return read_at(folder, floor + material(nodes), **files).meshes[0].reflectance


def test_a_textured_floor_reflects_the_mean_of_its_texels(tmp_path):
    pictures = {"texture": png(GREYS)}
    one_face = reflectance_of(tmp_path, quad(), texture(), **pictures)
    many_faces = reflectance_of(tmp_path, grid(5), texture(), **pictures)  # 1.6 texels a face
    np.testing.assert_allclose(one_face[0], GREYS.mean() / 255, rtol=1e-6)
    np.testing.assert_allclose(many_faces.mean(axis=0), GREYS.mean() / 255, rtol=1e-6)


def test_a_face_over_one_texel_has_its_colour_row_by_row_from_below(tmp_path):
    reflectance = reflectance_of(tmp_path, grid(8), texture(), texture=png(GREYS))
    np.testing.assert_allclose(reflectance[:, 0].reshape(8, 8), GREYS[::-1] / 255, atol=1e-6)


@pytest.mark.parametrize(
    ("mode", "inputs", "channel", "expected"),
    [
        ("RGB", 'token inputs:sourceColorSpace = "auto"', "rgb", SRGB_188 / 2),
        ("L", 'token inputs:sourceColorSpace = "auto"', "rgb", 188 / 255 / 2),
        ("RGB", "", "rgb", 188 / 255 / 2),
        ("L", 'token inputs:sourceColorSpace = "sRGB"', "rgb", SRGB_188 / 2),
        ("RGB", 'token inputs:sourceColorSpace = "srgb_rec709_scene"', "rgb", SRGB_188 / 2),
        ("RGB", "float4 inputs:scale = (0.5, 0.5, 0.5, 1)", "rgb", 188 / 255 / 4),
        ("RGB", "float4 inputs:bias = (0.2, 0.2, 0.2, 0)", "rgb", 188 / 255 / 2 + 0.2),
        ("RGB", "", "g", 188 / 255 / 2),
        ("RGB", "float4 inputs:scale = (1, 1, 1, 0.3)", "a", 0.3),
        ("RGBA", "", "a", 188 / 255 / 2),
        ("L", "", "b", 188 / 255 / 2),
    ],
)
def test_a_texture_is_averaged_in_linear_light(tmp_path, mode, inputs, channel, expected):
    """Half of the texels are dark, half at level 188."""
    texels = np.zeros((2, 2, len(mode)))
    texels[0] = 188
    nodes = texture(inputs)
    text = quad() + material(nodes).replace("Texture.outputs:rgb", f"Texture.outputs:{channel}")
    scene = read_at(tmp_path, text, texture=png(texels[..., 0] if mode == "L" else texels))
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[expected] * 3], rtol=1e-5)
    assert found(scene) == [TEXTURE_READ]


@pytest.mark.parametrize(
    ("wrap", "means"),
    [  # faces at s in -1..0, 0..1, 1..2, 2..3 of a picture of a dark and a bright half
        ("repeat", [0.5, 0.5, 0.5, 0.5]),
        ("clamp", [0.0, 0.5, 1.0, 1.0]),
        ("black", [0.0, 0.5, 0.0, 0.0]),
        ("useMetadata", [0.0, 0.5, 0.0, 0.0]),
    ],
)
def test_wrap_modes_beyond_the_picture(tmp_path, wrap, means):
    modes = f'token inputs:wrapS = "{wrap}"\n token inputs:wrapT = "{wrap}"'
    halves = png(np.array([[0, 204]]))
    for left, mean in zip((-1, 0, 1, 2), means, strict=True):
        square = [(left, 0), (left + 1, 0), (left + 1, 1), (left, 1)]
        reflectance = reflectance_of(tmp_path, quad(square), texture(modes), texture=halves)
        np.testing.assert_allclose(reflectance[0], mean * 0.8, atol=1e-6)


def test_a_mirrored_picture_meets_itself(tmp_path):
    halves = png(np.array([[0, 204]]))
    mirrored = 'token inputs:wrapS = "mirror"'
    for left, expected in ((0.5, 0.8), (1.0, 0.8), (1.5, 0.0), (-0.5, 0.0)):
        square = [(left, 0), (left + 0.5, 0), (left + 0.5, 1), (left, 1)]
        reflectance = reflectance_of(tmp_path, quad(square), texture(mirrored), texture=halves)
        np.testing.assert_allclose(reflectance[0], expected, atol=1e-6)


def test_black_is_scaled_and_biased_like_the_rest(tmp_path):
    far = [(5, 0), (6, 0), (6, 1), (5, 1)]
    modes = 'token inputs:wrapS = "black"\n float4 inputs:bias = (0.1, 0.2, 0.3, 0)'
    reflectance = reflectance_of(tmp_path, quad(far), texture(modes), texture=png(GREYS))
    np.testing.assert_allclose(reflectance, [[0.1, 0.2, 0.3]], rtol=1e-6)


MOVED = """
    def Shader "Moved" {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </Paint/Reader.outputs:result>
        %s
        float2 outputs:result
    }"""
BY_MOVED = "float2 inputs:st.connect = </Paint/Moved.outputs:result>"
QUARTERS = np.array([[51, 102], [153, 204]])  # 0.2 0.4 on top, 0.6 0.8 below


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ("float2 inputs:scale = (0.5, 0.5)", 0.6),  # the lower left quarter
        ("float2 inputs:scale = (0.5, 0.5)\nfloat2 inputs:translation = (0.5, 0.5)", 0.4),
        # turned by 90 degrees the lower left quarter lies at s in -0.5..0, thus lower right
        ("float2 inputs:scale = (0.5, 0.5)\nfloat inputs:rotation = 90", 0.8),
    ],
)
def test_transformed_coordinates(tmp_path, transform, expected):
    repeat = 'token inputs:wrapS = "repeat"\n token inputs:wrapT = "repeat"'
    nodes = texture(repeat, st=BY_MOVED) + MOVED % transform
    reflectance = reflectance_of(tmp_path, quad(), nodes, texture=png(QUARTERS))
    np.testing.assert_allclose(reflectance[0], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("interpolation", "coordinates", "expected"),
    [
        ("constant", [(0.25, 0.25)], [0.6, 0.6]),
        ("uniform", [(0.25, 0.25), (0.75, 0.75)], [0.6, 0.4]),
        ("varying", [(0, 0), (0.5, 0), (1, 0), (0, 1), (0.5, 1), (1, 1)], [0.4, 0.6]),
        ("vertex", [(0, 0), (0.5, 0), (1, 0), (0, 1), (0.5, 1), (1, 1)], [0.4, 0.6]),
        (
            "faceVarying",
            [(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5), (0.5, 0.5), (1, 0.5), (1, 1), (0.5, 1)],
            [0.6, 0.4],
        ),
    ],
)
@pytest.mark.parametrize("indexed", [False, True])
def test_coordinates_of_every_interpolation(
    tmp_path, interpolation, coordinates, expected, indexed
):
    """Two faces side by side, over six points; constant coordinates are inherited."""
    inherited = interpolation == "constant"
    points = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    order = range(len(coordinates))
    indices = ""
    if indexed:
        coordinates, order = coordinates[::-1], [*order][::-1]
        indices = f"\nint[] primvars:st:indices = {list(order)}"
    primvar = f"""texCoord2f[] primvars:st = [{values(coordinates)}] (
        interpolation = "{interpolation}" ){indices}"""
    text = mesh(points, [4, 4], [0, 1, 4, 3, 1, 2, 5, 4], extra="" if inherited else primvar)
    if inherited:
        text = f'def Xform "Room" {{ {primvar}\n{text} }}'
    reflectance = reflectance_of(tmp_path, text, texture(), texture=png(QUARTERS))
    np.testing.assert_allclose(np.broadcast_to(reflectance, (2, 3))[:, 0], expected, atol=1e-6)


def test_a_mesh_without_coordinates_takes_the_mean_and_says_so(tmp_path):
    scene = read_at(tmp_path, quad(None) + material(texture()), texture=png(GREYS))
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], GREYS.mean() / 255, rtol=1e-6)
    assert found(scene) == [TEXTURE_READ, ("/Floor", "texture", "approximated")]
    assert "no primvar st" in scene.findings[1].reason


def test_a_readers_fallback_stands_for_missing_coordinates(tmp_path):
    text = quad(None) + material(texture())
    text = text.replace('varname = "st"', 'varname = "st"\n float2 inputs:fallback = (0.75, 0.75)')
    scene = read_at(tmp_path, text, texture=png(QUARTERS))
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], 0.4, rtol=1e-6)


UDIM = {
    "paint.1001": png(np.full((2, 2), 51)),
    "paint.1002": png(np.full((4, 4), 102)),
    "paint.1011": png(np.full((2, 2), 204)),
}


def test_udim_tiles_lie_ten_across_and_a_missing_one_is_the_fallback(tmp_path):
    corners = [
        (x + i, y + j) for j in (0, 1) for i in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    text = mesh(corners, [4] * 4, range(16), corners)
    node = texture("float4 inputs:fallback = (0.1, 0.1, 0.1, 1)", file="paint.<UDIM>.png")
    scene = read_at(tmp_path, text + material(node), **UDIM)
    np.testing.assert_allclose(scene.meshes[0].reflectance[:, 0], [0.2, 0.4, 0.8, 0.1], rtol=1e-6)
    assert [f.reason for f in scene.findings if "tile" in f.reason]


def test_concave_and_bent_faces_weigh_their_parts_by_area(tmp_path):
    """An arrowhead whose notch is over a bright corner of the picture; coordinates as points."""
    arrow = [(0, 0), (1, 0.5), (0, 1), (0.4, 0.5)]
    text = mesh(arrow, [4], range(4), arrow)
    reflectance = reflectance_of(tmp_path, text, texture(), texture=png(np.array([[0, 204]])))
    # Right half: a triangle of height 1/2 and base 1/2 (at x = 1/2 the outline spans 0.25..0.75);
    # the whole: 1/2 less the notch of 0.2.
    np.testing.assert_allclose(reflectance[0], 0.8 * 0.125 / 0.3, rtol=1e-6)


def png16(samples: np.ndarray) -> bytes:
    """A PNG of (H, W, C) uint16 samples, written by hand: Pillow writes none."""
    height, width, channels = samples.shape
    header = struct.pack(">IIBBBBB", width, height, 16, {1: 0, 2: 4, 3: 2, 4: 6}[channels], 0, 0, 0)
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)

    def chunk(kind: bytes, contents: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + contents))
        return struct.pack(">I", len(contents)) + kind + contents + check

    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bits_are_linear_and_kept(tmp_path, channels):
    samples = np.arange(4 * channels).reshape(2, 2, channels) * 1000 + 77
    node = texture('token inputs:sourceColorSpace = "auto"')
    reflectance = reflectance_of(tmp_path, quad(), node, texture=png16(samples))
    expected = samples.mean(axis=(0, 1))[: 3 if channels > 1 else 1] / 65535
    np.testing.assert_allclose(reflectance[0], np.resize(expected, 3), rtol=1e-6)


def exr(folder, name, pixels, **header):
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, {"RGB": pixels}) as image:
        image.write(str(folder / "texture.exr"))
    (folder / "texture.exr").rename(folder / name)


def test_an_openexr_texture_is_linear_whatever_its_name(tmp_path):
    pixels = np.zeros((4, 4, 3), np.float32)
    pixels[:2] = (0.2, 0.4, 0.8)
    exr(tmp_path, "texture.png", pixels)
    node = texture('token inputs:sourceColorSpace = "auto"')
    reflectance = reflectance_of(tmp_path, quad(), node)
    np.testing.assert_allclose(reflectance, [[0.1, 0.2, 0.4]], rtol=1e-6)


def test_wrap_modes_by_the_metadata_of_the_file(tmp_path):
    pixels = np.full((4, 4, 3), 0.5, np.float32)
    exr(tmp_path, "texture.png", pixels, wrapmodes="periodic,black")
    aside, above = (
        [(s + i, t + j) for s, t in ((0, 0), (1, 0), (1, 1), (0, 1))] for i, j in ((3, 0), (0, 3))
    )
    assert reflectance_of(tmp_path, quad(aside), texture())[0, 0] == pytest.approx(0.5)
    assert reflectance_of(tmp_path, quad(above), texture())[0, 0] == 0


HUGE = png(GREYS)[:16] + struct.pack(">II", 100_000, 100_000) + png(GREYS)[24:]
BROKEN = {
    "missing": None,
    "empty": b"",
    "text": b"no image",
    "cut off": png(GREYS)[:45],
    "OpenEXR cut off": b"\x76\x2f\x31\x01",
    "16 bits cut off": png16(np.arange(300).reshape(10, 10, 3))[:90],
    "10 billion texels": HUGE[:29] + struct.pack(">I", zlib.crc32(HUGE[12:29])) + HUGE[33:],
}


@pytest.mark.parametrize("contents", BROKEN.values(), ids=BROKEN)
def test_an_unreadable_texture_gives_its_fallback_and_says_so(tmp_path, contents):
    files = {} if contents is None else {"texture": contents}
    node = texture("float4 inputs:fallback = (0.1, 0.2, 0.3, 1)")
    scene = read_at(tmp_path, quad() + material(node), **files)
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.1, 0.2, 0.3]], rtol=1e-6)
    assert found(scene) == [("/Paint/Texture", "UsdUVTexture", "skipped")]


def test_an_unreadable_texture_without_a_fallback_leaves_the_display_colour(tmp_path):
    display = 'color3f[] primvars:displayColor = [(0.3, 0.3, 0.3)] ( interpolation = "constant" )'
    surface = f"""color3f inputs:{FLAT}
        float inputs:opacity.connect = </Paint/Texture.outputs:r>"""
    scene = read_at(tmp_path, quad(extra=display) + material(texture(), surface))
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.3] * 3], rtol=1e-6)
    assert scene.meshes[0].opacity is None
    assert found(scene) == [
        ("/Paint/Texture", "UsdUVTexture", "skipped"),
        ("/Paint/Surface", "diffuseColor", "approximated"),
    ]


def test_a_texture_inside_a_usdz_package(tmp_path):
    node = texture()
    read_at(tmp_path, quad() + material(node), texture=png(GREYS))
    package = Sdf.ZipFileWriter.CreateNew(str(tmp_path / "room.usdz"))
    with package:
        package.AddFile(str(tmp_path / "stage.usda"), "stage.usda")
        package.AddFile(str(tmp_path / "texture.png"), "texture.png")
    reflectance = read_stage(Usd.Stage.Open(str(tmp_path / "room.usdz"))).meshes[0].reflectance
    np.testing.assert_allclose(reflectance[0], GREYS.mean() / 255, rtol=1e-6)


def test_a_cut_out_is_the_mean_of_its_texels_and_the_rest_keeps_its_colour(tmp_path):
    """A leaf of one bright texel in four; where it is cut out the picture is black."""
    leaf = np.zeros((2, 2, 4))
    leaf[1, 0] = (51, 204, 51, 255)
    surface = f"color3f inputs:{FLAT}\nfloat inputs:opacity.connect = </Paint/Texture.outputs:a>"
    scene = read_at(tmp_path, quad() + material(texture(), surface), texture=png(leaf))
    np.testing.assert_allclose(scene.meshes[0].opacity, [0.25], rtol=1e-6)
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.2, 0.8, 0.2]], rtol=1e-6)
    assert ("/Paint/Surface", "opacity", "approximated") in found(scene)


@pytest.mark.parametrize(
    ("threshold", "expected"), [(0, 0.5), (0.3, 0.75), (0.5, 0.5), (0.7, 0.25)]
)
def test_the_threshold_of_opacity_is_met_texel_by_texel(tmp_path, threshold, expected):
    alpha = np.array([[51, 102], [153, 204]])  # mean 0.5
    surface = f"""color3f inputs:diffuseColor = (0.5, 0.5, 0.5)
        float inputs:opacity.connect = </Paint/Texture.outputs:r>
        float inputs:opacityThreshold = {threshold}"""
    scene = read_at(tmp_path, quad() + material(texture(), surface), texture=png(alpha))
    np.testing.assert_allclose(scene.meshes[0].opacity, [expected], rtol=1e-6)


def test_a_textured_screen_shines_by_face(tmp_path):
    surface = "color3f inputs:emissiveColor.connect = </Paint/Texture.outputs:rgb>"
    node = texture("float4 inputs:scale = (1000, 1000, 1000, 1)")
    scene = read_at(tmp_path, grid(2) + material(node, surface), texture=png(QUARTERS))
    np.testing.assert_allclose(scene.meshes[0].emission[:, 1], [600, 800, 200, 400], rtol=1e-6)


def test_a_picture_without_alpha_cuts_nothing_out(tmp_path):
    surface = "float inputs:opacity.connect = </Paint/Texture.outputs:a>"
    scene = read_at(tmp_path, quad() + material(texture(), surface), texture=png(GREYS))
    assert scene.meshes[0].opacity is None
    assert found(scene) == [TEXTURE_READ]


def test_a_part_of_a_mesh_takes_its_own_texels(tmp_path):
    part = """
    def GeomSubset "Half" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1, 2]
        rel material:binding = </Paint>
    }"""
    text = grid(2, part).replace("rel material:binding = </Paint>", "", 1)
    scene = read_at(tmp_path, text + material(texture()), texture=png(QUARTERS))
    np.testing.assert_allclose(scene.meshes[0].reflectance[:, 0], [0.18, 0.8, 0.2, 0.18], rtol=1e-6)


@pytest.mark.parametrize("broken", ["nan", "inf", "-1e30", "transform"])
def test_coordinates_that_are_none_count_as_zero_and_are_reported(tmp_path, broken):
    nodes = texture()
    if broken == "transform":
        broken, nodes = 0.25, texture(st=BY_MOVED) + MOVED % "float2 inputs:scale = (1e38, 1e38)"
    text = quad([(broken, 0.25)] * 4)
    scene = read_at(tmp_path, text + material(nodes), texture=png(QUARTERS))
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], 0.6, rtol=1e-6)
    assert found(scene) == [TEXTURE_READ, ("/Floor", "texture", "repaired")]


@pytest.mark.parametrize(("reach", "actions"), [(1.0, []), (1.5, ["noted"])])
def test_faces_beyond_a_picture_that_does_not_say_how_to_wrap_are_reported(
    tmp_path, reach, actions
):
    square = [(0, 0), (reach, 0), (reach, 1), (0, 1)]
    scene = read_at(tmp_path, quad(square) + material(texture()), texture=png(QUARTERS))
    assert [action for _, kind, action in found(scene) if kind == "texture"] == actions


def test_a_large_texture_keeps_its_mean(tmp_path):
    """More texels across than are kept, and not a multiple of them."""
    texels = (np.arange(3 * 2999).reshape(3, 2999) * 37) % 251
    reflectance = reflectance_of(tmp_path, quad(), texture(), texture=png(texels))
    np.testing.assert_allclose(reflectance[0], texels.mean() / 255, rtol=1e-5)


def test_each_picture_is_read_once(tmp_path, monkeypatch):
    reads = []

    def counted(asset, space):
        reads.append(asset.path)
        return read_texture(asset, space)

    monkeypatch.setattr("isolux.texture_reader.read_texture", counted)
    surface = f"""color3f inputs:{FLAT}
        color3f inputs:emissiveColor.connect = </Paint/Texture.outputs:rgb>
        float inputs:opacity.connect = </Paint/Texture.outputs:r>"""
    text = quad() + grid(2).replace("Floor", "Wall") + material(texture(), surface)
    read_at(tmp_path, text, texture=png(GREYS))
    assert reads == ["texture.png"]
