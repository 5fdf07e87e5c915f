"""Diffuse reflectance: bound materials, textures, displayColor, and values that are none."""

import numpy as np
import pytest

from isolux import SceneError
from usda_stage import found, read_usda

TWO_TRIANGLES = """
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def mesh(extra: str = "", binding: str = "") -> str:
    bound = f"rel material:binding = <{binding}>" if binding else ""
    applied = '( prepend apiSchemas = ["MaterialBindingAPI"] )' if binding else ""
    return f'def Mesh "Wall" {applied} {{ {TWO_TRIANGLES} {bound}\n{extra}\n}}\n'


def material(inputs: str, shader_id: str = "UsdPreviewSurface", name: str = "Paint") -> str:
    return f"""
def Material "{name}" {{
    token outputs:surface.connect = </{name}/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "{shader_id}"
        {inputs}
        token outputs:surface
    }}
    def Shader "Texture" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @texture.png@
        float4 inputs:fallback = (0.1, 0.2, 0.3, 1)
        float3 outputs:rgb
        float outputs:g
    }}
    def Shader "Reader" {{
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "paint"
        float3 inputs:fallback = (0.4, 0.4, 0.4)
        float3 outputs:result
    }}
}}
"""


def reflectance_of(text: str):
    return read_usda(text).meshes[0].reflectance


@pytest.mark.parametrize(
    ("inputs", "shader_id", "expected"),
    [
        ("color3f inputs:diffuseColor = (0.7, 0.5, 0.3)", "UsdPreviewSurface", (0.7, 0.5, 0.3)),
        ("", "UsdPreviewSurface", (0.18, 0.18, 0.18)),
        (
            "color3f inputs:diffuseColor = (0.8, 0.4, 0.2)\nfloat inputs:metallic = 0.75",
            "UsdPreviewSurface",
            (0.8, 0.4, 0.2),
        ),
        (
            "color3f inputs:diffuseColor = (0.8, 0.4, 0.2)\nfloat inputs:metallic = 1\n"
            "int inputs:useSpecularWorkflow = 1",
            "UsdPreviewSurface",
            (0.8, 0.4, 0.2),
        ),
        (  # a metal of the specular workflow: little diffuse colour, much specular
            "color3f inputs:diffuseColor = (0, 0, 0)\nint inputs:useSpecularWorkflow = 1\n"
            "color3f inputs:specularColor = (1, 0.52, 0.04)",
            "UsdPreviewSurface",
            (0.99, 0.5, 0.0),
        ),
        (  # a plain dielectric of either workflow is its diffuse colour
            "color3f inputs:diffuseColor = (0.5, 0.5, 0.5)\nint inputs:useSpecularWorkflow = 1\n"
            "color3f inputs:specularColor = (0.04, 0.04, 0.04)",
            "UsdPreviewSurface",
            (0.5, 0.5, 0.5),
        ),
        (  # never more than all of the light
            "color3f inputs:diffuseColor = (0.8, 0.4, 0)\nint inputs:useSpecularWorkflow = 1\n"
            "color3f inputs:specularColor = (0.52, 0.52, 0.52)",
            "UsdPreviewSurface",
            (0.99, 0.9, 0.5),
        ),
        (
            "color3f inputs:base_color = (0.5, 0.6, 0.7)\nfloat inputs:base = 0.5",
            "ND_standard_surface_surfaceshader",
            (0.25, 0.3, 0.35),
        ),
        (
            "color3f inputs:base_color = (0.5, 0.6, 0.7)\nfloat inputs:base_metalness = 0.5",
            "ND_open_pbr_surface_surfaceshader",
            (0.5, 0.6, 0.7),
        ),
        ("color3f inputs:diffuseColor.connect = </Paint.inputs:tint>", "UsdPreviewSurface", None),
    ],
)
def test_base_colour_of_the_bound_material(inputs, shader_id, expected):
    text = material(inputs, shader_id)
    if expected is None:  # through the material's own interface
        text = text.replace(
            "token outputs", "color3f inputs:tint = (0.3, 0.2, 0.1)\n token outputs", 1
        )
        expected = (0.3, 0.2, 0.1)
    np.testing.assert_allclose(reflectance_of(mesh(binding="/Paint") + text), [expected], rtol=1e-6)


@pytest.mark.parametrize(
    ("interpolation", "colours", "by_face"),
    [
        ("constant", [0.3], [0.3]),
        ("uniform", [0.2, 0.6], [0.2, 0.6]),
        ("vertex", [0.0, 0.3, 0.6, 0.9], [0.3, 0.5]),
        ("varying", [0.0, 0.3, 0.6, 0.9], [0.3, 0.5]),
        ("faceVarying", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.2, 0.5]),
    ],
)
def test_display_colour_is_averaged_over_each_face(interpolation, colours, by_face):
    values = ", ".join(f"({c}, {c}, {c})" for c in colours)
    primvar = f'primvars:displayColor = [{values}] ( interpolation = "{interpolation}" )'
    reflectance = reflectance_of(mesh(f"color3f[] {primvar}"))
    np.testing.assert_allclose(reflectance[:, 1], by_face, rtol=1e-6)


def test_display_colour_by_indices_and_inherited():
    indexed = """color3f[] primvars:displayColor = [(0.1, 0, 0), (0.9, 0, 0)] (
            interpolation = "uniform" )
        int[] primvars:displayColor:indices = [1, 0]"""
    np.testing.assert_allclose(reflectance_of(mesh(indexed))[:, 0], [0.9, 0.1], rtol=1e-6)
    inherited = """def Xform "Group" {
        color3f[] primvars:displayColor = [(0.5, 0.6, 0.7)] ( interpolation = "constant" )
        %s
    }"""
    np.testing.assert_allclose(reflectance_of(inherited % mesh()), [[0.5, 0.6, 0.7]], rtol=1e-6)


def test_nothing_authored_reflects_18_percent():
    np.testing.assert_allclose(reflectance_of(mesh()), [[0.18, 0.18, 0.18]], rtol=1e-6)


def test_material_subsets_paint_their_faces():
    subset = """
    def GeomSubset "Red" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1, 9]
        rel material:binding = </Paint>
    }"""
    text = mesh(subset) + material("color3f inputs:diffuseColor = (0.6, 0, 0)")
    scene = read_usda(text)
    np.testing.assert_allclose(scene.meshes[0].reflectance[:, 0], [0.18, 0.6], rtol=1e-6)
    assert found(scene) == [("/Wall/Red", "GeomSubset", "repaired")]


def test_a_primvar_reader_takes_each_meshs_own_primvar_or_its_fallback():
    connected = "color3f inputs:diffuseColor.connect = </Paint/Reader.outputs:result>"
    paint = 'color3f[] primvars:paint = [(0.1, 0.2, 0.3)] ( interpolation = "constant" )'
    with_primvar = reflectance_of(mesh(paint, "/Paint") + material(connected))
    without = reflectance_of(mesh("", "/Paint") + material(connected))
    np.testing.assert_allclose(with_primvar, [[0.1, 0.2, 0.3]], rtol=1e-6)
    np.testing.assert_allclose(without, [[0.4, 0.4, 0.4]], rtol=1e-6)


@pytest.mark.parametrize("bad", ["(1.2, 0, 0)", "(-0.1, 0, 0)", "(nan, 0, 0)"])
@pytest.mark.parametrize("by_material", [True, False])
def test_an_impossible_reflectance_stops_and_names_its_prim(bad, by_material):
    if by_material:
        text = mesh(binding="/Paint") + material(f"color3f inputs:diffuseColor = {bad}")
    else:
        text = mesh(f'color3f[] primvars:displayColor = [{bad}] ( interpolation = "constant" )')
    with pytest.raises(SceneError) as error:
        read_usda(text)
    assert error.value.subject == ("/Paint/Surface" if by_material else "/Wall")


def test_a_perfect_white_is_taken_down_to_99_percent_once():
    white = material("color3f inputs:diffuseColor = (1, 1, 1)")
    two = mesh(binding="/Paint") + mesh(binding="/Paint").replace("Wall", "Floor")
    scene = read_usda(two + white)
    assert scene.meshes[1].reflectance.max() == np.float32(0.99)
    assert found(scene) == [("/Paint/Surface", "reflectance", "repaired")]


@pytest.mark.parametrize(
    ("inputs", "kind", "action"),
    [
        ("float inputs:metallic = 0.5", "metallic", "approximated"),
        (
            "color3f inputs:specularColor = (0.3, 0.3, 0.3)\nint inputs:useSpecularWorkflow = 1",
            "specularColor",
            "approximated",
        ),
        ("color3f inputs:emissiveColor = (-5, 5, 5)", "emission", "repaired"),
        ("float inputs:opacity = 1.5", "opacity", "repaired"),
    ],
)
def test_what_a_material_does_besides_is_reported(inputs, kind, action):
    scene = read_usda(mesh(binding="/Paint") + material(inputs))
    assert found(scene) == [("/Paint/Surface", kind, action)]


@pytest.mark.parametrize(
    ("inputs", "shader_id"),
    [
        ("", "OtherSurface"),
        ('string inputs:diffuseColor = "red"', "UsdPreviewSurface"),
        ("color3f inputs:diffuseColor.connect = </Paint/Noise.outputs:out>", "UsdPreviewSurface"),
    ],
)
def test_a_network_that_is_not_understood_falls_back_to_display_colour(inputs, shader_id):
    noise = '\ndef Shader "Noise" { uniform token info:id = "Noise"\n color3f outputs:out\n}'
    text = material(inputs, shader_id).rstrip().removesuffix("}") + noise + "\n}\n"
    colour = 'color3f[] primvars:displayColor = [(0.5, 0, 0)] ( interpolation = "constant" )'
    scene = read_usda(mesh(colour, "/Paint") + text)
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.5, 0, 0]])
    assert [action for _, _, action in found(scene)] == ["approximated"]
