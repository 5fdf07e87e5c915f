"""Closed rooms whose wall is a subdivision surface: flux is kept on its limit surface."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from cages import CUBE_EDGES, CUBE_FACES, CUBE_POINTS, mesh_usda, triangles
from isolux.results import ResultsWriter
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import ProgressiveSolver
from isolux.stage_reader import read_stage
from small_room import write_stage
from validation.rows import GLOBAL

pytestmark = pytest.mark.validation(GLOBAL)

LAMP = """    def SphereLight "Lamp" {
        float inputs:intensity = 1000
        float inputs:radius = 0.1
    }
"""
REFLECTANCE = 0.6
PHOTONS = 60_000
INWARD = [face[::-1] for face in CUBE_FACES]
SHARP = "; ".join(
    [
        f"int[] creaseIndices = {[p for edge in CUBE_EDGES for p in edge]}",
        f"int[] creaseLengths = {[2] * 12}",
        f"float[] creaseSharpnesses = {[10] * 12}",
    ]
)
SIGMA = np.sqrt(REFLECTANCE / PHOTONS)
ROOMS = pytest.mark.parametrize(
    ("faces", "scheme", "extra", "area"),
    [
        (INWARD, "catmullClark", "", None),
        (triangles(INWARD), "loop", "", None),
        (INWARD, "bilinear", "", 9 * 24.0),
        (INWARD, "catmullClark", SHARP, 9 * 24.0),
    ],
    ids=["catmullClark", "loop", "bilinear", "sharp"],
)


def solved_room(folder, faces, scheme, extra, area):
    """The stage, its solution, and E = Φ / (A (1 - ρ)), the mean over the wall; see test_furnace.

    area : m², of the wall; None: not known
    """
    colour = f"color3f[] primvars:displayColor = [({REFLECTANCE}, {REFLECTANCE}, {REFLECTANCE})]"
    cage = mesh_usda(3 * CUBE_POINTS, faces, f"{colour}; {extra}", scheme)
    stage = Usd.Stage.Open(str(write_stage(folder / "room.usda", cage, LAMP)))
    scene = read_stage(stage)
    settings = SolverSettings(photons=PHOTONS, target_error=0, method="dept", threads=1)
    *_, solution = ProgressiveSolver(scene, settings).stages()
    wall = solution.vertex_areas.sum()
    if area:
        assert wall == pytest.approx(area, rel=1e-9)
    return stage, solution, scene.luminous_flux / (wall * (1 - REFLECTANCE))


@ROOMS
def test_mean_illuminance_of_a_closed_subdivided_room(tmp_path, faces, scheme, extra, area):
    """Whatever its form."""
    _, solution, expected = solved_room(tmp_path, faces, scheme, extra, area)
    assert solution.mean_illuminance("/World/Cage") == pytest.approx(expected, rel=4 * SIGMA)


@ROOMS
@pytest.mark.usefixtures("undivided")
def test_the_cages_primvar_has_that_mean_on_the_limit_surface(tmp_path, faces, scheme, extra, area):
    """Of a mesh that isn't divided, whose vertices alone tell the light of all of it."""
    stage, solution, expected = solved_room(tmp_path, faces, scheme, extra, area)
    assert solution.mean_illuminance("/World/Cage") == pytest.approx(expected, rel=4 * SIGMA)
    (mesh,) = solution.scene.meshes
    writer = ResultsWriter(stage, tmp_path / "out.usda", solution.scene, {})
    writer.write(solution)
    results = Usd.Stage.Open(str(tmp_path / "out.usda"))
    primvar = UsdGeom.PrimvarsAPI(results.GetPrimAtPath("/World/Cage")).GetPrimvar(
        "isolux:illuminance"
    )
    interpolation = primvar.GetInterpolation()
    indices = np.array(primvar.GetIndices(), np.int32) if primvar.IsIndexed() else None
    surface = mesh.cage.refine()
    values = surface.refine_primvar(
        np.array(primvar.Get(), float) @ LUMINANCE_WEIGHTS[:, None], interpolation, indices
    )
    corners = surface.topology.to_corners(values, interpolation)[:, 0]
    first = np.unique(solution.layouts["/World/Cage"].corner_vertices, return_index=True)[1]
    mean = np.average(corners[first], weights=solution.vertex_areas)
    assert mean == pytest.approx(expected, rel=0.001 + 4 * SIGMA)
