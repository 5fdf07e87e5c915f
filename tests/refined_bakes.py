"""Stages baked with refined results: authored, split where asked, and read as any reader does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from hand_built import solution_of
from isolux.results import ResultsWriter
from isolux.stage_reader import read_stage
from split_edges import SplitMesh, every_edge, layouts_of, some_edges

# A linear function of local space, which every interpolation over triangles reproduces.
SLOPES = np.array([[0.3, -1.0, 0.2], [2.0, 0.1, 0.5], [-0.4, 0.7, 1.1]])
OFFSET = np.array([5.0, 6.0, 7.0])

# A pentagon with a dent, a quad and a triangle in one plane; a roof over the quad's edge.
POINTS = [
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1.2, 0), (0, 2, 0),
    (4, 0, 0.5), (4, 2, 0.5), (3, 3, 2),
]  # fmt: skip
FACES = [[0, 1, 2, 3, 4], [1, 5, 6, 2], [2, 6, 7], [3, 2, 7]]
TIME = 5.0


def linear(points):
    return np.asarray(points, float) @ SLOPES + OFFSET


def add_mesh(stage, path, points=POINTS, faces=FACES, **attributes):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.array(points, np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([point for face in faces for point in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))])
    for name, value in attributes.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    return mesh


def add_primvar(mesh, name, type_name, interpolation, values, indices=None, element_size=-1):
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        name, getattr(Sdf.ValueTypeNames, type_name), interpolation, element_size
    )
    primvar.Set(values)
    if indices is not None:
        primvar.SetIndices(indices)
    return primvar


def new_stage(folder, name="room.usda"):
    stage = Usd.Stage.CreateNew(str(folder / name))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


class Bake:
    """A source stage, its solution's refinements, and the results as usd-core reads them."""

    def __init__(self, source, output, *rounds, coarse_stages=1):
        source.GetRootLayer().Save()
        self.scene = read_stage(source)
        self.layouts = layouts_of(self.scene)
        self.split = SplitMesh(self.scene, self.layouts)
        self.meshes = [None] * coarse_stages
        self.writer = ResultsWriter(source, output, self.scene, {})
        self.solutions = []
        for refined in [*[None] * coarse_stages, *rounds]:
            self.add(self.split.split(**refined) if refined else None)
        self.stage = Usd.Stage.Open(str(output))

    def add(self, refined):
        index = len(self.solutions) + 1
        parts = [(mesh, self.layouts[mesh.path].corner_vertices) for mesh in self.scene.meshes]
        solution = solution_of(parts, index)
        if refined is not None:
            solution = replace(
                solution,
                refined=refined,
                direct=refined.interpolate(solution.direct),
                indirect=refined.interpolate(solution.indirect),
                relative_deviation=refined.interpolate(solution.relative_deviation),
            )
        self.writer.write(replace(solution, layouts=self.layouts, scene=self.scene))
        self.solutions.append(solution)

    def mesh(self, path="/World/Mesh"):
        return UsdGeom.Mesh(self.stage.GetPrimAtPath(path))


def bake(source, *rounds, name="baked", **options):
    output = Path(source.GetRootLayer().realPath).with_name(f"{name}.usda")
    return Bake(source, output, *(rounds or ALL_TWICE), **options)


ALL_TWICE = ({"choose": every_edge}, {"choose": every_edge})
SOME = ({"choose": some_edges(1), "fraction": 0.3}, {"choose": some_edges(2), "fraction": 0.6})


def values_at_corners(mesh, name, time=1.0):
    """A primvar at each face corner, as any reader expands it; its count is checked."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
    values = np.array(primvar.ComputeFlattened(time))
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    interpolation = primvar.GetInterpolation()
    points = len(mesh.GetPointsAttr().Get())
    wanted = {"constant": 1, "uniform": len(counts), "faceVarying": len(corners)}
    assert len(values) == wanted.get(interpolation, points) * primvar.GetElementSize()
    if primvar.GetElementSize() > 1:
        values = values.reshape(-1, primvar.GetElementSize(), *values.shape[1:])
    if interpolation == "constant":
        return np.repeat(values, len(corners), axis=0)
    if interpolation == "uniform":
        return np.repeat(values, counts, axis=0)
    return values if interpolation == "faceVarying" else values[corners]


def points_at_corners(mesh):
    return np.array(mesh.GetPointsAttr().Get())[mesh.GetFaceVertexIndicesAttr().Get()]


def assert_readable(stage):
    """What a reader relies on: sound faces; primvars as long as wanted, at all times; families."""
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    for mesh in meshes:
        counts = mesh.GetFaceVertexCountsAttr().Get()
        assert UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(), counts, len(mesh.GetPointsAttr().Get())
        )[0]
        for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
            for time in [Usd.TimeCode.Default(), *primvar.GetTimeSamples()]:
                values_at_corners(mesh, primvar.GetPrimvarName(), time)
        for family in UsdGeom.Subset.GetAllGeomSubsetFamilyNames(mesh):
            assert UsdGeom.Subset.ValidateFamily(mesh, "face", family) == (True, "")
    return len(meshes)


def area_vectors(points, counts, indices):
    """(F, 3) half the cross products of a fan: area times normal by the corner order."""
    corners = np.asarray(points, float)[indices]
    vectors, start = [], 0
    for count in counts:
        face = corners[start : start + count]
        vectors.append(np.cross(face[1:-1] - face[0], face[2:] - face[0]).sum(axis=0) / 2)
        start += count
    return np.array(vectors)
