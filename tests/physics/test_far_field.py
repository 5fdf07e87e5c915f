"""Far from a luminaire its light has the intensity that its shape or its goniometric diagram gives.

Photons are caught by a black sphere, so large that the luminaire is a point: the flux into a bucket
is the intensity I(ω) integrated over the bucket's solid angle. χ², p above 10⁻³ at the fixed seed.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare
from usd_scenes.furnace_sphere.generate import icosphere

from core_scenes import bucket_flux, luminaire, surface, trace
from isolux import _core
from validation.rows import DIAGRAMS

pytestmark = pytest.mark.validation(DIAGRAMS)

FLUX = 500.0  # lm
PHOTONS = 400_000
SIZE = (1e-3, 2e-3)  # m, beside a sphere of 1 m
SPHERE = surface(icosphere(3).flipped())
TURNED = Rotation.from_euler("xyz", [20, -50, 130], degrees=True).as_matrix().T


def assert_caught_as(validation, case, traced, intensity):
    """intensity : cd, of unit directions (n, 3) in world space."""

    def illuminance(points, normals):
        squared = (points**2).sum(axis=1)
        towards = points / np.sqrt(squared)[:, None]
        return intensity(towards) * -(towards * normals).sum(axis=1) / squared

    expected = bucket_flux(traced, illuminance, divisions=24) * PHOTONS / FLUX
    assert expected.sum() == pytest.approx(PHOTONS, rel=1e-3)
    counts = traced.hits[:, 0]
    lit = expected > 5
    observed = np.append(counts[lit], counts[~lit].sum())
    predicted = np.append(expected[lit], expected[~lit].sum())
    if predicted[-1] <= 5:
        assert observed[-1] < 20
        observed, predicted = observed[:-1], predicted[:-1]
    p = chisquare(observed, predicted * observed.sum() / predicted.sum()).pvalue
    validation.bound(f"{case}, p of χ² over {len(observed)} directions", p, at_least=1e-3)


def lambertian(local):
    return FLUX / np.pi * np.maximum(-local[:, 2], 0)


def tube(local):
    """Flux / π² times the sine of the angle to the axis."""
    return FLUX / np.pi**2 * np.sqrt(1 - local[:, 0] ** 2)


def isotropic(local):
    return np.full(len(local), FLUX / (4 * np.pi))


@pytest.mark.parametrize("axes", [np.eye(3), TURNED], ids=["upright", "turned"])
@pytest.mark.parametrize(
    ("shape", "intensity"),
    [("sphere", isotropic), ("disk", lambertian), ("rect", lambertian), ("cylinder", tube)],
)
def test_surfaces_of_constant_luminance(validation, shape, intensity, axes):
    traced = trace([SPHERE], [luminaire(FLUX, shape=shape, size=SIZE, axes=axes)], PHOTONS)
    case = f"{shape} from afar, {'upright' if axes is not TURNED else 'turned'}, photons"
    assert_caught_as(validation, case, traced, lambda directions: intensity(directions @ axes.T))


def lopsided(gamma, c):
    """Up and down, and another way on each side."""
    return (1 + np.cos(gamma)) ** 2 * (1.2 + np.sin(c)) + 3 * np.sin(gamma) ** 8 * (1 + np.cos(c))


def lopsided_diagram():
    gamma, c = np.radians(np.arange(181.0)), np.radians(np.arange(0.0, 361.0, 2.0))
    return _core.CandelaDistribution(gamma, c, lopsided(gamma, c[:, None]))


def lopsided_flux():
    """∫∫ I sinγ dγ dC, lm: only the terms without sin C and cos C are left."""
    down = 2 * np.pi * 1.2 * 8 / 3
    side = 2 * np.pi * 3 * 2 * (2 * 4 * 6 * 8) / (3 * 5 * 7 * 9)
    return down + side


@pytest.mark.parametrize("shape", ["sphere", "disk", "rect", "cylinder"])
def test_goniometric_diagrams_whatever_the_opening(validation, shape):
    diagram = lopsided_diagram()
    flux = diagram.luminous_flux
    validation.check("flux of a diagram", lopsided_flux(), flux, relative=1e-3, unit="lm")

    def intensity(directions):
        x, y, z = (directions @ TURNED.T).T
        candela = lopsided(np.arccos(-z), np.arctan2(y, x))
        return candela * FLUX / lopsided_flux()

    source = luminaire(FLUX, shape=shape, size=SIZE, axes=TURNED)
    traced = trace([SPHERE], [source], PHOTONS, diagram=diagram)
    assert_caught_as(validation, f"{shape} with a diagram from afar, photons", traced, intensity)


def test_luminaires_share_the_photons_by_their_flux(validation):
    """Two spots, up and down."""
    down, up = (
        luminaire(f, shape="disk", axes=np.diag([1.0, s, s])) for f, s in ((70, 1), (30, -1))
    )
    traced = trace([SPHERE], [down, up], PHOTONS)
    below = traced.hits[traced.scene.vertex_positions[:, 2] < -0.1, 0].sum()
    above = traced.hits[traced.scene.vertex_positions[:, 2] > 0.1, 0].sum()
    share = below / (below + above)
    sigma = np.sqrt(0.7 * 0.3 / PHOTONS)
    case = "share of the photons of a luminaire that has 70 % of the flux"
    validation.check(case, 0.7, share, sigma=sigma, unit="")
