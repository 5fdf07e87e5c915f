"""Cameras: those that a stage has, and candidates to frame a stage that has none.

A camera turns places in the picture into rays in world space (the stage's axes, metres). Clipping
planes, depth of field and shutter play no part.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from .errors import SceneError

# Horizontal and vertical shape of a framed camera: 75 degrees wide, 16 : 9.
_FRAMED_HALF_WIDTH = math.tan(math.radians(75.0) / 2)
_FRAMED_ASPECT = 16 / 9


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective or orthographic camera in world space.

    path : prim path; empty for a camera that was framed, not found
    position : (3,) float64, metres
    axes : (3, 3) float64, rows are unit right, up and backward (it looks along -Z)
    window : left, bottom, right, top of the picture: tangents of the angles to the axis, or metres
        where orthographic
    """

    path: str
    position: NDArray[np.float64]
    axes: NDArray[np.float64]
    window: tuple[float, float, float, float]
    orthographic: bool = False

    @property
    def aspect_ratio(self) -> float:
        """Width over height of the picture."""
        left, bottom, right, top = self.window
        return (right - left) / (top - bottom)

    def rays(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Rays through places in the picture.

        x, y : (n,) float64, 0 to 1 from the left and from the top
        returns : origins (n, 3) float64, metres; unit directions (n, 3) float32
        """
        left, bottom, right, top = self.window
        across = left + (right - left) * x
        upward = top + (bottom - top) * y
        in_plane = across[:, None] * self.axes[0] + upward[:, None] * self.axes[1]
        if self.orthographic:
            directions = np.broadcast_to(-self.axes[2], in_plane.shape)
            return self.position + in_plane, directions.astype(np.float32)
        directions = in_plane - self.axes[2]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = np.broadcast_to(self.position, directions.shape)
        return np.ascontiguousarray(origins), directions.astype(np.float32)


def stage_camera(
    stage: Usd.Stage, path: str | None = None, time_code: float | None = None
) -> Camera | None:
    """The camera at `path`, or the first on the stage; None where `path` is None and none exists.

    time_code : when to read it; None: the earliest
    raises : SceneError where `path` is no camera (naming those that are) or can form no picture
    """
    cameras = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    if path is not None:
        paths = [str(prim.GetPath()) for prim in cameras]
        if path not in paths:
            raise SceneError(path, "no camera", ", ".join(paths) or "a stage with a camera")
        cameras = [cameras[paths.index(path)]]
    if not cameras:
        return None
    when = Usd.TimeCode.EarliestTime() if time_code is None else Usd.TimeCode(time_code)
    return _read_camera(UsdGeom.Camera(cameras[0]), when, UsdGeom.GetStageMetersPerUnit(stage))


def framing_candidates(
    low: NDArray[np.float64], high: NDArray[np.float64], target: NDArray[np.float64], up_axis: str
) -> Iterator[Camera]:
    """Cameras that look at `target`: from where a visitor would stand inside, then from outside.

    low, high, target : (3,) float64, metres; bounds of the surfaces and the middle of their area
    up_axis : "Y" or "Z"
    """
    up = np.eye(3)[1 if up_axis == "Y" else 2]
    middle, half = (low + high) / 2, (high - low) / 2
    # To the target in plan, but level enough to keep floor and ceiling in the picture.
    aim = target + 0.5 * (middle - target) * up
    sides = [_in_plan(a, b, up_axis) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    for side in sides:
        for share in (0.92, 0.6):
            for height in (0.1, 0.5):
                yield _looking_at(middle + half * (share * side + height * up), aim, up)
    for side in sides:
        for steepness in (0.1, 0.6):
            outward = side / np.linalg.norm(side) + steepness * up
            distance = 1.4 * np.linalg.norm(half) / np.linalg.norm(outward)
            yield _looking_at(middle + distance * outward, middle, up)


def _read_camera(schema: UsdGeom.Camera, when: Usd.TimeCode, metres_per_unit: float) -> Camera:
    path = str(schema.GetPath())
    frustum = schema.GetCamera(when).frustum
    window = frustum.GetWindow()
    low, high = window.GetMin(), window.GetMax()
    bounds = (*low, *high)
    if not np.isfinite(bounds).all() or not (high[0] > low[0] and high[1] > low[1]):
        raise SceneError(path, f"a picture window of {low} to {high}", "one with width and height")
    orthographic = frustum.GetProjectionType() == Gf.Frustum.Orthographic
    unit = metres_per_unit if orthographic else 1.0
    rotation = frustum.GetRotation()
    return Camera(
        path=path,
        position=np.array(frustum.GetPosition()) * metres_per_unit,
        axes=np.array([rotation.TransformDir(Gf.Vec3d(*axis)) for axis in np.eye(3)]),
        window=(low[0] * unit, low[1] * unit, high[0] * unit, high[1] * unit),
        orthographic=orthographic,
    )


def _in_plan(a: float, b: float, up_axis: str) -> NDArray[np.float64]:
    return np.array([a, 0.0, b] if up_axis == "Y" else [a, b, 0.0])


def _looking_at(
    position: NDArray[np.float64], aim: NDArray[np.float64], up: NDArray[np.float64]
) -> Camera:
    backward = position - aim
    if not np.linalg.norm(backward) > 0:
        backward = up
    # Straight up or down any side may be the right one.
    right = np.cross(up, backward)
    if not np.linalg.norm(right) > 1e-6 * np.linalg.norm(backward):
        right = np.roll(up, 1)
    backward = backward / np.linalg.norm(backward)
    right = right / np.linalg.norm(right)
    half_height = _FRAMED_HALF_WIDTH / _FRAMED_ASPECT
    return Camera(
        path="",
        position=position,
        axes=np.array([right, np.cross(backward, right), backward]),
        window=(-_FRAMED_HALF_WIDTH, -half_height, _FRAMED_HALF_WIDTH, half_height),
    )
