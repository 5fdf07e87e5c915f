"""Which meshes a light lights, and which stand in its light: UsdLux's light and shadow linking."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pxr import Usd

from .reading_context import ReadingContext
from .scene_description import LuminaireDescription, MeshDescription


def link_luminaires(
    stage: Usd.Stage,
    luminaires: Iterable[LuminaireDescription],
    meshes: Sequence[MeshDescription],
    sources: Mapping[str, str],
    context: ReadingContext,
) -> list[LuminaireDescription]:
    """The luminaires with the sets of meshes that their prims' collections hold.

    A mesh belongs to a collection by its path, so that instances and their parts can, too.

    sources : path on the source stage of luminaires that have another in the results
    """
    linked = []
    for luminaire in luminaires:
        prim = stage.GetPrimAtPath(sources.get(luminaire.path, luminaire.path))
        lit = _members(prim, "lightLink", meshes, context)
        shadow = _members(prim, "shadowLink", meshes, context)
        if not context.value(prim, "inputs:shadow:enable", True):
            shadow = frozenset()
        if lit is not None or shadow is not None:
            luminaire = replace(luminaire, lit_meshes=lit, shadow_meshes=shadow)
        linked.append(luminaire)
    return linked


def _members(
    prim: Usd.Prim, name: str, meshes: Sequence[MeshDescription], context: ReadingContext
) -> frozenset[str] | None:
    """Paths of the meshes in a collection; None: all."""
    if not prim or not prim.HasAPI(Usd.CollectionAPI, name):
        return None
    collection = Usd.CollectionAPI(prim, name)
    includes, excludes = collection.GetIncludesRel(), collection.GetExcludesRel()
    is_restricted = (
        includes.HasAuthoredTargets()
        or excludes.HasAuthoredTargets()
        or collection.GetIncludeRootAttr().Get() is False
    )
    if not is_restricted:
        return None
    query = collection.ComputeMembershipQuery()
    members = frozenset(
        mesh.path for mesh in meshes if query.IsPathIncluded(mesh.source_path or mesh.path)
    )
    if len(members) == len(meshes):
        return None
    if name == "lightLink" and not members:
        context.note(prim, name, "noted", "it holds no mesh: the light lights nothing")
    return members
