"""IES LM-63 files as laboratories, catalogues and damaged downloads have them."""

import time

import numpy as np
import pytest
from isolux._core import CandelaDistribution

from isolux.errors import PhotometryError
from isolux.photometry import (
    luminous_flux,
    read_photometric_bytes,
    read_photometric_file,
)

ISOTROPIC = 4.0 * np.pi  # lm a cd


def numbers(values):
    return " ".join(f"{value:.10g}" for value in np.ravel(values))


def lm63(
    version="IESNA:LM-63-2002",
    header="[TEST] T1",
    tilt="TILT=NONE",
    lamps="1 -1 1",
    kind="1 2",
    opening="0 0 0",
    electrical="1 1 10",
    vertical=(0, 90, 180),
    horizontal=(0,),
    candela=(1, 1, 1),
):
    counts = f"{len(vertical)} {len(horizontal)}"
    lines = [version, header, tilt, f"{lamps} {counts} {kind} {opening}", electrical]
    lines += [numbers(vertical), numbers(horizontal)]
    lines += [numbers(plane) for plane in np.reshape(candela, (len(horizontal), -1))]
    return "\n".join(line for line in lines if line) + "\n"


def read(text, name="light.ies"):
    return read_photometric_bytes(text if isinstance(text, bytes) else text.encode(), name)


def intensity(diagram, gamma, c):
    """cd at angles in degrees."""
    gamma, c = np.radians(gamma), np.radians(c)
    directions = np.stack(
        np.broadcast_arrays(np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), -np.cos(gamma)),
        axis=-1,
    )
    distribution = CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)
    return distribution.intensity(directions.reshape(-1, 3))


# --- real files ---------------------------------------------------------------------------------

# Flux by integration, lm. Where a file or its name states the luminaire's flux: that (marked =).
REAL_FILES = {
    "Autodesk+arnold-usd/testsuite/test_0075/data/12.IES": 33.15,
    "Autodesk+arnold-usd/testsuite/test_0140/data/file.ies": 3062,
    "Autodesk+arnold-usd/testsuite/test_1316/data/light.ies": 231.8,
    "Autodesk+arnold-usd/testsuite/test_2477.1/data/profile.ies": 4777,  # =
    "GPUOpen-LibrariesAndSDKs+RadeonProRenderSDK/Resources/Textures/ies_light_1.ies": 18.22,
    "GPUOpen-LibrariesAndSDKs+RadeonProRenderSDK/Resources/Textures/ies_light_2.ies": 24.65,
    "LuxCoreRender+LuxCore/scenes/bigmonkey/ASA_15M_R2.ies": 9561,
    "NREL+Radiance/src/cv/mgflib/examp1.ies": 5297,
    "NVIDIA+MDL-SDK/examples/mdl/nvidia/sdk_examples/resources/example_modules.ies": 18.85,
    # Type B over a hemisphere; the odd parts cancel and leave the mean: 0.55 * 2 pi.
    "NVIDIA+MDL-SDK/src/io/scene/mdl_elements/resources/test.ies": 0.55 * 2.0 * np.pi,
    "NVIDIA+MDL-SDK/src/io/scene/mdl_elements/resources/test_file_format_error.ies": "line 3",
    "NVIDIA+OptiX_Apps/data/mdl/ies/TypeC.ies": 628.3,
    "NVIDIA+OptiX_Apps/data/test.ies": 143.7,
    "dlippok+photometric-viewer/tests/data/photometrics/ies95/"
    "absolute_photometry_with_multiplier.ies": 1357,
    "dlippok+photometric-viewer/tests/data/photometrics/ies95/"
    "horizontal_cylinder_opening_along_length.ies": 904.5,
    "dlippok+photometric-viewer/tests/data/photometrics/ies95/imperial_units.ies": 904.5,
    "dlippok+photometric-viewer/tests/data/photometrics/ies95/point_opening.ies": 904.5,
    "dlippok+photometric-viewer/tests/data/photometrics/ies95/"
    "rectangular_opening_with_height.ies": 904.5,
    "jvbelenky+guv-calcs/src/guv_calcs/data/lamp_data/B1 module.ies": 121.1,
    "jvbelenky+guv-calcs/src/guv_calcs/data/lamp_data/aerolamp.ies": 98.26,
    "jvbelenky+guv-calcs/src/guv_calcs/data/lamp_data/nukit_lantern.ies": 30.52,
    "jvbelenky+guv-calcs/src/guv_calcs/data/lamp_data/sterilray.ies": 317.0,
    "jvbelenky+photompy/tests/data/LLIA001477-002.ies": 53.57,
    "lwihlborg+IES-Thumbnail-Handler/sample.ies": 15320,
    "pmolodo+luxtest/04f377f94ce81cd7b5101fffdf571454.ies": 1862,
    "pmolodo+luxtest/bega_50988.6k3.ies": 1096,
    "pmolodo+luxtest/bega_84659K4.ies": 9600,
    "pmolodo+luxtest/bega_84693k4.ies": 2047,
    "pmolodo+luxtest/bega_omni001_1238lm.ies": 1238,  # =
    "pmolodo+luxtest/test_stripes_nonuniform.ies": 6.283,
    "pmolodo+luxtest/test_vstripes_hquadrants_nonuniform.ies": 7.061,
    "pmolodo+luxtest/test_vstripes_hquadrants_nonuniform_aimDown.ies": 1.020,
    "pmolodo+luxtest/test_vstripes_hquadrants_nonuniform_aimUp.ies": 1.024,
    "sammorrell+lidrs/src/io/ies/iesna2002_example_typec.ies": 98600,
}


