"""Which material a mesh and its parts wear: each way of binding by a table of grey paints."""

import numpy as np
import pytest
from pxr import UsdShade

from isolux.material_binding import MaterialBinding
from usda_stage import found, open_usda, read_usda

PAINTS = "\n".join(
    f"""def Material "Grey{percent}" {{
        token outputs:surface.connect = </Grey{percent}/Surface.outputs:surface>
        def Shader "Surface" {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = ({percent / 100}, {percent / 100}, {percent / 100})
            token outputs:surface
        }}
    }}"""
    for percent in (20, 40, 60)
)
API = '( prepend apiSchemas = ["MaterialBindingAPI"] )'
STRONGER = '( bindMaterialAs = "strongerThanDescendants" )'


def room(on_room: str = "", on_wall: str = "", on_parts: str = "", api: str = API) -> str:
    """A wall of two triangles in a room, with what binds on each."""
    return f"""
def Xform "Room" {api} {{
    {on_room}
    def Mesh "Wall" {API} {{
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        uniform token subdivisionScheme = "none"
        {on_wall}
        {on_parts}
    }}
}}
{PAINTS}
"""


def part(name: str, faces: list[int], percent: int, family: str = "materialBind") -> str:
    return f"""
        def GeomSubset "{name}" {API} {{
            uniform token elementType = "face"
            uniform token familyName = "{family}"
            int[] indices = {faces}
            rel material:binding = </Grey{percent}>
        }}"""


def bind(percent: int, purpose: str = "", metadata: str = "") -> str:
    suffix = f":{purpose}" if purpose else ""
    return f"rel material:binding{suffix} = </Grey{percent}> {metadata}\n"


WALL_BY_COLLECTION = (
    '( prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:painted"] )',
    """rel collection:painted:includes = </Room/Wall>
    rel material:binding:collection:painted = [</Room.collection:painted>, </Grey60>]""",
)


@pytest.mark.parametrize(
    ("stage", "expected"),
    [
        (room(), [18]),
        (room(on_wall=bind(20)), [20]),
        (room(on_room=bind(20)), [20]),
        (room(on_room=bind(20), on_wall=bind(40)), [40]),
        (room(on_room=bind(20, metadata=STRONGER), on_wall=bind(40)), [20]),
        (room(on_wall=bind(20, "full") + bind(40)), [20]),
        (room(on_wall=bind(20, "preview") + bind(40)), [40]),
        (room(on_wall=bind(20, "preview")), [20]),
        (room(on_wall=bind(20, "preview") + bind(40, "full")), [40]),
        (room(on_room=bind(20, "full"), on_wall=bind(40)), [20]),
        (room(on_room=bind(20) + WALL_BY_COLLECTION[1], api=WALL_BY_COLLECTION[0]), [60]),
        (
            room(on_wall=bind(20), on_room=WALL_BY_COLLECTION[1], api=WALL_BY_COLLECTION[0]),
            [20],
        ),
        (
            room(
                on_wall=bind(20),
                on_room=WALL_BY_COLLECTION[1] + STRONGER,
                api=WALL_BY_COLLECTION[0],
            ),
            [60],
        ),
        (room(on_wall=bind(20), on_parts=part("A", [1], 40)), [20, 40]),
        (room(on_parts=part("A", [1], 40)), [18, 40]),
        (room(on_parts=part("A", [0], 20) + part("B", [1], 60)), [20, 60]),
        (room(on_room=bind(60, metadata=STRONGER), on_parts=part("A", [1], 40)), [60, 60]),
        (
            room(
                on_parts=part("A", [1], 40),
                on_room=WALL_BY_COLLECTION[1] + STRONGER,
                api=WALL_BY_COLLECTION[0],
            ),
            [60, 60],
        ),
    ],
)
def test_the_bound_material_paints(stage, expected):
    scene = read_usda(stage)
    reflectance = scene.meshes[0].reflectance
    np.testing.assert_allclose(reflectance[:, 0], np.array(expected) / 100, rtol=1e-6)
    assert found(scene) == []


@pytest.mark.parametrize(
    ("parts", "expected", "action"),
    [
        (part("A", [0, 1], 20) + part("B", [1], 60), [20, 60], "repaired"),  # both have face 1
        (part("A", [1, 9], 60), [18, 60], "repaired"),
        (part("A", [1], 60, family="looks"), [18], "skipped"),
    ],
)
def test_parts_that_are_wrong_are_reported(parts, expected, action):
    scene = read_usda(room(on_parts=parts))
    reflectance = scene.meshes[0].reflectance
    np.testing.assert_allclose(reflectance[:, 0], np.array(expected) / 100, rtol=1e-6)
    assert [(kind, done) for _, kind, done in found(scene)] == [("GeomSubset", action)]


def test_a_part_of_no_faces_changes_nothing():
    scene = read_usda(room(on_wall=bind(20), on_parts=part("A", [], 40)))
    np.testing.assert_allclose(scene.meshes[0].reflectance, [[0.2] * 3], rtol=1e-6)


def test_collections_of_many_prims_are_looked_up_together():
    """All meshes below the prim that binds a collection are found with the first."""
    walls = "\n".join(f'def Mesh "Wall{i}" {{}}' for i in range(20))
    includes = ", ".join(f"</Room/Wall{i}>" for i in range(0, 20, 2))
    api = WALL_BY_COLLECTION[0]
    stage = open_usda(f"""
def Xform "Room" {api} {{
    rel collection:painted:includes = [{includes}]
    rel material:binding:collection:painted = [</Room.collection:painted>, </Grey60>]
    {bind(20)}
    {walls}
}}
{PAINTS}""")
    binding = MaterialBinding()
    for i in range(20):
        prim = stage.GetPrimAtPath(f"/Room/Wall{i}")
        alone, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
        assert binding.material(prim).GetPath() == alone.GetPath()
        assert alone.GetPath() == ("/Grey20" if i % 2 else "/Grey60")


def test_a_part_of_a_mesh_shines_and_lets_light_through_by_itself():
    lamp = """def Material "Lamp" {
        token outputs:surface.connect = </Lamp/Surface.outputs:surface>
        def Shader "Surface" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:emissiveColor = (100, 200, 300)
            float inputs:opacity = 0.25
            token outputs:surface
        }
    }"""
    parts = part("Tube", [1], 20).replace("/Grey20", "/Lamp")
    mesh = read_usda(room(on_wall=bind(40), on_parts=parts) + lamp).meshes[0]
    np.testing.assert_allclose(mesh.emission, [[0, 0, 0], [100, 200, 300]])
    np.testing.assert_allclose(mesh.opacity, [1, 0.25])
