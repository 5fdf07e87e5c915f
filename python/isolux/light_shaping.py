"""Directions of a shaped UsdLux light as a goniometric diagram.

UsdLux shapes a light by factors on its luminance that depend on direction alone: a cone, a focus,
an IES profile. So the light's far field is exact as a diagram,

    I(ω) = L · f(ω) · A_proj(ω)

with A_proj = A/4 (sphere), A·cos θ (disk, rect) or A/π·sin θ_x (cylinder), A the luminous area,
θ the angle from local −Z and θ_x the angle from local X.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .scene_description import GoniometricDiagram, LuminaireShape

# Between grid angles, 1° apart, the diagram is linear: a cosine is true to (1°)²/8 = 0.004 %.
GAMMA_GRID = np.radians(np.arange(0.0, 181.0))
# Angles that differ by less, rad, are one angle written in two ways.
SAME_ANGLE = 1e-9
# A cylinder's projected area varies with the azimuth, at |cos C| near the horizon.
CYLINDER_C_ANGLES = np.radians(np.arange(0.0, 361.0, 2.0))
# Nodes across a soft cone's edge.
EDGE_NODES = 33


@dataclass(frozen=True, slots=True)
class Shaping:
    """ShapingAPI's inputs.

    cone_angle : rad; None: no cone
    cone_softness : share of the cone over which it fades, in [0, 1]
    focus : exponent of |cos θ|
    focus_tint : factor far from the axis, in luminance
    profile : of the IES file; None: no profile
    """

    cone_angle: float | None = None
    cone_softness: float = 0.0
    focus: float = 0.0
    focus_tint: float = 0.0
    profile: GoniometricDiagram | None = None

    @property
    def is_plain(self) -> bool:
        """Whether the light keeps its own directions."""
        no_focus = self.focus <= 0 or self.focus_tint == 1
        return self.profile is None and self.cone_angle is None and no_focus


def shaped_diagram(
    shape: LuminaireShape, luminance_area: float, shaping: Shaping
) -> GoniometricDiagram:
    """The far field of a light of one shape, as shaped.

    luminance_area : cd, luminance × luminous area
    """
    gamma = _gamma_angles(shape, shaping)
    c_angles = _c_angles(shape, shaping)
    candela = np.full((len(c_angles), len(gamma)), luminance_area)
    if shaping.profile is not None:
        candela *= _sample(shaping.profile, gamma, c_angles)
    if shaping.cone_angle is not None:
        candela *= _cone(gamma, shaping.cone_angle, shaping.cone_softness)
    if shaping.focus > 0:
        factor = np.abs(np.cos(gamma)) ** shaping.focus
        candela *= shaping.focus_tint + (1 - shaping.focus_tint) * factor
    candela *= _projected_share(shape, gamma, c_angles)
    return GoniometricDiagram(gamma, c_angles, candela)


def scaled_vertically(profile: GoniometricDiagram, angle_scale: float) -> GoniometricDiagram:
    """A profile after UsdLux's angleScale: from nadir where it is positive, else from zenith."""
    if angle_scale == 0:
        return profile
    pole = 0.0 if angle_scale > 0 else np.pi
    gamma = pole + (profile.gamma - pole) * abs(angle_scale)
    inside = GoniometricDiagram(gamma, profile.c_angles, profile.candela)
    limits = np.clip([gamma[0], gamma[-1]], 0.0, np.pi)
    kept = gamma[(gamma > limits[0]) & (gamma < limits[1])]
    angles = np.unique([limits[0], *kept, limits[1]])
    return GoniometricDiagram(angles, profile.c_angles, _sample(inside, angles, profile.c_angles))


def mirrored(diagram: GoniometricDiagram) -> GoniometricDiagram:
    """A diagram whose C angles run the other way, about C0."""
    if len(diagram.c_angles) == 1:
        return diagram
    c_angles = 2 * np.pi - diagram.c_angles[::-1]
    candela = np.ascontiguousarray(diagram.candela[::-1])
    return GoniometricDiagram(diagram.gamma, c_angles, candela)