@pytest.mark.parametrize("name", REAL_FILES)
def test_real_file_gives_its_flux_or_its_error(inputs, name):
    expected = REAL_FILES[name]
    if isinstance(expected, str):
        with pytest.raises(PhotometryError, match=expected):
            read_photometric_file(inputs / "ies" / name)
        return
    file = read_photometric_file(inputs / "ies" / name)
    assert luminous_flux(file.diagram) == pytest.approx(expected, rel=1e-3)


def test_no_real_file_is_left_out(inputs):
    folder = inputs / "ies"
    found = {str(path.relative_to(folder)) for path in folder.rglob("*.[iI][eE][sS]")}
    assert found == set(REAL_FILES)


# --- candela and flux ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("version", "factor"),
    [
        ("", 2.0 * 0.9 * 1.1),
        ("IESNA91", 2.0 * 0.9 * 1.1),
        ("IESNA:LM-63-1995", 2.0 * 0.9 * 1.1),
        ("IESNA: LM-63-2002", 2.0 * 0.9 * 1.1),
        ("IES:LM-63-2019", 2.0 * 0.9),  # 1.1 says how the file was made
    ],
)
def test_candela_are_multiplied_by_the_factors_of_their_version(version, factor):
    file = read(lm63(version=version, lamps="1 -1 2", electrical="0.9 1.1 10"))
    assert luminous_flux(file.diagram) == pytest.approx(factor * ISOTROPIC)


def test_negative_lumens_mean_absolute_photometry():
    assert read(lm63(lamps="1 -1 1")).lamp_flux is None
    relative = read(lm63(lamps="2 1200 1"))
    assert relative.lamp_flux == 2400.0
    assert luminous_flux(relative.diagram) == pytest.approx(ISOTROPIC), "candela are never divided"


def test_more_light_than_the_lamps_give_is_remarked():
    assert "more than the lamps' 10 lm" in read(lm63(lamps="1 10 1")).warnings[0]
    assert read(lm63(lamps="1 13 1")).warnings == ()


@pytest.mark.parametrize(
    ("vertical", "candela", "flux"),
    [
        ((0, 90), (1, 1), ISOTROPIC / 2.0),
        ((90, 180), (1, 1), ISOTROPIC / 2.0),
        ((0, 60), (1, 1), ISOTROPIC / 4.0),
    ],
)
def test_outside_the_vertical_angles_there_is_no_light(vertical, candela, flux):
    file = read(lm63(vertical=vertical, candela=candela))
    assert luminous_flux(file.diagram) == pytest.approx(flux)


# --- symmetry -----------------------------------------------------------------------------------

ALL_ROUND = np.arange(0.0, 361.0, 22.5)


