"""Primvars, normals and velocities on a refined mesh are what they were on the source's."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from refined_bakes import (
    FACES,
    POINTS,
    SOME,
    TIME,
    add_mesh,
    add_primvar,
    assert_readable,
    bake,
    linear,
    new_stage,
    points_at_corners,
    values_at_corners,
)
from split_edges import every_edge

PRIMVAR_TYPES = {
    "vertex": ("Float3Array", "vertex"),
    "varying": ("Vector3fArray", "varying"),
    "face-varying": ("Color3fArray", "faceVarying"),
    "double precision": ("Double3Array", "vertex"),
    "half precision": ("Half3Array", "faceVarying"),
}


@pytest.mark.parametrize(("type_name", "interpolation"), PRIMVAR_TYPES.values(), ids=PRIMVAR_TYPES)
@pytest.mark.parametrize("indexed", [False, True], ids=["plain", "indexed"])
def test_linear_primvars_stay_what_they_were(tmp_path, type_name, interpolation, indexed):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    values = linear(POINTS)
    indices = np.concatenate(FACES) if interpolation == "faceVarying" else np.arange(len(POINTS))
    if indexed:  # in another order
        values, indices = values[::-1], len(POINTS) - 1 - indices
        picked = indices.tolist()
    else:
        values, picked = values[indices], None
    rows = [tuple(row) for row in values.tolist()]
    add_primvar(mesh, "place", type_name, interpolation, rows, picked)
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    found = values_at_corners(baked.mesh(), "place")
    tolerance = 1e-2 if type_name.startswith("Half") else 1e-5
    assert found == pytest.approx(linear(points_at_corners(baked.mesh())), abs=tolerance)
    assert UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("place").GetInterpolation() == interpolation


def test_a_seam_of_texture_coordinates_stays_a_seam(tmp_path):
    """Each face has its own chart: the face's number beside the place."""
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    st = [(10.0 * f + POINTS[p][0], POINTS[p][1]) for f, face in enumerate(FACES) for p in face]
    backwards = list(range(len(st)))[::-1]
    add_primvar(mesh, "st", "TexCoord2fArray", "faceVarying", st[::-1], backwards)
    baked = bake(stage, *SOME)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    found = values_at_corners(baked.mesh(), "st")
    places = points_at_corners(baked.mesh())
    expected = np.column_stack([10.0 * faces + places[:, 0], places[:, 1]])
    assert found == pytest.approx(expected, abs=1e-5)


def test_points_at_the_same_place_stay_apart(tmp_path):
    """Two quads side by side, unwelded: left of the seam the mesh is cold, right of it hot."""
    stage = new_stage(tmp_path)
    left = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    points = np.concatenate([left, left + np.array([1, 0, 0])])
    mesh = add_mesh(stage, "/World/Mesh", points, [[0, 1, 2, 3], [4, 5, 6, 7]])
    add_primvar(mesh, "heat", "FloatArray", "vertex", [0.0] * 4 + [100.0] * 4)
    baked = bake(stage)
    assert_readable(baked.stage)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    assert np.array_equal(values_at_corners(baked.mesh(), "heat"), 100.0 * faces)
    # A grid of five by five points on each, with the two that are shared by position apart.
    assert len(baked.mesh().GetPointsAttr().Get()) == 2 * 25


