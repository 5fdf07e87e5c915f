"""Skinned meshes: the pose against UsdSkel's own baking, and against rotations by hand."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel

from isolux import ProgressiveSolver, SolverSettings, read_stage
from isolux.results import ResultsWriter
from usda_stage import INFLUENCES, METRES, found, open_usda

IDENTITY = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))"
ELBOW = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(2,0,0,1))"
RIGID = """
    int[] primvars:skel:jointIndices = [1] ( interpolation = "constant" )
    float[] primvars:skel:jointWeights = [1] ( interpolation = "constant" )
"""
BULGE = """
    uniform token[] skel:blendShapes = ["bulge"]
    rel skel:blendShapeTargets = </Up/Root/Arm/Bulge>
    def BlendShape "Bulge" {
        uniform vector3f[] offsets = [(0, 0, 1)]
        uniform int[] pointIndices = [1]
        uniform vector3f[] inbetweens:half = [(0, 0, 3)] ( weight = 0.5 )
    }
"""
NORMALS = 'normal3f[] normals = [{}] ( interpolation = "{}" )'
VERTEX_NORMALS = NORMALS.format(", ".join(["(0, 0, 1)"] * 6), "vertex")
CORNER_NORMALS = NORMALS.format(", ".join(["(0, 0, 1)"] * 8), "faceVarying")


def arm(body, applied='( prepend apiSchemas = ["SkelBindingAPI"] )', root="SkelRoot"):
    """Two flat quads from x = 0 to 4, the elbow at x = 2 bends by 90 degrees from time 1 to 11."""
    return f"""
    def Xform "Up" {{
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def {root} "Root" {{
            float3 xformOp:rotateXYZ = (0, 0, 30)
            uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
            def Skeleton "Skeleton" ( prepend apiSchemas = ["SkelBindingAPI"] ) {{
                uniform token[] joints = ["Arm", "Arm/Elbow"]
                uniform matrix4d[] bindTransforms = [{IDENTITY}, {ELBOW}]
                uniform matrix4d[] restTransforms = [{IDENTITY}, {ELBOW}]
                rel skel:animationSource = </Up/Root/Bend>
                double3 xformOp:translate = (1, 0, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }}
            def SkelAnimation "Bend" {{
                uniform token[] joints = ["Arm", "Arm/Elbow"]
                float3[] translations = [(0, 0, 0), (2, 0, 0)]
                half3[] scales = [(1, 1, 1), (1, 1, 1)]
                quatf[] rotations.timeSamples = {{
                    1: [(1, 0, 0, 0), (1, 0, 0, 0)],
                    11: [(1, 0, 0, 0), (0.70710678, 0, 0.70710678, 0)],
                }}
                uniform token[] blendShapes = ["bulge"]
                float[] blendShapeWeights.timeSamples = {{ 1: [0], 11: [0.75] }}
            }}
            def Mesh "Arm" {applied} {{
                rel skel:skeleton = </Up/Root/Skeleton>
                int[] faceVertexCounts = [4, 4]
                int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
                point3f[] points = [(0,0,0), (2,0,0), (4,0,0), (0,1,0), (2,1,0), (4,1,0)]
                uniform token subdivisionScheme = "none"
                double3 xformOp:translate = (7, 7, 7)
                uniform token[] xformOpOrder = ["xformOp:translate"]
                {body}
            }}
        }}
    }}
    """


def baked(stage, time):
    """World points of the arm by UsdSkel.BakeSkinning on a copy."""
    copy = Usd.Stage.Open(stage.Flatten())
    UsdSkel.BakeSkinning(UsdSkel.Root(copy.GetPrimAtPath("/Up/Root")), Gf.Interval(1, 11))
    prim = copy.GetPrimAtPath("/Up/Root/Arm")
    matrix = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim))
    points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(time), float)
    return points @ matrix[:3, :3] + matrix[3, :3]


@pytest.mark.parametrize("time", [1, 11])  # where the animation has samples, baking has too
@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
@pytest.mark.parametrize(
    "body",
    [INFLUENCES, RIGID, BULGE, INFLUENCES + BULGE, RIGID + BULGE],
    ids=["linear", "rigid", "blend shape", "linear and blend shape", "rigid and blend shape"],
)
def test_the_pose_is_that_of_usds_own_baking(body, method, time):
    body += f'uniform token primvars:skel:skinningMethod = "{method}"\n'
    body += f"matrix4d primvars:skel:geomBindTransform = {ELBOW}\n"
    stage = open_usda(arm(body))
    scene = read_stage(stage, time)
    np.testing.assert_allclose(scene.meshes[0].points, baked(stage, time), atol=1e-6)
    assert ("/Up/Root/Arm", "SkelBindingAPI", "noted") in found(scene)


@pytest.mark.parametrize("time", [1, 11])
def test_a_subdivision_surface_is_refined_from_its_posed_cage(time):
    smooth = arm(INFLUENCES).replace('"none"', '"catmullClark"')
    stage = open_usda(smooth)
    copy = Usd.Stage.Open(stage.Flatten())
    UsdSkel.BakeSkinning(UsdSkel.Root(copy.GetPrimAtPath("/Up/Root")), Gf.Interval(1, 11))
    posed, explicit = (read_stage(of, time).meshes[0] for of in (stage, copy))
    assert len(posed.points) > 6 or time == 1  # flat there: the cage is the limit
    np.testing.assert_allclose(posed.points, explicit.points, atol=1e-6)


def test_halfway_the_elbow_has_bent_by_45_degrees():
    """Linear blending: a point of the forearm turns by 45 degrees about the elbow at x = 2."""
    mesh = read_stage(open_usda(arm(INFLUENCES)), 6).meshes[0]
    at_rest = open_usda(arm(""))
    skeleton = at_rest.GetPrimAtPath("/Up/Root/Skeleton")
    turn = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(skeleton))
    tip = np.array([2 + 2 * np.cos(np.pi / 4), 0, -2 * np.sin(np.pi / 4)])
    np.testing.assert_allclose(mesh.points[2], tip @ turn[:3, :3] + turn[3, :3], atol=1e-6)


def test_inbetweens_are_passed_on_the_way_to_a_blend_shape():
    """Weight 0.375 lies at three quarters of the way to the inbetween: 0.75 times 3 up."""
    flat, bulged = (read_stage(open_usda(arm(BULGE)), time).meshes[0].points for time in (1, 6))
    np.testing.assert_allclose(bulged[1] - flat[1], (0, 0, 0.75 * 3), atol=1e-6)
    np.testing.assert_allclose(np.delete(bulged, 1, 0), np.delete(flat, 1, 0))


@pytest.mark.parametrize("normals", [VERTEX_NORMALS, CORNER_NORMALS])
@pytest.mark.parametrize("influences", [INFLUENCES, RIGID])
def test_normals_turn_with_the_joints(influences, normals):
    """The far edge is the forearm's alone: its normal is the forearm's after 90 degrees."""
    mesh = read_stage(open_usda(arm(influences + normals)), 11).meshes[0]
    far = np.isin(mesh.face_vertex_indices, (2, 5))
    along_x = np.array([np.cos(np.pi / 6), 0.5, 0])  # the root is turned by 30 degrees
    np.testing.assert_allclose(mesh.corner_normals[far], [along_x] * far.sum(), atol=1e-6)


def test_a_mesh_may_have_its_own_order_of_joints():
    """Weights that belong to the elbow go to it, points and normals alike."""
    swapped = INFLUENCES.replace("0,1, 0,1, 0,1, 0,1, 0,1, 0,1", "1,0, 1,0, 1,0, 1,0, 1,0, 1,0")
    own_order = 'uniform token[] skel:joints = ["Arm/Elbow", "Arm"]\n'
    expected = read_stage(open_usda(arm(INFLUENCES + VERTEX_NORMALS)), 11).meshes[0]
    found_mesh = read_stage(open_usda(arm(swapped + own_order + VERTEX_NORMALS)), 11).meshes[0]
    np.testing.assert_allclose(found_mesh.points, expected.points, atol=1e-6)
    np.testing.assert_allclose(found_mesh.corner_normals, expected.corner_normals, atol=1e-6)


def test_normals_that_blend_shapes_have_outdated_are_not_used():
    scene = read_stage(open_usda(arm(BULGE + VERTEX_NORMALS)), 11)
    assert scene.meshes[0].corner_normals is None
    assert ("/Up/Root/Arm", "normals", "approximated") in found(scene)
    scene = read_stage(open_usda(arm(BULGE + VERTEX_NORMALS)), 1)
    assert scene.meshes[0].corner_normals is not None


APPLIED = '( prepend apiSchemas = ["SkelBindingAPI"] )'


@pytest.mark.parametrize(
    ("body", "applied", "root"),
    [
        (INFLUENCES, "", "SkelRoot"),
        (INFLUENCES, APPLIED, "Xform"),
        (INFLUENCES.replace("[0,1, 0,1,", "[0,1,"), APPLIED, "SkelRoot"),
        (INFLUENCES.replace("[0,1, 0,1,", "[0,1, 0,1000000000,"), APPLIED, "SkelRoot"),
        (INFLUENCES.replace("[0,1, 0,1,", "[0,1, -1,1,"), APPLIED, "SkelRoot"),
        (INFLUENCES.replace("elementSize = 2", "elementSize = -2"), APPLIED, "SkelRoot"),
        (INFLUENCES.replace("elementSize = 2", "elementSize = 1000000000"), APPLIED, "SkelRoot"),
        (INFLUENCES.replace('"vertex"', '"faceVarying"'), APPLIED, "SkelRoot"),
        (RIGID.replace("[1]", "[1000000000]"), APPLIED, "SkelRoot"),
        (RIGID.replace("[1]", "[]"), APPLIED, "SkelRoot"),
    ],
    ids=[
        "no API",
        "no SkelRoot",
        "too few influences",
        "no such joint",
        "negative joint",
        "negative count of influences",
        "huge count of influences",
        "influences by corner",
        "rigid, no such joint",
        "rigid, no joint",
    ],
)
def test_a_mesh_without_a_usable_binding_stays_at_rest_and_says_so(body, applied, root):
    scene = read_stage(open_usda(arm(body + VERTEX_NORMALS, applied, root)), 11)
    assert ("/Up/Root/Arm", "SkelBindingAPI", "approximated") in found(scene)
    assert ("/Up/Root/Arm", "SkelBindingAPI", "noted") not in found(scene)
    mesh = scene.meshes[0]
    np.testing.assert_allclose(mesh.points[:, 2], 5 + 7, atol=1e-9)  # by its own transform
    np.testing.assert_allclose(mesh.corner_normals, [(0, 0, 1)] * 8, atol=1e-6)


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_a_pose_that_is_not_finite_is_skipped(number):
    scene = read_stage(open_usda(arm(INFLUENCES.replace("[1,0,", f"[{number},0,"))), 11)
    assert scene.meshes == ()
    assert ("/Up/Root/Arm", "Mesh", "skipped") in found(scene)


@pytest.mark.parametrize("index", ["1000000000", "-1"])
def test_blend_shapes_of_other_points_are_left_out(index):
    scene = read_stage(open_usda(arm(BULGE.replace("[1]", f"[{index}]"))), 11)
    assert ("/Up/Root/Arm", "BlendShape", "approximated") in found(scene)
    assert np.ptp(scene.meshes[0].points[:, 2]) == 0


LAMP = """def SphereLight "Lamp" {
    double3 xformOp:translate = (0, 0, 9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float inputs:intensity = 300
}"""


@pytest.mark.parametrize("output_mode", ["vertex", "refined"])
@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_results_show_the_pose_at_the_time_of_the_light(tmp_path, output_mode, scheme):
    """Vertex results leave the skeleton at work, refined ones freeze the pose."""
    source = tmp_path / "arm.usda"
    source.write_text(
        "#usda 1.0\n"
        + METRES
        + arm(INFLUENCES + VERTEX_NORMALS).replace('"none"', f'"{scheme}"')
        + LAMP
    )
    scene = read_stage(source, 11)
    writer = ResultsWriter(source, tmp_path / "out.usda", scene, {})
    settings = SolverSettings(
        output_mode=output_mode, subdivision_threshold=0.002, stages=3
    ).with_budget(photons=20000)
    for solution in ProgressiveSolver(scene, settings).stages():
        writer.write(solution)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    points = baked(stage, 11)
    if output_mode == "vertex":
        np.testing.assert_array_equal(points, baked(Usd.Stage.Open(str(source)), 11))
        return
    solved = scene.meshes[0].points
    assert len(points) > len(solved)
    np.testing.assert_allclose(points[: len(solved)], solved, atol=1e-5)