def turned(diagram: GoniometricDiagram, angle: float) -> GoniometricDiagram:
    """A diagram turned about the vertical, so that its C0 lies at C angle `angle` (rad)."""
    if len(diagram.c_angles) == 1 or angle == 0:
        return diagram
    # Rounded in turns, or a plane meant for C0 could land just below 360°.
    turns = np.round((diagram.c_angles[:-1] + angle) / (2 * np.pi), 12) % 1.0
    c_angles = 2 * np.pi * np.unique([0.0, *turns, 1.0])
    candela = _sample(diagram, diagram.gamma, np.mod(c_angles - angle, 2 * np.pi))
    return GoniometricDiagram(diagram.gamma, c_angles, candela)


def _gamma_angles(shape: LuminaireShape, shaping: Shaping) -> NDArray[np.float64]:
    """Angles from −Z between which all factors are close to linear, over the lit range."""
    low, high = 0.0, np.pi / 2 if shape in ("disk", "rect") else np.pi
    nodes = [GAMMA_GRID]
    if shaping.profile is not None:
        low = max(low, float(shaping.profile.gamma[0]))
        high = min(high, float(shaping.profile.gamma[-1]))
        nodes.append(shaping.profile.gamma)
    if shaping.cone_angle is not None:
        high = min(high, shaping.cone_angle)
        inner = shaping.cone_angle * (1 - shaping.cone_softness)
        nodes.append(np.linspace(inner, shaping.cone_angle, EDGE_NODES))
    if shaping.focus > 0:
        # cosⁿ θ falls as exp(−n θ²/2): follow the bell for five deviations, at both poles.
        bell = np.linspace(0.0, min(5 / np.sqrt(shaping.focus), np.pi / 2), 200)
        nodes += [bell, np.pi - bell]
    angles = np.unique(np.concatenate(nodes))
    angles = angles[np.diff(angles, prepend=-1.0) > SAME_ANGLE]
    kept = angles[(angles > low + SAME_ANGLE) & (angles < high - SAME_ANGLE)]
    return np.unique([low, *kept, max(low, high)])


def _c_angles(shape: LuminaireShape, shaping: Shaping) -> NDArray[np.float64]:
    own = CYLINDER_C_ANGLES if shape == "cylinder" else np.zeros(1)
    profile = np.zeros(1) if shaping.profile is None else shaping.profile.c_angles
    return own if len(profile) == 1 else profile if len(own) == 1 else np.union1d(own, profile)


def _cone(gamma: NDArray[np.float64], angle: float, softness: float) -> NDArray[np.float64]:
    """1 − smoothstep from angle·(1 − softness) to angle; 1 up to a hard edge."""
    inner = angle * (1 - softness)
    if inner == angle:
        return np.where(gamma <= angle, 1.0, 0.0)
    t = np.clip((gamma - inner) / (angle - inner), 0.0, 1.0)
    return 1 - t * t * (3 - 2 * t)


def _sample(
    diagram: GoniometricDiagram, gamma: NDArray[np.float64], c_angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(H, G) candela of a diagram at other angles, bilinear; zero outside its gamma range."""
    by_gamma = np.array([np.interp(gamma, diagram.gamma, row, 0, 0) for row in diagram.candela])
    if len(diagram.c_angles) == 1:
        return np.repeat(by_gamma, len(c_angles), axis=0)
    return np.array([np.interp(c_angles, diagram.c_angles, column) for column in by_gamma.T]).T


def _projected_share(
    shape: LuminaireShape, gamma: NDArray[np.float64], c_angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(H, G) projected over luminous area by direction; (1, 1) where it doesn't vary."""
    if shape == "sphere":
        return np.full((1, 1), 0.25)
    if shape == "cylinder":
        along_x = np.cos(c_angles)[:, None] * np.sin(gamma)
        return np.sqrt(np.maximum(1 - along_x**2, 0.0)) / np.pi
    return np.maximum(np.cos(gamma), 0.0)[None]
