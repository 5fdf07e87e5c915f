"""The compiled components as the solver orders them: photons, direct lighting, gather, radiosity.

They never call each other: the solver hands the arrays of one to the next. Arrays have an entry an
illumination vertex, V of them; illuminance is lx by channel (linear Rec. 709).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from . import _core
from .settings import SolverSettings
from .solution import LUMINANCE_WEIGHTS, RefinedMesh

# Error relative to the total illuminance at which shadow rays stop [Volevich 2000, §3.1.1].
DIRECT_ACCURACY = 0.01
# The same of a first pass, where finer ones may follow, each finer by the factor. An error
# of direct light of about 3 % is left where some 5 % of indirect light are reached first.
FIRST_DIRECT_ACCURACY = 0.04
FINER_DIRECT = 3.0
# Error of radiosity at a point, of the mean indirect illuminance, that is aimed at.
RADIOSITY_ACCURACY = 0.02
# Receivers a call: how soon a cancelled run stops.
RECEIVERS_AT_ONCE = 1 << 14
# One in so many vertices is lit to learn what all will take, or so many of a large mesh.
TIMED_SHARE = 32
TIMED_VERTICES = 1 << 11

Array = NDArray[np.float32]


class Cancelled(Exception):  # noqa: N818 (no error: a request)
    """The caller asked to stop in the midst of a component."""


@dataclass(frozen=True, slots=True)
class FilteredLight:
    """Photons filtered, and how far that is from the truth.

    direct, indirect : (V, 3)
    direct_error, indirect_error : (V,) lx, standard errors, bias included
    direct_deviation : (V,) that of the direct light, relative
    support_radius : (V,) m, of the indirect light
    rms_error, rms_error_indirect : estimated, relative, bias of the filter included
    """

    direct: Array
    indirect: Array
    direct_error: Array
    indirect_error: Array
    direct_deviation: Array
    support_radius: Array
    rms_error: float
    rms_error_indirect: float


@dataclass(frozen=True, slots=True)
class BucketErrors:
    """Relative RMS errors of unfiltered buckets: from counts [Volevich 2000, Eq. 5], by batches."""

    total: float = np.nan
    indirect: float = np.nan
    batch: float = np.nan


class PhotonTracing:
    """Density estimation photon tracing, DEPT [Volevich 2000, §3.1.3]."""

    def __init__(self, scene: _core.Scene, settings: SolverSettings, threads: int) -> None:
        self._scene = scene
        self._settings = settings
        self._threads = threads
        self._filter: _core.IlluminationFilter | None = None  # kept from stage to stage
        self.buckets = _core.PhotonBuckets(scene)
        self.emitted = 0

    def trace(self, count: int) -> None:
        """Emit so many more photons."""
        _core.trace_photons(
            self._scene, self.buckets, self._settings.seed, self.emitted, count, self._threads
        )
        self.emitted += count

    @property
    def photon_flux(self) -> float:
        """lm of each photon."""
        return self._scene.luminous_flux / max(1, self.emitted)

    def filtered(self) -> tuple[FilteredLight, BucketErrors]:
        """The light of all photons so far [Volevich 2000, Appendix A]."""
        if self._filter is None:
            self._filter = _core.IlluminationFilter(self._scene)
        settings = self._settings
        found = self._filter.filter(
            self._scene,
            self.buckets,
            settings.filter_accuracy,
            settings.filter_sharing,
            settings.filter_interval == "paper",
            self._threads,
        )
        light = FilteredLight(
            direct=found["direct"],
            indirect=found["indirect"],
            direct_error=found["direct_standard_error"],
            indirect_error=found["indirect_standard_error"],
            direct_deviation=found["direct_relative_deviation"],
            support_radius=found["support_radius"],
            rms_error=found["rms_error"],
            rms_error_indirect=found["rms_error_indirect"],
        )
        errors = BucketErrors(
            found["bucket_rms_error"], found["bucket_rms_error_indirect"], found["batch_rms_error"]
        )
        return light, errors

    def end_filtering(self) -> None:
        """Free what filtering keeps: some 65 bytes a vertex."""
        self._filter = None


class DirectLight:
    """Deterministic direct lighting, DDL, at points [Volevich 2000, §3.1.1]."""

    def __init__(self, scene: _core.Scene, settings: SolverSettings, threads: int) -> None:
        self._threads = threads
        self._scene = scene
        self.accuracy = DIRECT_ACCURACY
        self._lighting = _core.DirectLighting(scene, settings.seed, self.accuracy)
        self.shadow_rays = 0

    def aim_at(self, accuracy: float) -> None:
        """Light as exactly as this from now on, relative to the total illuminance."""
        self.accuracy = accuracy
        self._lighting.aim_at(accuracy)

    @property
    def _receivers(self) -> tuple[NDArray[np.float64], Array]:
        """Positions and normals of all vertices; a run of photons alone does without."""
        return self._scene.receiver_positions, self._scene.vertex_normals

    @cached_property
    def _meshes(self) -> NDArray[np.int32] | None:
        return self._scene.vertex_meshes if self.linked else None

    @property
    def linked(self) -> bool:
        """Whether light depends on the mesh that receives it."""
        return bool(self._scene.linked)

    def estimated_seconds(self, indirect: Array, clock: Callable[[], float]) -> float:
        """T_i0, s: what all vertices will take, by lighting a few of them.

        indirect : (V,) lx, zeros where it isn't known

        Departure: the paper estimates it from the pilot's ray rate and a guess of the shadow rays;
        with many luminaires most are culled, which no guess knows.
        """
        step = max(TIMED_SHARE, len(indirect) // TIMED_VERTICES)
        few = [np.ascontiguousarray(values[::step]) for values in (*self._receivers, indirect)]
        meshes = None if self._meshes is None else self._meshes[::step].copy()
        started = clock()
        self._lighting.illuminate(*few, self._threads, meshes)
        return (clock() - started) * len(indirect) / max(1, len(few[0]))

    def at_vertices(
        self, indirect: Array, on_share: Callable[[float], None]
    ) -> tuple[Array, Array]:
        """Direct illuminance at all vertices, (V, 3), and its standard error, (V,) lx.

        indirect : (V,) lx, zeros where it isn't known
        on_share : called with the share that is done; may raise Cancelled
        """
        return self.at_points(*self._receivers, indirect, on_share, self._meshes)

    def sharpened(
        self,
        direct: Array,
        standard_error: Array,
        indirect: Array,
        areas: NDArray[np.float64],
        on_share: Callable[[float], None],
    ) -> tuple[Array, Array]:
        """Direct light found before, anew at the vertices that the accuracy now asks more of.

        areas : (V,) m^2; a vertex of less than the mean counts as less exact only in so far as
            its error shows in that of all
        """
        shown = standard_error * np.sqrt(np.minimum(1.0, areas / areas.mean()))
        wanted = np.flatnonzero(shown > self.accuracy * (photometric(direct) + indirect))
        positions, normals = self._receivers
        meshes = None if self._meshes is None else self._meshes[wanted]
        found = self.at_points(
            positions[wanted], normals[wanted], indirect[wanted], on_share, meshes
        )
        direct, standard_error = direct.copy(), standard_error.copy()
        direct[wanted], standard_error[wanted] = found
        return direct, standard_error

    def at_points(
        self,
        positions: NDArray[np.float64],
        normals: Array,
        indirect: Array,
        on_share: Callable[[float], None],
        meshes: NDArray[np.int32] | None = None,
    ) -> tuple[Array, Array]:
        """The same at other points, m, world space, that receive light on the side of normals.

        meshes : of the points, where light is linked
        """
        count = len(positions)
        illuminance = np.zeros((count, 3), np.float32)
        standard_error = np.zeros(count, np.float32)
        for first in range(0, count, RECEIVERS_AT_ONCE):
            block = slice(first, min(first + RECEIVERS_AT_ONCE, count))
            found = self._lighting.illuminate(
                positions[block],
                normals[block],
                indirect[block],
                self._threads,
                None if meshes is None else meshes[block],
            )
            illuminance[block] = found["illuminance"]
            standard_error[block] = found["standard_error"]
            self.shadow_rays += found["shadow_rays"]
            on_share(block.stop / count)
        return illuminance, standard_error


class AdaptiveMesh:
    """The adaptive mesh of direct lighting, refined in turns with it [Volevich 2000, §3.1.1, §4].

    Iterations can be asked for at any time, with another threshold too: the mesh starts anew from
    the scene's elements, but every sample of light is kept.
    """

    def __init__(self, scene: _core.Scene) -> None:
        self._refinement = _core.MeshRefinement(scene)
        self._vertex_count = int(scene.vertex_count)

    def begin(
        self,
        direct: Array,
        standard_error: Array,
        indirect: Array,
        adaptation: float,
        threshold: float,
        photons: FilteredLight | None,
    ) -> None:
        """Back to the scene's elements.

        direct, indirect : (V, 3); standard_error : (V,) lx, of the direct light
        adaptation : luminance that the scene's observer is adapted to, cd/m^2
        threshold : difference of displayed brightness that may be lost; 1: black to white
        photons : the same light by photons; where both disagree the threshold is stricter
        """
        none = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        regional = none if photons is None else (photons.direct, photons.direct_deviation)
        self._refinement.begin(direct, standard_error, indirect, adaptation, threshold, *regional)

    def iterate(self, lighting: DirectLight, on_share: Callable[[float], None]) -> bool:
        """One iteration; false where no element wanted to be split."""
        while True:
            wanted = self._refinement.wanted_samples()
            if len(wanted["positions"]) == 0:
                return bool(self._refinement.split())
            meshes = self._refinement.wanted_meshes() if lighting.linked else None
            self._refinement.add_samples(
                *lighting.at_points(
                    wanted["positions"], wanted["normals"], wanted["indirect"], on_share, meshes
                )
            )

    def mesh(self) -> tuple[RefinedMesh, Array, Array]:
        """The mesh as it stands; direct light (V + S, 3) and its standard error (V + S,)."""
        found = self._refinement.mesh()
        arrays = {f.name: found[f.name] for f in fields(RefinedMesh) if f.name in found}
        mesh = RefinedMesh(vertex_count=self._vertex_count, **arrays)
        return mesh, found["direct"], found["standard_error"]


@dataclass(frozen=True, slots=True)
class IndirectLight:
    """Indirect illuminance at the vertices.

    illuminance : (V, 3)
    standard_error : (V,) lx
    rms : lx, area-weighted RMS error
    rays : that this took
    """

    illuminance: Array
    standard_error: Array
    rms: float
    rays: int


class FinalGather:
    """Final gather over direct light, its own reflections, and the light that photons left.

    Departure: the paper traces and filters photons to the end (IDEPT).
    """

    def __init__(self, scene: _core.Scene, settings: SolverSettings, threads: int) -> None:
        self._scene = scene
        self._gather = _core.FinalGather(scene, settings.seed)
        self._threads = threads

    def gather(self, photons: PhotonTracing, direct: Array, ray_budget: int) -> IndirectLight:
        """Indirect light by about so many more rays.

        direct : (V, 3), at the vertices
        """
        buckets: Array = photons.buckets.illuminance(self._scene)
        everything, indirect = buckets.sum(axis=1), buckets[:, 1].copy()
        del buckets
        found = self._gather.advance(
            everything,
            ray_budget,
            self._threads,
            indirect,
            photons.photon_flux,
            direct,
            photons.buckets,
        )
        return IndirectLight(
            found["indirect"], found["standard_error"], found["indirect_rms"], found["rays"]
        )


class Radiosity:
    """Hierarchical progressive radiosity, HPR [Volevich 2000, §3.1.2]."""

    def __init__(
        self,
        scene: _core.Scene,
        settings: SolverSettings,
        threads: int,
        lighting: DirectLight,
        on_share: Callable[[float], None],
    ) -> None:
        self._radiosity = _core.ProgressiveRadiosity(scene, settings.seed, RADIOSITY_ACCURACY)
        self._threads = threads
        self._receivers = scene.receiver_positions, scene.vertex_normals
        self._areas: NDArray[np.float64] = scene.vertex_areas
        self.finished = False
        positions, normals = self._radiosity.receivers()
        none = np.zeros(len(positions), np.float32)
        meshes = self._radiosity.receiver_meshes() if lighting.linked else None
        direct, _ = lighting.at_points(positions, normals, none, on_share, meshes)
        self._radiosity.begin(direct)

    def shoot(self, ray_budget: int) -> IndirectLight:
        """Indirect light after reflections worth about so many more rays, one at least."""
        progress = self._radiosity.advance(ray_budget, self._threads)
        self.finished = progress["finished"]
        found = self._radiosity.indirect(*self._receivers, self._threads)
        error: Array = found["standard_error"]
        return IndirectLight(
            found["illuminance"], error, root_mean_square(error, self._areas), found["rays"]
        )


def photometric(illuminance: Array) -> Array:
    """(n,) lx of (n, 3) colours."""
    # Not by @: BLAS would wake threads for it, which then wait for more at full speed.
    luminous: Array = np.einsum("ij,j", illuminance, LUMINANCE_WEIGHTS.astype(np.float32))
    return luminous


def root_mean_square(values: Array, areas: NDArray[np.float64]) -> float:
    """Area-weighted, of (V,) values."""
    total = areas.sum()
    square = np.einsum("i,i", areas, values.astype(np.float64) ** 2)
    return float(np.sqrt(square / total)) if total > 0 else 0.0
