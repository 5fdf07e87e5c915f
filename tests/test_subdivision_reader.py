"""Subdivision surfaces of a stage: how finely they are refined, and what is wrong with them."""

import numpy as np
import pytest

from cages import CUBE_FACES, CUBE_POINTS, face_area_vectors, grid, mesh_usda, triangles
from isolux.mesh_topology import MeshTopology
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage
from usda_stage import open_usda


def read(points, faces, extra="", scheme="catmullClark", **settings):
    """The mesh, and (kind, action) of all findings."""
    stage = open_usda(mesh_usda(points, faces, extra, scheme))
    scene = read_stage(stage, settings=SolverSettings(**settings))
    (mesh,) = scene.meshes
    return mesh, {(finding.kind, finding.action) for finding in scene.findings}


def area(mesh):
    topology = MeshTopology(mesh.face_vertex_counts, mesh.face_vertex_indices, len(mesh.points))
    areas = np.linalg.norm(face_area_vectors(topology, mesh.points), axis=1)
    areas[mesh.hole_faces] = 0
    return areas.sum()


def sphere_cage(n):
    """A cube of n by n faces a side, its points on the unit sphere."""
    points, faces = [], []
    for axis in range(3):
        for side in (-1, 1):
            first = len(points)
            for j in range(n + 1):
                for i in range(n + 1):
                    u, v = np.tan(np.pi / 4 * (2 * np.array([i, j]) / n - 1))
                    place = np.roll([side, side * u, v], axis)
                    points.append(place / np.linalg.norm(place))
            faces += [[first + p for p in face] for face in grid(n)[1]]
    places, same = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    return places, [[same.ravel()[p] for p in face] for face in faces]


def test_the_area_of_a_subdivided_sphere():
    mesh, found = read(*sphere_cage(4))
    # Bicubic patches pull the surface inwards, nearly alike everywhere.
    radii = np.linalg.norm(mesh.points, axis=1)
    assert np.ptp(radii) < 0.012
    # 16 faces a quarter turn: flat ones fall short by 1 - (θ/2)² / 3 each way.
    short = 1 - (np.pi / 2 / 16 / 2) ** 2 * 2 / 3
    assert area(mesh) == pytest.approx(4 * np.pi * np.mean(radii**2) * short, rel=0.003)
    assert not found


@pytest.mark.parametrize(
    ("points", "faces", "setting", "level"),
    [
        (*grid(3), 6, 0),  # flat: its faces are the limit already
        (CUBE_POINTS, CUBE_FACES, 1, 1),  # as far as allowed
        (CUBE_POINTS, CUBE_FACES, 6, 3),
        (*sphere_cage(8), 6, 1),  # finely modelled
        (*sphere_cage(16), 6, 0),
    ],
    ids=["flat", "bounded", "cube", "fine", "finer"],
)
def test_the_level_follows_the_curvature(points, faces, setting, level):
    mesh, found = read(points, faces, surface_level=setting)
    assert mesh.cage.level == level
    assert not found


def test_surface_level_0_reads_the_control_cage_and_says_so():
    mesh, found = read(CUBE_POINTS, CUBE_FACES, surface_level=0)
    assert mesh.cage is None
    assert area(mesh) == pytest.approx(24.0)
    assert found == {("subdivisionScheme", "approximated")}


def test_a_polygon_mesh_is_left_alone():
    mesh, found = read(CUBE_POINTS, CUBE_FACES, scheme="none")
    assert mesh.cage is None
    assert len(mesh.face_vertex_counts) == 6
    assert not found


def test_normals_point_to_the_front_whatever_the_winding():
    for orientation, sign in (("rightHanded", 1), ("leftHanded", -1)):
        mesh, _ = read(CUBE_POINTS, CUBE_FACES, f'uniform token orientation = "{orientation}"')
        outward = mesh.points[mesh.face_vertex_indices]
        assert (np.einsum("ij,ij->i", mesh.corner_normals, outward) * sign > 0.8).all()


def test_authored_normals_of_a_subdivision_surface_have_no_say():
    mesh, found = read(*grid(3), 'normal3f[] normals = [(1, 0, 0)] ( interpolation = "constant" )')
    np.testing.assert_allclose(mesh.corner_normals, [[0, 0, 1]] * 36, atol=1e-6)
    assert not found


