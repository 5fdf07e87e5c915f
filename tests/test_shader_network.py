"""Networks of nodes: MaterialX arithmetic and images, and networks that lead nowhere."""

import numpy as np
import pytest

from textured_stage import BY_READER, grid, material, png, quad, read_at, texture
from usda_stage import found

STANDARD = "ND_standard_surface_surfaceshader"
OPEN_PBR = "ND_open_pbr_surface_surfaceshader"
BY_NODE = "color3f inputs:base_color.connect = </Paint/Out.outputs:out>\nfloat inputs:base = 1"


def node(kind: str, inputs: str, name: str = "Out", output: str = "color3f outputs:out") -> str:
    return f"""
    def Shader "{name}" {{
        uniform token info:id = "{kind}"
        {inputs}
        {output}
    }}"""


def colour(name: str, value: str, kind: str = "color3f") -> str:
    return f"{kind} inputs:{name} = {value}\n"


def reflectance_of(folder, nodes, surface=BY_NODE, kind=STANDARD, **files):
    scene = read_at(folder, quad() + material(nodes, surface, kind), **files)
    return scene.meshes[0].reflectance[0]


A, B = "(0.8, 0.4, 0.2)", "(0.5, 0.25, 1)"
LUMA = 0.2722287 * 0.8 + 0.6740818 * 0.4 + 0.0536895 * 0.2  # MaterialX's own weights (ACEScg)


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        ("constant_color3", colour("value", A), (0.8, 0.4, 0.2)),
        ("multiply_color3", colour("in1", A) + colour("in2", B), (0.4, 0.1, 0.2)),
        ("multiply_color3FA", colour("in1", A) + "float inputs:in2 = 0.5", (0.4, 0.2, 0.1)),
        ("multiply_color3", colour("in1", A), (0.8, 0.4, 0.2)),
        ("add_color3", colour("in1", "(0.1, 0.2, 0.3)") + colour("in2", B), (0.6, 0.45, 1.3)),
        ("subtract_color3", colour("in1", A) + colour("in2", "(0.1, 0.1, 0.1)"), (0.7, 0.3, 0.1)),
        ("divide_color3FA", colour("in1", A) + "float inputs:in2 = 2", (0.4, 0.2, 0.1)),
        ("power_color3FA", colour("in1", A) + "float inputs:in2 = 2", (0.64, 0.16, 0.04)),
        ("min_color3", colour("in1", A) + colour("in2", B), (0.5, 0.25, 0.2)),
        ("max_color3", colour("in1", A) + colour("in2", "(0.3, 0.3, 0.3)"), (0.8, 0.4, 0.3)),
        ("invert_color3", colour("in", A), (0.2, 0.6, 0.8)),
        ("absval_color3", colour("in", "(-0.1, 0.2, 0)"), (0.1, 0.2, 0)),
        ("clamp_color3FA", colour("in", A) + "float inputs:high = 0.5", (0.5, 0.4, 0.2)),
        (
            "mix_color3",
            colour("fg", A) + colour("bg", "(0, 0, 1)") + "float inputs:mix = 0.25",
            (0.2, 0.1, 0.8),
        ),
        (
            "remap_color3FA",
            colour("in", A) + "float inputs:outlow = 0.5\nfloat inputs:outhigh = 0.6",
            (0.58, 0.54, 0.52),
        ),
        ("luminance_color3", colour("in", A), (LUMA,) * 3),
        ("saturate_color3", colour("in", A) + "float inputs:amount = 0", (LUMA,) * 3),
        ("dot_color3", colour("in", A), (0.8, 0.4, 0.2)),
        ("convert_float_color3", "float inputs:in = 0.3", (0.3,) * 3),
        (
            "combine3_color3",
            "float inputs:in1 = 0.1\nfloat inputs:in2 = 0.2\nfloat inputs:in3 = 0.3",
            (0.1, 0.2, 0.3),
        ),
        ("extract_color3", colour("in", A) + "int inputs:index = 1", (0.4,) * 3),
    ],
)
def test_arithmetic_as_the_materialx_standard_library_has_it(tmp_path, kind, inputs, expected):
    # through a scale of 0.5, so that sums above 1 are reflectances too
    half = node(
        "ND_multiply_color3FA",
        "color3f inputs:in1.connect = </Paint/In.outputs:out>\nfloat inputs:in2 = 0.5",
    )
    nodes = node(f"ND_{kind}", inputs, "In") + half
    np.testing.assert_allclose(
        reflectance_of(tmp_path, nodes), np.array(expected) / 2, rtol=1e-5, atol=1e-7
    )


