"""Luminaires of the path-traced reference: one sample's illuminance, and which of them to sample.

No code of the solver's luminaires: shapes and goniometric diagrams are evaluated here on their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isolux.scene_description import GoniometricDiagram, LuminaireDescription

Array = NDArray[np.float64]

GRID_CELLS, GRID_ENTRIES = 16, 1 << 22  # along each axis; cells times luminaires at most


class Emitters:
    """All luminaires, evaluated side by side.

    With I(ω) the intensity towards the point and θ its angle there, each sample of a shape gives
    E = I cosθ w. A luminance that depends on direction alone is I over the projected area, so that
    w is 1/d² for a flat shape where it is sampled uniformly; 2 / (d² (1 + cosη)) for a sphere seen
    under the half angle η, sampled uniformly over its solid angle; and φ cosθ' / (d² sinα) for a
    cylinder seen over the angles ±φ around its axis, α the angle between axis and ray.
    """

    def __init__(self, luminaires: Sequence[LuminaireDescription], lift: float) -> None:
        self.count = len(luminaires)
        self.colour = np.array([luminaire.colour for luminaire in luminaires], np.float64)
        self._lift = lift
        self._origin = np.array([luminaire.origin for luminaire in luminaires], np.float64)
        self._axes = np.array([luminaire.axes for luminaire in luminaires], np.float64)
        self._size = np.array([luminaire.size for luminaire in luminaires], np.float64)
        self.flux = np.array([luminaire.luminous_flux for luminaire in luminaires], np.float64)
        self._shape = np.array([luminaire.shape for luminaire in luminaires])
        # Equal diagrams are looked up at once.
        self._diagrams: list[GoniometricDiagram] = []
        self._diagram = np.full(self.count, -1)
        self._scale = np.ones(self.count)
        known: dict[bytes, int] = {}
        for i, luminaire in enumerate(luminaires):
            if luminaire.diagram is not None:
                d = luminaire.diagram
                key = b"/".join(np.asarray(a).tobytes() for a in (d.gamma, d.c_angles, d.candela))
                if key not in known:
                    known[key] = len(self._diagrams)
                    self._diagrams.append(d)
                self._diagram[i] = known[key]
                self._scale[i] = luminaire.luminous_flux / diagram_flux(d)

    def intensity(self, which: NDArray[np.int64], towards: Array) -> Array:
        """(n,) cd of luminaire `which` (n,) in unit world directions (n, 3)."""
        local = np.einsum("nij,nj->ni", self._axes[which], towards)
        shape, flux = self._shape[which], self.flux[which]
        flat = (shape == "disk") | (shape == "rect")
        out = np.where(flat, flux / np.pi * np.maximum(0.0, -local[:, 2]), flux / (4 * np.pi))
        across = np.hypot(local[:, 1], local[:, 2])
        out = np.where(shape == "cylinder", flux / np.pi**2 * across, out)
        diagram = self._diagram[which]
        for i, table in enumerate(self._diagrams):
            of = np.flatnonzero(diagram == i)
            out[of] = diagram_intensity(table, local[of]) * self._scale[which[of]]
        return out

    def illuminance(
        self, which: NDArray[np.int64], x: Array, normals: Array, u: Array
    ) -> tuple[Array, Array]:
        """One sample of each luminaire `which` (n,) as seen from points (n, 3).

        u : (n, 2) in [0, 1)
        returns : (n,) lx of luminance before occlusion; (n, 3) where the shadow ray ends
        """
        axes, size = self._axes[which], self._size[which]
        seen_from = np.einsum("nij,nj->ni", axes, x - self._origin[which])  # local
        local_normals = np.einsum("nij,nj->ni", axes, normals)
        weight = np.zeros(len(which))
        y, lift = np.zeros((len(which), 3)), np.zeros((len(which), 3))
        shape = self._shape[which]
        for name, sample in (
            ("rect", _sample_flat), ("disk", _sample_flat),
            ("sphere", _sample_sphere), ("cylinder", _sample_cylinder),
        ):  # fmt: skip
            of = np.flatnonzero(shape == name)
            if len(of):
                y[of], lift[of], weight[of] = sample(
                    name, seen_from[of], local_normals[of], size[of], u[of]
                )
        end = self._origin[which] + np.einsum("nji,nj->ni", axes, y + self._lift * lift)
        to_light = np.einsum("nji,nj->ni", axes, y - seen_from)
        distance = np.linalg.norm(to_light, axis=1)
        lit = (distance > 0) & (weight > 0)
        to_light[lit] /= distance[lit, None]
        cosine = np.where(lit, np.einsum("ni,ni->n", to_light, normals), 0.0)
        out = np.zeros(len(which))
        seen = np.flatnonzero(cosine > 0)
        out[seen] = self.intensity(which[seen], -to_light[seen]) * cosine[seen] * weight[seen]
        return out, end


def _sample_flat(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    """Uniform over the shape; close to it, half of the samples along cosine-distributed rays.

    These bound the light of a single sample; both by the balance heuristic [Veach 1995].
    """
    if name == "rect":
        area = size.prod(axis=1)
        beside = np.linalg.norm(np.maximum(0.0, np.abs(x[:, :2]) - size / 2), axis=1)
    else:
        area = np.pi * size[:, 0] ** 2
        beside = np.maximum(0.0, np.hypot(x[:, 0], x[:, 1]) - size[:, 0])
    nearest = np.maximum(beside**2 + x[:, 2] ** 2, 1e-300)
    share = 0.5 * np.clip(area / nearest - 1, 0.0, 1.0)  # of the rays
    y = np.zeros_like(x)
    uniform = u[:, 0] >= share
    low, span = np.where(uniform, share, 0.0), np.where(uniform, 1 - share, share)
    v = np.stack([(u[:, 0] - low) / span, u[:, 1]], axis=1)
    if name == "rect":
        y[:, :2] = (v - 0.5) * size
    else:
        radius, angle = size[:, 0] * np.sqrt(v[:, 0]), 2 * np.pi * v[:, 1]
        y[:, 0], y[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    ray = cosine_directions(normals, v)
    meets = x[:, 2] * ray[:, 2] < 0
    length = -x[:, 2] / np.where(meets, ray[:, 2], 1.0)
    cast = np.flatnonzero(~uniform)
    y[cast] = (x + length[:, None] * ray)[cast]
    y[:, 2] = 0.0
    inside = (
        (np.abs(y[:, :2]) <= size / 2).all(axis=1)
        if name == "rect"
        else np.hypot(y[:, 0], y[:, 1]) <= size[:, 0] * (1 + 1e-12)
    )
    to_y = y - x
    square = np.maximum((to_y**2).sum(axis=1), 1e-300)
    cosine = np.maximum(0.0, (to_y * normals).sum(axis=1)) / np.sqrt(square)
    # Density of both ways over the uniform one's.
    density = 1 - share + share * area * cosine * np.abs(x[:, 2]) / (np.pi * square**1.5)
    lift = np.zeros_like(x)
    lift[:, 2] = np.sign(x[:, 2])  # off a ceiling that it is flush with
    weight = np.where(inside & (uniform | meets), 1.0 / (density * square), 0.0)
    return y, lift, weight


def _sample_sphere(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    radius = size[:, 0]
    distance = np.linalg.norm(x, axis=1)
    outside = distance > radius
    distance = np.where(outside, distance, np.inf)
    sine2 = (radius / distance) ** 2
    least = np.sqrt(1 - sine2)  # cosine of the half angle
    from_axis = sine2 / (1 + least) * u[:, 0]  # 1 - cosine: keeps its digits for small spheres
    cosine, sine = 1 - from_axis, np.sqrt(from_axis * (2 - from_axis))
    s, t, w = _frame(-x / np.linalg.norm(x, axis=1, keepdims=True))
    angle = 2 * np.pi * u[:, 1:]
    ray = (s * np.cos(angle) + t * np.sin(angle)) * sine[:, None] + w * cosine[:, None]
    far = np.where(outside, distance, 0.0)
    along = far * cosine - np.sqrt(np.maximum(0.0, radius**2 - (far * sine) ** 2))
    y = x + ray * along[:, None]
    length = np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)
    return y, y / length, np.where(outside, 2.0 / (distance**2 * (1 + least)), 0.0)


def _sample_cylinder(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    radius, length = size.T
    across = np.hypot(x[:, 1], x[:, 2])
    half = np.arccos(np.minimum(1.0, radius / np.maximum(across, 1e-300)))  # 0: inside
    angle = np.arctan2(x[:, 2], x[:, 1]) + (2 * u[:, 1] - 1) * half
    normal = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    y = normal * radius[:, None]
    y[:, 0] = (u[:, 0] - 0.5) * length
    to_x = x - y
    square = (to_x**2).sum(axis=1)
    cosine = np.maximum(0.0, (to_x * normal).sum(axis=1))
    sine = np.hypot(to_x[:, 1], to_x[:, 2])
    weight = half * cosine / np.maximum(sine * square, 1e-300)
    return y, normal, weight


def diagram_intensity(diagram: GoniometricDiagram, directions: Array) -> Array:
    """(n,) cd in local directions (n, 3), bilinear in (gamma, C); 0 outside the gamma range."""
    gamma = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), -directions[:, 2])
    j, t = _locate(diagram.gamma, gamma)
    inside = (gamma >= diagram.gamma[0] - 1e-9) & (gamma <= diagram.gamma[-1] + 1e-9)
    table = np.asarray(diagram.candela, np.float64)
    if len(diagram.c_angles) == 1:
        between = table[0, j] * (1 - t) + table[0, j + 1] * t
    else:
        c = np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi)
        i, s = _locate(diagram.c_angles, c)
        low = table[i, j] * (1 - s) + table[i + 1, j] * s
        high = table[i, j + 1] * (1 - s) + table[i + 1, j + 1] * s
        between = low * (1 - t) + high * t
    return np.where(inside, between, 0.0)


def diagram_flux(diagram: GoniometricDiagram) -> float:
    """lm, by Gauss-Legendre quadrature in gamma and the trapezoid rule in C, which are exact."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    low, high = diagram.gamma[:-1, None], diagram.gamma[1:, None]
    t = (nodes + 1) / 2
    table = np.asarray(diagram.candela, np.float64)
    if len(diagram.c_angles) == 1:
        profile = 2 * np.pi * table[0]
    else:
        profile = ((table[1:] + table[:-1]) / 2 * np.diff(diagram.c_angles)[:, None]).sum(axis=0)
    between = profile[:-1, None] * (1 - t) + profile[1:, None] * t
    sine = np.sin(low + (high - low) * t)
    return float((between * sine * weights * (high - low) / 2).sum())


