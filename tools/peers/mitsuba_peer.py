"""Mitsuba 3: its path integrator, started at the vertices.

Each sample is one luminaire sample and one cosine-distributed ray, which the `path` integrator
follows without a limit of bounces; both ways to meet a luminaire are weighed by the balance
heuristic. Samples of a vertex are stratified (`multijitter`). Luminaires stop no light there (null
material), and those with a goniometric diagram are emitters of our own: Mitsuba has none that are
surfaces.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from .peer_scene import C_COUNT, GAMMA_COUNT, Array, PeerLuminaire, PeerScene

# Dr.Jit takes the oldest that it finds; those before 19 lack an instruction that it needs.
for _library in Path("/usr/lib").glob("*/libLLVM.so.*"):
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(_library))

import drjit as dr  # noqa: E402
import mitsuba as mi  # noqa: E402

mi.set_variant("llvm_ad_rgb")

WAVEFRONT = 1 << 22  # samples that are followed side by side
TABLES: dict[str, PeerLuminaire] = {}


class GoniometricSurface(mi.Emitter):  # type: ignore[misc]
    """A shape whose luminance is the intensity of its diagram over its projected area."""

    def __init__(self, props: Any) -> None:
        super().__init__(props)
        luminaire = TABLES[props["luminaire"]]
        assert luminaire.candela is not None
        self._texture = mi.Texture2f(mi.TensorXf(luminaire.candela[..., None]))
        self._axes = mi.Matrix3f(luminaire.axes)
        self._colour = mi.Color3f(luminaire.colour)
        self._is_sphere = luminaire.shape == "sphere"
        self._is_flat = luminaire.shape in ("rect", "disk")
        self._area = luminaire.area
        self.m_flags = mi.EmitterFlags.Surface
        self.m_needs_sample_2_2d = True

    def _luminance(self, normal: Any, towards: Any) -> Any:
        local = self._axes @ towards
        gamma = dr.acos(dr.clip(-local.z, -1, 1)) / dr.pi
        c = dr.atan2(local.y, local.x) / (2 * dr.pi)
        c = dr.select(c < 0, c + 1, c)
        # Texels' values lie at their centres.
        u = (gamma * (GAMMA_COUNT - 1) + 0.5) / GAMMA_COUNT
        v = (c * (C_COUNT - 1) + 0.5) / C_COUNT
        projected = self._area * dr.maximum(1e-6, dr.abs(dr.dot(normal, towards)))
        if self._is_sphere:
            projected = self._area / 4
        return self._colour * self._texture.eval(mi.Point2f(u, v))[0] / projected

    def eval(self, si: Any, active: Any = True) -> Any:
        # Rays pass through: a sphere shines where they enter.
        outside = True if self._is_flat else mi.Frame3f.cos_theta(si.wi) > 0
        return dr.select(active & outside, self._luminance(si.n, si.to_world(si.wi)), 0)

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        ds = self.get_shape().sample_direction(it, sample, active)
        active = active & (ds.pdf > 0)
        ds.emitter = mi.EmitterPtr(self)
        return ds, dr.select(active, self._luminance(ds.n, -ds.d) / ds.pdf, 0)

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.get_shape().pdf_direction(it, ds, active)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return dr.select(active, self._luminance(ds.n, -ds.d), 0)


mi.register_emitter("goniometric_surface", lambda props: GoniometricSurface(props))


class MitsubaPeer:
    """quality : samples a vertex, a square number"""

    def __init__(self, scene: PeerScene, threads: int, mode: str) -> None:
        dr.set_thread_count(threads)
        content: dict[str, Any] = {"type": "scene"}
        for double_sided in (False, True):
            of = scene.double_sided == double_sided
            if of.any():
                content[f"surfaces{double_sided}"] = _mesh(
                    scene.corners[of], scene.reflectance[of], double_sided
                )
        for number, luminaire in enumerate(scene.luminaires):
            content[f"luminaire{number}"] = _shape(luminaire, f"{number}")
        self._scene = mi.load_dict(content)
        self._integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
        self._positions = mi.Point3f(scene.positions.T.astype(np.float32))
        self._normals = mi.Normal3f(scene.normals.T.astype(np.float32))
        self._count = len(scene.positions)
        self._gather(0, 1, 4, 0)  # compiles the kernels

    def illuminance(self, quality: int, seed: int) -> Array:
        """(N, 3) lx by channel."""
        side = round(quality**0.5)
        step = max(1, WAVEFRONT // side**2)
        parts = [
            self._gather(first, min(step, self._count - first), side**2, seed + (first << 8))
            for first in range(0, self._count, step)
        ]
        return np.concatenate(parts)

    def _gather(self, first: int, count: int, samples: int, seed: int) -> Array:
        sampler = mi.load_dict({"type": "multijitter", "sample_count": samples})
        sampler.set_samples_per_wavefront(samples)
        sampler.seed(seed, count * samples)
        of = dr.arange(mi.UInt32, count * samples) // samples + first
        it = dr.zeros(mi.SurfaceInteraction3f, count * samples)
        it.p = dr.gather(mi.Point3f, self._positions, of)
        it.n = dr.gather(mi.Normal3f, self._normals, of)
        it.sh_frame = mi.Frame3f(it.n)
        sample, weight = self._scene.sample_emitter_direction(it, sampler.next_2d(), True)
        cosine = dr.maximum(0, dr.dot(sample.d, it.n))
        share = sample.pdf / (sample.pdf + cosine / dr.pi)
        light = dr.select((sample.pdf > 0) & (cosine > 0), weight * cosine * share, 0)
        local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        ray = mi.RayDifferential3f(mi.Ray3f(it.p, it.sh_frame.to_world(local)))
        along = self._integrator.sample(self._scene, sampler, ray, None, True)[0]
        met = self._scene.ray_intersect(ray, mi.RayFlags.All, coherent=False)
        met = met if met is not None else it
        emitter = met.emitter(self._scene)
        meets = emitter != None  # noqa: E711
        seen = mi.DirectionSample3f(self._scene, met, it)
        density = self._scene.pdf_emitter_direction(it, seen, meets)
        own = density / (density + local.z / dr.pi)
        along -= dr.select(meets & (density > 0), emitter.eval(met, meets) * own, 0)
        light += dr.pi * along
        sums = [dr.block_sum(channel, samples) for channel in light]
        return np.stack([np.array(channel) for channel in sums], axis=1) / samples


def _mesh(corners: Array, reflectance: Array, double_sided: bool) -> Any:
    bsdf: dict[str, Any] = {
        "type": "diffuse",
        "reflectance": {"type": "mesh_attribute", "name": "face_color"},
    }
    if double_sided:
        bsdf = {"type": "twosided", "material": bsdf}
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    props["face_normals"] = True
    mesh = mi.Mesh("surfaces", 3 * len(corners), len(corners), props)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners.astype(np.float32).ravel()
    parameters["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
    parameters.update()
    mesh.add_attribute("face_color", 3, reflectance.astype(np.float32).ravel())
    return mesh


def _shape(luminaire: PeerLuminaire, name: str) -> dict[str, Any]:
    x, y, z = luminaire.axes
    width, height = luminaire.size
    to_world = np.eye(4)
    # Mitsuba's rectangle and disk look to their +Z.
    half = (width / 2, height / 2) if luminaire.shape == "rect" else (width, width)
    to_world[:3, :3] = np.stack([x * half[0], -y * half[1], -z], axis=1)
    to_world[:3, 3] = luminaire.origin
    ends = [luminaire.origin - x * height / 2, luminaire.origin + x * height / 2]
    shape: dict[str, Any] = {
        "rect": {"type": "rectangle", "to_world": mi.ScalarTransform4f(to_world)},
        "disk": {"type": "disk", "to_world": mi.ScalarTransform4f(to_world)},
        "sphere": {"type": "sphere", "center": luminaire.origin.tolist(), "radius": float(width)},
        "cylinder": {
            "type": "cylinder", "p0": ends[0].tolist(), "p1": ends[1].tolist(),
            "radius": float(width),
        },
    }[luminaire.shape]  # fmt: skip
    emitter: dict[str, Any] = {
        "type": "area",
        "radiance": {"type": "rgb", "value": luminaire.luminance.tolist()},
    }
    if luminaire.candela is not None:
        TABLES[name] = luminaire
        emitter = {"type": "goniometric_surface", "luminaire": name}
    emitter["sampling_weight"] = float(luminaire.luminous_flux)
    return {**shape, "bsdf": {"type": "null"}, "emitter": emitter}
