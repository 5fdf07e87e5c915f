"""The path-traced reference that the solver is measured by, itself against closed forms."""

import numpy as np
import pytest
from luminaire_sampling import diagram_flux
from path_tracer import PathTracer
from reference import DIRECT, INDIRECT, TOTAL, PathTracedReference, path_traced_reference
from usd_scenes.box_room.generate import LUMINOUS_FLUX, SIZE
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, merge, rectangle

from core_scenes import build, luminaire, surface
from hand_built import scene_of
from isolux.scene_description import GoniometricDiagram

FLUX = 1000.0  # lm
BATCHES = 16
SAMPLES = 64  # of all luminaires together


def tracer_of(meshes, luminaires):
    return PathTracer(scene(meshes, luminaires))


def scene(meshes, luminaires):
    description = scene_of(meshes)
    return type(description)(
        meshes=description.meshes,
        luminaires=tuple(luminaires),
        findings=(),
        meters_per_unit=1.0,
        up_axis="Z",
        time_code=None,
        source_hash="",
    )


def mean_and_error(gather):
    """Of independent batches; gather : takes a random generator."""
    values = np.array([gather(np.random.default_rng([7, batch])) for batch in range(BATCHES)])
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(BATCHES)


def with_diagram(light, gamma, c_angles, candela):
    diagram = GoniometricDiagram(gamma, c_angles, candela)
    return type(light)(
        **{name: getattr(light, name) for name in light.__slots__ if name != "diagram"},
        diagram=diagram,
    )


def on_walls(random, cells, size):
    """A random point in each cell of six walls of a cube around the origin; normals inwards."""
    i = np.stack(np.meshgrid(np.arange(cells), np.arange(cells)), axis=-1).reshape(-1, 2)
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            across = ((i + random.random(i.shape)) / cells - 0.5) * size
            points.append(np.insert(across, axis, side * size / 2, axis=1))
            normals.append(np.insert(np.zeros(i.shape), axis, -side, axis=1))
    return np.concatenate(points), np.concatenate(normals)


def test_indirect_light_in_the_cube_of_cie_171_case_5_8():
    """Mean indirect light ρ Φ / (S (1 - ρ)), by channel: each has its own reflectance."""
    reflectance = np.array([0.9, 0.5, 0.2])
    room = surface(box((SIZE, SIZE, SIZE), 1.0).flipped(), reflectance)
    tracer = tracer_of([room], [luminaire(LUMINOUS_FLUX)])
    mean, error = mean_and_error(
        lambda random: tracer.indirect(*on_walls(random, 8, SIZE), 4, random).mean(axis=0)
    )
    expected = LUMINOUS_FLUX / (6 * SIZE**2) * reflectance / (1 - reflectance)
    assert expected[:2] == pytest.approx([937, 104], rel=3e-3)  # as tabulated
    assert (np.abs(mean - expected) < 4 * error).all()
    assert (error < 0.02 * expected).all()


@pytest.mark.parametrize("double_sided", [False, True])
def test_the_inside_of_a_sphere_that_faces_outwards(double_sided):
    """One-sided, its backs absorb; double-sided, it is a furnace."""
    reflectance = 0.5
    sphere = icosphere(3)
    tracer = tracer_of([surface(sphere, reflectance, double_sided=double_sided)], [luminaire(FLUX)])
    inwards = -sphere.points / np.linalg.norm(sphere.points, axis=1, keepdims=True)
    positions = 0.9 * sphere.points  # clear of the facets; in the limit the same at each point
    light, error = mean_and_error(
        lambda random: tracer.indirect(positions, inwards, 4, random)[:, 0].mean()
    )
    # From the inside of a furnace the facets' luminance is the same in all directions.
    expected = FLUX / sphere.area() * reflectance / (1 - reflectance) if double_sided else 0.0
    assert light == pytest.approx(expected, abs=4 * error + 2e-3 * expected)


def parallel_rectangle(a, b, height):
    """Factor of a rectangle a by b with a corner above the point."""
    p, q = np.hypot(a, height), np.hypot(b, height)
    return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi)