@pytest.mark.parametrize(
    ("kind", "surface", "expected"),
    [
        (STANDARD, "", 0.8),
        (STANDARD, "float inputs:base = 0.5\n" + colour("base_color", "(0.6, 0.6, 0.6)"), 0.3),
        (
            STANDARD,
            colour("base_color", "(0.6, 0.6, 0.6)")
            + "float inputs:subsurface = 0.5\n"
            + colour("subsurface_color", "(0.2, 0.2, 0.2)"),
            0.4,
        ),
        (OPEN_PBR, "", 0.8),
        (OPEN_PBR, "float inputs:base_weight = 0.5", 0.4),
        ("ND_UsdPreviewSurface_surfaceshader", colour("diffuseColor", "(0.3, 0.3, 0.3)"), 0.3),
    ],
)
def test_base_colour_of_materialx_surfaces(tmp_path, kind, surface, expected):
    np.testing.assert_allclose(reflectance_of(tmp_path, "", surface, kind), expected, rtol=1e-6)


QUARTERS = png(np.array([[51, 102], [153, 204]]))  # 0.2 0.4 on top, 0.6 0.8 below
LEVELS = np.array([0.2, 0.4, 0.6, 0.8])
SRGB_MEAN = (((LEVELS + 0.055) / 1.055) ** 2.4).mean()
FILE = 'asset inputs:file = @texture.png@ ( colorSpace = "raw" )\n'


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        ("image_color3", FILE, 0.5),
        ("image_float", FILE, 0.5),
        ("image_color4", FILE, 0.5),
        ("tiledimage_color3", FILE + "float2 inputs:uvtiling = (2, 2)", 0.5),
        ("tiledimage_color3", FILE + "float2 inputs:uvtiling = (0.5, 0.5)", 0.6),
        (
            "tiledimage_color3",
            FILE + "float2 inputs:uvtiling = (0.5, 0.5)\nfloat2 inputs:uvoffset = (-0.5, -0.5)",
            0.4,
        ),
        ("image_color3", FILE + "float2 inputs:texcoord = (0.75, 0.25)", 0.8),
        ("image_color3", "asset inputs:file = @no.png@\n" + colour("default", A), (0.8, 0.4, 0.2)),
        ("image_color3", FILE.replace("raw", "srgb_texture"), SRGB_MEAN),
        ("image_color3", "asset inputs:file = @colour.png@", SRGB_MEAN),  # 8 bits, 3 channels
        ("image_float", "asset inputs:file = @colour.png@", 0.5),
    ],
)
def test_images_of_materialx(tmp_path, kind, inputs, expected):
    out = "float outputs:out" if kind.endswith("float") else "color3f outputs:out"
    nodes = node(f"ND_{kind}", inputs, output=out)
    coloured = png(np.array([[51, 102], [153, 204]])[..., None].repeat(3, axis=2))
    reflectance = reflectance_of(tmp_path, nodes, texture=QUARTERS, colour=coloured)
    np.testing.assert_allclose(reflectance, np.broadcast_to(expected, 3), rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        ("texcoord_vector2", "", 0.5),
        ("geompropvalue_vector2", 'string inputs:geomprop = "st"', 0.5),
        ("geompropvalue_vector2", 'string inputs:geomprop = "UV0"', 0.5),
        ("UsdPrimvarReader_vector2", 'string inputs:varname = "st"', 0.5),
        ("multiply_vector2FA", "float inputs:in2 = 0.5", 0.6),
        ("place2d_vector2", "float2 inputs:scale = (2, 2)", 0.6),
        ("place2d_vector2", "float2 inputs:scale = (2, 2)\nfloat2 inputs:offset = (-0.5, 0)", 0.8),
        # Halved about the upper right corner.
        ("place2d_vector2", "float2 inputs:scale = (2, 2)\nfloat2 inputs:pivot = (1, 1)", 0.4),
    ],
)
def test_coordinates_of_materialx(tmp_path, kind, inputs, expected):
    if kind.startswith("multiply"):
        inputs += "\nfloat2 inputs:in1.connect = </Paint/St.outputs:out>"
    nodes = (
        node("ND_image_color3", FILE + "float2 inputs:texcoord.connect = </Paint/At.outputs:out>")
        + node(f"ND_{kind}", inputs, "At", "float2 outputs:out")
        + node("ND_texcoord_vector2", "", "St", "float2 outputs:out")
    )
    reflectance = reflectance_of(tmp_path, nodes, texture=QUARTERS)
    np.testing.assert_allclose(reflectance, expected, rtol=1e-6)


