"""Write the invented photometric files of the scenes: python -m usd_scenes.photometry.generate.

Each diagram is a formula in (gamma, C), scaled so that its exact integral is the wanted flux.
"""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
Table = NDArray[np.float64]

IES_HEADER = """\
IESNA:LM-63-2002
[TEST] computed from a formula, not measured
[TESTLAB] none
[ISSUEDATE] 2025-01-01
[MANUFAC] Isolux (invented)
[LUMCAT] {name}
[LUMINAIRE] {title}
[LAMP] LED
TILT=NONE
"""


def integrated_flux(gamma: Table, c_angles: Table, candela: Table) -> float:
    """Flux of a diagram that is bilinear between its angles, lm.

    gamma : (G,) degrees
    c_angles : (H,) degrees; [0] alone or from 0 to 180 or 360; the rest mirrors
    candela : (H, G) cd
    """
    g = np.radians(gamma)
    low, high = g[:-1], g[1:]
    # The integrals of sin(g) times the two hat functions of each interval.
    total = np.cos(low) - np.cos(high)
    rising = (np.sin(high) - np.sin(low)) / (high - low) - np.cos(high)
    weights = np.zeros(len(g))
    weights[:-1] += total - rising
    weights[1:] += rising
    by_plane = candela @ weights
    if len(c_angles) == 1:
        return float(2 * np.pi * by_plane[0])
    pairs = (by_plane[1:] + by_plane[:-1]) / 2 * np.diff(c_angles)
    return float(2 * np.pi * pairs.sum() / (c_angles[-1] - c_angles[0]))


def downlight() -> str:
    """Wide and axial, relative photometry: one lamp of 1000 lm, 90 % of it leaves."""
    gamma = np.arange(0.0, 91.0, 5.0)
    candela = np.cos(np.radians(gamma))[None] ** 1.4 * (1 - (gamma / 90) ** 8)
    return _ies("downlight", "Recessed downlight, wide", gamma, np.zeros(1), candela, 900.0, 1000.0)


def wall_washer() -> str:
    """Aimed 34 degrees from nadir towards C0; mirrored about the plane C0-C180."""
    gamma, c_angles = np.arange(0.0, 91.0, 2.5), np.arange(0.0, 181.0, 10.0)
    aim = np.radians(34.0)
    c, g = np.radians(c_angles)[:, None], np.radians(gamma)[None]
    cosine = np.sin(g) * np.cos(c) * np.sin(aim) + np.cos(g) * np.cos(aim)
    off_axis = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    beam = np.exp(-0.5 * (off_axis / 11.0) ** 2) + 0.06 * np.exp(-0.5 * (off_axis / 28.0) ** 2)
    candela = beam * np.clip((90 - gamma) / 15, 0, 1)
    return _ies("wall_washer", "Ceiling wall-washer", gamma, c_angles, candela, 620.0, None)


def pendant() -> str:
    """Down and up, faint at the sides, where the shade is."""
    gamma = np.arange(0.0, 181.0, 5.0)
    down = np.clip(np.cos(np.radians(gamma)), 0, 1) ** 1.6 * np.clip((75 - gamma) / 12, 0.03, 1)
    up = np.clip(-np.cos(np.radians(gamma)), 0, 1) ** 1.2 * np.clip((gamma - 110) / 12, 0.03, 1)
    candela = (down + 0.45 * up + 0.05)[None]
    return _ies("pendant", "Drum pendant, up and down", gamma, np.zeros(1), candela, 1300.0, None)


def oblong() -> str:
    """EULUMDAT, wide along C90 and narrow along C0; mirrored about both planes (Isym 4)."""
    gamma, c_angles = np.arange(0.0, 91.0, 5.0), np.arange(0.0, 360.0, 15.0)
    lamp_flux, output_ratio = 1500.0, 0.8
    c, g = np.radians(c_angles[:7])[:, None], np.radians(gamma)[None]  # C0 to C90 are written
    exponent = 5.0 * np.cos(c) ** 2 + 1.5 * np.sin(c) ** 2
    candela = np.cos(g) ** exponent * (1 - (gamma / 90) ** 8)
    candela *= 1000 * output_ratio / integrated_flux(gamma, c_angles[:7], candela)
    head = ["Isolux (invented)", 3, 4, 24, 15, 19, 5, "none", "Oblong downlight", "oblong",
            "oblong.ldt", "2025-01-01", 300, 100, 80, 300, 100, 0, 0, 0, 0, 100, 80, 1, 0, 1,
            1, "LED", lamp_flux, "3500 K", 80, 14]  # fmt: skip
    direct_ratios = [0.0] * 10  # of no use without a room index
    numbers = [*direct_ratios, *c_angles, *gamma, *candela.reshape(-1)]
    return "\r\n".join([*map(str, head), *(f"{number:.2f}" for number in numbers)]) + "\r\n"


def _ies(
    name: str,
    title: str,
    gamma: Table,
    c_angles: Table,
    candela: Table,
    flux: float,
    lamp_flux: float | None,
) -> str:
    """LM-63-2002 text, type C, round opening of 120 mm; absolute where `lamp_flux` is None."""
    candela = candela * flux / integrated_flux(gamma, c_angles, candela)
    opening = "-0.120 -0.120 0.000"
    lumens = -1 if lamp_flux is None else f"{lamp_flux:g}"
    rows = [gamma, c_angles, *candela]
    return "".join(
        [
            IES_HEADER.format(name=name, title=title),
            f"1 {lumens} 1 {len(gamma)} {len(c_angles)} 1 2 {opening}\n",
            "1 1 12\n",
            *(fill(" ".join(f"{number:.2f}" for number in row), 80) + "\n" for row in rows),
        ]
    )


FILES = {
    "downlight.ies": downlight,
    "wall_washer.ies": wall_washer,
    "pendant.ies": pendant,
    "oblong.ldt": oblong,
}

if __name__ == "__main__":
    for file_name, text in FILES.items():
        (HERE / file_name).write_bytes(text().encode("ascii"))
