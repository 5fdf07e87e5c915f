"""Direct light on flat surfaces, from each shape of luminaire, against closed forms.

The flux into each bucket is the closed form's integral over the bucket, so that the counts must be
a multinomial sample of it: χ² over all buckets, p above 10⁻³ at the fixed seed. For configuration
factors F the illuminance is M F, M = flux / emitting area.
"""

from functools import partial

import numpy as np
import pytest
from scipy.stats import chisquare
from usd_scenes.shapes import rectangle

from core_scenes import bucket_flux, luminaire, surface, trace
from isolux import _core
from validation.rows import STOCHASTIC

pytestmark = pytest.mark.validation(STOCHASTIC)

FLUX = 1000.0  # lm
PHOTONS = 400_000
HEIGHT = 2.0  # m, of the luminaires above the floor
FLOOR = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25))


def assert_sampled_from(validation, case, traced, expected_flux, mesh=0):
    """χ² of the direct counts of a mesh, and of the photons that went elsewhere."""
    photons = traced.buckets.ends["emitted"]
    counts = traced.hits[traced.front(mesh), 0]
    expected = expected_flux / traced.scene.luminous_flux * photons
    observed = np.append(counts, photons - counts.sum())
    predicted = np.append(expected, photons - expected.sum())
    kept = predicted > 5
    assert predicted[~kept].sum() < 50
    observed, predicted = observed[kept], predicted[kept]
    p = chisquare(observed, predicted * observed.sum() / predicted.sum()).pvalue
    validation.bound(f"{case}, photons, p of χ² over {len(observed)} places", p, at_least=1e-3)


def cosine_power_source(points, normals):
    """CIE 171:2006, case 5.2: I = 1000 cosθ cd at 3 m, E = 9000 / d⁴."""
    return 9000.0 / (points[:, 0] ** 2 + points[:, 1] ** 2 + 9.0) ** 2


def test_point_source_over_a_floor_of_cie_171_case_5_2(validation):
    points = np.array([(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (1.5, 0, 0), (1.5, 1.5, 0)])
    tabulated = [111.11, 105.21, 90.02, 71.11, 49.39]  # lx
    assert cosine_power_source(points, None) == pytest.approx(tabulated, rel=3e-4)

    gamma = np.radians(np.arange(0.0, 90.5, 0.5))
    candela = 1000.0 * np.cos(gamma)
    diagram = _core.CandelaDistribution(gamma, np.zeros(1), candela[None])
    source = luminaire(1000.0 * np.pi, (0, 0, 3), size=(1e-4, 0.0))
    traced = trace([FLOOR], [source], PHOTONS, diagram=diagram)
    flux = bucket_flux(traced, cosine_power_source)
    assert_sampled_from(validation, "CIE 171 case 5.2", traced, flux)


def sphere_factor(points, normals, radius):
    """cosθ (r / d)² above the horizon."""
    d2 = points[:, 0] ** 2 + points[:, 1] ** 2 + HEIGHT**2
    return HEIGHT / np.sqrt(d2) * radius**2 / d2


def disk_factor(points, normals, radius):
    """A parallel disk at a distance a from the point's axis."""
    a = np.hypot(points[:, 0], points[:, 1])
    h, r = HEIGHT / a, radius / a
    z = 1 + h**2 + r**2
    return (1 - (z - 2 * r**2) / np.sqrt(z**2 - 4 * r**2)) / 2


def rectangle_factor(points, normals, width, height):
    """A parallel rectangle: four with a corner above the point, signed."""

    def corner(x, y):
        a, b = x / HEIGHT, y / HEIGHT
        p, q = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
        return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi)

    x, y = points[:, 0], points[:, 1]
    return sum(
        i * j * corner(i * width / 2 - x, j * height / 2 - y) for i in (-1, 1) for j in (-1, 1)
    )


def tube_factor(points, normals, radius, length, along):
    """A thin tube whose middle is above the origin, all of it above the horizon."""
    to_middle = np.array([0.0, 0.0, HEIGHT]) - points
    foot = to_middle - np.outer(to_middle @ along, along)
    d = np.linalg.norm(foot, axis=1)

    def terms(end):
        cosine = end / (d * (d**2 + end**2)) + np.arctan(end / d) / d**2
        return cosine * foot[:, 2] + end**2 / (d * (d**2 + end**2)) * along[2]

    middle = to_middle @ along
    return radius / np.pi * (terms(middle + length / 2) - terms(middle - length / 2))


TILTED = np.array([np.cos(0.5), 0.0, np.sin(0.5)])
TILTED_AXES = np.array([TILTED, (0, 1, 0), np.cross(TILTED, (0, 1, 0))])


