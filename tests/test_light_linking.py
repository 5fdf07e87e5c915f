"""Which meshes a light lights, and which of them stand in its light."""

import pytest

from usda_stage import found, read_usda

SQUARE = """{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
}"""
MESHES = f"""def Xform "Room" {{
    def Mesh "Wall" {SQUARE}
    def Mesh "Floor" {SQUARE}
}}
def Mesh "Car" {SQUARE}
"""


def linked(inputs: str):
    scene = read_usda(MESHES + f'def SphereLight "Lamp" {{\n{inputs}\n}}')
    return scene.luminaires[0], scene


@pytest.mark.parametrize(
    ("inputs", "lit"),
    [
        ("", None),
        ("uniform bool collection:lightLink:includeRoot = 1", None),
        ("rel collection:lightLink:excludes = </Car>", {"/Room/Wall", "/Room/Floor"}),
        ("rel collection:lightLink:excludes = </Room>", {"/Car"}),
        (
            """uniform bool collection:lightLink:includeRoot = 0
            rel collection:lightLink:includes = [</Room>]
            rel collection:lightLink:excludes = </Room/Wall>""",
            {"/Room/Floor"},
        ),
        (
            """uniform bool collection:lightLink:includeRoot = 0
            rel collection:lightLink:includes = </Room>
            uniform token collection:lightLink:expansionRule = "explicitOnly\"""",
            set(),
        ),
        ("rel collection:lightLink:excludes = </Elsewhere>", None),
    ],
)
def test_the_meshes_that_a_light_lights(inputs, lit):
    lamp, _ = linked(inputs)
    assert lamp.lit_meshes == lit
    assert lamp.shadow_meshes is None


@pytest.mark.parametrize("name", ["lightLink", "shadowLink"])
def test_a_collection_that_usd_cannot_read_is_found_and_holds_all(name):
    attribute = f"""uniform bool collection:{name}:includeRoot = 0
        float collection:{name}:includes = 1"""
    lamp, scene = linked(attribute)
    assert lamp.lit_meshes is lamp.shadow_meshes is None
    assert found(scene) == [("/Lamp", name, "skipped")]
    assert "not a relationship" in scene.findings[0].reason


def test_the_meshes_that_cast_shadows():
    lamp, scene = linked("rel collection:shadowLink:excludes = </Car>")
    assert lamp.shadow_meshes == {"/Room/Wall", "/Room/Floor"}
    assert lamp.lit_meshes is None
    assert found(scene) == []


def test_a_light_without_shadows():
    lamp, scene = linked("bool inputs:shadow:enable = 0")
    assert lamp.shadow_meshes == frozenset()
    assert found(scene) == []


def test_a_light_that_lights_nothing_says_so():
    lamp, scene = linked("uniform bool collection:lightLink:includeRoot = 0")
    assert lamp.lit_meshes == frozenset()
    assert found(scene) == [("/Lamp", "lightLink", "noted")]


@pytest.mark.parametrize("kind", ["DistantLight", "DomeLight"])
def test_light_from_afar_is_linked_too(kind):
    text = MESHES + f'def {kind} "Lamp" {{\nrel collection:lightLink:excludes = </Car>\n}}'
    assert read_usda(text).luminaires[0].lit_meshes == {"/Room/Wall", "/Room/Floor"}