def test_textures_are_multiplied_texel_by_texel(tmp_path):
    """A mask over a picture: the mean of products, not the product of means."""
    nodes = (
        node(
            "ND_multiply_color3",
            "color3f inputs:in1.connect = </Paint/Picture.outputs:out>\n"
            "color3f inputs:in2.connect = </Paint/Mask.outputs:out>",
        )
        + node("ND_image_color3", FILE, "Picture")
        + node("ND_image_color3", 'asset inputs:file = @mask.png@ ( colorSpace = "raw" )', "Mask")
    )
    mask = np.zeros((4, 4))  # finer than the picture
    mask[:2, :2] = 255
    reflectance = reflectance_of(tmp_path, nodes, texture=QUARTERS, mask=png(mask))
    np.testing.assert_allclose(reflectance, 0.2 / 4, rtol=1e-6)


def test_a_network_behind_node_graphs(tmp_path):
    graph = """
    def NodeGraph "Graph" {
        color3f inputs:tint = (0.5, 1, 1)
        color3f outputs:out.connect = </Paint/Graph/Tinted.outputs:out>
        def Shader "Tinted" {
            uniform token info:id = "ND_multiply_color3"
            color3f inputs:in1 = (0.8, 0.4, 0.2)
            color3f inputs:in2.connect = </Paint/Graph.inputs:tint>
            color3f outputs:out
        }
    }"""
    surface = (
        "color3f inputs:base_color.connect = </Paint/Graph.outputs:out>\nfloat inputs:base = 1"
    )
    np.testing.assert_allclose(reflectance_of(tmp_path, graph, surface), (0.4, 0.4, 0.2), rtol=1e-6)


def test_a_primvar_tints_a_texture_by_face(tmp_path):
    primvar = """color3f[] primvars:tint = [(1, 1, 1), (0.5, 0.5, 0.5), (1, 1, 1), (0, 0, 0)] (
        interpolation = "uniform" )"""
    nodes = (
        node(
            "ND_multiply_color3",
            "color3f inputs:in1.connect = </Paint/Picture.outputs:out>\n"
            "color3f inputs:in2.connect = </Paint/Tint.outputs:out>",
        )
        + node("ND_image_color3", FILE, "Picture")
        + node("ND_geompropvalue_color3", 'string inputs:geomprop = "tint"', "Tint")
    )
    text = grid(2, primvar) + material(nodes, BY_NODE, STANDARD)
    scene = read_at(tmp_path, text, texture=QUARTERS)
    np.testing.assert_allclose(scene.meshes[0].reflectance[:, 0], [0.6, 0.4, 0.2, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "surface", "expected"),
    [
        ("UsdPreviewSurface", colour("emissiveColor", "(5, 6, 7)"), (5, 6, 7)),
        (
            STANDARD,
            "float inputs:emission = 2\n" + colour("emission_color", "(1, 2, 3)"),
            (2, 4, 6),
        ),
        (STANDARD, colour("emission_color", "(1, 2, 3)"), None),
        (OPEN_PBR, "float inputs:emission_luminance = 1000", (1000, 1000, 1000)),
        (
            OPEN_PBR,
            "float inputs:emission_luminance = 10\n" + colour("emission_color", "(1, 0.5, 0)"),
            (10, 5, 0),
        ),
        ("UsdPreviewSurface", "", None),
        (
            "UsdPreviewSurface",
            colour("emissiveColor", "(5, 6, 7)") + "float inputs:opacity = 0.5",
            (5, 6, 7),
        ),
        (
            "UsdPreviewSurface",
            colour("emissiveColor", "(5, 6, 7)") + "float inputs:opacity = 0.5\n"
            'token inputs:opacityMode = "presence"',
            (2.5, 3, 3.5),
        ),
    ],
)
def test_surfaces_that_shine(tmp_path, kind, surface, expected):
    scene = read_at(tmp_path, quad() + material("", surface, kind))
    if expected is None:
        assert scene.meshes[0].emission is None
    else:
        np.testing.assert_allclose(scene.meshes[0].emission, [expected], rtol=1e-6)
    assert found(scene) == []


