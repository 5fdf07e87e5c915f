"""Shapes given by numbers: where they lie, what area they have, what their results look like."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from isolux import ProgressiveSolver, SolverSettings, read_stage
from isolux.gprim_shapes import SEGMENTS_AROUND
from isolux.mesh_topology import MeshTopology
from isolux.results import ResultsWriter
from usda_stage import found, open_usda, read_usda

PI = np.pi
CONE_SLANT = np.hypot(3.0, 4.0)
# Attributes, area by closed form, extent along Z for axis Z.
SHAPES = {
    "Sphere": ("double radius = 3", 4 * PI * 9, (-3, 3)),
    "Cube": ("double size = 3", 6 * 9, (-1.5, 1.5)),
    "Cylinder": ("double radius = 3\n double height = 4", 2 * PI * 3 * (4 + 3), (-2, 2)),
    "Cone": ("double radius = 3\n double height = 4", PI * 3 * (3 + CONE_SLANT), (-2, 2)),
    "Capsule": ("double radius = 3\n double height = 4", 2 * PI * 3 * 4 + 4 * PI * 9, (-5, 5)),
    "Plane": ("double width = 3\n double length = 5", 15, (0, 0)),
    "Cylinder_1": (
        "double radiusBottom = 4\n double radiusTop = 1\n double height = 4",
        PI * (16 + 1 + (4 + 1) * 5),
        (-2, 2),
    ),
    "Capsule_1": (
        "double radiusBottom = 4\n double radiusTop = 1\n double height = 4",
        # The side touches spheres of radius 5 and 1.25 at heights -2 and 2: two zones, a frustum.
        PI * (2 * 5 * 8 + 2 * 1.25 * 0.5 + (4 + 1) * 5),
        (-10, 2.5),
    ),
}
HAS_AXIS = {"Cylinder", "Cone", "Capsule", "Plane", "Cylinder_1", "Capsule_1"}


def shape(kind, extra="", name="Shape"):
    return f'def {kind} "{name}" {{\n{SHAPES[kind][0]}\n{extra}\n}}\n'


def faces_of(mesh):
    """Area vector of each face by its front, its first point."""
    topology = MeshTopology(mesh.face_vertex_counts, mesh.face_vertex_indices, len(mesh.points))
    areas = topology.face_normals(mesh.points, np.arange(len(topology.counts))) / 2
    return areas * (-1 if mesh.flip_winding else 1), mesh.points[topology.indices[topology.starts]]


def area(mesh):
    return np.linalg.norm(faces_of(mesh)[0], axis=1).sum()


@pytest.mark.parametrize("kind", SHAPES)
def test_area_is_that_of_the_shape_to_four_thousandths(kind):
    mesh = read_usda(shape(kind)).meshes[0]
    exact = SHAPES[kind][1]
    short = 1 - area(mesh) / exact
    assert (abs(short) < 1e-12) if kind in ("Cube", "Plane") else (0 < short < 4e-3)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", SHAPES)
def test_extent_is_what_usd_computes(kind, axis):
    stage = open_usda(shape(kind, f'uniform token axis = "{axis}"' if kind in HAS_AXIS else ""))
    boundable = UsdGeom.Boundable(stage.GetPrimAtPath("/Shape"))
    expected = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode.Default())
    points = read_stage(stage).meshes[0].points
    # The widest circle of a tapered capsule lies between two circles of corners.
    rtol = 1 - np.cos(PI / SEGMENTS_AROUND) if kind == "Capsule_1" else 0
    np.testing.assert_allclose([points.min(0), points.max(0)], expected, rtol, atol=1e-6)


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", sorted(HAS_AXIS))
def test_the_top_is_up_the_axis(kind, axis):
    mesh = read_usda(shape(kind, f'uniform token axis = "{axis}"')).meshes[0]
    heights = mesh.points[:, "XYZ".index(axis)]
    assert (heights.min(), heights.max()) == SHAPES[kind][2]


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("kind", sorted(set(SHAPES) - {"Plane"}))
def test_fronts_and_normals_point_outward_unless_left_handed(kind, orientation, mirror):
    extra = f"""uniform token orientation = "{orientation}"
        double3 xformOp:translate = (10, 20, 30)
        float3 xformOp:scale = ({mirror}, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]"""
    mesh = read_usda(shape(kind, extra)).meshes[0]
    outward = 1 if orientation == "rightHanded" else -1
    areas, corners = faces_of(mesh)
    centre = np.array([10, 20, 30])
    assert np.allclose(areas.sum(axis=0), 0, atol=1e-9)  # closed
    assert (outward * np.einsum("ij,ij->i", areas, corners - centre) > 0).all()
    at_corners = np.repeat(areas, mesh.face_vertex_counts, axis=0)
    assert (np.einsum("ij,ij->i", at_corners, mesh.corner_normals) > 0).all()


def test_normals_of_a_sphere_are_exact_at_every_corner():
    mesh = read_usda(shape("Sphere")).meshes[0]
    np.testing.assert_allclose(
        mesh.corner_normals, mesh.points[mesh.face_vertex_indices] / 3, atol=1e-6
    )


def test_normals_of_a_cone_are_exact_and_its_apex_has_one_a_face():
    mesh = read_usda(shape("Cone")).meshes[0]
    side = np.abs(mesh.corner_normals[:, 2] + 1) > 1e-6
    # Along the side radius falls by 3 on a height of 4: the normal rises by 3 in 5.
    np.testing.assert_allclose(mesh.corner_normals[side, 2], 3 / 5, atol=1e-6)
    apex = mesh.points[mesh.face_vertex_indices][:, 2] == 2
    assert len(np.unique(mesh.corner_normals[apex].round(5), axis=0)) == apex.sum()
    np.testing.assert_allclose(mesh.corner_normals[apex].sum(axis=0)[:2], 0, atol=1e-5)


def test_a_capsule_is_smooth_where_its_caps_begin():
    mesh = read_usda(shape("Capsule")).meshes[0]
    at_seam = np.isclose(np.abs(mesh.points[mesh.face_vertex_indices][:, 2]), 2)
    np.testing.assert_allclose(mesh.corner_normals[at_seam, 2], 0, atol=1e-6)


@pytest.mark.parametrize(
    ("axis", "normal", "sizes"),
    [("Z", (0, 0, 1), (3, 5, 0)), ("Y", (0, 1, 0), (3, 0, 5)), ("X", (1, 0, 0), (0, 5, 3))],
)
def test_a_plane_faces_up_its_axis_with_width_and_length_as_the_schema_says(axis, normal, sizes):
    mesh = read_usda(shape("Plane", f'uniform token axis = "{axis}"')).meshes[0]
    np.testing.assert_allclose(faces_of(mesh)[0].sum(axis=0), np.array(normal) * 15)
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), sizes)
    assert mesh.double_sided  # by the schema's fallback


@pytest.mark.parametrize(
    ("prim", "reason"),
    [
        ('def Capsule_1 "A" {\n double height = 0\n double radiusTop = 1\n}', "height 0"),
        ('def Sphere "A" {\n double radius = 0\n}', "radius 0"),
        ('def Sphere "A" {\n double radius = -1\n}', "radius -1"),
        ('def Cube "A" {\n double size = nan\n}', "size nan"),
        ('def Cylinder "A" {\n double height = inf\n}', "height inf"),
        ('def Sphere "A" {\n string radius = "3"\n}', "radius '3'"),
        ('def Cube "A" {\n double size = 1e300\n}', "size 1e+300"),
        ('def Sphere "A" {\n double radius = 1e-310\n}', "radius 1e-310"),
        ('def Cone "A" {\n double radius = 1e20\n}', "over 10⁹ m away"),
        ('def Cone "A" {\n uniform token axis = "W"\n}', "axis W"),
        ('def Cylinder_1 "A" {\n double radiusTop = 0\n double radiusBottom = 0\n}', "0"),
        ('def TetMesh "A" {\n}', "no faces"),
        (
            'def TetMesh "A" {\n point3f[] points = [(0, 0, 0)]\n'
            " int4[] tetVertexIndices = [(0, 1, 2, 1000000000)]\n}",
            "a corner at point 1000000000 of 1 points",
        ),
        ('def BasisCurves "A" {\n}', "no surface"),
        ('def HermiteCurves "A" {\n}', "no surface"),
        ('def NurbsCurves "A" {\n}', "no surface"),
        ('def NurbsPatch "A" {\n}', "no surface"),
        ('def Points "A" {\n}', "no surface"),
        ('def Volume "A" {\n}', "no surface"),
    ],
)
def test_what_has_no_surface_to_read_is_skipped_by_name(prim, reason):
    scene = read_usda(prim)
    assert scene.meshes == ()
    assert found(scene) == [("/A", prim.split()[1], "skipped")]
    assert reason in scene.findings[0].reason


def test_tetrahedra_are_read_as_their_skin():
    """Two of them that share a face: six faces are left, and the volume by the divergence."""
    scene = read_usda("""def TetMesh "A" {
        point3f[] points = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (0, 0, -2)]
        int4[] tetVertexIndices = [(0, 1, 2, 3), (0, 2, 1, 4)]
    }""")
    areas, corners = faces_of(scene.meshes[0])
    assert len(areas) == 6
    assert np.einsum("ij,ij->", areas, corners) / 3 == pytest.approx(2 * 8 / 6)


def test_a_material_and_a_moving_radius_are_those_of_the_gprim():
    scene = read_usda(
        """def Sphere "Ball" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            double radius.timeSamples = { 1: 1, 3: 3 }
            rel material:binding = </Red>
        }
        def Material "Red" {
            token outputs:surface.connect = </Red/S.outputs:surface>
            def Shader "S" {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.5, 0.1, 0.1)
                token outputs:surface
            }
        }""",
        time_code=2.0,
    )
    ball = scene.meshes[0]
    np.testing.assert_allclose(ball.reflectance, [[0.5, 0.1, 0.1]])
    assert ball.points.max() == pytest.approx(2)
    assert found(scene) == [("/Ball", "Sphere", "approximated"), ("/Ball", "animation", "noted")]


def test_a_skinned_gprim_says_that_it_is_not_posed():
    scene = read_usda("""def Sphere "Ball" ( prepend apiSchemas = ["SkelBindingAPI"] ) {
        int[] primvars:skel:jointIndices = [0] ( interpolation = "constant" )
    }""")
    assert ("/Ball", "SkelBindingAPI", "approximated") in found(scene)


ROOM = """
def Plane "Floor" {
    double width = 10
    double length = 10
    color3f[] primvars:displayColor = [(0.5, 0.4, 0.3)]
}
def Xform "Group" {
    float3 xformOp:scale = (-1, 1, 2)
    double3 xformOp:translate = (1, 1, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    def Sphere "Ball" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
        double radius = 0.5
        rel material:binding = </Red>
        float[] primvars:wet = [1, 2, 3] ( interpolation = "vertex" )
    }
}
def Material "Red" {
}
def SphereLight "Lamp" {
    double3 xformOp:translate = (-2, 0, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float inputs:intensity = 100
}
"""


@pytest.mark.parametrize("output_mode", ["vertex", "refined"])
def test_results_make_the_gprim_a_mesh_at_its_place(tmp_path, output_mode):
    source = tmp_path / "room.usda"
    source.write_text('#usda 1.0\n(\n metersPerUnit = 0.5\n upAxis = "Z"\n)\n' + ROOM)
    scene = read_stage(source)
    writer = ResultsWriter(source, tmp_path / "out.usda", scene, {})
    settings = SolverSettings(output_mode=output_mode, stages=3).with_budget(photons=20000)
    for solution in ProgressiveSolver(scene, settings).stages():
        writer.write(solution)
    assert [finding.kind for finding in writer.findings] == ["primvars:wet"]
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    transforms = UsdGeom.XformCache()
    for description in scene.meshes:
        prim = stage.GetPrimAtPath(description.path)
        assert prim.IsDefined() and prim.IsA(UsdGeom.Mesh)
        mesh = UsdGeom.Mesh(prim)
        points, indices = (
            np.array(mesh.GetPointsAttr().Get()),
            np.array(mesh.GetFaceVertexIndicesAttr().Get()),
        )
        world = points.astype(float)
        matrix = np.array(transforms.GetLocalToWorldTransform(prim))
        world = (world @ matrix[:3, :3] + matrix[3, :3]) * 0.5
        assert UsdGeom.Mesh.ValidateTopology(
            mesh.GetFaceVertexIndicesAttr().Get(),
            mesh.GetFaceVertexCountsAttr().Get(),
            len(points),
        )[0]
        if output_mode == "vertex":
            np.testing.assert_allclose(world, description.points, atol=1e-6)
        np.testing.assert_allclose(
            [world.min(0), world.max(0)],
            [description.points.min(0), description.points.max(0)],
            atol=1e-6,
        )
        normals = np.array(mesh.GetNormalsAttr().Get())
        assert str(mesh.GetNormalsInterpolation()) == "faceVarying"
        assert len(normals) == len(indices)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
        if description.path == "/Group/Ball":
            # The inner prim is a sphere about its own origin.
            cosine = np.einsum("ij,ij->i", normals, points[indices]) / np.linalg.norm(
                points[indices], axis=1
            )
            assert cosine.min() > 0.999
        illuminance = UsdGeom.PrimvarsAPI(prim).GetPrimvar("isolux:illuminance")
        values = np.array(illuminance.ComputeFlattened(3.0))
        wanted = {"vertex": len(points), "faceVarying": len(indices)}
        assert len(values) == wanted[illuminance.GetInterpolation()]
        assert values.max() > 0
        assert mesh.GetDoubleSidedAttr().Get() == (description.path == "/Floor")
    bound, _ = UsdShade.MaterialBindingAPI(
        stage.GetPrimAtPath("/Group/Ball")
    ).ComputeBoundMaterial()
    assert str(bound.GetPath()) == "/Red"
    assert not stage.GetPrimAtPath("/Group/Ball").GetAttribute("primvars:wet").HasValue()
