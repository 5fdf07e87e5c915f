"""Meshes as lights: by MeshLightAPI and by what their materials emit."""

from dataclasses import replace

import numpy as np
import pytest

from hand_built import grid
from isolux.mesh_lights import mesh_luminaires
from isolux.stage_reader import read_stage
from usda_stage import found, open_usda, read_usda


def lamp(inputs: str = "", apis: str = '"MeshLightAPI"', points: str = "2, 3") -> str:
    """A rectangle of 2 by 3 units that is a light."""
    x, y = points.split(",")
    return f"""def Mesh "Lamp" ( prepend apiSchemas = [{apis}] ) {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), ({x}, 0, 0), ({x}, {y}, 0), (0, {y}, 0)]
        uniform token subdivisionScheme = "none"
        {inputs}
    }}
    """


GREY = """def Material "Grey" {
    token outputs:surface.connect = </Grey/Shader.outputs:surface>
    def Shader "Shader" {
        uniform token info:id = "UsdPreviewSurface"
        token outputs:surface
    }
}
"""
BOUND = "rel material:binding = </Grey>"


@pytest.mark.parametrize(
    ("inputs", "flux"),
    [
        ("", np.pi * 6),
        ("float inputs:intensity = 10\nfloat inputs:exposure = 2", 40 * np.pi * 6),
        ("bool inputs:normalize = 1", np.pi),
        ("uniform bool doubleSided = 1", 2 * np.pi * 6),
        ("color3f inputs:color = (0, 1, 0)", 0.7152 * np.pi * 6),
    ],
)
def test_a_mesh_light_has_the_flux_of_its_area(inputs, flux):
    scene = read_usda(lamp(inputs))
    (light,) = scene.luminaires
    assert (light.path, light.shape) == ("/Lamp", "mesh")
    assert light.luminous_flux == pytest.approx(flux)
    assert scene.luminous_flux == pytest.approx(flux)
    assert [m.path for m in scene.meshes] == ["/Lamp"]  # it receives light, too


def test_in_centimetres():
    centimetres = '(\n    metersPerUnit = 0.01\n    upAxis = "Z"\n)\n'
    one, normalised = (
        read_usda(lamp(inputs), centimetres).luminous_flux
        for inputs in ("", "bool inputs:normalize = 1")
    )
    assert one == pytest.approx(np.pi * 6e-4)
    assert normalised == pytest.approx(np.pi * 1e-4)


@pytest.mark.parametrize(
    ("mode", "flux", "reflects"),
    [
        ("materialGlowTintsLight", 0.0, True),  # the material does not glow
        ("independent", np.pi * 6, True),
        ("noMaterialResponse", np.pi * 6, False),
    ],
)
def test_a_light_with_a_material_that_does_not_glow(mode, flux, reflects):
    scene = read_usda(
        GREY
        + lamp(
            f'{BOUND}\nuniform token light:materialSyncMode = "{mode}"',
            '"MeshLightAPI", "MaterialBindingAPI"',
        )
    )
    assert scene.luminous_flux == pytest.approx(flux)
    assert scene.meshes[0].reflectance.any() == reflects
    skipped = [("/Lamp", "MeshLightAPI", "skipped")]
    assert [row for row in found(scene) if row[2] == "skipped"] == ([] if flux else skipped)


def test_a_plain_light_api_has_no_material_response():
    scene = read_usda(lamp(apis='"LightAPI"'))
    assert scene.luminous_flux == pytest.approx(np.pi * 6)
    assert not scene.meshes[0].reflectance.any()


def test_faces_shine_by_their_own_luminance():
    """Emission a face: black faces are no light, holes neither."""
    emission = np.array([[0, 0, 0], [10, 10, 10], [20, 0, 0], [99, 99, 99]], np.float32)
    description, _ = grid("/Floor", holes=(3,))
    shining = replace(description, emission=emission)
    (light,) = mesh_luminaires([shining, description])
    assert light.luminous_flux == pytest.approx(np.pi * (10 + 20 * 0.2126))
    assert light.colour @ [0.2126, 0.7152, 0.0722] == pytest.approx(1)


def test_a_mesh_light_is_linked_like_any_other():
    scene = read_usda(lamp("rel collection:lightLink:excludes = </Lamp>"))
    assert scene.luminaires[0].lit_meshes == frozenset()


def test_a_mesh_light_over_time():
    stage = open_usda(lamp("float inputs:intensity.timeSamples = { 1: 10, 2: 30 }"))
    fluxes = [read_stage(stage, time).luminous_flux for time in (1.0, 2.0)]
    assert fluxes == pytest.approx([60 * np.pi, 180 * np.pi])