class LuminaireChoice:
    """Probabilities of the luminaires by cell of a grid: by intensity and distance.

    They change the variance alone: none is zero.
    """

    def __init__(self, emitters: Emitters, low: Array, high: Array) -> None:
        n = int(min(GRID_CELLS, (GRID_ENTRIES / emitters.count) ** (1 / 3)))
        self._n, self._low = n, low
        self._cell = np.maximum(high - low, 1e-12 * (high - low).max()) / n
        index = np.stack(np.unravel_index(np.arange(n**3), (n, n, n)), axis=1)
        centres = low + (index + 0.5) * self._cell
        near = (self._cell**2).sum() / 4
        weights = np.empty((n**3, emitters.count))
        for i in range(emitters.count):
            away = centres - emitters._origin[i]
            square = (away**2).sum(axis=1)
            unit = away / np.sqrt(np.maximum(square, 1e-300))[:, None]
            intensity = emitters.intensity(np.full(len(unit), i), unit)
            floor = emitters.flux[i] / (4 * np.pi) / 4
            weights[:, i] = (intensity + floor) / (square + near)
        self._probability = weights / weights.sum(axis=1, keepdims=True)
        cumulative = np.cumsum(self._probability, axis=1)
        cumulative /= cumulative[:, -1:]
        # Rows laid end to end, each a unit higher than the one before.
        self._cumulative = (cumulative + np.arange(n**3)[:, None]).reshape(-1)
        self._count = emitters.count

    def choose(self, x: Array, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Luminaires (n,) for points (n, 3), and the probability of each."""
        i = np.clip(((x - self._low) / self._cell).astype(np.int64), 0, self._n - 1)
        cell = (i[:, 0] * self._n + i[:, 1]) * self._n + i[:, 2]
        place = np.searchsorted(self._cumulative, cell + u, side="right")
        which = np.clip(place - cell * self._count, 0, self._count - 1)
        return which, self._probability[cell, which]


def _locate(angles: Array, at: Array) -> tuple[NDArray[np.int64], Array]:
    """Interval below each angle and the place in it."""
    i = np.clip(np.searchsorted(angles, at, side="right") - 1, 0, len(angles) - 2)
    return i, np.clip((at - angles[i]) / (angles[i + 1] - angles[i]), 0.0, 1.0)


def _frame(w: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (n, 3) across unit w, and w."""
    x, y, z = w.T
    side = np.where(z < 0, -1.0, 1.0)
    a = -1 / (side + z)
    b = x * y * a
    s = np.stack([1 + side * x * x * a, side * b, -side * x], axis=1)
    return s, np.stack([b, side + y * y * a, -y], axis=1), w


def cosine_directions(normals: Array, u: Array) -> Array:
    s, t, w = _frame(normals)
    radius, angle = np.sqrt(u[:, :1]), 2 * np.pi * u[:, 1:]
    across = (s * np.cos(angle) + t * np.sin(angle)) * radius
    return across + w * np.sqrt(1 - u[:, :1])
