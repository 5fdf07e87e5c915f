"""Small scenes for the compiled solver, built from arrays, and what photons leave in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from usd_scenes.shapes import Shape, rectangle

from isolux import _core
from isolux.core_scene import mesh_triangles
from isolux.scene_description import LuminaireDescription, LuminaireShape, MeshDescription

WHITE = (1.0, 1.0, 1.0)
CREASE_ANGLE = np.radians(40.0)
CENTRE = np.zeros(3)
Array = NDArray[np.float64]


def surface(
    shape: Shape,
    reflectance: ArrayLike = 0.0,
    *,
    double_sided: bool = False,
    flip_winding: bool = False,
    opacity: ArrayLike | None = None,
    path: str = "/Surface",
) -> MeshDescription:
    """A shape as the solver takes it. reflectance : one number, or linear Rec. 709."""
    return MeshDescription(
        path=path,
        points=np.asarray(shape.points, np.float64),
        face_vertex_counts=np.asarray(shape.counts, np.int32),
        face_vertex_indices=np.asarray(shape.indices, np.int32),
        corner_normals=None,
        hole_faces=np.zeros(0, np.int32),
        reflectance=np.broadcast_to(reflectance, (1, 3)).astype(np.float32),
        double_sided=double_sided,
        flip_winding=flip_winding,
        opacity=None if opacity is None else np.atleast_1d(np.asarray(opacity, np.float32)),
    )


def luminaire(
    luminous_flux: float = 1000.0,
    at: ArrayLike = CENTRE,
    shape: LuminaireShape = "sphere",
    size: tuple[float, float] = (1e-3, 0.0),
    *,
    axes: Array | None = None,
    colour: ArrayLike = WHITE,
) -> LuminaireDescription:
    """By default a small sphere that shines alike in all directions. luminous_flux : lm."""
    return LuminaireDescription(
        path="/Luminaire",
        shape=shape,
        origin=np.asarray(at, np.float64),
        axes=np.eye(3) if axes is None else axes,
        size=np.array(size),
        colour=np.asarray(colour, np.float64),
        luminous_flux=luminous_flux,
        diagram=None,
    )


def distant(
    flux_density: float = 1000.0, angle: float = 0.0, axes: Array | None = None
) -> LuminaireDescription:
    """Light to local -Z. flux_density : lm/m² across its directions; angle : rad, half."""
    return luminaire(flux_density, shape="distant", size=(angle, 0.0), axes=axes)


def dome(luminance: ArrayLike, axes: Array | None = None) -> LuminaireDescription:
    """luminance : cd/m²; one number, or a map (H, W, 3)."""
    texels = np.asarray(luminance, np.float32)
    environment = np.broadcast_to(texels, (1, 1, 3)) if texels.ndim == 0 else texels
    environment = np.ascontiguousarray(environment)
    return replace(luminaire(1.0, shape="dome", axes=axes), environment=environment)


def shining(shape: Shape, luminance: float, path: str = "/Lamp", **kwargs: Any) -> MeshDescription:
    """A black mesh that shines, by default on its front. luminance : cd/m²"""
    emission = np.full((1, 3), luminance, np.float32)
    return replace(surface(shape, **kwargs), path=path, emission=emission)


@dataclass(frozen=True)
class Traced:
    """A scene, and the photons traced in it so far."""

    scene: _core.Scene
    buckets: _core.PhotonBuckets
    meshes: Sequence[MeshDescription]

    @property
    def hits(self) -> Array:
        """(V, 2): direct, indirect."""
        return self.buckets.hit_counts.astype(float)

    @property
    def areas(self) -> Array:
        """(V,) m^2"""
        return self.scene.vertex_areas

    @property
    def photon_flux(self) -> float:
        """lm"""
        return self.scene.luminous_flux / self.buckets.ends["emitted"]

    @property
    def illuminance(self) -> Array:
        """(V, 2) lx in the buckets, unfiltered: direct, indirect."""
        return self.hits * self.photon_flux / self.areas[:, None]

    @property
    def mean_illuminance(self) -> Array:
        """(2,) lx over all surfaces: direct, indirect."""
        return self.hits.sum(axis=0) * self.photon_flux / self.areas.sum()

    def filtered(
        self, accuracy: float = 0.05, sharing: float = 0.25, *, paper: bool = False
    ) -> dict:
        """As IlluminationFilter.filter, with the solver's default settings."""
        lighting = _core.IlluminationFilter(self.scene)
        return lighting.filter(self.scene, self.buckets, accuracy, sharing, paper, 2)

    def colours(self) -> tuple[Array, Array]:
        """Direct and indirect (V, 3), lx by channel: at accuracy 1 a lit bucket is a support."""
        unfiltered = self.filtered(accuracy=1.0, sharing=0.0)
        return unfiltered["direct"].astype(float), unfiltered["indirect"].astype(float)

    def front(self, mesh: int = 0) -> slice:
        """The vertices of a mesh's front side."""
        begin, end, _, _ = self.scene.mesh_ranges[mesh]
        return slice(begin, end)

    def back(self, mesh: int = 0) -> slice:
        """The vertices of a mesh's back side."""
        _, begin, end, _ = self.scene.mesh_ranges[mesh]
        return slice(begin, end)


