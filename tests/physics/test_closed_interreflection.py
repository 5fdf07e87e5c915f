"""Interreflection that can be written down: spheres, spheres in spheres, plates; by each method.

On the inside of a sphere each point sees all others alike, dF = dA / A, so that reflected light is
the same everywhere: E = E0 + <ρ E0> / (1 - <ρ>), whatever ρ and the direct light E0 are from place
to place. Areas are those of the meshes, whose facets are flat.
"""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import Shape, rectangle

from core_scenes import build, luminaire, shining, surface
from isolux import _core
from solved_scenes import mean, photometric, solved
from validation.rows import GLOBAL

pytestmark = pytest.mark.validation(GLOBAL)

FLUX = 1000.0  # lm
SPHERE = icosphere(3)  # of radius 1 m; 1,280 facets
INSIDE = SPHERE.flipped()
WORST = 0.02  # relative, of means
# The mean of so many photons that bounced deviates by 0.4 %, that of a gather over fewer by less.
PHOTONS = {"composite": 50_000, "dept": 150_000, "ddl+idept": 150_000}
by_each_method = pytest.mark.parametrize("method", PHOTONS)
# The indirect light of ddl+idept is that of dept.
by_both_methods = pytest.mark.parametrize("method", ["composite", "dept"])


def face_corners(shape):
    """(F, 3, 3)"""
    return shape.points[shape.indices].reshape(-1, 3, 3)


def face_areas(shape):
    a, b, c = face_corners(shape).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def isotropic_flux(shape, at):
    """Share (F,) of an isotropic source's flux that each facet takes: its solid angle / 4π."""
    a, b, c = (face_corners(shape) - at).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.abs((a * np.cross(b, c)).sum(1))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return 2 * np.arctan2(volume, below) / (4 * np.pi)


REFLECTANCES = {
    "half black, half 0.9": lambda p: np.where(p[:, 2] > 0, 0.9, 0.0),
    "0.1 to 0.8 from pole to pole": lambda p: 0.45 + 0.35 * p[:, 0],
    "patches of 0.95": lambda p: np.where(np.sin(5 * p[:, 0]) * np.cos(4 * p[:, 1]) > 0, 0.95, 0.3),
}


@by_both_methods
@pytest.mark.parametrize("name", REFLECTANCES)
def test_sphere_of_any_reflectance_under_any_light(validation, name, method):
    """The lamp is nearer to one side: direct light varies by a factor of nine."""
    at = np.array([0.3, 0.2, -0.35])
    areas = face_areas(INSIDE)
    reflectance = REFLECTANCES[name](face_corners(INSIDE).mean(axis=1))
    shares = isotropic_flux(INSIDE, at)
    assert shares.sum() == pytest.approx(1)
    expected = FLUX * (reflectance @ shares) / (areas @ (1 - reflectance))
    wall = replace(
        surface(INSIDE), reflectance=np.repeat(reflectance[:, None], 3, axis=1).astype(np.float32)
    )
    solution = solved([wall], [luminaire(FLUX, at)], method=method, photons=PHOTONS[method])
    validation.check(
        f"sphere, {name}, mean indirect light, {method}",
        *(expected, mean(solution, "indirect")),
        relative=WORST,
    )
    if method != "composite":  # there photons are filtered, whose deviation is their own
        return
    indirect = photometric(solution, "indirect")
    off = np.sqrt(np.average((indirect / expected - 1) ** 2, weights=solution.vertex_areas))
    validation.bound(f"sphere, {name}, RMS from one value all over", off, at_most=WORST)


