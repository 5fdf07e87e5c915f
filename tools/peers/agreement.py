"""Does a peer see the same scene? Its illuminance beside the path-traced reference.

Two runs of a peer and two halves of the reference have independent noise, so that the mean product
of their differences is the square of what does not go away with samples: of a wrong adapter, or of
what the peer does otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from reference import TOTAL, PathTracedReference

from isolux.solution import LUMINANCE_WEIGHTS

from .peer_scene import Array

QUANTITY = "illuminance, total"


@dataclass(frozen=True, slots=True)
class Agreement:
    """All relative to the reference's mean illuminance.

    mean_ratio : of the area-weighted means
    mean_error_bar : two standard errors of the ratio, of both programs
    rms_difference : noise of both programs taken out
    error_bar : what of `rms_difference` could still be noise, at two standard errors
    noise : of the mean of the peer's runs and of the reference together
    """

    mean_ratio: float
    mean_error_bar: float
    rms_difference: float
    error_bar: float
    noise: float

    @property
    def within(self) -> bool:
        return (
            abs(self.mean_ratio - 1) <= self.mean_error_bar
            and self.rms_difference <= self.error_bar
        )


def agreement(runs: tuple[Array, Array], reference: PathTracedReference) -> Agreement:
    """runs : (M, 3) lx by channel, at the reference's vertices"""
    batches = reference.batches[:, :, TOTAL].sum(axis=2) @ LUMINANCE_WEIGHTS
    halves = batches[::2].mean(axis=0), batches[1::2].mean(axis=0)
    weights, mean = reference.weights, reference.mean(TOTAL)
    first, second = (
        (run @ LUMINANCE_WEIGHTS - half) / mean for run, half in zip(runs, halves, strict=True)
    )
    product = first * second
    square = float(weights @ product)
    # Vertices are independent; so are the two differences.
    spread = float(np.sqrt(weights**2 @ (product - square) ** 2))
    own = float(np.sqrt(weights @ (first - second) ** 2)) / 2
    of_means = float(np.sqrt(weights**2 @ (first - second) ** 2)) / 2
    return Agreement(
        mean_ratio=1 + float(weights @ (first + second)) / 2,
        mean_error_bar=2 * of_means,
        rms_difference=float(np.sqrt(max(0.0, square))),
        error_bar=float(np.sqrt(2 * spread)),
        noise=own,
    )
