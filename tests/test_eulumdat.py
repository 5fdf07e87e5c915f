"""EULUMDAT files: every symmetry, relative and absolute, whole and damaged."""

import time

import numpy as np
import pytest
from isolux._core import CandelaDistribution

from isolux.errors import PhotometryError
from isolux.photometry import luminous_flux, read_photometric_bytes, read_photometric_file

ISOTROPIC = 4.0 * np.pi  # lm a cd


def eulumdat(
    symmetry=1,
    c_angles=(0.0,),
    gamma=(0.0, 90.0, 180.0),
    candela=(1000.0, 1000.0, 1000.0),
    opening=("200", "100", "0", "0", "0", "0"),
    output_ratio="0",
    conversion="1",
    lamps=(("1", "LED", "1000", "3000", "80", "20"),),
):
    """Lines of a file; intensities in cd/klm, those of the stored planes one after the other."""
    lines = ["Nobody", "1", symmetry, len(c_angles), 0, len(gamma), 0, "T1", "Lamp", "L1", "l.ldt"]
    lines += ["today", "200", "100", "50", *opening, "100", output_ratio, conversion, "0"]
    lines += [len(lamps), *(item for lamp in lamps for item in lamp), *["0"] * 10]
    lines += [f"{value:.10g}" for value in (*c_angles, *gamma, *np.ravel(candela))]
    return [str(line) for line in lines]


def read(lines, name="light.ldt"):
    return read_photometric_bytes("\r\n".join(lines).encode(), name)


# Flux by integration over the flux that the file declares for its luminaire.
REAL_FILES = {
    "123VincentB+eulumdat-py/tests/samples/sample1.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample2.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample3.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample5.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample6.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample8.ldt": 1.0,
    "123VincentB+eulumdat-py/tests/samples/sample9.ldt": 1.0,
    "123VincentB+eulumdat-ugr/data/input/sample_11.ldt": 1.0,
    # Two files made up to test readers, with candela that don't belong to their lamps.
    "dlippok+photometric-viewer/tests/data/photometrics/ldt/multiple_lamp_sets.ldt": 0.9045,
    "dlippok+photometric-viewer/tests/data/photometrics/ldt/symmetry_to_c0c180.ldt": 3.141,
    "sammorrell+lidrs/src/io/eulumdat/example.ldt": 1.0,
}


@pytest.mark.parametrize("name", REAL_FILES)
def test_real_file_gives_the_flux_that_it_declares(inputs, name):
    file = read_photometric_file(inputs / "ldt" / name)
    ratio = luminous_flux(file.diagram) / file.declared_flux
    assert ratio == pytest.approx(REAL_FILES[name], rel=2e-3)
    assert any("declares" in warning for warning in file.warnings) == (abs(ratio - 1.0) > 0.05)


def test_no_real_file_is_left_out(inputs):
    found = {str(path.relative_to(inputs / "ldt")) for path in (inputs / "ldt").rglob("*.ldt")}
    assert found == set(REAL_FILES)


CIRCLE = np.arange(0.0, 360.0, 22.5)


@pytest.mark.parametrize(
    ("symmetry", "stored", "of_c"),
    [
        (0, CIRCLE, lambda c: 2 + np.sin(c) + np.cos(c)),
        (1, [0.0], lambda c: 2 + 0 * c),
        (2, np.arange(0.0, 181.0, 22.5), lambda c: 2 + np.cos(c)),
        (3, np.arange(270.0, 451.0, 22.5), lambda c: 2 + np.sin(c)),
        (4, np.arange(0.0, 91.0, 22.5), lambda c: 2 + np.cos(2 * c)),
    ],
    ids=["none", "axial", "about C0-C180", "about C90-C270", "both"],
)
def test_every_symmetry_unfolds_to_the_whole_circle(symmetry, stored, of_c):
    candela = of_c(np.radians(stored))[:, None] * [1000.0, 3000.0, 1000.0]
    diagram = read(eulumdat(symmetry, CIRCLE, candela=candela)).diagram
    distribution = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    c = np.radians(CIRCLE)
    horizontal = np.stack([np.cos(c), np.sin(c), 0.0 * c], axis=-1)
    assert distribution.intensity(horizontal) == pytest.approx(3000.0 * of_c(c))