@pytest.mark.parametrize(
    ("kind", "surface", "expected"),
    [
        ("UsdPreviewSurface", "float inputs:opacity = 0.25", 0.25),
        ("UsdPreviewSurface", "float inputs:opacity = 0", 0),
        ("UsdPreviewSurface", "float inputs:opacity = 1", None),
        (
            "UsdPreviewSurface",
            "float inputs:opacity = 0.25\nfloat inputs:opacityThreshold = 0.2",
            None,
        ),
        (
            "UsdPreviewSurface",
            "float inputs:opacity = 0.25\nfloat inputs:opacityThreshold = 0.3",
            0,
        ),
        (STANDARD, colour("opacity", "(0.5, 0.5, 0.5)"), 0.5),
        (STANDARD, colour("opacity", "(1, 0, 0)"), 0.2126),
        (OPEN_PBR, "float inputs:geometry_opacity = 0.3", 0.3),
    ],
)
def test_surfaces_that_let_light_through(tmp_path, kind, surface, expected):
    scene = read_at(tmp_path, quad() + material("", surface, kind))
    if expected is None:
        assert scene.meshes[0].opacity is None
    else:
        np.testing.assert_allclose(scene.meshes[0].opacity, [expected], atol=1e-4)
    assert found(scene) == []


@pytest.mark.parametrize(
    ("kind", "surface", "opacity", "reflectance"),
    [
        # All passes, whatever the base colour is.
        (STANDARD, "float inputs:transmission = 1", 0, 0),
        (OPEN_PBR, "float inputs:transmission_weight = 1", 0, 0),
        # Half passes; of the half that is stopped all meets the base colour.
        (STANDARD, "float inputs:transmission = 0.5", 0.5, 0.8),
        # Half of what enters is absorbed on its way.
        (
            STANDARD,
            "float inputs:transmission = 0.5\n" + colour("transmission_color", "(0.5, 0.5, 0.5)"),
            0.75,
            0.8 * 0.5 / 0.75,
        ),
    ],
)
def test_light_passes_straight_through_panes(tmp_path, kind, surface, opacity, reflectance):
    scene = read_at(tmp_path, quad() + material("", surface, kind))
    np.testing.assert_allclose(scene.meshes[0].opacity, [opacity], atol=1e-6)
    np.testing.assert_allclose(scene.meshes[0].reflectance[0], reflectance, rtol=1e-5)
    assert [action for *_, action in found(scene)] == ["approximated"]


@pytest.mark.parametrize(("authored", "expected"), [(0.4, 0.4), (1, None)])
def test_display_opacity_counts_where_no_material_does(tmp_path, authored, expected):
    primvar = f'float[] primvars:displayOpacity = [{authored}] ( interpolation = "constant" )'
    mesh = read_at(tmp_path, quad(extra=primvar)).meshes[0]
    assert mesh.opacity is None if expected is None else mesh.opacity == [np.float32(expected)]


