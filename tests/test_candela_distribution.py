"""Flux and sampling of goniometric diagrams against closed forms and quadrature."""

import numpy as np
import pytest
from isolux._core import CandelaDistribution
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import chisquare

from isolux.photometry import read_photometric_file
from validation.rows import DIAGRAMS

pytestmark = pytest.mark.validation(DIAGRAMS)

AXIAL = np.zeros(1)
EVERY_5_DEG = np.radians(np.arange(0.0, 181.0, 5.0))
EVERY_15_DEG = np.radians(np.arange(0.0, 361.0, 15.0))


def axial(gamma, candela):
    return CandelaDistribution(gamma, AXIAL, np.asarray(candela, float)[None, :])


def cell_fluxes(gamma, c, candela):
    """(H - 1, G - 1) lm, bilinear intensity by Gauss-Legendre quadrature in each cell."""
    x, w = np.polynomial.legendre.leggauss(12)
    s, w = 0.5 * (x + 1.0), 0.5 * w
    flux = np.empty((len(c) - 1, len(gamma) - 1))
    for k in range(len(c) - 1):
        for j in range(len(gamma) - 1):
            corners = candela[k : k + 2, j : j + 2]
            values = np.array([1 - s, s]).T @ corners @ np.array([1 - s, s])
            sines = np.sin(gamma[j] + s * (gamma[j + 1] - gamma[j]))
            flux[k, j] = w @ values @ (w * sines)
    return flux * np.diff(c)[:, None] * np.diff(gamma)


def halved(gamma, c, candela):
    """The same bilinear function on cells of half the size."""

    def finer(angles):
        return np.insert(angles, range(1, len(angles)), 0.5 * (angles[1:] + angles[:-1]))

    rows = np.array([np.interp(finer(gamma), gamma, plane) for plane in candela])
    planes = np.array([np.interp(finer(c), c, column) for column in rows.T]).T
    return finer(gamma), finer(c), planes


def peaked():
    """10^6 : 1 over half a degree at 30 deg in one plane."""
    gamma = np.radians([0.0, 10, 20, 29.5, 30, 30.5, 40, 60, 90, 130, 180])
    candela = np.ones((len(EVERY_15_DEG), len(gamma)))
    candela[3, 4] = 1e6
    return gamma, EVERY_15_DEG, candela


def nadir_spike():
    gamma = np.radians([0.0, 0.01, 0.02, 1.0, 90.0])
    return gamma, EVERY_15_DEG, np.tile([1e6, 1e3, 1.0, 1.0, 0.0], (len(EVERY_15_DEG), 1))


def uneven():
    return EVERY_5_DEG, EVERY_15_DEG, np.random.default_rng(1).random((25, 37)) ** 3


def mostly_dark():
    candela = np.zeros((25, 37))
    candela[4:6, 10:14] = candela[20, 30] = 1.0
    return EVERY_5_DEG, EVERY_15_DEG, candela


def uplight():
    gamma, c, candela = uneven()
    return gamma[20:], c, candela[:, 20:].copy()


def coarse():
    return (
        np.radians([0.0, 90.0, 180.0]),
        np.radians([0.0, 120.0, 360.0]),
        np.arange(9.0).reshape(3, 3),
    )


DIAGRAMS = [peaked, nadir_spike, uneven, mostly_dark, uplight, coarse]


def test_isotropic_source_gives_four_pi_lumens_a_candela():
    assert axial(EVERY_5_DEG, np.full(37, 100.0)).luminous_flux == pytest.approx(
        400.0 * np.pi, rel=1e-11
    )


def test_lambertian_source_gives_pi_lumens_a_candela():
    gamma = np.radians(np.arange(0.0, 91.0))
    assert axial(gamma, np.cos(gamma)).luminous_flux == pytest.approx(np.pi, rel=1e-4)


@pytest.mark.parametrize("angles", [2, 3, 37, 4001])
def test_intensity_linear_in_gamma_is_integrated_exactly(angles):
    gamma = np.pi * np.linspace(0.0, 1.0, angles) ** 1.7
    flux = axial(gamma, 2.0 + 3.0 * gamma).luminous_flux
    assert flux == pytest.approx(2.0 * np.pi * (4.0 + 3.0 * np.pi), rel=1e-11)


@pytest.mark.parametrize("edge", [1e-8, 1e-5, 1e-3, 0.1, 3.0])
def test_caps_keep_their_flux_however_thin(edge):
    nadir = axial(np.array([0.0, edge]), [1.0, 1.0]).luminous_flux
    assert nadir == pytest.approx(4.0 * np.pi * np.sin(edge / 2.0) ** 2, rel=1e-9)
    cone = axial(np.array([0.0, edge]), [1.0, 0.0]).luminous_flux
    assert cone == pytest.approx(2.0 * np.pi * (1.0 - np.sinc(edge / np.pi)), rel=1e-7)


@pytest.mark.parametrize("diagram", DIAGRAMS)
def test_flux_is_the_sum_of_the_quadratures_of_the_cells(diagram):
    expected = cell_fluxes(*diagram()).sum()
    assert CandelaDistribution(*diagram()).luminous_flux == pytest.approx(expected, rel=1e-10)


