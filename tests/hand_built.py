"""Small meshes and solutions put together by hand, for tests of what is written and read."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from isolux.scene_description import MeshDescription, SceneDescription
from isolux.solution import MeshLayout, ProgressiveStage, Solution

GREY = np.array([[0.5, 0.5, 0.5]], np.float32)
CUBE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def mesh(path, points, faces, *, reflectance=GREY, double_sided=False, holes=()):
    return MeshDescription(
        path=path,
        points=np.array(points, np.float64),
        face_vertex_counts=np.array([len(face) for face in faces], np.int32),
        face_vertex_indices=np.concatenate(faces).astype(np.int32),
        corner_normals=None,
        hole_faces=np.array(holes, np.int32),
        reflectance=np.asarray(reflectance, np.float32),
        double_sided=double_sided,
        flip_winding=False,
    )


def cube(path, **kwargs):
    """Every edge is a crease: an illumination vertex for each of the 24 corners."""
    points = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    description = mesh(path, points, CUBE_FACES, **kwargs)
    return description, _without_holes(description, np.arange(24))


def grid(path, *, unused_points=0, **kwargs):
    """Two by two flat quads: an illumination vertex for each of the 9 points."""
    points = [(x, y, 0) for y in range(3) for x in range(3)] + [(9, 9, 9)] * unused_points
    faces = [[i, i + 1, i + 4, i + 3] for i in (0, 1, 3, 4)]
    description = mesh(path, points, faces, **kwargs)
    return description, _without_holes(description, description.face_vertex_indices)


def _without_holes(description, corner_vertices):
    """-1 at the corners of holes; the vertices that are left count from 0 without gaps."""
    faces = np.repeat(np.arange(len(description.face_vertex_counts)), 4)
    surface = ~np.isin(faces, description.hole_faces)
    numbered = np.full(len(faces), -1, np.int32)
    numbered[surface] = np.unique(corner_vertices[surface], return_inverse=True)[1]
    return numbered


def scene_of(meshes):
    return SceneDescription(
        meshes=tuple(meshes),
        luminaires=(),
        findings=(),
        meters_per_unit=1.0,
        up_axis="Z",
        time_code=None,
        source_hash="f00d",
    )


def solution_of(parts, index=1, **stage):
    """Random illuminances, other ones in each stage. parts : (mesh, corner_vertices) of each."""
    rng = np.random.default_rng(index)
    layouts, start = {}, 0
    for description, corner_vertices in parts:
        count = corner_vertices.max(initial=-1) + 1
        front = slice(start, start + count)
        back = slice(front.stop, front.stop + count * description.double_sided)
        layouts[description.path] = MeshLayout(front, back, corner_vertices)
        start = back.stop
    numbers = {
        "index": index,
        "component": "DEPT",
        "photons": 2**40 + index,
        "rays": 3 * 2**40,
        "shadow_rays": 5 * 2**40,
        "indirect_rays": 2**41,
        "elements": 12,
        "elapsed": 0.5 * index,
        "rms_error": 0.1 / index,
        "rms_error_indirect": 0.2 / index,
        "bucket_rms_error": 0.3,
        "bucket_rms_error_indirect": 0.4,
        "batch_rms_error": 0.35,
        "switchover_time": 0.25,
        "switchover_photons": 2**33,
        "second_switchover_time": 0.375,
        "absorbed": 7,
        "back_absorbed": 2,
        "escaped": 1,
    }
    return Solution(
        stage=ProgressiveStage(**(numbers | stage)),
        scene=scene_of(description for description, _ in parts),
        layouts=layouts,
        direct=rng.uniform(1, 500, (start, 3)).astype(np.float32),
        indirect=rng.uniform(1, 500, (start, 3)).astype(np.float32),
        relative_deviation=rng.uniform(0, 0.3, start).astype(np.float32),
        support_radius=np.full(start, 0.1, np.float32),
        vertex_areas=rng.uniform(0.5, 2, start),
    )


def source_stage(path, parts):
    """The stage on disk that the meshes were read of."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    for description, _ in parts:
        prim = UsdGeom.Mesh.Define(stage, Sdf.Path(description.path))
        prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(description.points.astype(np.float32)))
        prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(description.face_vertex_counts))
        prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(description.face_vertex_indices))
        prim.CreateDoubleSidedAttr(description.double_sided)
        prim.CreateSubdivisionSchemeAttr("none")
        extent = description.points[description.face_vertex_indices]
        prim.CreateExtentAttr([tuple(extent.min(0)), tuple(extent.max(0))])
    stage.Save()
    return stage
