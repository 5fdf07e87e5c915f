"""Where illuminance is kept: a vertex for each point and side of creases, with its area."""

import dataclasses

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, superellipsoid

from core_scenes import build, luminaire, surface, trace
from hand_built import CUBE_FACES, GREY, mesh

CUBE = mesh("/Cube", [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], CUBE_FACES)
SPHERE = surface(icosphere(3))


def built(*meshes, crease_angle=40.0):
    return build(meshes, [luminaire()], crease_angle=np.radians(crease_angle))


def fan(angles, radius=1.0):
    """Quads that stand on the X axis at these angles around it, one point apart at each end."""
    tips = [(x, radius * np.cos(a), radius * np.sin(a)) for a in np.radians(angles) for x in (0, 1)]
    faces = [[0, 1, 3 + 2 * i, 2 + 2 * i] for i in range(len(angles))]
    return mesh("/Fan", [(0, 0, 0), (1, 0, 0), *tips], faces)


def test_a_cube_splits_its_8_points_into_24_vertices():
    scene = built(CUBE)
    assert (scene.vertex_count, scene.element_count) == (24, 12)
    assert np.abs(scene.vertex_normals).sum(axis=1) == pytest.approx(np.ones(24))
    outward = scene.vertex_normals * (scene.vertex_positions - 0.5)
    assert (outward.sum(axis=1) > 0).all()


def test_a_smooth_surface_keeps_one_vertex_a_point():
    scene = built(SPHERE)
    assert scene.vertex_count == len(SPHERE.points)
    assert np.abs(scene.vertex_normals - scene.vertex_positions).max() < 0.02


@pytest.mark.parametrize(("angle", "vertices"), [(89.0, 24), (91.0, 8)])
def test_creases_are_edges_sharper_than_the_crease_angle(angle, vertices):
    assert built(CUBE, crease_angle=angle).vertex_count == vertices


def test_corner_vertices_name_the_vertex_of_each_corner():
    scene = built(SPHERE, CUBE)
    for description, (begin, _, _, corner_vertices) in zip(
        (SPHERE, CUBE), scene.mesh_ranges, strict=True
    ):
        at_corners = scene.vertex_positions[begin + corner_vertices]
        assert np.array_equal(at_corners, description.points[description.face_vertex_indices])


def with_corner_normals(description, normals):
    return dataclasses.replace(description, corner_normals=np.array(normals, np.float32))


def test_authored_normals_decide_about_creases_whatever_the_angle():
    axes = np.repeat(np.eye(3), 2, axis=0)
    axes[::2] *= -1  # as the faces are in order: -X, +X, -Y, ...
    face_normals = np.repeat(axes, 4, axis=0)
    outward = CUBE.points[CUBE.face_vertex_indices] * 2 - 1
    smooth = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    assert built(with_corner_normals(CUBE, face_normals), crease_angle=120).vertex_count == 24
    rounded = built(with_corner_normals(CUBE, smooth), crease_angle=10)
    assert rounded.vertex_count == 8
    assert rounded.vertex_normals == pytest.approx(
        (2 * rounded.vertex_positions - 1) / np.sqrt(3), abs=1e-6
    )


def test_authored_normals_that_differ_by_rounding_alone_are_one_vertex():
    directions = SPHERE.points[SPHERE.face_vertex_indices]
    noise = np.random.default_rng(1).normal(0, 1e-4, directions.shape)
    rounded = (directions + noise) / np.linalg.norm(directions + noise, axis=1, keepdims=True)
    assert built(with_corner_normals(SPHERE, rounded)).vertex_count == len(SPHERE.points)


@pytest.mark.parametrize(
    "description",
    [CUBE, SPHERE, surface(box((1, 2, 3), 0.4)), surface(superellipsoid((1, 0.3, 2), 4.0, 0.1))],
    ids=["cube", "sphere", "box", "cushion"],
)
@pytest.mark.parametrize("double_sided", [False, True])
def test_vertices_share_out_the_area_of_the_mesh(description, double_sided):
    scene = built(dataclasses.replace(description, double_sided=double_sided))
    first = np.cumsum(description.face_vertex_counts) - description.face_vertex_counts
    p, q, r = description.points[description.face_vertex_indices[first + np.array([[0], [1], [2]])]]
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2
    if description.face_vertex_counts[0] == 4:
        s = description.points[description.face_vertex_indices[first + 3]]
        area += np.linalg.norm(np.cross(r - p, s - p), axis=1) / 2
    sides = 1 + double_sided
    assert scene.vertex_areas.sum() == pytest.approx(sides * area.sum(), rel=1e-12)
    assert (scene.vertex_areas > 0).all()


def test_a_double_sided_mesh_has_a_twin_on_the_back_for_each_vertex():
    scene = built(CUBE, dataclasses.replace(SPHERE, double_sided=True))
    (_, cube_end, cube_back_end, _), (begin, middle, end, _) = scene.mesh_ranges
    assert (cube_end, cube_back_end, begin) == (24, 24, 24)
    front, back = slice(begin, middle), slice(middle, end)
    assert middle - begin == end - middle == len(SPHERE.points)
    assert np.array_equal(scene.vertex_normals[back], -scene.vertex_normals[front])
    assert np.array_equal(scene.vertex_positions[back], scene.vertex_positions[front])
    assert np.array_equal(scene.vertex_areas[back], scene.vertex_areas[front])