def perpendicular_disk(radius, height, away):
    h, r = height / away, radius / away
    z = 1 + h**2 + r**2
    return h / 2 * (z / np.sqrt(z**2 - 4 * r**2) - 1)


def tube(radius, length, distance):
    """A thin tube square to the normal above the point, in front of its middle."""
    d, end = distance, length / 2
    return 2 * radius / np.pi * (end / (d * (d**2 + end**2)) + np.arctan(end / d) / d**2) * d


UP, SIDEWAYS = (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("shape", "size", "point", "normal", "area", "factor"),
    [
        ("rect", (1.2, 0.6), (-0.6, -0.3, -2), UP, 0.72, parallel_rectangle(1.2, 0.6, 2.0)),
        ("disk", (0.5, 0.0), (0, 0, -1), UP, np.pi * 0.25, 0.25 / 1.25),
        (
            *("disk", (0.5, 0.0), (1.5, 0, -1), SIDEWAYS, np.pi * 0.25),
            perpendicular_disk(0.5, 1.0, 1.5),
        ),
        ("rect", (6.0, 6.0), (-3, -3, -0.01), UP, 36.0, parallel_rectangle(6.0, 6.0, 0.01)),
        ("sphere", (0.3, 0.0), (0, 0, -0.5), UP, 4 * np.pi * 0.09, 0.36),
        ("sphere", (0.3, 0.0), (2, 0, -2), UP, 4 * np.pi * 0.09, 0.09 / 8 * np.sqrt(0.5)),
        (
            *("cylinder", (0.002, 1.5), (0, 0, -1), UP, 2 * np.pi * 0.002 * 1.5),
            tube(0.002, 1.5, 1.0),
        ),
    ],
)
def test_direct_light_of_each_shape(shape, size, point, normal, area, factor):
    """Configuration factor F in closed form: the illuminance is flux / area times F."""
    away = surface(rectangle((50, 50, 0), (1, 0, 0), (0, 1, 0), 1.0))
    tracer = tracer_of([away], [luminaire(FLUX, shape=shape, size=size)])
    at = np.array([point], float), np.array([normal])
    light, error = mean_and_error(lambda random: tracer.direct(*at, SAMPLES, random)[0, 0])
    assert light == pytest.approx(FLUX / area * factor, abs=4 * error + 1e-4 * light)
    assert error < 0.01 * light


def test_point_source_of_cie_171_case_5_2():
    gamma = np.radians(np.arange(0.0, 90.5, 0.5))
    source = with_diagram(
        luminaire(2 * FLUX * np.pi, (0, 0, 3)), gamma, np.zeros(1), FLUX / 2 * np.cos(gamma)[None]
    )
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 1.0))
    points = np.array([(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (1.5, 0, 0), (1.5, 1.5, 0)])
    tracer = tracer_of([floor], [source])
    light = tracer.direct(points, np.tile(UP, (5, 1)), SAMPLES, np.random.default_rng(1))[:, 0]
    # The diagram is of relative intensity: it is scaled to the flux.
    assert light == pytest.approx(2 * np.array([111.11, 105.21, 90.02, 71.11, 49.39]), rel=1e-3)


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ("sphere", (0.3, 0.0)), ("disk", (0.5, 0.0)), ("rect", (1.0, 0.4)), ("cylinder", (0.2, 1)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("with_a_diagram", [False, True])
def test_all_flux_arrives_on_the_walls(shape, size, with_a_diagram):
    """CIE 171:2006, case 5.4, for every shape, with and without a skew goniometric diagram."""
    source = luminaire(FLUX, shape=shape, size=size)
    if with_a_diagram:
        gamma, c_angles = np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 5)
        candela = 20 + 10 * np.sin(c_angles)[:, None] * np.sin(gamma) + 8 * np.cos(gamma)
        source = with_diagram(source, gamma, c_angles, candela)
    room = surface(box((2, 2, 2), 1.0).flipped())
    tracer = tracer_of([room], [source])
    light, error = mean_and_error(
        lambda random: tracer.direct(*on_walls(random, 8, 2.0), SAMPLES, random)[:, 0].mean()
    )
    assert light * 24 == pytest.approx(FLUX, abs=4 * 24 * error)
    assert error < 0.005 * light


def test_flux_of_a_diagram_is_that_of_its_interpolation():
    """Against quadrature of a million directions."""
    random = np.random.default_rng(3)
    gamma, c_angles = np.array([0.1, 0.5, 1.7, 2.9]), np.linspace(0, 2 * np.pi, 4)
    candela = random.uniform(0, 100, (4, 4))
    g, c = (np.arange(1000) + 0.5) / 1000 * np.pi, (np.arange(1000) + 0.5) / 1000 * 2 * np.pi
    rows = np.array([np.interp(g, gamma, plane, left=0, right=0) for plane in candela])
    table = np.array([np.interp(c, c_angles, column) for column in rows.T])
    expected = (table.sum(axis=1) * np.sin(g)).sum() * 2 * np.pi**2 / 1e6
    assert diagram_flux(GoniometricDiagram(gamma, c_angles, candela)) == pytest.approx(
        expected, rel=1e-3
    )


def test_a_blocker_leaves_a_shadow_and_light_around_it():
    floor = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 1.0)
    blocker = rectangle((-0.5, -0.5, 1), (1, 0, 0), (0, 1, 0), 1.0)  # half as high as the lamp
    tracer = tracer_of([surface(merge(floor, blocker))], [luminaire(FLUX, (0, 0, 2))])
    points = np.array([(0, 0, 0), (0.95, 0.95, 0), (1.05, 0, 0), (1.8, 1.8, 0)])
    light = tracer.direct(points, np.tile(UP, (4, 1)), SAMPLES, np.random.default_rng(1))[:, 0]
    open_light = FLUX / (4 * np.pi) * 2 / ((points**2).sum(axis=1) + 4) ** 1.5
    assert light == pytest.approx(open_light * [0, 0, 1, 1], rel=1e-3)