@pytest.mark.parametrize(
    ("horizontal", "of_c"),
    [
        (np.arange(0.0, 91.0, 22.5), lambda c: 2 + np.cos(2 * c)),
        (np.arange(0.0, 181.0, 22.5), lambda c: 2 + np.cos(c)),
        (np.arange(90.0, 271.0, 22.5), lambda c: 2 + np.sin(c)),
        (np.array([90.0, 135.0, 157.5, 202.5, 270.0]), lambda c: 2 + np.sin(c)),
        (ALL_ROUND[:-1], lambda c: 2 + np.sin(c) + np.cos(c)),
        (ALL_ROUND, lambda c: 2 + np.sin(c) + np.cos(c)),
        (np.array([0.0]), lambda c: 2 + 0 * c),
    ],
    ids=["0-90", "0-180", "90-270", "90-270 without 180", "0-360 without 360", "0-360", "0"],
)
def test_symmetric_files_unfold_to_the_whole_circle(horizontal, of_c):
    gamma = np.array([0.0, 45.0, 90.0, 180.0])
    falloff = np.array([1.0, 3.0, 2.0, 1.0])
    file = read(
        lm63(
            vertical=gamma,
            horizontal=horizontal,
            candela=of_c(np.radians(horizontal))[:, None] * falloff,
        )
    )
    c = file.diagram.c_angles
    if len(horizontal) > 1:
        assert c[0] == 0.0 and c[-1] == 2.0 * np.pi
    tabulated = np.degrees(c)
    tabulated = tabulated[np.isclose(tabulated % 22.5, 0.0) & (tabulated % 180.0 != 0.0)]
    assert intensity(file.diagram, 45.0, tabulated) == pytest.approx(
        3.0 * of_c(np.radians(tabulated))
    )


@pytest.mark.parametrize("horizontal", [(0, 45), (0, 90, 120), (90, 180), (45, 135, 360)])
def test_other_horizontal_ranges_are_refused(horizontal):
    with pytest.raises(PhotometryError, match="0, 0-90, 0-180, 90-270 or 0-360"):
        read(lm63(horizontal=horizontal, candela=np.ones((len(horizontal), 3))))


# --- types A and B ------------------------------------------------------------------------------


def beam(x, y, z):
    """cd towards a direction: wide, leaning 25 deg to C0 and 15 deg to C90."""
    lean_x, lean_y = np.sin(np.radians([25.0, 15.0]))
    cosine = x * lean_x + y * lean_y - z * np.sqrt(1.0 - lean_x**2 - lean_y**2)
    return 1000.0 * np.maximum(cosine, 0.0) ** 4


def type_a(v, h):
    return np.sin(v), np.cos(v) * np.sin(h), -np.cos(v) * np.cos(h)


def type_b(v, h):
    return np.cos(h) * np.sin(v), np.sin(h), -np.cos(h) * np.cos(v)


@pytest.mark.parametrize(("code", "direction"), [("3", type_a), ("2", type_b)])
def test_types_a_and_b_are_the_same_light_about_other_axes(code, direction):
    angles = np.arange(-90.0, 91.0, 2.5)
    v, h = np.meshgrid(np.radians(angles), np.radians(angles))  # horizontal-major
    file = read(
        lm63(kind=f"{code} 2", vertical=angles, horizontal=angles, candela=beam(*direction(v, h)))
    )
    gamma, c = np.meshgrid(np.arange(1.0, 89.0, 4.0), np.arange(3.0, 360.0, 10.0))
    exact = beam(
        np.sin(np.radians(gamma)) * np.cos(np.radians(c)),
        np.sin(np.radians(gamma)) * np.sin(np.radians(c)),
        -np.cos(np.radians(gamma)),
    ).ravel()
    np.testing.assert_allclose(intensity(file.diagram, gamma, c), exact, atol=4.0)

    # Direct integration in the file's own axes: the latitude's cosine is the solid angle's.
    step = np.radians(2.5)
    latitude = v if code == "3" else h
    direct = float((beam(*direction(v, h)) * np.cos(latitude)).sum() * step**2)
    assert luminous_flux(file.diagram) == pytest.approx(direct, rel=2e-3)