@pytest.mark.parametrize(
    ("shape", "size", "axes", "emitting_area", "factor"),
    [
        ("sphere", (0.3, 0.0), None, 4 * np.pi * 0.09, partial(sphere_factor, radius=0.3)),
        ("disk", (0.5, 0.0), None, np.pi * 0.25, partial(disk_factor, radius=0.5)),
        ("rect", (1.2, 0.6), None, 0.72, partial(rectangle_factor, width=1.2, height=0.6)),
        (
            *("cylinder", (0.005, 1.5), None, 2 * np.pi * 0.005 * 1.5),
            partial(tube_factor, radius=0.005, length=1.5, along=np.array([1.0, 0.0, 0.0])),
        ),
        (
            *("cylinder", (0.005, 1.5), TILTED_AXES, 2 * np.pi * 0.005 * 1.5),
            partial(tube_factor, radius=0.005, length=1.5, along=TILTED),
        ),
    ],
    ids=["sphere", "disk", "rect", "cylinder", "tilted cylinder"],
)
def test_light_of_each_shape_on_a_floor(validation, shape, size, axes, emitting_area, factor):
    source = luminaire(FLUX, (0, 0, HEIGHT), shape, size, axes=axes)
    traced = trace([FLOOR], [source], PHOTONS)
    exitance = FLUX / emitting_area
    flux = bucket_flux(traced, lambda p, n: exitance * factor(p, n))
    assert_sampled_from(validation, f"{shape} {size} over a floor", traced, flux)


def polygon_illuminance(corners, luminance, points, normals):
    """Lambert: E = L/2 Σ Γ·n over the edges; the whole polygon above the horizon."""
    total = np.zeros(len(points))
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = first - points, second - points
        cross = np.cross(a, b)
        sine = np.linalg.norm(cross, axis=1)
        angle = np.arctan2(sine, (a * b).sum(axis=1))
        total += np.where(sine > 0, angle / np.maximum(sine, 1e-300), 0) * (cross * normals).sum(1)
    return luminance / 2 * total


@pytest.fixture(scope="module")
def area_light_room():
    """CIE 171:2006, case 5.3: 4 × 4 × 3 m, a source of 1 × 1 m and 1000 cd/m² in the ceiling.

    The source lies in the plane of the ceiling, touching it.
    """
    floor = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25)
    wall = rectangle((2, 2, 0), (0, -4, 0), (0, 0, 3), 0.25)
    ceiling = rectangle((-2, 2, 3), (4, 0, 0), (0, -4, 0), 0.25)
    walls = [wall, wall.turned(z=90), wall.turned(z=180), wall.turned(z=270)]
    meshes = [surface(shape) for shape in (floor, *walls, ceiling)]
    source = luminaire(1000.0 * np.pi, (0, 0, 3), "rect", (1.0, 1.0))
    return trace(meshes, [source], PHOTONS)


def ceiling_source(points, normals):
    corners = np.array([(-0.5, -0.5, 3), (0.5, -0.5, 3), (0.5, 0.5, 3), (-0.5, 0.5, 3)])
    return polygon_illuminance(corners, 1000.0, points, normals)


def test_area_light_of_cie_171_case_5_3(validation, area_light_room):
    heights = np.arange(2.75, 0.0, -0.5)
    on_wall = np.stack([np.full(6, 2.0), np.zeros(6), heights], axis=1)
    exact = [32.677, 75.194, 81.323, 69.061, 53.404, 40.002]
    facing = np.tile([-1.0, 0.0, 0.0], (6, 1))
    assert ceiling_source(on_wall, facing) == pytest.approx(exact, abs=1e-3)

    for mesh in range(5):
        predicted = bucket_flux(area_light_room, ceiling_source, mesh)
        case = f"CIE 171 case 5.3, {'floor' if mesh == 0 else f'wall {mesh}'}"
        assert_sampled_from(validation, case, area_light_room, predicted, mesh)


def test_a_light_that_touches_a_surface_loses_no_flux_to_it(area_light_room):
    assert area_light_room.hits[area_light_room.front(5)].sum() == 0
    assert area_light_room.hits[:, 0].sum() == PHOTONS


def test_without_reflection_all_flux_arrives_as_direct_light(area_light_room):
    """CIE 171:2006, case 5.4: ΣE·A = Φ; and no indirect light at all."""
    assert (area_light_room.illuminance[:, 0] @ area_light_room.areas) == pytest.approx(
        1000.0 * np.pi
    )
    assert not area_light_room.hits[:, 1].any()
    assert not area_light_room.filtered()["indirect"].any()