def test_materials_of_faces_go_to_their_parts():
    colours = [(0.1 * i, 0.0, 0.5) for i in range(6)]
    mesh, _ = read(
        CUBE_POINTS,
        CUBE_FACES,
        f'color3f[] primvars:displayColor = {colours} ( interpolation = "uniform" )',
    )
    parents = mesh.cage.refine().cage_faces
    np.testing.assert_allclose(mesh.reflectance, np.array(colours)[parents], atol=1e-6)


def test_holes_are_no_surface_but_bear_on_their_neighbours():
    points, faces = grid(3)
    points[:, 2] = points[:, 0] ** 2 / 9
    whole, _ = read(points, faces)
    open_, found = read(points, faces, "int[] holeIndices = [4]")
    np.testing.assert_array_equal(open_.points, whole.points)
    assert set(open_.cage.refine().cage_faces[open_.hole_faces]) == {4}
    assert found == {("holeIndices", "noted")}


SHARP_TOP = "int[] creaseIndices = [1, 3, 7, 5, 1]; int[] creaseLengths = [5]"
SHARP_CREASE = f"{SHARP_TOP}; float[] creaseSharpnesses = [10]"


@pytest.mark.parametrize(
    ("extra", "edges", "findings"),
    [
        (SHARP_CREASE, 4, set()),
        (f"{SHARP_TOP}; float[] creaseSharpnesses = [10, 10, 0, 10]", 3, set()),
        (
            f"{SHARP_TOP}; float[] creaseSharpnesses = [3]",
            4,
            {("creaseSharpnesses", "approximated")},
        ),
        (f"{SHARP_TOP}; float[] creaseSharpnesses = [10, 10]", 0, {("creaseIndices", "repaired")}),
        (f"{SHARP_TOP}; float[] creaseSharpnesses = [nan]", 0, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("[5]", "[7]"), 4, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("[5]", "[2000000000]"), 4, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("[5]", "[-5]"), 0, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("[5]", "[3]"), 2, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("7, 5, 1]", "7, 5, 99]"), 3, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("1, 3, 7", "1, 6, 7"), 3, {("creaseIndices", "repaired")}),
        (SHARP_CREASE.replace("1, 3, 7", "-1, 3, 7"), 3, {("creaseIndices", "repaired")}),
    ],
)
def test_creases_by_edge_or_by_chain_and_wrong_ones(extra, edges, findings):
    mesh, found = read(CUBE_POINTS, CUBE_FACES, extra)
    assert len(mesh.cage.sharp_edges) == edges
    assert found == findings


@pytest.mark.parametrize(
    ("extra", "corners", "findings"),
    [
        ("int[] cornerIndices = [7]; float[] cornerSharpnesses = [10]", 1, set()),
        ("int[] cornerIndices = [7, 0]; float[] cornerSharpnesses = [10, 0]", 1, set()),
        ("int[] cornerIndices = [7]", 0, {("cornerIndices", "repaired")}),
        (
            "int[] cornerIndices = [7, 8]; float[] cornerSharpnesses = [10, 10]",
            1,
            {("cornerIndices", "repaired")},
        ),
    ],
)
def test_corners_and_wrong_ones(extra, corners, findings):
    mesh, found = read(CUBE_POINTS, CUBE_FACES, extra)
    assert len(mesh.cage.sharp_points) == corners
    assert found == findings
    if corners:  # stays where it is
        assert np.abs(mesh.points - CUBE_POINTS[7]).sum(axis=1).min() < 1e-12


def test_loop_of_quads_is_subdivided_by_catmull_clark_and_told():
    mesh, found = read(CUBE_POINTS, CUBE_FACES, scheme="loop")
    assert mesh.cage.scheme == "catmullClark"
    assert found == {("subdivisionScheme", "approximated")}
    mesh, found = read(CUBE_POINTS, triangles(CUBE_FACES), scheme="loop")
    assert mesh.cage.scheme == "loop"
    assert not found