def test_type_b_from_zero_is_laterally_symmetric():
    vertical, horizontal = np.arange(-90.0, 91.0, 5.0), np.arange(0.0, 91.0, 5.0)
    v, h = np.meshgrid(np.radians(vertical), np.radians(horizontal))
    half = read(
        lm63(kind="2 2", vertical=vertical, horizontal=horizontal, candela=np.cos(v) * np.cos(h))
    )
    assert luminous_flux(half.diagram) == pytest.approx(np.pi, rel=2e-3), "Lambertian: pi lm/cd"
    assert intensity(half.diagram, 60.0, 90.0) == pytest.approx(0.5, rel=1e-2)
    assert intensity(half.diagram, 60.0, 270.0) == pytest.approx(0.5, rel=1e-2)
    assert any("symmetric" in warning for warning in half.warnings)


def test_a_narrow_type_b_beam_keeps_its_flux_and_its_peak():
    fine = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(2.0, 10.0, 0.5), [10, 30, 90]])
    angles = np.unique(np.concatenate([-fine, fine]))
    v, h = np.meshgrid(angles, angles)
    candela = 1e6 * np.exp(-(v**2 + h**2) / (2 * 0.5**2)) + 1.0
    diagram = read(lm63(kind="2 2", vertical=angles, horizontal=angles, candela=candela)).diagram
    # A bilinear bell of sigma 5 steps has 1 / 300 more than the bell in each direction, squared.
    bell = 1e6 * 2.0 * np.pi * np.radians(0.5) ** 2 + 2.0 * np.pi
    assert luminous_flux(diagram) == pytest.approx(bell, rel=5e-3)
    assert diagram.candela.max() == pytest.approx(1e6, rel=1e-2)


# --- header, opening, TILT ----------------------------------------------------------------------


def test_header_keywords_are_kept_with_their_continuation_lines():
    file = read(lm63(header="[TEST] T1\n[OTHER] one\n[MORE] two\n[MANUFAC]Nobody & Co"))
    assert file.format == "IES LM-63-2002"
    assert file.keywords == {"TEST": "T1", "OTHER": "one\ntwo", "MANUFAC": "Nobody & Co"}
    assert file.input_watts == 10.0


@pytest.mark.parametrize(
    ("version", "units", "opening", "expected"),
    [
        ("IESNA:LM-63-1995", 2, "0 0 0", ("point", 0, 0, 0)),
        ("IESNA:LM-63-1995", 2, "0.3 1.2 0.1", ("rectangle", 1.2, 0.3, 0.1)),
        ("IESNA:LM-63-1995", 1, "1 4 0", ("rectangle", 1.2192, 0.3048, 0)),
        ("", 2, "-0.2 0 0", ("round", 0.2, 0.2, 0)),
        ("IESNA:LM-63-2002", 2, "-0.2 -0.2 0", ("round", 0.2, 0.2, 0)),
        ("IESNA:LM-63-2002", 2, "-0.2 0 0", ("round", 0.2, 0.2, 0)),
        ("IESNA:LM-63-1995", 2, "-0.2 0 -0.2", ("round", 0.2, 0.2, 0.2)),
        ("IES:LM-63-2019", 2, "-0.2 -0.2 -0.2", ("round", 0.2, 0.2, 0.2)),
        ("IESNA:LM-63-2002", 2, "-0.2 0 -0.2", ("round", 0, 0.2, 0.2)),
        ("IESNA:LM-63-1995", 2, "0 1.2 -0.1", ("round", 1.2, 0.1, 0.1)),
        ("IESNA:LM-63-2002", 2, "-0.1 1.2 -0.1", ("round", 1.2, 0.1, 0.1)),
        ("IESNA:LM-63-1995", 2, "-0.2 0 0.5", ("round", 0.2, 0.2, 0.5)),
    ],
    ids=[
        "point", "box", "feet", "disk 1986", "disk 2002", "disk 1986 in 2002", "sphere 1995",
        "sphere 2002", "upright disk 2002", "lying tube 1995", "lying tube 2002", "cylinder",
    ],
)  # fmt: skip
def test_opening_sizes_in_every_encoding(version, units, opening, expected):
    found = read(lm63(version=version, kind=f"1 {units}", opening=opening)).opening
    assert found.shape == expected[0]
    assert (found.along_c0, found.along_c90, found.height) == pytest.approx(expected[1:])


