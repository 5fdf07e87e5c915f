"""Which meshes a light lights, and which stand in its light: UsdLux's light and shadow linking."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pxr import Tf, Usd

from .reading_context import ReadingContext
from .scene_description import LuminaireDescription, MeshDescription
from .usd_messages import usd_message


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
        path = luminaire.path
        prim = stage.GetPrimAtPath(sources.get(path, path))
        lit = _members(prim, path, "lightLink", meshes, context)
        shadow = _members(prim, path, "shadowLink", meshes, context)
        if not context.value(prim, "inputs:shadow:enable", True):
            shadow = frozenset()
        if lit is not None or shadow is not None:
            luminaire = replace(luminaire, lit_meshes=lit, shadow_meshes=shadow)
        linked.append(luminaire)
    return linked


def _members(
    prim: Usd.Prim, path: str, name: str, meshes: Sequence[MeshDescription], context: ReadingContext
) -> frozenset[str] | None:
    """Paths of the meshes in a collection; None: all.

    path : of the luminaire in the results
    """
    if not prim or not prim.HasAPI(Usd.CollectionAPI, name):
        return None
    collection = Usd.CollectionAPI(prim, name)
    includes, excludes = collection.GetIncludesRel(), collection.GetExcludesRel()
    try:
        is_restricted = (
            includes.HasAuthoredTargets()
            or excludes.HasAuthoredTargets()
            or collection.GetIncludeRootAttr().Get() is False
        )
        if not is_restricted:
            return None
        query = collection.ComputeMembershipQuery()
    except Tf.ErrorException as error:
        context.note(prim, name, "skipped", f"taken as holding all; USD: {usd_message(error)}")
        return None
    copy, prototype = _copy_of_prototype(path, str(prim.GetPath()))
    members = frozenset(
        mesh.path
        for mesh in meshes
        if query.IsPathIncluded(mesh.source_path or mesh.path)
        and (mesh.path.startswith(copy) or not mesh.source_path.startswith(prototype))
    )
    if len(members) == len(meshes):
        return None
    if name == "lightLink" and not members:
        context.note(prim, name, "noted", "it holds no mesh: the light lights nothing")
    return members


def _copy_of_prototype(path: str, source: str) -> tuple[str, str]:
    """What a light in a copy of a point instancer's prototype says of the prototype holds there.

    returns : beginnings of paths, in the results and on the source stage, that differ
    """
    if path == source:
        return "/", "/"
    parts, others = path.split("/"), source.split("/")
    while len(parts) > 2 and len(others) > 2 and parts[-1] == others[-1]:
        parts.pop()
        others.pop()
    return "/".join(parts) + "/", "/".join(others) + "/"
