"""Closed rooms of one reflectance: the mean illuminance is known whatever their form.

Of each photon's flux the share ρ is reflected at every hit. So its number of hits K is geometric,
E[K] = 1 / (1 - ρ), Var[K] = ρ / (1 - ρ)², and the relative standard deviation of the mean
illuminance over all surfaces is √(ρ / N) for N photons. Of the indirect hits K - 1 alone it is
√(Var[K] / N) / E[K - 1] = 1 / √(ρ N).
"""

import numpy as np
import pytest
from usd_scenes.box_room.generate import LUMINOUS_FLUX as BOX_FLUX
from usd_scenes.box_room.generate import SIZE
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box

from core_scenes import luminaire, surface, trace
from validation.rows import STOCHASTIC

pytestmark = pytest.mark.validation(STOCHASTIC)

RAYS = 600_000
FLUX = 1000.0  # lm


@pytest.fixture(scope="module", params=[0.2, 0.5, 0.8, 0.95])
def furnace(request):
    reflectance = request.param
    sphere = icosphere(2).flipped()
    photons = int(RAYS * (1 - reflectance))
    traced = trace([surface(sphere, reflectance)], [luminaire(FLUX)], photons)
    return reflectance, photons, sphere.area(), traced


def test_mean_illuminance_of_a_closed_sphere(validation, furnace):
    reflectance, photons, area, traced = furnace
    expected = FLUX / (area * (1 - reflectance))
    sigma = np.sqrt(reflectance / photons)
    case = f"sphere of ρ {reflectance}, mean light, photons"
    validation.check(case, expected, traced.mean_illuminance.sum(), sigma=sigma * expected)
    indirect = expected * reflectance
    sigma = indirect / np.sqrt(reflectance * photons)
    case = f"sphere of ρ {reflectance}, mean indirect light, photons"
    validation.check(case, indirect, traced.mean_illuminance[1], sigma=sigma)


def test_filtered_illuminance_of_a_closed_sphere_is_uniform(validation, furnace):
    reflectance, photons, area, traced = furnace
    filtered = traced.filtered()
    illuminance = (filtered["direct"] + filtered["indirect"])[:, 0]
    expected = FLUX / (area * (1 - reflectance))
    sigma_of_mean = np.sqrt(reflectance / photons)
    validation.check(
        f"sphere of ρ {reflectance}, mean light, filtered photons",
        *(expected, np.average(illuminance, weights=traced.areas)),
        sigma=sigma_of_mean * expected,
    )
    # Each vertex is as far off as the solution says of itself.
    assert np.abs(illuminance / expected - 1).max() < 4.5 * np.hypot(
        filtered["rms_error"], sigma_of_mean
    )


def test_the_reported_error_of_a_closed_sphere_is_the_true_one(furnace):
    reflectance, photons, area, traced = furnace
    reported = traced.filtered()["bucket_rms_error"]
    # About the mean of this run: all buckets share the noise of how many hits there were.
    off = traced.illuminance.sum(axis=1) / traced.mean_illuminance.sum() - 1
    true = np.sqrt(np.average(off**2, weights=traced.areas))
    assert reported == pytest.approx(true, rel=4 / np.sqrt(2 * len(off)))
    # By Eq. 5, 1 / √(hits a bucket), buckets weighted by 1 / area as the error is.
    hits = photons / (1 - reflectance) * (traced.areas / area)
    assert reported == pytest.approx(np.sqrt(np.average(1 / hits, weights=traced.areas)), rel=0.02)


# Mean indirect illuminance ρ Φ / (S (1 - ρ)), lx, as CIE 171:2006 tabulates it for case 5.8.
CIE_171_5_8 = {
    **{0.05: 5.48, 0.1: 11.6, 0.2: 26.0, 0.3: 44.6, 0.4: 69.4, 0.5: 104.0, 0.6: 156.0},
    **{0.7: 243.0, 0.8: 417.0, 0.9: 937.0, 0.95: 1979.0},
}


@pytest.mark.parametrize(("reflectance", "tabulated"), CIE_171_5_8.items())
def test_indirect_light_in_the_cube_of_cie_171_case_5_8(validation, reflectance, tabulated):
    photons = int(RAYS / 2 * (1 - reflectance))
    room = surface(box((SIZE, SIZE, SIZE), 1.0).flipped(), reflectance)
    traced = trace([room], [luminaire(BOX_FLUX)], photons)
    expected = reflectance * BOX_FLUX / (6 * SIZE**2 * (1 - reflectance))
    assert expected == pytest.approx(tabulated, rel=3e-3)  # to three figures
    validation.check(
        f"cube of ρ {reflectance}, mean indirect light, photons",
        *(expected, traced.mean_illuminance[1]),
        sigma=expected / np.sqrt(reflectance * photons),
    )
    assert traced.mean_illuminance[0] == pytest.approx(BOX_FLUX / (6 * SIZE**2))