def test_tilt_factors_are_read_over_and_remarked():
    included = read(lm63(tilt="TILT=INCLUDE\n1\n3\n0 90 180\n1 0.9 1"))
    assert luminous_flux(included.diagram) == pytest.approx(ISOTROPIC)
    assert "TILT" in included.warnings[0]
    assert "lamp.tlt" in read(lm63(tilt="TILT=lamp.tlt")).warnings[0]


def test_tilt_may_come_first():
    assert read(lm63(version="", header="")).format == "IES LM-63-1986"


# --- the text itself ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        lm63().replace("\n", "\r\n").encode(),
        lm63().replace("\n", "\r").encode(),
        lm63().encode("utf-8-sig"),
        lm63(header="[MANUFAC] Lumière à côté").encode("latin-1"),
        lm63().replace(" ", ", ").encode(),
        lm63().replace(" 3 1 1 2 ", " 3.0 1.0 1.0 2.0 ").encode(),
        (lm63() + "\x1a\0\0").encode(),
        lm63().replace("TILT=NONE", "Tilt = none").encode(),
    ],
    ids=["CRLF", "CR", "BOM", "Latin-1", "commas", "counts as 1.0", "CP/M end", "spaced TILT"],
)
def test_text_in_any_dress_reads_the_same(content):
    file = read(content)
    assert luminous_flux(file.diagram) == pytest.approx(ISOTROPIC)
    assert file.warnings == ()


def test_what_follows_the_candela_is_ignored_and_remarked():
    assert "Text after the candela" in read(lm63() + "END OF FILE").warnings[0]
    assert "2 numbers more" in read(lm63() + "1 1").warnings[0]


BROKEN = {
    "no TILT= line": "PK\x03\x04 no photometry at all\n",
    "no TILT=": "",
    "only 1 of 3 numbers before the end of the file in line 8": lm63()[:-4],
    "only 0 of 1 numbers": "\n".join(lm63().split("\n")[:3]),
    "-2 cd in line 8": lm63(candela=(1, -2, 1)),
    "all zero": lm63(candela=(0, 0, 0)),
    "90 after 90 in line 6": lm63(vertical=(0, 90, 90)),
    "90 after 180 in line 7": lm63(horizontal=(0, 180, 90), candela=np.ones((3, 3))),
    "0 to 190": lm63(vertical=(0, 90, 190)),
    "one vertical angle": lm63(vertical=(90,), candela=(1,)),
    "photometric type 4 in line 4": lm63(kind="4 2"),
    "units type 3 in line 4": lm63(kind="1 3"),
    "'x' in line 5": lm63(electrical="1 x 10"),
    "'nan' in line 5": lm63(electrical="1 nan 10"),
    "'1e999' in line 5": lm63(electrical="1 1e999 10"),
    "'1e300' in line 4": lm63(lamps="4294967295 1e300 1"),
    "3.5 in line 4": lm63().replace(" 3 1 1 2 ", " 3.5 1 1 2 "),
    "0 in line 4": lm63().replace(" 3 1 1 2 ", " 0 1 1 2 "),
    "'1,0' in line 5": lm63().replace("1 1 10", "1,0 1,0 10"),
    "'1,5' in line 8": lm63(candela=(1.5, 2.5, 3.5)).replace("1.5 2.5", "1,5 2,5"),
}


@pytest.mark.parametrize("found", BROKEN)
def test_what_cannot_be_read_says_what_and_where(found):
    with pytest.raises(PhotometryError) as error:
        read(BROKEN[found], "broken.ies")
    assert error.value.subject == "broken.ies"
    assert found in error.value.found


def test_huge_counts_are_refused_before_anything_is_allocated():
    start = time.perf_counter()
    with pytest.raises(PhotometryError, match="before the end of the file"):
        read(lm63().replace(" 3 1 1 2 ", " 2000000000 2000000000 1 2 "))
    assert time.perf_counter() - start < 1.0


@pytest.mark.parametrize("name", ["missing.ies", "."])
def test_a_path_that_is_no_file_is_named(tmp_path, name):
    with pytest.raises(PhotometryError) as error:
        read_photometric_file(tmp_path / name)
    assert error.value.subject == str(tmp_path / name)


def test_an_absurdly_large_file_is_refused(tmp_path):
    path = tmp_path / "large.ies"
    path.write_bytes(b"\n" * (17 * 1024 * 1024))
    with pytest.raises(PhotometryError, match="bytes"):
        read_photometric_file(path)
