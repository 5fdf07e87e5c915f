"""Large elements are divided before light is solved: the surface and what is told of it stay."""

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, merge

from core_scenes import luminaire, surface
from hand_built import scene_of
from isolux.core_scene import build_core_scene, mesh_triangles
from isolux.settings import SolverSettings
from solved_scenes import solved, solver_of

MANY = 5000  # elements of a scene, at the least where it had fewer
ROOM = box((5, 4, 3), 10.0)


def walls(shape):
    """Each face of a shape as a mesh of its own."""
    return [
        type(shape)(shape.points[quad], np.array([4]), np.arange(4))
        for quad in shape.indices.reshape(-1, 4)
    ]


def unwelded(shape):
    return merge(*walls(shape))


SCENES = {
    "a room of six quads": [ROOM],
    "its quads unwelded": [unwelded(ROOM)],
    "each a mesh": walls(ROOM),
    "smooth quads": [icosphere(0)],
    "a strip of 20 m": [box((20, 0.2, 0.01), 50.0)],
    "walls beside fine ones": [ROOM, box((1, 1, 1), 0.05)],
    "far away": [ROOM.moved(x=1e6, y=-3e5)],
}


def meshes_of(name, double_sided):
    return [
        surface(shape, 0.5, double_sided=double_sided, path=f"/M{i}")
        for i, shape in enumerate(SCENES[name])
    ]


def both(meshes):
    scene = scene_of(meshes)
    return [build_core_scene(scene, SolverSettings(), 1, divide=d) for d in (False, True)]


def triangles_of(core):
    return core.vertex_positions[core.division["elements"]]


@pytest.mark.parametrize("double_sided", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_the_surface_stays_and_nothing_gapes(name, double_sided):
    whole, divided = both(meshes_of(name, double_sided))
    assert divided.element_count > MANY > whole.element_count or name == "walls beside fine ones"
    assert divided.element_count < whole.element_count + 5 * MANY
    assert divided.vertex_areas.sum() == pytest.approx(whole.vertex_areas.sum(), rel=1e-9)
    corners = triangles_of(divided)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(sides, axis=1).max() / 2 < whole.vertex_areas.sum() / MANY
    # The scenes are closed: each edge, by its places, is that of two elements, of any meshes.
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    axis = (edges[:, 0] != edges[:, 1]).argmax(axis=1)
    swapped = np.take_along_axis(edges[:, 0] > edges[:, 1], axis[:, None], 1).ravel()
    edges[swapped] = edges[swapped][:, ::-1]
    _, count = np.unique(edges.reshape(len(edges), 6), axis=0, return_counts=True)
    assert (count == 2).all()


@pytest.mark.parametrize("name", SCENES)
def test_vertices_of_the_scene_keep_place_normal_and_receiver(name):
    meshes = meshes_of(name, double_sided=True)
    whole, divided = both(meshes)
    at = divided.division["vertices"]
    for arrays in ("vertex_positions", "vertex_normals", "receiver_positions", "vertex_meshes"):
        assert np.array_equal(getattr(divided, arrays)[at], getattr(whole, arrays))
    assert np.array_equal(divided.told_areas[at], whole.vertex_areas)
    assert divided.told_areas.sum() == pytest.approx(whole.vertex_areas.sum())
    for before, now in zip(whole.mesh_ranges, divided.mesh_ranges, strict=True):
        assert np.array_equal(before[3], now[3])


@pytest.mark.parametrize("name", SCENES)
def test_a_vertex_is_added_in_the_middle_of_two_and_a_part_lies_in_its_parent(name):
    meshes = meshes_of(name, double_sided=True)
    whole, divided = both(meshes)
    of, positions = divided.division, divided.vertex_positions
    ends = positions[of["between"]]
    assert np.array_equal(positions[of["added"]], ends.mean(axis=1))
    front = of["twins"] >= 0
    assert np.array_equal(positions[of["twins"][front]], positions[of["added"][front]])
    normals = divided.vertex_normals
    assert np.array_equal(normals[of["twins"][front]], -normals[of["added"][front]])
    before = whole.vertex_positions[parents_elements(meshes, whole)[of["parents"]]]
    parts = positions[of["elements"][of["parts"]]]
    scale = np.abs(positions).max()
    assert np.abs(of["barycentrics"] @ before - parts).max() < 1e-12 * scale


def parents_elements(meshes, core):
    return np.concatenate(
        [
            corner_vertices[mesh_triangles(mesh)[0]] + begin
            for mesh, (begin, _, _, corner_vertices) in zip(meshes, core.mesh_ranges, strict=True)
        ]
    )


def test_a_mesh_of_even_elements_stays_as_it_is():
    _, divided = both([surface(box((5, 4, 3), 0.1), 0.5)])
    assert divided.division is None
    assert np.array_equal(divided.told_areas, divided.vertex_areas)


@pytest.mark.parametrize(
    ("method", "reflectance", "divided"),
    [
        ("composite", 0.5, True),
        ("dept", 0.0, True),
        ("composite", 0.0, False),  # direct light is found at vertices
        ("ddl+hpr", 0.5, False),  # radiosity divides by itself
    ],
)
def test_elements_are_divided_where_that_helps(method, reflectance, divided):
    room = surface(ROOM.flipped(), reflectance)
    solution = solved([room], [luminaire()], method=method, photons=1000)
    assert len(solution.direct) == 24
    assert (solution.stage.elements > 12) == divided


def test_the_adaptive_mesh_of_a_room_of_six_quads_begins_from_the_divided_one():
    room = surface(ROOM.flipped(), 0.5, double_sided=True)
    solver = solver_of([room], [luminaire()], method="composite", photons=3000,
                       output_mode="refined")  # fmt: skip
    stages = list(solver.stages())
    for solution in stages:
        refined = solution.refined
        assert refined.vertex_count == 48
        count = 48 + len(refined.split_parents)
        assert len(solution.direct) == len(solution.indirect) == count
        assert len(refined.elements) == solution.stage.elements > MANY
        # Linear interpolation from its parents gives a vertex its place; a part is where it says.
        places = refined.interpolate(places_of(room, solution).astype(np.float32))
        corners = places_of(room, solution)[elements_of(room, solution)[refined.element_parents]]
        assert np.abs(refined.barycentrics @ corners - places[refined.elements]).max() < 1e-5
        twins = refined.split_twin >= 0
        new = places[48:]
        assert np.array_equal(places[refined.split_twin[twins]], new[twins])
        own = solution.refined.common_vertices(stages[0].refined)
        assert own >= 48 + len(stages[0].refined.split_parents)


def places_of(mesh, solution):
    layout = solution.layout(mesh.path)
    places = np.zeros((layout.back.stop, 3))
    for side in (layout.front, layout.back):
        places[layout.corner_vertices + side.start] = mesh.points[mesh.face_vertex_indices]
    return places


def elements_of(mesh, solution):
    return solution.layout(mesh.path).corner_vertices[mesh_triangles(mesh)[0]]
