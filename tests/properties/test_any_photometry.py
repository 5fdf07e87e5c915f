"""Any legal photometric file gives back the candela that were written into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from isolux._core import CandelaDistribution

from isolux.photometry import inline_diagram, luminous_flux, read_photometric_bytes

seeds = st.integers(0, 2**32 - 1)


def increasing(first, last, most):
    """Angles in deg from first to last, tenths between."""
    inner = st.lists(
        st.integers(round(first * 10) + 1, round(last * 10) - 1), max_size=most, unique=True
    )
    return inner.map(lambda tenths: np.array([first, *sorted(t / 10 for t in tenths), last]))


VERTICAL = st.sampled_from([(0, 90), (90, 180), (0, 180), (12.5, 77)]).flatmap(
    lambda ends: increasing(*ends, most=6)
)


@dataclass(frozen=True)
class Table:
    """Candela as a file tabulates them, and the symmetry that fills the rest of the circle.

    c : (H,) deg, stored planes; gamma : (G,) deg; candela : (H, G) cd
    fold : takes C in [0, 360) to the stored range
    """

    gamma: np.ndarray
    c: np.ndarray
    candela: np.ndarray
    fold: str

    def at(self, gamma, c):
        """cd, bilinear; by folding directions into the table, where readers unfold the table."""
        c = np.mod(c, 360.0)
        match self.fold:
            case "axial":
                c = np.zeros_like(c)
            case "quadrant":
                c = np.where(c > 180, 360 - c, c)
                c = np.where(c > 90, 180 - c, c)
            case "about C0-C180":
                c = np.where(c > 180, 360 - c, c)
            case "about C90-C270":
                c = np.where((c < 90) | (c > 270), np.mod(180 - c, 360), c)
        planes, values = self.c, self.candela
        if self.fold == "none" and planes[-1] < 360:
            planes, values = np.append(planes, 360), np.vstack([values, values[:1]])
        rows = np.array([np.interp(gamma, self.gamma, plane) for plane in values])
        inside = (gamma >= self.gamma[0]) & (gamma <= self.gamma[-1])
        return np.array(
            [
                np.interp(c[i], planes, rows[:, i]) if inside[i] else 0.0  # no extrapolation
                for i in range(len(c))
            ]
        )


def candela_of(seed, shape):
    """Four digits, some of them zero."""
    rng = np.random.default_rng(seed)
    values = np.round(rng.uniform(0, 1000, shape), 1) * (rng.random(shape) < 0.9)
    values.flat[rng.integers(values.size)] = 777.7
    return values


@st.composite
def lm63_tables(draw):
    fold, planes = draw(
        st.one_of(
            st.just(("axial", np.zeros(1))),
            increasing(0, 90, 4).map(lambda c: ("quadrant", c)),
            increasing(0, 180, 5).map(lambda c: ("about C0-C180", c)),
            increasing(90, 270, 5).map(lambda c: ("about C90-C270", c)),
            increasing(0, 360, 8).map(lambda c: ("none", c)),
        )
    )
    gamma = draw(VERTICAL)
    values = candela_of(draw(seeds), (len(planes), len(gamma)))
    if fold == "none":
        values[-1] = values[0]
    return Table(gamma, planes, values, fold)


def intensity(diagram, gamma, c):
    gamma, c = np.radians(gamma), np.radians(c)
    directions = np.column_stack(
        [np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), -np.cos(gamma)]
    )
    own = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    return own.intensity(directions)


def compare(file, table, seed):
    """At the nodes and between them. At nadir and zenith each plane has a value of its own."""
    rng = np.random.default_rng(seed)
    c, gamma = (a.ravel() for a in np.meshgrid(table.c, table.gamma))
    at_poles = (gamma < 1e-6) | (gamma > 180 - 1e-6)
    edges = np.isin(gamma, table.gamma[[0, -1]])
    c = np.concatenate([c[~(at_poles | edges)], rng.uniform(0, 360, 40)])
    gamma = np.concatenate([gamma[~(at_poles | edges)], rng.uniform(0.01, 179.99, 40)])
    expected = table.at(gamma, c)
    found = intensity(file.diagram, gamma, c)
    np.testing.assert_allclose(found, expected, atol=1e-5 * table.candela.max())
    # Each tabulated value is there, the edges and poles among them.
    for plane, values in zip(table.c, table.candela, strict=True):
        nearest = np.abs(np.mod(np.degrees(file.diagram.c_angles) - plane + 180, 360) - 180)
        np.testing.assert_allclose(file.diagram.candela[nearest.argmin()], values, rtol=1e-9)
    np.testing.assert_allclose(np.degrees(file.diagram.gamma), table.gamma, atol=1e-9)


@given(
    lm63_tables(),
    seeds,
    st.sampled_from(
        [("", 1986), ("IESNA91", 1991), ("IESNA:LM-63-1995", 1995), ("IESNA:LM-63-2002", 2002),
         ("IES:LM-63-2019", 2019)]
    ),
    st.tuples(*[st.sampled_from([1.0, 0.5, 1.25, 4.0])] * 3),
    st.sampled_from([" ", "\n", ", ", "\r\n", "\t"]),
    st.booleans(),
)  # fmt: skip
def test_any_lm_63_file_gives_back_its_candela(table, seed, version, factors, between, tilt):
    """Candela = value x multiplier x ballast factor, and x the twelfth number before 2019."""
    first, year = version
    whole = np.prod(factors if year < 2019 else factors[:2])
    head = [first or "A luminaire", *(["[TEST] T1"] if first else [])]
    head += ["TILT=INCLUDE\n1\n2\n0 90\n1 0.9"] if tilt else ["TILT=NONE"]
    planes = table.c[: len(table.c) - (table.fold == "none" and len(table.c) > 4 and tilt)]
    full = table.fold == "none"
    if full and len(planes) < len(table.c):  # 360 left out, where the gap tells
        gaps = np.diff(table.c)
        assume(gaps[-1] <= gaps[:-1].max() and planes[-1] > 180)
    numbers = [1, -1, factors[0], len(table.gamma), len(planes), 1, 2, 0.2, 0.3, 0]
    numbers += [factors[1], factors[2], 20, *table.gamma, *planes]
    numbers += (table.candela[: len(planes)] / 1.0).ravel().tolist()
    text = "\n".join(head) + "\n" + between.join(f"{x:.10g}" for x in numbers) + "\n"
    file = read_photometric_bytes(text.encode(), "light.ies")
    assert file.format.endswith(str(year))
    compare(file, Table(table.gamma, table.c, table.candela * whole, table.fold), seed)


@st.composite
def eulumdat_tables(draw):
    symmetry = draw(st.integers(0, 4))
    quarter = draw(st.integers(1, 6))
    count = 1 if symmetry == 1 else 4 * quarter
    circle = np.arange(count) * 360 / count
    gamma = draw(st.sampled_from([(0, 90), (90, 180), (0, 180)]).flatmap(
        lambda ends: increasing(*ends, most=6)
    ))  # fmt: skip
    fold = ["none", "axial", "about C0-C180", "about C90-C270", "quadrant"][symmetry]
    match symmetry:
        case 0 | 1:
            stored = np.arange(count)
        case 2:
            stored = np.arange(count // 2 + 1)
        case 3:  # the format starts them at C270, through C0, to C90
            stored = np.arange(-quarter, quarter + 1)
        case 4:
            stored = np.arange(quarter + 1)
    values = candela_of(draw(seeds), (len(stored), len(gamma)))
    return symmetry, circle, gamma, stored, values, fold


@given(
    eulumdat_tables(),
    seeds,
    st.sampled_from([500.0, 1000.0, 2750.5]),
    st.sampled_from([1.0, 0.8]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.booleans(),
)
def test_any_eulumdat_file_gives_back_its_candela(drawn, seed, flux, conversion, end, commas):
    symmetry, circle, gamma, stored, values, fold = drawn
    lines = ["Nobody", 1, symmetry, len(circle), 360 / len(circle), len(gamma), 0, "T1", "Lamp"]
    lines += ["L1", "l.ldt", "today", 200, 100, 50, 200, 100, 0, 0, 0, 0, 100, 0, conversion, 0]
    lines += [1, "1", "LED", flux, "3000", "80", 20, *[0] * 10]
    lines += [*circle, *gamma, *values.ravel()]
    texts = [f"{x:.10g}" if isinstance(x, float) else str(x) for x in lines]
    if commas:
        texts = [t.replace(".", ",") if "l.ldt" not in t else t for t in texts]
    file = read_photometric_bytes(end.join(texts).encode(), "light.ldt")
    planes = circle[stored % len(circle)]
    candela = values * flux * conversion / 1000
    if symmetry == 3:  # as C90 to C270: the mirror images of the stored ones
        planes, candela = (180 - stored * 360 / len(circle))[::-1], candela[::-1]
    compare(file, Table(gamma, planes, candela, fold), seed)


@given(lm63_tables(), seeds)
def test_an_inline_diagram_is_what_it_says(table, seed):
    diagram = inline_diagram(table.gamma, table.c, table.candela, "/Lamp")
    gamma, c = np.random.default_rng(seed).uniform([0.01, 0], [179.99, 360], (40, 2)).T
    np.testing.assert_allclose(
        intensity(diagram, gamma, c), table.at(gamma, c), atol=1e-5 * table.candela.max()
    )


def quadrature(diagram):
    """lm: the bilinear intensity by 8 Gauss-Legendre points a cell and way."""
    x, w = np.polynomial.legendre.leggauss(8)
    s, w = 0.5 * (x + 1), 0.5 * w
    c, planes = diagram.c_angles, diagram.candela
    if len(c) == 1:
        c, planes = np.array([0, 2 * np.pi]), np.repeat(planes, 2, axis=0)
    width = np.diff(diagram.gamma)
    gamma = diagram.gamma[:-1, None] + width[:, None] * s
    along = planes[:, :-1, None] * (1 - s) + planes[:, 1:, None] * s
    of_plane = (along * np.sin(gamma) * w).sum(axis=2) @ width  # of each C, per radian
    return np.diff(c) @ (of_plane[1:] + of_plane[:-1]) / 2


@given(lm63_tables())
def test_the_flux_of_any_diagram_is_its_integral(table):
    diagram = inline_diagram(table.gamma, table.c, table.candela, "/Lamp")
    assert luminous_flux(diagram) == pytest.approx(quadrature(diagram), rel=1e-9)


@given(lm63_tables(), seeds)
@settings(max_examples=60)
def test_photons_leave_any_luminaire_only_where_it_shines_and_on_its_mean_intensity(table, seed):
    """E[1 / I] over samples of density I / flux is the solid angle that shines over the flux."""
    diagram = inline_diagram(table.gamma, table.c, table.candela + 1.0, "/Lamp")
    own = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    u = np.random.default_rng(seed).random((4000, 3))
    directions = own.sample(u)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-9)
    inverse = 1 / own.intensity(directions)
    assert np.isfinite(inverse).all()
    solid_angle = 2 * np.pi * (np.cos(diagram.gamma[0]) - np.cos(diagram.gamma[-1]))
    error = inverse.std() / np.sqrt(len(u))
    assert abs(inverse.mean() - solid_angle / own.luminous_flux) < 5.5 * error + 1e-9
