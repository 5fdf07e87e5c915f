"""What the solver reads of a stage, for the peers."""

from __future__ import annotations

import numpy as np
from luminaire_sampling import diagram_flux, diagram_intensity
from path_tracer import OFFSET

from isolux import _core
from isolux.core_scene import mesh_triangles
from isolux.scene_description import LuminaireDescription, SceneDescription

from .peer_scene import C_COUNT, GAMMA_COUNT, Array, PeerLuminaire, PeerScene


def export_scene(scene: SceneDescription, core: _core.Scene) -> PeerScene:
    """The whole scene; its points are all illumination vertices with an area.

    They come in the order of `lit_vertices`.
    """
    corners, reflectance, double_sided = [], [], []
    for mesh in scene.meshes:
        triangles, faces = mesh_triangles(mesh)
        corners.append(mesh.points[mesh.face_vertex_indices[triangles]])
        of_face = faces if len(mesh.reflectance) > 1 else np.zeros_like(faces)
        reflectance.append(mesh.reflectance[of_face])
        double_sided.append(np.full(len(faces), mesh.double_sided))
    surfaces = np.concatenate(corners)
    extent = surfaces.reshape(-1, 3)
    lift = OFFSET * float((extent.max(axis=0) - extent.min(axis=0)).max()) / 2
    lit = lit_vertices(core)
    normals = np.asarray(core.vertex_normals, np.float64)[lit]
    positions = np.asarray(core.receiver_positions, np.float64)[lit] + lift * normals
    return PeerScene(
        surfaces,
        np.concatenate(reflectance),
        np.concatenate(double_sided),
        [_exported(luminaire) for luminaire in scene.luminaires],
        positions,
        normals,
    )


def lit_vertices(core: _core.Scene) -> np.ndarray:
    """Numbers of the illumination vertices that have an area and a normal."""
    return np.flatnonzero(core.vertex_areas * (np.abs(core.vertex_normals).max(axis=1) > 0))


def _exported(luminaire: LuminaireDescription) -> PeerLuminaire:
    return PeerLuminaire(
        luminaire.shape,
        np.asarray(luminaire.origin, np.float64),
        np.asarray(luminaire.axes, np.float64),
        np.asarray(luminaire.size, np.float64),
        np.asarray(luminaire.colour, np.float64),
        float(luminaire.luminous_flux),
        None if luminaire.diagram is None else _candela(luminaire),
    )


def _candela(luminaire: LuminaireDescription) -> Array:
    """On the grid that peers get, scaled to the luminous flux."""
    diagram = luminaire.diagram
    assert diagram is not None
    gamma = np.linspace(0, np.pi, GAMMA_COUNT)
    c = np.linspace(0, 2 * np.pi, C_COUNT)[:, None]
    directions = np.stack(
        np.broadcast_arrays(np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), -np.cos(gamma)),
        axis=-1,
    )
    intensity = diagram_intensity(diagram, directions.reshape(-1, 3)).reshape(C_COUNT, GAMMA_COUNT)
    return intensity * luminaire.luminous_flux / diagram_flux(diagram)