def chain(length: int, twice: bool = False) -> str:
    """Nodes one behind the other; `twice`: each takes the last one for both of its inputs."""
    nodes = node("ND_image_color3", FILE, "N0")
    for i in range(1, length):
        last = f"connect = </Paint/N{i - 1}.outputs:out>\n"
        inputs = f"color3f inputs:in1.{last}" + (f"color3f inputs:in2.{last}" if twice else "")
        nodes += node("ND_multiply_color3", inputs, "Out" if i == length - 1 else f"N{i}")
    return nodes


@pytest.mark.parametrize(
    "nodes",
    [
        node("ND_multiply_color3", "color3f inputs:in1.connect = </Paint/Out.outputs:out>"),
        node("ND_add_color3", "color3f inputs:in1.connect = </Paint/B.outputs:out>")
        + node("ND_add_color3", "color3f inputs:in1.connect = </Paint/Out.outputs:out>", "B"),
        node("ND_noise2d_color3", ""),
        node("", ""),
        'def Scope "Out" {\n color3f outputs:out\n}',
        node("ND_constant_color3", 'string inputs:value = "red"'),
        node("ND_constant_color3", "float3[] inputs:value = [(1, 1, 1)]"),
        chain(150),
        chain(40, twice=True),
        node("ND_image_color3", FILE + "float2 inputs:texcoord.connect = </Paint/Out.outputs:out>"),
        node("ND_image_color3", FILE + "float2 inputs:texcoord.connect = </Paint/W.outputs:out>")
        + node("ND_worley2d_vector2", "", "W", "float2 outputs:out"),
    ],
)
def test_networks_that_lead_nowhere_fall_back_and_say_so(tmp_path, nodes):
    display = 'color3f[] primvars:displayColor = [(0.3, 0.3, 0.3)] ( interpolation = "constant" )'
    text = quad(extra=display) + material(nodes, BY_NODE, STANDARD)
    scene = read_at(tmp_path, text, texture=QUARTERS)
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.3] * 3], rtol=1e-6)
    fallen = [f for f in scene.findings if f.kind == "base_color"]
    assert [(f.path, f.action) for f in fallen] == [("/Paint/Surface", "approximated")]


@pytest.mark.parametrize(
    "inputs",
    [
        'string inputs:scale = "much"',
        "float4 inputs:scale = (nan, 1, 1, 1)",
        "float[] inputs:bias = [1, 2]",
        "asset[] inputs:sourceColorSpace = [@a@]",
        'string inputs:wrapS = "around"',
        "int inputs:st = 3",
    ],
)
def test_inputs_of_the_wrong_type_count_as_not_authored(tmp_path, inputs):
    text = quad() + material(texture(inputs))
    if "inputs:st" in inputs:
        text = text.replace(BY_READER, "")
    scene = read_at(tmp_path, text, texture=QUARTERS)
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.5] * 3], rtol=1e-6)


def test_interfaces_connected_in_a_circle_are_as_good_as_none(tmp_path):
    surface = "color3f inputs:base_color.connect = </Paint.inputs:a>\nfloat inputs:base = 1"
    text = quad() + material("", surface, STANDARD)
    circle = """color3f inputs:a.connect = </Paint.inputs:b>
        color3f inputs:b.connect = </Paint.inputs:a>"""
    text = text.replace('def Material "Paint" {', 'def Material "Paint" {\n' + circle)
    np.testing.assert_allclose(
        read_at(tmp_path, text).meshes[0].reflectance, [[0.8] * 3], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("surface", "kind", "action"),
    [
        ("float inputs:coat = 0.5", "coat", "approximated"),
        ("float inputs:base.timeSamples = { 1: 0.5, 2: 1 }", "animation", "noted"),
        ("float inputs:opacity.connect = </Paint/Noise.outputs:out>", "opacity", "approximated"),
    ],
)
def test_what_is_not_read_of_a_surface_is_reported(tmp_path, surface, kind, action):
    noise = node("ND_noise2d_float", "", "Noise", "float outputs:out")
    scene = read_at(tmp_path, quad() + material(noise, surface, STANDARD))
    assert found(scene) == [("/Paint/Surface", kind, action)]