def test_intensities_are_per_kilolumen_of_the_lamps():
    file = read(eulumdat(lamps=[("2", "T5", "2500", "", "", "60")], output_ratio="80"))
    assert luminous_flux(file.diagram) == pytest.approx(2.5 * 1000.0 * ISOTROPIC)
    assert (file.lamp_flux, file.declared_flux, file.input_watts) == (2500.0, 2000.0, 60.0)


def test_a_negative_number_of_lamps_means_absolute_photometry():
    file = read(eulumdat(lamps=[("-1", "LED", "2500", "", "", "60")], output_ratio="100"))
    assert file.lamp_flux is None
    assert file.declared_flux == 2500.0


def test_of_alternative_lamp_sets_the_first_is_taken():
    sets = [("1", "LED", "500", "", "", "10"), ("1", "LED", "900", "", "", "20")]
    file = read(eulumdat(lamps=sets))
    assert luminous_flux(file.diagram) == pytest.approx(0.5 * 1000.0 * ISOTROPIC)
    assert "first of 2" in file.warnings[0]


def test_the_conversion_factor_multiplies_the_intensities():
    file = read(eulumdat(conversion="1.5"))
    assert luminous_flux(file.diagram) == pytest.approx(1500.0 * ISOTROPIC)


@pytest.mark.parametrize(
    ("opening", "expected"),
    [
        (("1200", "100", "20", "30", "20", "30"), ("rectangle", 0.1, 1.2, 0.03)),
        (("200", "0", "0", "0", "0", "0"), ("round", 0.2, 0.2, 0.0)),
        (("0", "", "0", "0", "0", "0"), ("point", 0.0, 0.0, 0.0)),
    ],
)
def test_luminous_area_in_millimetres(opening, expected):
    found = read(eulumdat(opening=opening)).opening
    assert (found.shape, found.along_c0, found.along_c90, found.height) == pytest.approx(expected)


def test_decimal_commas_are_read_as_points_and_remarked():
    lines = [line.replace(".", ",") for line in eulumdat(candela=(999.5, 999.5, 999.5))]
    lines[10] = "l.ldt"
    file = read(lines)
    assert luminous_flux(file.diagram) == pytest.approx(999.5 * ISOTROPIC)
    assert "Decimal commas" in file.warnings[0]


def test_the_content_decides_where_the_extension_says_nothing():
    assert read(eulumdat(), "light.txt").format == "EULUMDAT"
    assert read(eulumdat(), "kit.usdz[light.ldt]").format == "EULUMDAT"
    with pytest.raises(PhotometryError, match="neither"):
        read(["#usda 1.0"], "scene.txt")


def with_line(number, text, symmetry=1):
    lines = eulumdat(symmetry)
    lines[number - 1] = text
    return lines


BROKEN = {
    "the end of the file in line 48": eulumdat()[:-1],
    "the end of the file in line 20": eulumdat()[:20],
    "the end of the file in line 1": [],
    "symmetry 7": with_line(3, "7"),
    "'x' in line 4": with_line(4, "x"),
    "1 in line 6": with_line(6, "1"),
    "lamp flux of 0 lm in line 29": with_line(29, "0"),
    "'bright' in line 29": with_line(29, "bright"),
    "'1e300' in line 29": with_line(29, "1e300"),
    "0 after 0 in line 45": with_line(45, "0"),
    "-5 cd in line 48": with_line(48, "-5"),
    "all zero": eulumdat(candela=(0, 0, 0)),
    "0 to 100": eulumdat(2, (0.0, 100.0), candela=np.ones((2, 3))),
}


@pytest.mark.parametrize("found", BROKEN)
def test_what_cannot_be_read_says_what_and_where(found):
    with pytest.raises(PhotometryError) as error:
        read(BROKEN[found], "broken.ldt")
    assert error.value.subject == "broken.ldt"
    assert found in error.value.found


def test_huge_counts_are_refused_before_anything_is_allocated():
    start = time.perf_counter()
    with pytest.raises(PhotometryError, match="the end of the file"):
        read(with_line(4, "2000000000", symmetry=0))
    assert time.perf_counter() - start < 1.0
