"""Light on shapes given by numbers, by closed forms."""

import numpy as np
import pytest

from isolux import ProgressiveSolver, SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from usda_stage import read_usda
from validation.rows import GLOBAL

pytestmark = pytest.mark.validation(GLOBAL)

LAMP = """def SphereLight "Lamp" {
    float inputs:radius = 0.02
    float inputs:intensity = 1000
}
"""


def last_solution(scene, **settings):
    chosen = SolverSettings(**{"stages": 4, **settings}).with_budget(photons=400_000)
    return list(ProgressiveSolver(scene, chosen).stages())[-1]


SPHERES = pytest.mark.parametrize(
    ("reflectance", "mirror"), [(r, m) for r in (0.0, 0.5, 0.8) for m in (1, -1)]
)


def in_a_sphere(reflectance, mirror):
    """Solved, and E = flux / (A (1 - rho)); A of the polygons, 0.36 % below that of the sphere."""
    scene = read_usda(
        f"""def Sphere "Ball" {{
            double radius = 2
            uniform token orientation = "leftHanded"
            color3f[] primvars:displayColor = [({reflectance}, {reflectance}, {reflectance})]
            float3 xformOp:scale = ({mirror}, 1, 1)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }}
        """
        + LAMP
    )
    solution = last_solution(scene, method="dept")
    area = solution.vertex_areas.sum()
    assert 1 - area / (16 * np.pi) == pytest.approx(0.0036, abs=1e-4)
    expected = scene.luminous_flux / (area * (1 - reflectance))
    return solution, expected


def rms_in_told_deviations(solution, expected):
    everywhere = (solution.direct + solution.indirect) @ LUMINANCE_WEIGHTS
    deviations = (everywhere / expected - 1) / solution.relative_deviation
    return np.sqrt(np.mean(deviations**2))


@SPHERES
def test_a_sphere_seen_from_inside_is_an_integrating_sphere(validation, reflectance, mirror):
    solution, expected = in_a_sphere(reflectance, mirror)
    case = f"Sphere prim of ρ {reflectance}, scaled by ({mirror}, 1, 1), mean light, dept"
    validation.check(case, expected, solution.mean_illuminance("/Ball"), relative=0.005)
    # Of buckets so fine the filter tells up to twice its error; undivided spheres of as many
    # elements the same.
    assert 0.5 < rms_in_told_deviations(solution, expected) < 1.3


@SPHERES
@pytest.mark.usefixtures("undivided")
def test_the_deviation_told_of_an_undivided_sphere_is_the_true_one(reflectance, mirror):
    solution, expected = in_a_sphere(reflectance, mirror)
    assert solution.mean_illuminance("/Ball") == pytest.approx(expected, rel=0.005)
    assert rms_in_told_deviations(solution, expected) == pytest.approx(1, abs=0.3)


def test_a_plane_under_a_small_lamp_has_the_illuminance_of_the_cosine_law():
    """E = I cos(theta) / d^2, with I = flux / 4 pi of a small sphere."""
    lamp = LAMP.replace(
        "float inputs:radius",
        "double3 xformOp:translate = (0, 0, 1)\n"
        ' uniform token[] xformOpOrder = ["xformOp:translate"]\n float inputs:radius',
    )
    scene = read_usda('def Plane "Floor" {\n double width = 4\n double length = 4\n}\n' + lamp)
    solution = last_solution(scene, method="ddl+hpr")
    floor = scene.meshes[0]
    distance = np.linalg.norm(floor.points - (0, 0, 1), axis=1)
    expected = scene.luminous_flux / (4 * np.pi) / distance**3
    baked = np.zeros(len(floor.points))
    baked[floor.face_vertex_indices] = solution.illuminance("/Floor") @ LUMINANCE_WEIGHTS
    np.testing.assert_allclose(baked, expected, rtol=0.01)
