"""The preview layer: every baked mesh shines with its displayColor, whatever binds it elsewhere."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdShade, UsdValidation

from hand_built import cube, grid, scene_of, solution_of, source_stage
from isolux.errors import SceneError
from isolux.preview_layer import preview_path, write_preview
from isolux.results import ResultsWriter

PURPOSES = ("", "preview", "full")

# What a source may bind, as opinions over /World/A (a cube), /World/Set/B (a grid).
BINDINGS = {
    "nothing": "",
    "the mesh": """over "A" {
        rel material:binding = </Looks/Red>
    }""",
    "subsets": """over "A" {
        def GeomSubset "Lid" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            int[] indices = [0]
            uniform token familyName = "materialBind"
            rel material:binding = </Looks/Red>
        }
        def GeomSubset "Rest" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            int[] indices = [1, 2, 3, 4, 5]
            uniform token familyName = "materialBind"
            rel material:binding:full = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
        }
    }""",
    "a group, stronger than what is in it": """over "Set" {
        rel material:binding = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
    }""",
    "groups within groups, all stronger": """
    rel material:binding = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
    over "Set" {
        rel material:binding = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
        over "B" {
            rel material:binding = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
        }
    }""",
    "one purpose": """over "Set" {
        rel material:binding:full = </Looks/Red>
    }
    over "A" {
        rel material:binding:preview = </Looks/Red>
    }""",
    "one purpose of a group, stronger": """
    rel material:binding:full = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )
    rel material:binding:preview = </Looks/Red> ( bindMaterialAs = "strongerThanDescendants" )""",
    "a collection of a group": """
    rel collection:all:includes = </World>
    rel material:binding:collection:all = [</World.collection:all>, </Looks/Red>] (
        bindMaterialAs = "strongerThanDescendants" )""",
    "a collection of the mesh itself": """over "A" (prepend apiSchemas = ["CollectionAPI:all"]) {
        rel collection:all:includes = </World/A>
        rel material:binding:collection:all = [</World/A.collection:all>, </Looks/Red>]
    }""",
    "a collection with a purpose": """
    rel collection:all:includes = </World>
    rel material:binding:collection:full:all = [</World.collection:all>, </Looks/Red>] (
        bindMaterialAs = "strongerThanDescendants" )""",
}
# Materials and schemas, over the meshes.
LOOKS = """#usda 1.0
def Scope "Looks" {
    def Material "Red" {
    }
}
over "World" (prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:all"]) {
    over "A" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    }
    over "Set" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        over "B" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        }
        def BasisCurves "Curtain" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            rel material:binding = </Looks/Red>
        }
    }
}
"""
SHOT = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Z"
    subLayers = [@./looks.usda@, @./meshes.usda@]
)
over "World" {
    BINDING
}
"""
PARTS = [cube("/World/A"), grid("/World/Set/B")]


def bake(folder, binding=""):
    """Results over a source with these bindings."""
    stage = source_stage(folder / "meshes.usda", PARTS)
    stage.GetPrimAtPath("/World/Set").SetSpecifier(Sdf.SpecifierDef)
    stage.Save()
    (folder / "looks.usda").write_text(LOOKS)
    (folder / "shot.usda").write_text(SHOT.replace("BINDING", binding))
    output = folder / "shot.isolux.usda"
    scene = scene_of(description for description, _ in PARTS)
    writer = ResultsWriter(folder / "shot.usda", output, scene, {})
    writer.write(solution_of(PARTS))
    return output


def bound(stage, path, purpose):
    api = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path))
    material, _ = api.ComputeBoundMaterial(purpose)
    return str(material.GetPath())


def surfaces(stage):
    """Paths of what Hydra asks for a material: meshes and their subsets."""
    return [
        str(prim.GetPath())
        for prim in stage.Traverse()
        if prim.GetTypeName() in ("Mesh", "GeomSubset")
    ]