def test_a_mirrored_mesh_is_flipped_once():
    """Mirrored points with the flag have outward normals again; the flag alone turns them in."""
    mirrored = dataclasses.replace(SPHERE, points=SPHERE.points * [-1, 1, 1], flip_winding=True)
    turned_in = dataclasses.replace(SPHERE, flip_winding=True)
    for description, sign in ((SPHERE, 1), (mirrored, 1), (turned_in, -1)):
        scene = built(description)
        facing = (scene.vertex_normals * scene.vertex_positions).sum(axis=1)
        assert sign * facing.min() > 0.9 or sign * facing.max() > 0.9
        assert np.sign(facing).tolist() == [sign] * len(facing)


def test_degenerate_faces_keep_the_topology_with_weight_0():
    """A point in use by a face without area alone still has its vertex, where 0 is kept."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (3, 0, 0)]
    description = mesh("/Mesh", points, [[0, 1, 2, 3], [1, 4, 5], [0, 0, 2], [2, 2, 2]])
    scene = built(description)
    (_, _, _, corner_vertices) = scene.mesh_ranges[0]
    assert scene.element_count == 2
    assert (corner_vertices >= 0).all()
    assert np.isfinite(scene.vertex_normals).all()
    assert scene.vertex_areas.sum() == pytest.approx(1.0)
    assert (scene.vertex_areas[corner_vertices[:4]] > 0).all()
    assert (scene.vertex_areas[corner_vertices[5:7]] == 0).all()


def test_holes_have_no_vertices():
    description = dataclasses.replace(CUBE, hole_faces=np.array([0, 3], np.int32))
    scene = built(description)
    (_, end, _, corner_vertices) = scene.mesh_ranges[0]
    assert end == 16
    assert (corner_vertices.reshape(6, 4) == -1).all(axis=1).tolist() == [
        *(True, False, False, True, False, False)
    ]
    assert scene.vertex_areas.sum() == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("angles", "vertices_on_the_axis"),
    [
        ([0, 180], 4),  # one flat strip, but its halves wind against each other
        ([0, 120, 240], 6),
        ([0, 20, 40], 2),
        ([0, 30, 100, 130], 4),
        ([0, 90, 180, 270], 8),
    ],
)
def test_a_non_manifold_edge_splits_by_normal(angles, vertices_on_the_axis):
    scene = built(fan(angles))
    on_axis = (scene.vertex_positions[:, 1:] == 0).all(axis=1)
    assert on_axis.sum() == vertices_on_the_axis
    assert np.linalg.norm(scene.vertex_normals, axis=1) == pytest.approx(np.ones(len(on_axis)))


def test_two_cones_that_meet_in_a_point_have_a_vertex_each():
    ring = [(np.cos(a), np.sin(a)) for a in np.arange(24) * np.pi / 12]
    points = [(0, 0, 0), *((x, y, 4) for x, y in ring), *((x, y, -4) for x, y in ring)]
    faces = [[0, 1 + i, 1 + (i + 1) % 24] for i in range(24)]
    faces += [[0, 25 + (i + 1) % 24, 25 + i] for i in range(24)]
    scene = built(mesh("/Cones", points, faces))
    assert (scene.vertex_positions == 0).all(axis=1).sum() == 2


def test_reflectance_is_by_face_where_it_is_given_so():
    """Black faces absorb whatever meets them; the floor alone has light to hand on."""
    reflectance = np.zeros((6, 3), np.float32)
    reflectance[4] = 0.9
    inside = dataclasses.replace(CUBE, reflectance=reflectance, flip_winding=True)
    grey = dataclasses.replace(CUBE, reflectance=GREY, flip_winding=True)
    lamp = luminaire(at=(0.5, 0.5, 0.5))
    one, all_grey = (trace([m], [lamp], 60_000) for m in (inside, grey))
    # A sixth of the light meets the floor; what it reflects meets the others.
    expected = 0.9 / 6
    assert one.hits[:, 1].sum() / 60_000 == pytest.approx(
        expected, abs=4 * np.sqrt(expected * (1 - expected) / 60_000)
    )
    assert all_grey.hits[:, 1].sum() / 60_000 == pytest.approx(1.0, rel=0.05)
    on_floor = (one.scene.vertex_normals == (0, 0, 1)).all(axis=1)
    assert on_floor.sum() == 4
    assert one.hits[on_floor, 1].sum() == 0


@pytest.mark.parametrize("shape", [icosphere(3), icosphere(3).flipped(), box((1, 1, 1), 0.25)])
def test_no_receiver_lies_behind_an_element_that_it_receives_for(shape):
    """On a convex body the middle of the elements around a vertex lies inside."""
    description = surface(shape, double_sided=True)
    scene = built(description)
    begin, back, _, corner_vertices = scene.mesh_ranges[0]
    corners = corner_vertices.reshape(len(shape.counts), -1)
    p = shape.points[shape.indices].reshape(*corners.shape, 3)
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edge = np.linalg.norm(p[:, 1] - p[:, 0], axis=1).max()
    for side, first in ((1, begin), (-1, back)):
        receivers = scene.receiver_positions[first + corners]
        heights = side * ((receivers - p) * normals[:, None]).sum(axis=-1)
        assert heights.min() > -1e-12
        assert heights.max() < edge / 64