def build(
    meshes: Sequence[MeshDescription],
    luminaires: Sequence[LuminaireDescription],
    diagram: _core.CandelaDistribution | None = None,
    crease_angle: float = CREASE_ANGLE,
) -> _core.Scene:
    """diagram : of all luminaires. crease_angle : rad"""
    builder = _core.SceneBuilder(crease_angle)
    for m in meshes:
        builder.add_mesh(
            m.points,
            m.face_vertex_counts,
            m.face_vertex_indices,
            m.corner_normals,
            m.hole_faces,
            m.reflectance,
            m.double_sided,
            m.flip_winding,
            m.opacity,
        )
    for light in luminaires:
        if light.environment is not None:
            width = light.environment.shape[1]
            builder.add_dome(light.axes, light.environment.reshape(-1, 3), width)
            continue
        if light.shape == "mesh":
            shining = next(m for m in meshes if m.path == light.path)
            corners, faces = mesh_triangles(shining)
            luminance = np.broadcast_to(shining.emission, (len(shining.face_vertex_counts), 3))
            builder.add_mesh_luminaire(
                shining.points,
                shining.face_vertex_indices[corners],
                np.ascontiguousarray(luminance[faces]),
                shining.double_sided,
            )
            continue
        builder.add_luminaire(
            light.shape,
            light.origin,
            light.axes,
            light.size,
            light.colour,
            light.luminous_flux,
            diagram,
        )
    return builder.build(2)


def trace(
    meshes: Sequence[MeshDescription],
    luminaires: Sequence[LuminaireDescription],
    photons: int,
    *,
    seed: int = 1,
    diagram: _core.CandelaDistribution | None = None,
) -> Traced:
    """Photons 0 to `photons` of a scene."""
    scene = build(meshes, luminaires, diagram)
    buckets = _core.PhotonBuckets(scene)
    _core.trace_photons(scene, buckets, seed, 0, photons, 2)
    return Traced(scene, buckets, meshes)


def retrace(traced: Traced, photons: int, seed: int) -> Traced:
    """Other photons in the same scene."""
    buckets = _core.PhotonBuckets(traced.scene)
    _core.trace_photons(traced.scene, buckets, seed, 0, photons, 2)
    return Traced(traced.scene, buckets, traced.meshes)


def bucket_flux(
    traced: Traced,
    illuminance: Callable[[Array, Array], Array],
    mesh: int = 0,
    divisions: int = 12,
) -> Array:
    """Integral of a direct illuminance over each front bucket of a mesh, lm.

    illuminance : of points (n, 3) with unit normals (n, 3), lx
    divisions : of each edge of a triangle, for quadrature at the centroids of the small triangles
    """
    m = traced.meshes[mesh]
    corners, _ = mesh_triangles(m)
    begin, end, _, corner_vertices = traced.scene.mesh_ranges[mesh]
    p, q, r = m.points[m.face_vertex_indices[corners]].transpose(1, 0, 2)
    normals = np.cross(q - p, r - p)
    areas = np.linalg.norm(normals, axis=1) / 2
    normals /= 2 * areas[:, None]

    # Three times the barycentric coordinates, so that all are whole numbers and ties are exact.
    n = divisions
    upright = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    inverted = [(3 * i + 2, 3 * j + 2) for i in range(n - 1) for j in range(n - 1 - i)]
    v, w = np.array(upright + inverted).T
    weights = np.stack([3 * n - v - w, v, w], axis=1)
    nearest = weights == weights.max(axis=1, keepdims=True)
    owners = nearest / nearest.sum(axis=1, keepdims=True)

    flux = np.zeros(end - begin)
    for weight, owner in zip(weights / (3 * n), owners, strict=True):
        points = weight[0] * p + weight[1] * q + weight[2] * r
        share = illuminance(points, normals) * areas / n**2
        for k in np.flatnonzero(owner):
            np.add.at(flux, corner_vertices[corners[:, k]], share * owner[k])
    return flux


LAMP_HEIGHT, BLOCKER_HEIGHT = 3.0, 1.5  # m


def shadowed_floor(photons: int, seed: int = 1) -> Traced:
    """A floor under a lamp of 1000 cosθ cd, with the shadow of a blocker: direct light alone.

    No vertex is on the shadow's border. The blocker is black below, so that no light comes by way
    of the floor.
    """
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.1), 0.2)
    blocker = surface(rectangle((-0.48, -0.48, BLOCKER_HEIGHT), (0.9, 0, 0), (0, 0.7, 0), 0.1))
    gamma = np.radians(np.arange(0.0, 90.5, 0.5))
    diagram = _core.CandelaDistribution(gamma, np.zeros(1), np.cos(gamma)[None])
    lamp = luminaire(1000 * np.pi, (0, 0, LAMP_HEIGHT), size=(1e-5, 0.0))
    return trace([floor, blocker], [lamp], photons, seed=seed, diagram=diagram)


def _beside_shadow(points: Array, normals: Array) -> Array:
    """(n,) lx, I cosθ / d² where the lamp is seen, of points on floor and blocker."""
    height = LAMP_HEIGHT - points[:, 2]
    across = points[:, :2] * ((LAMP_HEIGHT - BLOCKER_HEIGHT) / LAMP_HEIGHT)
    inside = (np.abs(across - [-0.03, -0.13]) < [0.45, 0.35]).all(axis=1)
    squared = (points[:, :2] ** 2).sum(axis=1) + height**2
    return np.where(inside & (points[:, 2] == 0), 0.0, 1000 * height**2 / squared**2)


def shadowed_floor_illuminance(traced: Traced) -> Array:
    """(V,) lx, mean over each bucket."""
    flux = [bucket_flux(traced, _beside_shadow, mesh, divisions=24) for mesh in (0, 1)]
    return np.concatenate(flux) / traced.areas


def shadowed_floor_at_vertices(traced: Traced) -> Array:
    """(V,) lx, where each vertex samples light."""
    scene = traced.scene
    return _beside_shadow(scene.receiver_positions, scene.vertex_normals)


def relative_rms(values: Array, truth: Array, areas: Array) -> float:
    """Area-weighted RMS of the difference over the mean of the truth."""
    square = np.average((values - truth) ** 2, weights=areas)
    return float(np.sqrt(square) / np.average(truth, weights=areas))
