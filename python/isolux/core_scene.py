"""The compiled scene of what was read of a stage."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import _core
from .scene_description import (
    GoniometricDiagram,
    LuminaireDescription,
    MeshDescription,
    SceneDescription,
)
from .settings import SolverSettings
from .solution import MeshLayout


def build_core_scene(
    scene: SceneDescription,
    settings: SolverSettings,
    threads: int,
    worth_sharing: int = _core.WORTH_SHARING,
    divide: bool = False,
) -> _core.Scene:
    """The compiled scene: meshes tessellated, the ray tracing tree built by so many threads.

    worth_sharing : bytes; where copies of meshes save as many, they share a tree
    divide : large elements, see `MeshDivision`
    """
    builder = _core.SceneBuilder(math.radians(settings.crease_angle))
    numbers = {mesh.path: number for number, mesh in enumerate(scene.meshes)}
    for number, mesh in enumerate(scene.meshes):
        copy = mesh.copy_of
        source = -1 if copy is None else numbers.get(copy.path, -1)
        builder.add_mesh(
            mesh.points,
            mesh.face_vertex_counts,
            mesh.face_vertex_indices,
            mesh.corner_normals,
            _faces_of_no_surface(mesh),
            mesh.reflectance,
            mesh.double_sided,
            mesh.flip_winding,
            mesh.opacity,
            source if source < number else -1,
            None if copy is None else np.ascontiguousarray(copy.matrix),
        )
    links = _LightLinks(scene.meshes)
    meshes = {mesh.path: mesh for mesh in scene.meshes}
    for luminaire in scene.luminaires:
        if luminaire.shape == "mesh":
            _add_mesh_luminaire(builder, meshes[luminaire.path], links.of(luminaire))
        else:
            _add_luminaire(builder, luminaire, links.of(luminaire))
    return builder.build(threads, worth_sharing, divide)


def _add_luminaire(
    builder: _core.SceneBuilder, luminaire: LuminaireDescription, links: _core.MeshLinks | None
) -> None:
    if luminaire.environment is not None:
        width = luminaire.environment.shape[1]
        builder.add_dome(luminaire.axes, luminaire.environment.reshape(-1, 3), width, links)
        return
    builder.add_luminaire(
        luminaire.shape,
        luminaire.origin,
        luminaire.axes,
        luminaire.size,
        luminaire.colour,
        luminaire.luminous_flux,
        _candela_distribution(luminaire.diagram),
        links,
    )


def _add_mesh_luminaire(
    builder: _core.SceneBuilder, mesh: MeshDescription, links: _core.MeshLinks | None
) -> None:
    """Each element that shines is a luminaire."""
    assert mesh.emission is not None
    corners, faces = mesh_triangles(mesh)
    luminance = mesh.emission if len(mesh.emission) == 1 else mesh.emission[faces]
    triangles = mesh.face_vertex_indices[corners]
    builder.add_mesh_luminaire(mesh.points, triangles, luminance, mesh.double_sided, links)


class _LightLinks:
    """Luminaires that light the same meshes share what says so."""

    def __init__(self, meshes: Sequence[MeshDescription]) -> None:
        self._paths = [mesh.path for mesh in meshes]
        self._known: dict[tuple[frozenset[str] | None, ...], _core.MeshLinks] = {}

    def of(self, luminaire: LuminaireDescription) -> _core.MeshLinks | None:
        both = luminaire.lit_meshes, luminaire.shadow_meshes
        if both == (None, None):
            return None
        if both not in self._known:
            self._known[both] = _core.MeshLinks(*(self._flags(paths) for paths in both))
        return self._known[both]

    def _flags(self, paths: frozenset[str] | None) -> NDArray[np.uint8]:
        return np.array([paths is None or path in paths for path in self._paths], np.uint8)


def mesh_triangles(mesh: MeshDescription) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The mesh's elements in the order of the compiled scene.

    returns : corners (T, 3), face corners counter-clockwise seen from the front; faces (T,)
    """
    corners, faces = _core.triangulate(
        mesh.points,
        mesh.face_vertex_counts,
        mesh.face_vertex_indices,
        _faces_of_no_surface(mesh),
        mesh.flip_winding,
    )
    return corners, faces


def _faces_of_no_surface(mesh: MeshDescription) -> NDArray[np.int32]:
    """Holes, and faces that stop no light."""
    if mesh.opacity is None or mesh.opacity.all():
        return mesh.hole_faces
    opacity = np.broadcast_to(mesh.opacity, mesh.face_vertex_counts.shape)
    clear = np.flatnonzero(opacity == 0.0).astype(np.int32)
    return np.union1d(mesh.hole_faces, clear)


def _candela_distribution(
    diagram: GoniometricDiagram | None,
) -> _core.CandelaDistribution | None:
    if diagram is None:
        return None
    return _core.CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)


def mesh_layouts(scene: SceneDescription, core_scene: _core.Scene) -> dict[str, MeshLayout]:
    """Where each mesh's vertices lie in the arrays of the compiled scene, by prim path."""
    return {
        mesh.path: MeshLayout(slice(begin, middle), slice(middle, end), corner_vertices)
        for mesh, (begin, middle, end, corner_vertices) in zip(
            scene.meshes, core_scene.mesh_ranges, strict=True
        )
    }
