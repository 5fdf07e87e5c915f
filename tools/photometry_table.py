"""Prints what Isolux makes of every photometric file under a folder.

    python tools/photometry_table.py FOLDER

Flux by integration beside what the file declares (for LM-63 the lamps' rated flux, so that the
ratio is the light output ratio), and the p-value of a chi-squared test of 10^6 sampled directions
against the flux of each part of the sphere.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from isolux._core import CandelaDistribution
from scipy.stats import chisquare

from isolux.errors import PhotometryError
from isolux.photometry import read_photometric_file
from isolux.scene_description import GoniometricDiagram

SAMPLES = 1_000_000
SMALLEST_EXPECTED = 10.0  # samples in a cell of the test; sparser cells are pooled


def sampling_p_value(diagram: GoniometricDiagram) -> float:
    """Chi-squared p-value of sampled directions over the diagram's cells."""
    axial = len(diagram.c_angles) == 1
    c_edges = np.linspace(0.0, 2.0 * np.pi, 9) if axial else diagram.c_angles
    planes = np.repeat(diagram.candela, 9, axis=0) if axial else diagram.candela
    whole = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    # Each cell's flux as that of a distribution which is that cell alone.
    flux = np.array(
        [
            [
                CandelaDistribution(
                    diagram.gamma[j : j + 2],
                    c_edges[k : k + 2],
                    np.ascontiguousarray(planes[k : k + 2, j : j + 2]),
                ).luminous_flux
                for j in range(len(diagram.gamma) - 1)
            ]
            for k in range(len(c_edges) - 1)
        ]
    )
    directions = whole.sample(np.random.default_rng(0).random((SAMPLES, 3)))
    gamma = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), -directions[:, 2])
    c = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
    counts = np.histogram2d(c, gamma, [c_edges, diagram.gamma])[0].ravel()
    expected = (flux / flux.sum()).ravel() * SAMPLES
    dense = expected >= SMALLEST_EXPECTED
    observed = np.append(counts[dense], counts[~dense].sum() + SAMPLES - counts.sum())
    expected = np.append(expected[dense], expected[~dense].sum())
    if expected[-1] < SMALLEST_EXPECTED:
        observed, expected = observed[:-1], expected[:-1]
    return float(chisquare(observed, expected * observed.sum() / expected.sum()).pvalue)


def main() -> None:
    folder = Path(sys.argv[1])
    print(f"{'file':58} {'format':15} {'declared lm':>11} {'integrated':>10} {'ratio':>7} {'p':>6}")
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in (".ies", ".ldt"):
            continue
        name = str(path.relative_to(folder))[-58:]
        try:
            file = read_photometric_file(path)
        except PhotometryError as error:
            print(f"{name:58} found {error.found}; wanted {error.wanted}")
            continue
        flux = CandelaDistribution(
            file.diagram.gamma, file.diagram.c_angles, file.diagram.candela
        ).luminous_flux
        declared = file.declared_flux or file.lamp_flux
        stated = (
            f"{declared:11.4g} {flux:10.4g} {flux / declared:7.4f}"
            if declared
            else (f"{'-':>11} {flux:10.4g} {'-':>7}")
        )
        print(f"{name:58} {file.format:15} {stated} {sampling_p_value(file.diagram):6.3f}")
        for warning in file.warnings:
            print(f"    {warning}")


if __name__ == "__main__":
    main()