@pytest.mark.parametrize("complete", [False, True])
def test_the_error_of_a_solution_is_told_without_the_noise_of_the_reference(complete):
    random = np.random.default_rng(5)
    truth = random.uniform(50, 150, (1000, 2, 1)) * np.ones(3)
    noise = 20 * random.standard_normal((16, 1000, 2, 1))  # 5 % of the mean once averaged
    reference = PathTracedReference(np.arange(1000), np.full(1000, 1e-3), complete, truth + noise)
    assert reference.noise(INDIRECT) == pytest.approx(0.05, rel=0.05)
    direct, indirect = truth[:, 0], truth[:, 1] * 1.0
    indirect += 3 * random.standard_normal((1000, 1))  # 3 % of the mean
    error = reference.error(direct, indirect, INDIRECT)
    assert error.rms == pytest.approx(0.03, abs=3 * error.error_bar)
    assert error.error_bar < 0.004
    exact = reference.error(direct, indirect, DIRECT)
    assert exact.rms < 3 * exact.error_bar
    total = reference.error(direct, indirect, TOTAL)
    assert total.rms == pytest.approx(0.015, abs=3 * total.error_bar)


def test_a_reference_of_a_scene_is_kept(tmp_path):
    meshes = [surface(box((2, 2, 2), 0.5).flipped(), 0.5)]
    lights = [luminaire(FLUX, (0.2, 0, 0))]
    core = build(meshes, lights)
    description = scene(meshes, lights)

    def reference(**asked):
        return path_traced_reference(description, core, 50, 4, 4, cache=tmp_path, **asked)

    first, again = reference(), reference()
    assert np.array_equal(first.batches, again.batches)
    finer = reference(noise=0.5 * first.noise(TOTAL))
    assert finer.noise(TOTAL) <= 0.5 * first.noise(TOTAL)
    assert 8 <= len(finer.batches) <= 32
    assert np.array_equal(finer.batches[:4], first.batches)
    assert np.array_equal(reference().batches, first.batches)
    assert len(list(tmp_path.glob("*.npz"))) == 1
    # About the mean light of the closed room: each vertex stands for its area.
    mean, error = first.luminance_pair(TOTAL)
    assert mean.mean() == pytest.approx(FLUX / 24 / 0.5, rel=0.1)
    assert (error > 0).any()