def test_values_of_faces_go_to_their_parts(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    add_primvar(mesh, "number", "IntArray", "uniform", [0, 10, 20, 30])
    add_primvar(mesh, "name", "StringArray", "uniform", ["wall", "floor"], [1, 0, 0, 1])
    add_primvar(mesh, "pair", "FloatArray", "uniform", [0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5], None, 2)
    add_primvar(mesh, "all", "Float3Array", "constant", [(1, 2, 3)])
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    faces = values_at_corners(baked.mesh(), "isolux:sourceFace")
    assert np.array_equal(values_at_corners(baked.mesh(), "number"), 10 * faces)
    names = np.array(["floor", "wall", "wall", "floor"])
    assert np.array_equal(values_at_corners(baked.mesh(), "name"), names[faces])
    pairs = np.column_stack([faces, faces + 0.5])
    assert np.array_equal(values_at_corners(baked.mesh(), "pair"), pairs)
    assert not baked.writer.findings


def test_what_cannot_be_blended_takes_the_nearest_and_says_so(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    joints = np.repeat(np.arange(8), 2).tolist()
    add_primvar(mesh, "skel:jointIndices", "IntArray", "vertex", joints, None, 2)
    weights = [x for p in range(8) for x in (1 - p / 8, p / 8)]
    add_primvar(mesh, "skel:jointWeights", "FloatArray", "vertex", weights, None, 2)
    baked = bake(stage, {"choose": every_edge, "fraction": 0.3})
    assert_readable(baked.stage)
    found = values_at_corners(baked.mesh(), "skel:jointIndices")[:, 0]
    places = points_at_corners(baked.mesh())
    distance = np.linalg.norm(places[:, None] - np.array(POINTS), axis=2)
    on_its_edge = distance[np.arange(len(found)), found]
    assert (on_its_edge <= 0.3 * np.linalg.norm([3, 3, 2]) + 1e-6).all()
    assert np.array_equal(
        found[distance.min(axis=1) == 0], distance.argmin(axis=1)[distance.min(axis=1) == 0]
    )
    shares = values_at_corners(baked.mesh(), "skel:jointWeights")
    assert shares == pytest.approx(np.column_stack([1 - found / 8, found / 8]))
    kinds = {(f.path, f.kind, f.action) for f in baked.writer.findings}
    assert kinds == {
        ("/World/Mesh", "primvars:skel:jointIndices", "approximated"),
        ("/World/Mesh", "primvars:skel:jointWeights", "approximated"),
    }


BROKEN = {
    "too few": (["vertex", [1.0, 2.0]], "2 vertex values, 8 wanted"),
    "not whole elements": (["vertex", [1.0] * 17, None, 2], "17 vertex values, 8 of 2 each wanted"),
    "indices to nowhere": (["vertex", [1.0], [0, 9] * 4], "0 vertex values, 8 wanted"),
}


@pytest.mark.parametrize(("values", "found"), BROKEN.values(), ids=BROKEN.keys())
def test_a_primvar_that_never_fitted_is_left_out_and_named(tmp_path, capfd, values, found):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    add_primvar(mesh, "broken", "FloatArray", *values)
    baked = bake(stage)
    assert_readable(baked.stage)
    assert not UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("broken").HasValue()
    (finding,) = baked.writer.findings
    assert (finding.kind, finding.action) == ("primvars:broken", "skipped")
    assert found in finding.reason
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("as_primvar", [False, True], ids=["attribute", "primvar"])
def test_normals_stay_of_unit_length_and_between_their_neighbours(tmp_path, as_primvar):
    """Of a half tube, where the normals turn by 60 degrees from edge to edge."""
    angles = np.radians([0.0, 60.0, 120.0, 180.0])
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    points = np.concatenate([ring, ring + np.array([0, 0, 1])])
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh", points, [[i, i + 1, i + 5, i + 4] for i in range(3)])
    outward = Vt.Vec3fArray.FromNumpy(np.concatenate([ring, ring]).astype(np.float32))
    if as_primvar:
        add_primvar(mesh, "normals", "Normal3fArray", "vertex", outward)
    else:
        mesh.CreateNormalsAttr(outward)
        mesh.SetNormalsInterpolation("vertex")
    baked = bake(stage, {"choose": every_edge})
    refined = baked.mesh()
    if as_primvar:
        found = np.array(UsdGeom.PrimvarsAPI(refined).GetPrimvar("normals").Get())
    else:
        found = np.array(refined.GetNormalsAttr().Get())
        assert refined.GetNormalsInterpolation() == "vertex"
    # At the middle of a chord the outward direction is that of the point itself.
    places = np.array(refined.GetPointsAttr().Get()) * (1, 1, 0)
    assert len(found) == len(places) > 8
    assert found == pytest.approx(places / np.linalg.norm(places, axis=1, keepdims=True), abs=1e-6)


def test_velocities_go_along(tmp_path):
    stage = new_stage(tmp_path)
    mesh = add_mesh(stage, "/World/Mesh")
    mesh.CreateVelocitiesAttr([Gf.Vec3f(*row) for row in linear(POINTS)])
    baked = bake(stage, *SOME)
    refined = baked.mesh()
    found = np.array(refined.GetVelocitiesAttr().Get())
    assert found == pytest.approx(linear(refined.GetPointsAttr().Get()), abs=1e-5)


def test_animated_meshes_are_refined_as_they_were_when_read(tmp_path):
    stage = new_stage(tmp_path)
    stage.SetStartTimeCode(TIME)
    stage.SetEndTimeCode(TIME + 10)
    mesh = add_mesh(stage, "/World/Mesh")
    primvar = add_primvar(mesh, "heat", "FloatArray", "vertex", [0.0] * 8)
    faces = add_primvar(mesh, "number", "IntArray", "uniform", [0] * 4)
    for frame in (TIME, TIME + 1):
        later = np.array(POINTS) + (frame - TIME)
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(later.astype(np.float32)), frame)
        primvar.Set(linear(POINTS)[:, 0] + (frame - TIME), frame)
        faces.Set([int(frame)] * (4 if frame == TIME else 3), frame)
    baked = bake(stage, *SOME)
    assert_readable(baked.stage)
    for frame in (Usd.TimeCode.Default(), TIME, TIME + 1):
        points = np.array(baked.mesh().GetPointsAttr().Get(frame))
        assert np.array_equal(points[:8], np.array(POINTS, np.float32))
        found = np.array(UsdGeom.PrimvarsAPI(baked.mesh()).GetPrimvar("heat").Get(frame))
        assert found == pytest.approx(linear(points)[:, 0], abs=1e-5)
