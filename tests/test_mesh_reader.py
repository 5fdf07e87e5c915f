"""Polygon meshes: where their points lie, which side is the front, what is wrong with them."""

import numpy as np
import pytest

from isolux.mesh_topology import MeshTopology
from usda_stage import found, read_usda

SQUARE = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""
NESTED = """
def Xform "A" {{
    double3 xformOp:translate = (10, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Xform "B" {{
        float3 xformOp:scale = ({scale})
        double xformOp:rotateZ = 90
        uniform token[] xformOpOrder = ["xformOp:rotateZ", "xformOp:scale"]
        def Mesh "Square" {{ {body}
        }}
    }}
}}
"""


def square(extra: str = "", subdivision: str = "none") -> str:
    body = SQUARE.replace('"none"', f'"{subdivision}"')
    return f'def Mesh "Square" {{ {body} {extra}\n}}'


def front_normals(mesh):
    """Unit normals by the corner order, on the side that the reader calls the front."""
    topology = MeshTopology(mesh.face_vertex_counts, mesh.face_vertex_indices, len(mesh.points))
    normals = topology.face_normals(mesh.points, np.arange(len(mesh.face_vertex_counts)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return -normals if mesh.flip_winding else normals


def test_points_are_world_space_metres_through_nested_transforms():
    scene = read_usda(NESTED.format(scale="2, 3, 1", body=SQUARE), "( metersPerUnit = 0.01 )")
    # (1, 1, 0) scaled to (2, 3, 0), turned by 90° to (-3, 2, 0), moved to (7, 2, 0) cm
    np.testing.assert_allclose(scene.meshes[0].points[2], [0.07, 0.02, 0.0], atol=1e-15)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_the_same_room_in_other_units_only_scales(unit):
    scene = read_usda(square(), f"( metersPerUnit = {unit} )")
    np.testing.assert_allclose(scene.meshes[0].points[2], [unit, unit, 0.0], rtol=1e-15)


def test_far_from_the_origin_double_precision_survives():
    far = """def Xform "Far" {
        double3 xformOp:translate = (10000000, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Mesh "Square" { %s
        }
    }"""
    points = read_usda(far % SQUARE.replace("(1, 0, 0)", "(0.001, 0, 0)")).meshes[0].points
    assert points[1, 0] - points[0, 0] == pytest.approx(1e-3, rel=1e-5)


@pytest.mark.parametrize(
    ("orientation", "scale", "flipped", "front"),
    [
        ("rightHanded", "1, 1, 1", False, 1),
        ("leftHanded", "1, 1, 1", True, -1),
        ("rightHanded", "-1, 1, 1", True, 1),
        ("leftHanded", "-1, 1, 1", False, -1),
        ("rightHanded", "-1, -1, 1", False, 1),
    ],
)
def test_the_front_stays_the_front_under_mirroring(orientation, scale, flipped, front):
    body = f'{SQUARE} uniform token orientation = "{orientation}"'
    mesh = read_usda(NESTED.format(scale=scale, body=body)).meshes[0]
    assert mesh.flip_winding is flipped
    np.testing.assert_allclose(front_normals(mesh)[0], [0, 0, front], atol=1e-12)


@pytest.mark.parametrize(
    ("interpolation", "count"),
    [("constant", 1), ("uniform", 1), ("vertex", 4), ("varying", 4), ("faceVarying", 4)],
)
@pytest.mark.parametrize("as_primvar", [True, False])
def test_authored_normals_in_every_interpolation(interpolation, count, as_primvar):
    name = "primvars:normals" if as_primvar else "normals"
    normals = f"normal3f[] {name} = [{', '.join(['(0, 0.6, 0.8)'] * count)}]"
    mesh = read_usda(square(f'{normals} ( interpolation = "{interpolation}" )')).meshes[0]
    np.testing.assert_allclose(mesh.corner_normals, [[0, 0.6, 0.8]] * 4, rtol=1e-6)


def test_indexed_normals_go_to_their_corners():
    normals = """
        normal3f[] primvars:normals = [(0, 0, 1), (0, 0.6, 0.8)] ( interpolation = "faceVarying" )
        int[] primvars:normals:indices = [0, 1, 1, 0]"""
    mesh = read_usda(square(normals)).meshes[0]
    np.testing.assert_allclose(mesh.corner_normals[:, 1], [0, 0.6, 0.6, 0], rtol=1e-6)


def test_normals_stay_perpendicular_under_uneven_scale_and_outward_under_mirroring():
    # A ramp rising along x: direction (1, 0, 1), normal (-1, 0, 1).
    ramp = SQUARE.replace("(1, 0, 0), (1, 1, 0)", "(1, 0, 1), (1, 1, 1)")
    body = f'{ramp} normal3f[] normals = [(-1, 0, 1)] ( interpolation = "constant" )'
    for scale in ("4, 1, 1", "-4, 1, 1"):
        mesh = read_usda(NESTED.format(scale=scale, body=body)).meshes[0]
        along = mesh.points[1] - mesh.points[0]
        assert mesh.corner_normals[0] @ along == pytest.approx(0, abs=1e-6)
        np.testing.assert_allclose(mesh.corner_normals[0], front_normals(mesh)[0], atol=1e-6)


def test_normals_that_all_oppose_the_winding_say_where_the_front_is():
    scene = read_usda(
        square("normal3f[] normals = [(0, 0, -1), (0, 0, -1), (0, 0, -1), (0, 0, -1)]")
    )
    assert scene.meshes[0].flip_winding
    np.testing.assert_array_equal(scene.meshes[0].corner_normals, [[0, 0, -1]] * 4)
    assert [(f.path, f.kind, f.action) for f in scene.findings] == [
        ("/Square", "orientation", "repaired")
    ]


@pytest.mark.parametrize(
    "normals",
    [
        "[(0, 0, 1), (0, 0, 1)]",  # two for four vertices
        "[(0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 0, 1)]",
        "[(nan, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]",
    ],
)
def test_normals_that_can_not_be_trusted_are_left_out_by_name(normals):
    scene = read_usda(square(f"normal3f[] normals = {normals}"))
    assert scene.meshes[0].corner_normals is None
    assert found(scene) == [("/Square", "normals", "repaired")]


@pytest.mark.parametrize(
    ("authored", "broken", "reason"),
    [
        ("[0, 1, 2, 3]", "[0, 1, 2, 4]", "point 4 of 4"),
        ("[0, 1, 2, 3]", "[0, 1, 2, -1]", "point -1 of 4"),
        ("[0, 1, 2, 3]", "[0, 1, 2]", "4 corners"),
        ("Counts = [4]", "Counts = [-4]", "-4 corners"),
        ("Counts = [4]", "Counts = []", "no faces"),
        ("(1, 1, 0)", "(nan, 1, 0)", "NaN"),
        ("(1, 1, 0)", "(inf, 1, 0)", "infinite"),
    ],
)
def test_a_corrupt_mesh_is_skipped_by_name_and_the_others_are_read(authored, broken, reason):
    corrupt = square().replace(authored, broken).replace('"Square"', '"Corrupt"')
    scene = read_usda(corrupt + "\n" + square())
    assert [mesh.path for mesh in scene.meshes] == ["/Square"]
    assert found(scene) == [("/Corrupt", "Mesh", "skipped")]
    assert reason in scene.findings[0].reason


@pytest.mark.parametrize("scale", ["0, 1, 1", "0, 0, 0", "nan, 1, 1", "1, 1, 1e-14"])
def test_a_singular_transform_culls_its_mesh(scale):
    scene = read_usda(NESTED.format(scale=scale, body=SQUARE))
    assert found(scene) == [("/A/B/Square", "Mesh", "skipped")]


def test_faces_without_area_keep_their_place():
    text = square().replace("[4]", "[4, 2, 3, 3, 1]")
    text = text.replace("[0, 1, 2, 3]", "[0, 1, 2, 3,  0, 1,  0, 1, 0,  0, 1, 2,  3]")
    scene = read_usda(text)
    assert list(scene.meshes[0].face_vertex_counts) == [4, 2, 3, 3, 1]
    assert found(scene) == [("/Square", "Mesh", "repaired")]
    assert scene.findings[0].reason.startswith("3 faces")


def test_hole_faces_are_no_surface_and_wrong_ones_are_ignored():
    scene = read_usda(square("int[] holeIndices = [0, 7]"))
    assert list(scene.meshes[0].hole_faces) == [0]
    assert [action for _, kind, action in found(scene)] == ["repaired", "noted"]


def test_animated_points_are_read_at_the_asked_time():
    moving = square().replace(
        "point3f[] points =", "point3f[] points.timeSamples = { 1: [(9, 9, 9)], 5:"
    )
    moving = moving.replace("(0, 1, 0)]", "(0, 1, 0)] }")
    scene = read_usda(moving, time_code=5.0)
    assert len(scene.meshes[0].points) == 4
    assert found(scene) == [("/Square", "animation", "noted")]
    assert "time 5" in scene.findings[0].reason


def test_a_skinned_mesh_without_a_skeleton_is_read_in_its_rest_pose():
    scene = read_usda(square("int[] primvars:skel:jointIndices = [0, 0, 0, 0]"))
    assert found(scene) == [("/Square", "SkelBindingAPI", "approximated")]