def test_faces_without_area_take_no_part():
    mesh, found = read(CUBE_POINTS, [*CUBE_FACES, [0, 1], []])
    assert len(mesh.cage.faces) == 6
    assert ("Mesh", "repaired") in found
    corners = mesh.cage.refine().corners_of_cage
    assert corners[-2:].tolist() == [-1, -1]


def test_what_would_not_fit_stays_a_cage_and_says_so():
    # A fan of n triangles around one point: each limit value there has n terms, n² in all.
    n = 9000
    ring = [(np.cos(a), np.sin(a), 0.2 * (i % 2)) for i, a in enumerate(np.arange(n) * 2e-4)]
    faces = [[0, 1 + i, 1 + (i + 1) % n] for i in range(n)]
    mesh, found = read([(0, 0, 0), *ring], faces)
    assert mesh.cage is None
    assert found == {("subdivisionScheme", "approximated")}


def test_unknown_rules_are_those_of_usd():
    extra = 'token interpolateBoundary = "round"; token faceVaryingLinearInterpolation = "so"'
    mesh, found = read(CUBE_POINTS, CUBE_FACES, extra)
    assert (mesh.cage.boundary, mesh.cage.face_varying) == ("edgeAndCorner", "cornersPlus1")
    assert len(found) == 2


def test_an_unknown_scheme_stays_a_cage_and_says_so():
    mesh, found = read(CUBE_POINTS, CUBE_FACES, scheme="doo-sabin")
    assert mesh.cage is None
    assert found == {("subdivisionScheme", "approximated")}


def test_a_cage_without_extent_is_read():
    mesh, _ = read(np.full((8, 3), 1 / 3), CUBE_FACES)
    np.testing.assert_allclose(mesh.points, 1 / 3)


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [("vertex", range(9)), ("varying", range(9)), ("faceVarying", [0, 1, 4, 3, 1, 2, 5, 4] * 2)],
)
def test_colours_given_at_points_and_corners_vary_over_the_refined_faces(interpolation, values):
    """Red grows along x: each refined face has the mean of its corners, not of its cage face's."""
    points, faces = grid(2)
    if interpolation == "faceVarying":
        values = np.concatenate(faces)
    # A bent sheet, to be refined; red is x / 2 on its cage.
    points[:, 2] = [0, 1, 0] * 3
    colours = [(float(points[v, 0] / 2) * 0.9, 0.2, 0.2) for v in values]
    extra = f'color3f[] primvars:displayColor = {colours} ( interpolation = "{interpolation}" )'
    mesh, found = read(points, faces, extra)
    assert mesh.cage.level == 2
    assert len(mesh.reflectance) == 4 * 16
    refined = mesh.cage.refine()
    at_corners = refined.topology.to_corners(
        refined.refine_primvar(
            points[:, :1] * 0.45, "vertex" if interpolation == "vertex" else "varying"
        ),
        "vertex",
    )
    expected = at_corners.reshape(-1, 4).mean(axis=1)
    tolerance = 0.02 if interpolation == "faceVarying" else 1e-6  # corners of a chart stay corners
    np.testing.assert_allclose(mesh.reflectance[:, 0], expected, atol=tolerance)
    assert not found


def test_a_material_subset_of_the_cage_covers_the_parts_of_its_faces():
    subset = """
        def GeomSubset "Red" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0, 3]
            rel material:binding = </Cage/Paint>
        }
        def Material "Paint" {
            token outputs:surface.connect = </Cage/Paint/Shader.outputs:surface>
            def Shader "Shader" {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.7, 0.1, 0.1)
                token outputs:surface
            }
        }"""
    mesh, _ = read(CUBE_POINTS, CUBE_FACES, subset)
    parents = mesh.cage.refine().cage_faces
    is_red = mesh.reflectance[:, 0] > 0.5
    np.testing.assert_array_equal(is_red, np.isin(parents, [0, 3]))


def test_faces_that_a_boundary_without_interpolation_leaves_out_are_told():
    mesh, found = read(*grid(4), 'uniform token interpolateBoundary = "none"')
    left = np.setdiff1d(np.arange(len(mesh.face_vertex_counts)), mesh.hole_faces)
    assert set(mesh.cage.refine().cage_faces[left]) == {5, 6, 9, 10}
    assert found == {("interpolateBoundary", "noted")}