def assert_sampled_by_flux(gamma, c, candela):
    """Chi-squared over quarters of the cells."""
    distribution = CandelaDistribution(gamma, c, candela)
    if len(c) == 1:
        c, candela = np.linspace(0.0, 2.0 * np.pi, 9), np.repeat(candela, 9, axis=0)
    gamma, c, candela = halved(gamma, c, candela)
    samples = 400_000
    x, y, z = distribution.sample(np.random.default_rng(7).random((samples, 3))).T
    counts = np.histogram2d(
        np.arctan2(y, x) % (2.0 * np.pi), np.arctan2(np.hypot(x, y), -z), [c, gamma]
    )[0]
    assert counts.sum() == samples, "sampled outside the tabulated angles"
    expected = cell_fluxes(gamma, c, candela)
    assert not counts[expected == 0.0].any(), "sampled where there is no light"

    expected *= samples / expected.sum()
    dense = expected > 10.0
    observed = np.append(counts[dense], counts[~dense].sum())
    predicted = np.append(expected[dense], expected[~dense].sum())
    if predicted[-1] < 10.0:
        observed, predicted = observed[:-1], predicted[:-1]
    assert chisquare(observed, predicted * observed.sum() / predicted.sum()).pvalue > 1e-3


@pytest.mark.parametrize("diagram", DIAGRAMS)
def test_directions_are_sampled_in_proportion_to_flux(diagram):
    assert_sampled_by_flux(*diagram())


@pytest.mark.parametrize(
    "name",
    [
        "ies/pmolodo+luxtest/bega_84693k4.ies",  # axial
        "ies/pmolodo+luxtest/test_vstripes_hquadrants_nonuniform_aimDown.ies",  # to 50 deg only
        "ies/NREL+Radiance/src/cv/mgflib/examp1.ies",  # up and down
        "ies/NVIDIA+OptiX_Apps/data/mdl/ies/TypeC.ies",  # planes of unlike form
        "ldt/123VincentB+eulumdat-py/tests/samples/sample3.ldt",  # no symmetry
    ],
)
def test_real_luminaires_are_sampled_in_proportion_to_flux(inputs, name):
    diagram = read_photometric_file(inputs / name).diagram
    assert_sampled_by_flux(diagram.gamma, diagram.c_angles, diagram.candela)


def test_the_whole_range_of_uniform_numbers_gives_unit_directions():
    ends = [0.0, 1e-300, 1e-16, 0.5, 1.0 - 2.0**-53]
    u = np.stack(np.meshgrid(ends, ends, ends), axis=-1).reshape(-1, 3)
    for diagram in DIAGRAMS:
        directions = CandelaDistribution(*diagram()).sample(u)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-10)


def test_sampled_directions_are_a_function_of_their_numbers():
    u = np.random.default_rng(3).random((1000, 3))
    first, second = (CandelaDistribution(*uneven()).sample(u) for _ in range(2))
    assert np.array_equal(first, second)


def test_intensity_follows_the_axes_nadir_c0_and_c90():
    c = np.radians([0.0, 90.0, 180.0, 270.0, 360.0])
    planes = np.array([[1.0, 10.0], [1.0, 20.0], [1.0, 30.0], [1.0, 40.0], [1.0, 10.0]])
    distribution = CandelaDistribution(np.array([0.0, np.pi / 2.0]), c, planes)
    directions = np.array([[0, 0, -2], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1.0]])
    assert distribution.intensity(directions) == pytest.approx([1.0, 10.0, 20.0, 30.0, 40.0, 0.0])
    between = np.array([[np.cos(3.0 * np.pi / 8.0), np.sin(3.0 * np.pi / 8.0), -1.0]])
    assert distribution.intensity(between) == pytest.approx([0.5 * 1.0 + 0.5 * 17.5])


@pytest.mark.parametrize("diagram", DIAGRAMS)
def test_intensity_is_bilinear_between_the_angles_and_zero_outside(diagram):
    gamma, c, candela = diagram()
    rng = np.random.default_rng(3)
    # Anywhere, and on the tabulated angles themselves.
    g = np.append(rng.uniform(0.0, np.pi, 2000), rng.choice(gamma[1:-1], 500))
    around = np.append(rng.uniform(0.0, 2.0 * np.pi, 2000), rng.choice(c[:-1], 500))
    directions = np.array([np.sin(g) * np.cos(around), np.sin(g) * np.sin(around), -np.cos(g)]).T
    bilinear = RegularGridInterpolator((c, gamma), candela, bounds_error=False, fill_value=0.0)
    found = CandelaDistribution(gamma, c, candela).intensity(directions * 3.0)
    steepest = np.abs(np.diff(candela) / np.diff(gamma)).max()
    expected = bilinear(np.array([around, g]).T)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * steepest)  # 1e-9 rad


@pytest.mark.parametrize(
    ("gamma", "c", "candela", "wanted"),
    [
        ([0.0], [0.0], [[1.0]], "at least two"),
        ([0.0, 1.0], [], np.zeros((0, 2)), "at least two"),
        ([0.0, 1.0], [0.0], [[1.0, 1.0, 1.0]], "shape"),
        ([1.0, 0.0], [0.0], [[1.0, 1.0]], "increasing"),
        ([0.0, 4.0], [0.0], [[1.0, 1.0]], "increasing"),
        ([0.0, np.nan], [0.0], [[1.0, 1.0]], "increasing"),
        ([0.0, 1.0], [0.0, 7.0], [[1.0, 1.0]] * 2, "increasing"),
        ([0.0, 1.0], [0.0], [[1.0, -1.0]], "finite"),
        ([0.0, 1.0], [0.0], [[1.0, np.inf]], "finite"),
    ],
)
def test_what_is_no_diagram_is_refused(gamma, c, candela, wanted):
    with pytest.raises(ValueError, match=wanted):
        CandelaDistribution(np.array(gamma), np.array(c), np.array(candela))


def test_no_light_has_no_flux_and_no_samples():
    dark = axial(EVERY_5_DEG, np.zeros(37))
    assert dark.luminous_flux == 0.0
    with pytest.raises(ValueError, match="light"):
        dark.sample(np.zeros((1, 3)))
