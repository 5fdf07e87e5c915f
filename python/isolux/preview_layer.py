"""A root layer over the results that makes stock viewers show the bake.

A bound material hides displayColor, and a viewer's lights would add to it. `OUT.preview.usda` lays
one material over all baked meshes, stronger than any other binding: it emits displayColor and
reflects nothing. The results, the source and their bindings stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade

from .errors import SceneError
from .layer_authoring import export_layer
from .scene_description import Finding

_BAKED = "primvars:displayColor"
_SCOPE = "IsoluxPreview"
_PURPOSES = (UsdShade.Tokens.allPurpose, UsdShade.Tokens.preview, UsdShade.Tokens.full)


def preview_path(results: Path) -> Path:
    """room.isolux.usda gives room.isolux.preview.usda."""
    return results.with_suffix(f".preview{results.suffix}")


def write_preview(results: Path) -> list[Finding]:
    """Write the preview beside the root layer of results; one of an earlier run is replaced.

    returns : baked meshes that can't be given another material
    raises : SceneError where the results can't be opened or the file can't be written
    """
    output = preview_path(results)
    try:
        root = Sdf.Layer.FindOrOpen(str(results))
    except Tf.ErrorException:
        root = None
    if root is None:
        raise SceneError(str(results), "no results", "a file that `isolux solve` wrote")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.subLayerPaths = [root.identifier]
    # Stage metadata does not come with a sublayer.
    for key in root.pseudoRoot.ListInfoKeys():
        if key not in ("subLayers", "subLayerOffsets", "customLayerData", "documentation"):
            layer.pseudoRoot.SetInfo(key, root.pseudoRoot.GetInfo(key))
    stage = Usd.Stage.Open(layer)
    used = {Path(used.realPath) for used in stage.GetUsedLayers() if used.realPath}
    if output.resolve() in used:
        raise SceneError(str(output), "a layer of the source stage", "another output file")
    findings: list[Finding] = []
    material = _emissive_material(stage)
    meshes = list(_baked_meshes(stage, findings))
    findings += _bind_all(layer, meshes, material.GetPath())

    written = Sdf.Layer.CreateAnonymous(".usda")
    written.TransferContent(layer)
    written.subLayerPaths = [
        f"./{results.name}"
    ]  # as a path beside it, so that the folder can move
    export_layer(written, output)
    return findings


def _emissive_material(stage: Usd.Stage) -> UsdShade.Material:
    scope = Sdf.Path(f"/{_SCOPE}")
    while stage.GetPrimAtPath(scope):
        scope = Sdf.Path(f"/Isolux{scope.name}")
    UsdGeom.Scope.Define(stage, scope)
    material = UsdShade.Material.Define(stage, scope.AppendChild("Bake"))
    reader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("DisplayColor"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    colour = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0, 0, 0))
    # A black metal reflects nothing at any angle. In the specular workflow a black specularColor
    # would still leave the white rim at grazing angles that UsdPreviewSurface prescribes.
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(1.0)
    shown = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shown)
    return material


def _baked_meshes(stage: Usd.Stage, findings: list[Finding]) -> Iterator[Usd.Prim]:
    """Prims to which the results layer, directly below the root layers, gives displayColor."""
    for layer in stage.GetLayerStack(includeSessionLayers=False):
        if "isolux" not in layer.customLayerData:
            continue
        baked: list[Sdf.Path] = []
        layer.Traverse(
            Sdf.Path.absoluteRootPath,
            lambda path, baked=baked: (
                baked.append(path.GetPrimPath())
                if path.IsPropertyPath() and path.name == _BAKED
                else None
            ),
        )
        for path in baked:
            prim = stage.GetPrimAtPath(path)
            if not prim or not prim.IsActive():
                continue
            if prim.IsInstanceProxy() or prim.IsInPrototype():
                reason = "its own material is shown: an instance takes no material of its own"
                findings.append(Finding(str(path), "preview", "skipped", reason))
                continue
            yield prim


def _bind_all(layer: Sdf.Layer, meshes: Sequence[Usd.Prim], material: Sdf.Path) -> list[Finding]:
    """Bind the meshes and their subsets, whatever else is bound to them or above them.

    Which binding wins is USD's to tell, so it is asked until ours does everywhere.

    returns : prims on which ours does not win
    """
    subsets = [
        child for mesh in meshes for child in mesh.GetChildren() if child.IsA(UsdGeom.Subset)
    ]
    ours: set[tuple[Sdf.Path, str]] = set()

    def bind(path: Sdf.Path, purpose: str) -> None:
        ours.add((path, purpose))
        _bind(layer, path, purpose, material)

    with Sdf.ChangeBlock():
        for mesh in meshes:
            bind(mesh.GetPath(), UsdShade.Tokens.allPurpose)
        for subset in subsets:  # for readers that ask a subset for its own binding alone
            for purpose in _PURPOSES:
                if subset.HasRelationship(_binding_name(purpose)):
                    bind(subset.GetPath(), purpose)
    shown = [*meshes, *subsets]
    overruled: set[Sdf.Path] = set()
    while True:
        lost = list(_lost(shown, material))
        progress = False
        with Sdf.ChangeBlock():
            for path, purpose, winner in lost:
                if (path, purpose) not in ours:
                    bind(path, purpose)
                elif winner not in overruled:
                    overruled.add(winner)
                    _overrule(layer, winner, below=winner.GetPrimPath() != path)
                else:
                    continue
                progress = True
        if not progress:
            break
    reason = "shown in its own material, as no binding of the preview holds"
    return [
        Finding(str(path), "preview", "skipped", reason)
        for path in sorted({path for path, _, _ in lost})
    ]


def _lost(
    prims: Sequence[Usd.Prim], material: Sdf.Path
) -> Iterator[tuple[Sdf.Path, str, Sdf.Path]]:
    """Prim, purpose and winning relationship wherever another material is bound."""
    for purpose in _PURPOSES:
        bound, winners = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(prims, purpose)
        for prim, found, winner in zip(prims, bound, winners, strict=True):
            if found.GetPath() != material:
                yield prim.GetPath(), purpose, winner.GetPath()


def _binding_name(purpose: str) -> str:
    return f"material:binding:{purpose}" if purpose else "material:binding"


def _bind(layer: Sdf.Layer, path: Sdf.Path, purpose: str, material: Sdf.Path) -> None:
    prim = Sdf.CreatePrimInLayer(layer, path)
    schemas = prim.GetInfo("apiSchemas")
    schemas.prependedItems = ["MaterialBindingAPI"]
    prim.SetInfo("apiSchemas", schemas)
    binding = Sdf.RelationshipSpec(prim, _binding_name(purpose), custom=False)
    binding.targetPathList.explicitItems = [material]
    binding.SetInfo("bindMaterialAs", UsdShade.Tokens.strongerThanDescendants)


def _overrule(layer: Sdf.Layer, winner: Sdf.Path, *, below: bool) -> None:
    """Make a binding the weaker one; one on the prim itself (not `below` it) is taken away."""
    prim = Sdf.CreatePrimInLayer(layer, winner.GetPrimPath())
    binding = Sdf.RelationshipSpec(prim, winner.name, custom=False)
    if below:
        binding.SetInfo("bindMaterialAs", UsdShade.Tokens.weakerThanDescendants)
    else:
        binding.targetPathList.ClearEditsAndMakeExplicit()
