"""What is rendered: purposes, their visibility, draw modes, levels of detail, moments."""

import pytest
from pxr import Usd

from isolux import read_stage
from usda_stage import METRES, found, read_usda

SQUARE = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def mesh(name, extra="", applied=""):
    return f'def Mesh "{name}" {applied} {{ {SQUARE} {extra}\n}}\n'


ALL_PURPOSES = "".join(
    mesh(purpose.capitalize(), f'uniform token purpose = "{purpose}"')
    for purpose in ("default", "render", "proxy", "guide")
)
SETTINGS = '(\n metersPerUnit = 1\n upAxis = "Z"\n renderSettingsPrimPath = "/Settings"\n)\n'


@pytest.mark.parametrize(
    ("included", "read"),
    [
        (None, ["/Default", "/Render"]),
        ("", ["/Default", "/Render"]),
        ('["default", "proxy"]', ["/Default", "/Proxy"]),
        # Guides stay invisible unless VisibilityAPI shows them.
        ('["default", "render", "guide"]', ["/Default", "/Render"]),
        ('["render"]', ["/Render"]),
    ],
)
def test_purposes_are_those_of_the_render_settings(included, read):
    """Default and render without RenderSettings, and by the schema's fallback."""
    settings = f"uniform token[] includedPurposes = {included}" if included else ""
    prims = ALL_PURPOSES + f'def RenderSettings "Settings" {{\n{settings}\n}}\n'
    scene = read_usda(prims, METRES if included is None else SETTINGS)
    assert [mesh.path for mesh in scene.meshes] == read
    others = {"/Default", "/Render", "/Proxy", "/Guide"} - set(read)
    assert {path for path, _, action in found(scene) if action == "skipped"} == others


def test_a_purpose_holds_for_all_that_is_below_it():
    body = f'def Xform "P" {{\n uniform token purpose = "proxy"\n {mesh("A")} \n}}\n'
    assert found(read_usda(body)) == [("/P/A", "purpose proxy", "skipped")]


def test_a_stand_in_is_named_once_by_the_prim_it_stands_for():
    scene = read_usda(f"""def Xform "Chair" {{
        def Xform "Full" {{
            uniform token purpose = "render"
            rel proxyPrim = </Chair/Box>
            {mesh("A")} {mesh("B")}
        }}
        {mesh("Box", 'uniform token purpose = "proxy"')}
    }}""")
    assert found(scene) == [
        ("/Chair/Full", "proxyPrim", "noted"),
        ("/Chair/Box", "purpose proxy", "skipped"),
    ]


def test_geometry_for_rendering_can_be_invisible_to_renders():
    """By VisibilityAPI, whatever the visibility of the rest."""
    applied = '( prepend apiSchemas = ["VisibilityAPI"] )'
    hidden = 'uniform token renderVisibility = "invisible"\n'
    scene = read_usda(
        f'def Xform "G" {applied} {{\n{hidden}'
        + mesh("A", 'uniform token purpose = "render"')
        + mesh("B")
        + "}\n"
    )
    assert [mesh.path for mesh in scene.meshes] == ["/G/B"]
    assert found(scene) == [("/G/A", "renderVisibility", "skipped")]


@pytest.mark.parametrize(("time", "read"), [(1, []), (4.9, []), (5, ["/G/A"]), (9, ["/G/A"])])
def test_visibility_is_that_of_the_time(time, read):
    blinking = 'token visibility.timeSamples = { 1: "invisible", 5: "inherited" }'
    scene = read_usda(f'def Xform "G" {{\n{blinking}\n{mesh("A")}\n}}\n', time_code=time)
    assert [mesh.path for mesh in scene.meshes] == read
    assert ("/G", "animation", "noted") in found(scene)
    assert (("/G", "visibility", "skipped") in found(scene)) == (not read)


@pytest.mark.parametrize("mode", ["cards", "bounds", "origin"])
def test_geometry_behind_a_draw_mode_is_read_in_full(mode):
    applied = '( prepend apiSchemas = ["GeomModelAPI"]\n kind = "component" )'
    drawn = f'uniform token model:drawMode = "{mode}"\n uniform bool model:applyDrawMode = true\n'
    scene = read_usda(f'def Xform "Tree" {applied} {{\n{drawn}{mesh("A")}\n}}\n')
    assert [mesh.path for mesh in scene.meshes] == ["/Tree/A"]
    assert found(scene) == [("/Tree", "model:drawMode", "noted")]


def test_a_mesh_without_extent_and_of_any_kind_is_read():
    scene = read_usda(mesh("A", applied='( kind = "made up" )'))
    assert [mesh.path for mesh in scene.meshes] == ["/A"]
    assert found(scene) == []


@pytest.mark.parametrize(
    ("index", "read", "skipped"),
    [
        ("", "/Tree/Near/A", "/Tree/Far"),
        ("int lod:default:index = 1", "/Tree/Far/B", "/Tree/Near"),
    ],
)
def test_one_level_of_detail_is_read(index, read, skipped):
    pytest.importorskip("pxr.UsdLod")
    scene = read_usda(f"""def Xform "Tree" ( prepend apiSchemas = ["LODRootAPI"] ) {{
        {index}
        def Xform "Near" {{ {mesh("A")} }}
        def Xform "Far" {{ {mesh("B")} }}
    }}""")
    assert [mesh.path for mesh in scene.meshes] == [read]
    assert found(scene) == [(skipped, "LOD", "skipped")]


def test_the_stage_of_others_reads_as_its_purposes_say(inputs):
    """Ten squares, of which two are proxies and two guides."""
    path = inputs / "usd/NVIDIA-Omniverse+usd-optimize/source/tests/data/purpose.usda"
    stage = Usd.Stage.Open(str(path))
    assert len(read_stage(stage).meshes) == 6
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        settings = stage.DefinePrim("/Settings", "RenderSettings")
        settings.GetAttribute("includedPurposes").Set(["default", "proxy"])
        stage.SetMetadata("renderSettingsPrimPath", "/Settings")
    assert len(read_stage(stage).meshes) == 6