@pytest.mark.parametrize("binding", BINDINGS.values(), ids=BINDINGS.keys())
def test_every_baked_mesh_and_subset_takes_the_emissive_material(tmp_path, binding):
    output = bake(tmp_path, binding)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    plain = Usd.Stage.Open(str(output))
    red = [
        (path, purpose)
        for path in surfaces(plain)
        for purpose in PURPOSES
        if bound(plain, path, purpose) == "/Looks/Red"
    ]
    assert bool(red) == bool(binding)  # the source does bind what is overruled here

    assert write_preview(output) == []
    stage = Usd.Stage.Open(str(preview_path(output)))
    for path in surfaces(stage):
        for purpose in PURPOSES:
            assert bound(stage, path, purpose) == "/IsoluxPreview/Bake", (path, purpose)
    # What has no bake keeps its look; no other file is touched.
    assert bound(stage, "/World/Set/Curtain", "") == "/Looks/Red"
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_subsets_are_told_themselves_for_readers_that_ask_them_alone(tmp_path):
    output = bake(tmp_path, BINDINGS["subsets"])
    write_preview(output)
    stage = Usd.Stage.Open(str(preview_path(output)))
    for path, purpose in (("/World/A/Lid", ""), ("/World/A/Rest", "full")):
        api = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path))
        assert api.GetDirectBinding(purpose).GetMaterialPath() == "/IsoluxPreview/Bake"


def test_the_material_emits_display_colour_and_reflects_nothing(tmp_path):
    output = bake(tmp_path)
    write_preview(output)
    stage = Usd.Stage.Open(str(preview_path(output)))
    material = UsdShade.Material(stage.GetPrimAtPath("/IsoluxPreview/Bake"))
    surface, _, _ = material.ComputeSurfaceSource()
    assert surface.GetShaderId() == "UsdPreviewSurface"
    emission, _, _ = surface.GetInput("emissiveColor").GetConnectedSource()
    reader = UsdShade.Shader(emission.GetPrim())
    assert reader.GetShaderId() == "UsdPrimvarReader_float3"
    assert reader.GetInput("varname").Get() == "displayColor"
    # Metallic workflow: what reflects, at normal incidence and at the rim, is diffuseColor.
    assert surface.GetInput("diffuseColor").Get() == (0, 0, 0)
    assert surface.GetInput("metallic").Get() == 1
    assert surface.GetInput("opacity").Get() == 1
    assert not surface.GetInput("useSpecularWorkflow")


def test_the_preview_is_the_same_stage_otherwise(tmp_path):
    output = bake(tmp_path)
    write_preview(output)
    results, preview = (Usd.Stage.Open(str(p)) for p in (output, preview_path(output)))
    for key in ("metersPerUnit", "upAxis", "defaultPrim", "startTimeCode", "endTimeCode"):
        assert preview.GetMetadata(key) == results.GetMetadata(key)
    assert preview.GetMetadata("renderSettingsPrimPath") == "/Render/Isolux"
    for path in ("/World/A", "/World/Set/B"):
        for name in ("displayColor", "isolux:illuminance"):
            one, other = (
                stage.GetPrimAtPath(path).GetAttribute(f"primvars:{name}")
                for stage in (results, preview)
            )
            assert np.array_equal(one.Get(1), other.Get(1))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(preview)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []


def test_the_folder_can_move(tmp_path):
    (tmp_path / "shot").mkdir()
    write_preview(bake(tmp_path / "shot"))
    (tmp_path / "shot").rename(tmp_path / "moved")
    stage = Usd.Stage.Open(str(tmp_path / "moved/shot.isolux.preview.usda"))
    assert stage.GetPrimAtPath("/World/A").GetAttribute("primvars:displayColor").Get(1)


def test_a_prim_of_the_same_name_is_left_alone(tmp_path):
    output = bake(tmp_path)
    with (tmp_path / "shot.usda").open("a") as shot:
        shot.write('def Sphere "IsoluxPreview" {\n}\n')
    Usd.Stage.Open(str(output)).Reload()
    write_preview(output)
    stage = Usd.Stage.Open(str(preview_path(output)))
    assert stage.GetPrimAtPath("/IsoluxPreview").GetTypeName() == "Sphere"
    assert bound(stage, "/World/A", "") == "/IsoluxIsoluxPreview/Bake"


@pytest.mark.parametrize("content", [None, "no stage"])
def test_results_that_are_none_are_named(tmp_path, content):
    path = tmp_path / "shot.usda"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SceneError, match=r"shot\.usda"):
        write_preview(path)


def test_a_preview_never_replaces_a_layer_of_the_source(tmp_path):
    output = bake(tmp_path)
    preview_path(output).write_text("#usda 1.0\n")
    shot = (tmp_path / "shot.usda").read_text()
    shot = shot.replace("@./looks.usda@", f"@./{preview_path(output).name}@, @./looks.usda@")
    (tmp_path / "shot.usda").write_text(shot)
    Usd.Stage.Open(str(output)).Reload()
    with pytest.raises(SceneError, match="a layer of the source stage"):
        write_preview(output)
    assert preview_path(output).read_text() == "#usda 1.0\n"