@by_both_methods
@pytest.mark.parametrize("edge", [0.9, 0.6, 0.0])
def test_sphere_with_a_port(validation, method, edge):
    """Indirect light is ρ <E0> / (1 - ρ (1 - f)), f the port's share of the whole sphere."""
    reflectance = 0.8
    kept = face_corners(SPHERE)[:, :, 2].max(axis=1) <= edge + 1e-9
    faces = INSIDE.indices.reshape(-1, 3)[kept]
    port = 1 - face_areas(SPHERE)[kept].sum() / SPHERE.area()
    wall = surface(Shape(INSIDE.points, INSIDE.counts[kept], faces.ravel()), reflectance)
    solution = solved([wall], [luminaire(FLUX)], method=method, photons=PHOTONS[method])
    shares = isotropic_flux(SPHERE, np.zeros(3))[kept].sum()
    direct = FLUX * shares / SPHERE.area()  # <E0>, over the port as well, where it is 0
    expected = reflectance * direct / (1 - reflectance * (1 - port))
    validation.check(
        f"sphere with a port of {100 * port:.3g} %, mean indirect light, {method}",
        *(expected, mean(solution, "indirect")),
        relative=WORST,
    )


@by_each_method
@pytest.mark.parametrize("radius", [0.5, 0.8])
def test_concentric_spheres(validation, method, radius):
    """The inner one shines. F12 = 1, F21 = A1 / A2, F22 = 1 - F21: two equations."""
    inner_reflectance, outer_reflectance = 0.6, 0.7
    inner = shining(replace(SPHERE, points=SPHERE.points * radius), 100.0, path="/Inner")
    inner = replace(inner, reflectance=np.full((1, 3), inner_reflectance, np.float32))
    outer = surface(INSIDE, outer_reflectance, path="/Outer")
    lamp = replace(luminaire(shape="mesh"), path=inner.path)
    solution = solved([inner, outer], [lamp], method=method, photons=PHOTONS[method])
    factor = radius**2
    # Unknown: illuminances of inner and outer.
    reflected = np.array(
        [
            [0.0, outer_reflectance],
            [factor * inner_reflectance, (1 - factor) * outer_reflectance],
        ]
    )
    own = np.pi * 100.0 * np.array([0.0, factor])
    expected = np.linalg.solve(np.eye(2) - reflected, own)
    for path, value in zip(("/Inner", "/Outer"), expected, strict=True):
        case = f"sphere of radius {radius} m in one of 1 m, {path[1:].lower()}, {method}"
        validation.check(case, value, mean(solution, path=path), relative=WORST)


def test_wide_plates(validation):
    """B1 = M / (1 - ρ1 ρ2), B2 = ρ2 B1, by gathering again and again until nothing changes."""
    reflectances = (0.8, 0.3)
    width, gap, exitance = 60.0, 1.0, 100.0
    corner, step = -width / 2, 0.99 * gap  # no ray hits nearer than a bucket is wide
    up = surface(rectangle((corner, corner, 0), (width, 0, 0), (0, width, 0), step))
    down = surface(rectangle((corner, corner, gap), (0, width, 0), (width, 0, 0), step))
    plates = [
        replace(m, reflectance=np.full((1, 3), r, np.float32))
        for m, r in zip((up, down), reflectances, strict=True)
    ]
    scene = build(plates, [luminaire(at=(0, 0, 20))])
    (first, middle, _, _), (_, last, _, _) = scene.mesh_ranges
    shines = np.zeros((scene.vertex_count, 1), np.float32)
    shines[first:middle] = exitance / reflectances[0]  # as if this fell on plate 1
    gather = _core.FinalGather(scene, 1)
    light = np.zeros((scene.vertex_count, 3), np.float32)
    for round_ in range(10):
        light = gather.advance(shines + light, 100_000 if round_ == 0 else 0, 2)["indirect"]
    near = (np.abs(scene.vertex_positions[:, :2]) < 4).all(axis=1)
    b1 = exitance / (1 - np.prod(reflectances))
    for name, plate, expected in (
        ("1", slice(first, middle), reflectances[1] * b1),
        ("2", slice(middle, last), b1),
    ):
        found = light[plate][near[plate], 0].mean()
        case = f"wide plates of ρ {reflectances}, light on plate {name}, by gathers in turn"
        validation.check(case, expected, found, relative=WORST)
