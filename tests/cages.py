"""Control cages for the tests of subdivision surfaces."""

import numpy as np

from isolux.mesh_topology import MeshTopology
from isolux.subdivision import SubdivisionCage, sound_faces

CUBE_POINTS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
CUBE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_EDGES = sorted({tuple(sorted((f[i - 1], f[i]))) for f in CUBE_FACES for i in range(4)})


def grid(n):
    """n by n unit squares: points (P, 3) with z = 0, faces."""
    points = np.array([(x, y, 0) for y in range(n + 1) for x in range(n + 1)], float)
    corners = [i + j * (n + 1) for j in range(n) for i in range(n)]
    return points, [[c, c + 1, c + n + 2, c + n + 1] for c in corners]


def triangles(faces):
    return [[f[0], *f[i : i + 2]] for f in faces for i in range(1, len(f) - 1)]


def cage(faces, point_count, level, *, creases=(), corners=(), holes=(), **rules):
    """creases : (point, point, sharpness) each; corners : (point, sharpness) each."""
    creases = np.array(creases, float).reshape(-1, 3)
    corners = np.array(corners, float).reshape(-1, 2)
    topology = MeshTopology(
        np.array([len(f) for f in faces], np.int32),
        np.concatenate(faces).astype(np.int32),
        point_count,
    )
    sound, used_corners = sound_faces(topology)
    return SubdivisionCage(
        topology=topology,
        faces=sound,
        corners=used_corners,
        hole_faces=np.array(holes, np.int32),
        sharp_edges=creases[:, :2].astype(np.int32),
        edge_sharpness=creases[:, 2].astype(np.float32),
        sharp_points=corners[:, 0].astype(np.int32),
        point_sharpness=corners[:, 1].astype(np.float32),
        level=level,
        **{
            "scheme": "catmullClark",
            "boundary": "edgeAndCorner",
            "face_varying": "cornersPlus1",
            "smooth_triangles": False,
        }
        | rules,
    )


def cube(level, **rules):
    return cage(CUBE_FACES, 8, level, **rules)


def face_area_vectors(topology, points):
    """(F, 3): area times unit normal by the corner order."""
    return topology.face_normals(points, np.arange(len(topology.counts))) / 2


def mesh_usda(points, faces, extra="", scheme="catmullClark"):
    places = ", ".join(str(tuple(float(x) for x in point)) for point in points)
    return f"""def Mesh "Cage" {{
        int[] faceVertexCounts = {[len(face) for face in faces]}
        int[] faceVertexIndices = {[int(p) for face in faces for p in face]}
        point3f[] points = [{places}]
        uniform token subdivisionScheme = "{scheme}"
        {extra.replace("; ", chr(10))}
    }}
"""
