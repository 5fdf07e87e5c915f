"""Goniometric diagrams authored as plain numbers on a prim."""

import numpy as np
import pytest
from isolux._core import CandelaDistribution

from isolux.errors import PhotometryError
from isolux.photometry import inline_diagram, luminous_flux, scale


def test_an_inline_diagram_is_unfolded_like_type_c_photometry():
    diagram = inline_diagram([0, 90, 180], [0, 90], [1, 2, 1, 1, 4, 1], "/World/Lamp")
    c = np.radians([0, 45, 90, 180, 225])
    horizontal = np.stack([np.cos(c), np.sin(c), 0.0 * c], axis=-1)
    distribution = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    assert distribution.intensity(horizontal) == pytest.approx([2, 3, 4, 2, 3])


def test_scaling_scales_the_flux_and_leaves_the_original():
    diagram = inline_diagram([0, 180], [0], [1, 1], "/World/Lamp")
    assert luminous_flux(scale(diagram, 3.0)) == pytest.approx(12.0 * np.pi)
    assert luminous_flux(diagram) == pytest.approx(4.0 * np.pi)


@pytest.mark.parametrize(
    ("gamma", "c", "candela", "found"),
    [
        ([0], [0], [1], "1 gamma angles"),
        ([0, 90], [], [], "0 C-angles"),
        ([0, 90], [0], [1, 1, 1], "3 candela values"),
        ([0, np.nan], [0], [1, 1], "NaN"),
        ([0, 90], [0], [1, np.inf], "inf cd"),
        ([90, 0], [0], [1, 1], "0 after 90"),
        ([0, 90], [0, 0], [1, 1, 1, 1], "0 after 0"),
        ([0, 90], [0], [1, -1], "-1 cd"),
        ([0, 90], [0], [0, 0], "all zero"),
        ([0, 200], [0], [1, 1], "0 to 200"),
        ([0, 90], [0, 45], [1, 1, 1, 1], "0 to 45"),
        ([0, 90], [0, 200, 720], [1] * 6, "0 to 720"),
    ],
)
def test_an_inline_diagram_that_makes_no_sense_names_its_prim(gamma, c, candela, found):
    with pytest.raises(PhotometryError) as error:
        inline_diagram(gamma, c, candela, "/World/Lamp")
    assert error.value.subject == "/World/Lamp"
    assert found in error.value.found
