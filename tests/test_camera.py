"""Cameras see what USD's own frustum says that they see."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from isolux.camera import framing_candidates, stage_camera
from isolux.errors import SceneError


def stage_with_camera(metres_per_unit=1.0, **attributes):
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    for name, value in attributes.items():
        camera.GetPrim().GetAttribute(name).Set(value)
    placed = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 40))
    camera.AddTransformOp().Set(placed * Gf.Matrix4d().SetTranslate(Gf.Vec3d(3, -2, 7)))
    return stage


CAMERAS = {
    "default lens": {},
    "long lens": {"focalLength": 135.0},
    "scene units of tenths of a metre": {"metres_per_unit": 0.1},
    "shifted lens": {"horizontalApertureOffset": 4.0, "verticalApertureOffset": -2.5},
    "orthographic": {"projection": "orthographic", "horizontalAperture": 40.0},
    "orthographic in centimetres": {"projection": "orthographic", "metres_per_unit": 0.01},
    "orthographic, shifted": {"projection": "orthographic", "horizontalApertureOffset": 4.0},
}


@pytest.mark.parametrize("attributes", CAMERAS.values(), ids=CAMERAS.keys())
def test_corner_rays_run_along_the_edges_of_the_frustum(attributes):
    stage = stage_with_camera(**attributes)
    unit = attributes.get("metres_per_unit", 1.0)
    camera = stage_camera(stage, "/Camera")

    origins, directions = camera.rays(
        np.array([0.0, 1.0, 0.0, 1.0]), np.array([1.0, 1.0, 0.0, 0.0])
    )

    frustum = UsdGeom.Camera.Get(stage, "/Camera").GetCamera(Usd.TimeCode.Default()).frustum
    # Near and far, each: left bottom, right bottom, left top, right top.
    corners = np.array(frustum.ComputeCorners()) * unit
    for k in range(4):
        for corner in (corners[k], corners[k + 4]):
            off_ray = np.cross(corner - origins[k], directions[k].astype(np.float64))
            distance = np.linalg.norm(corner - origins[k])
            assert np.linalg.norm(off_ray) <= 1e-6 * max(distance, 1.0)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0, abs=1e-6)


def test_aspect_ratio_is_that_of_the_aperture():
    stage = stage_with_camera(horizontalAperture=36.0, verticalAperture=24.0)
    assert stage_camera(stage).aspect_ratio == pytest.approx(1.5)


def test_the_first_camera_is_taken_unless_one_is_named():
    stage = stage_with_camera()
    UsdGeom.Camera.Define(stage, "/Other")
    assert stage_camera(stage).path == "/Camera"
    assert stage_camera(stage, "/Other").path == "/Other"
    assert stage_camera(Usd.Stage.CreateInMemory()) is None


@pytest.mark.parametrize("path", ["/Nowhere", "/Room", "not a path"])
def test_a_wrong_path_is_answered_with_the_cameras_there_are(path):
    stage = stage_with_camera()
    UsdGeom.Xform.Define(stage, "/Room")
    with pytest.raises(SceneError, match=r"no camera; wanted /Camera"):
        stage_camera(stage, path)


def test_a_camera_without_width_is_refused():
    with pytest.raises(SceneError, match="/Camera"):
        stage_camera(stage_with_camera(horizontalAperture=0.0))


@pytest.mark.parametrize(("up_axis", "up"), [("Y", 1), ("Z", 2)])
def test_framing_candidates_stand_upright_and_look_at_the_target(up_axis, up):
    low, high = np.array([-2.0, -2.0, -2.0]), np.array([4.0, 2.0, 4.0])
    target = np.array([1.5, 0.0, 1.0])
    for camera in framing_candidates(low, high, target, up_axis):
        right, upward, backward = camera.axes
        assert camera.axes @ camera.axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.cross(right, upward) == pytest.approx(backward, abs=1e-12)
        assert right[up] == pytest.approx(0.0, abs=1e-12)
        assert upward[up] > 0
        assert (target - camera.position) @ -backward > 0
