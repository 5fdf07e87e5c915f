"""Luminaires that light some meshes only, or whose light passes through some: direct light alone
is linked; what a lit surface reflects goes everywhere."""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from core_scenes import Traced, distant, dome, luminaire, surface
from hand_built import scene_of
from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import ProgressiveSolver
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

NONE = np.zeros(0, np.float32)
PHOTONS = 200_000
ROOM, TABLE, BALL = "/Room", "/Table", "/Ball"
TABLE_TOP = rectangle((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), 0.125)
MESHES = [
    surface(box((2, 2, 2), 0.25).flipped(), 0.5, path=ROOM),
    surface(TABLE_TOP, 0.6, double_sided=True, path=TABLE),
    surface(box((0.3, 0.3, 0.3), 0.1).moved(0.6, 0.5, -0.6), 0.4, path=BALL),
]
LAMP = luminaire(1000.0, (0.1, 0.2, 0.7), size=(0.05, 0.0))
OTHER = luminaire(600.0, (-0.6, 0.1, -0.1), "rect", (0.2, 0.2))
ALL = frozenset({ROOM, TABLE, BALL})


def built(meshes, lamps):
    scene = replace(scene_of(meshes), luminaires=tuple(lamps))
    return build_core_scene(scene, SolverSettings(), 2)


def traced(meshes, lamps, photons=PHOTONS, seed=1):
    scene = built(meshes, lamps)
    buckets = _core.PhotonBuckets(scene)
    _core.trace_photons(scene, buckets, seed, 0, photons, 2)
    return Traced(scene, buckets, meshes)


def direct_light(scene, accuracy=0.01):
    """(V,) lx"""
    found = _core.DirectLighting(scene, 1, accuracy).illuminate(
        scene.receiver_positions, scene.vertex_normals, NONE, 2, scene.vertex_meshes
    )
    return found["illuminance"] @ LUMINANCE_WEIGHTS


def of_mesh(scene, values):
    """Values of each mesh's vertices, fronts and backs."""
    return [values[begin:end] for begin, _, end, _ in scene.mesh_ranges]


def linked(lamp=LAMP, lit=None, shadow=None):
    return replace(
        lamp,
        lit_meshes=None if lit is None else frozenset(lit),
        shadow_meshes=None if shadow is None else frozenset(shadow),
    )


LINKS = {
    "all": {},
    "all by name": {"lit": ALL, "shadow": ALL},
    "lights the room alone": {"lit": {ROOM}},
    "lights the table alone": {"lit": {TABLE}},
    "lights nothing": {"lit": set()},
    "the table casts no shadow": {"shadow": {ROOM, BALL}},
    "nothing casts a shadow": {"shadow": set()},
    "lights the room, the table alone stands in its light": {"lit": {ROOM}, "shadow": {TABLE}},
    "lights the table through the ball": {"lit": {TABLE}, "shadow": {TABLE, ROOM}},
}


@pytest.mark.parametrize("links", LINKS.values(), ids=LINKS)
def test_direct_light_is_that_of_the_scene_authored_with_what_is_linked(links):
    """Receivers of a scene without the meshes that cast no shadow, seen from where they were."""
    scene = built(MESHES, [linked(**links)])
    shadows = links.get("shadow", ALL)
    explicit = built([m for m in MESHES if m.path in shadows] or [FAR], [LAMP])
    lit = links.get("lit", ALL)
    truth = _core.DirectLighting(explicit, 1, 0.01).illuminate(
        scene.receiver_positions, scene.vertex_normals, NONE, 2
    )
    expected = of_mesh(scene, truth["illuminance"] @ LUMINANCE_WEIGHTS)
    for mesh, found, wanted in zip(
        MESHES, of_mesh(scene, direct_light(scene)), expected, strict=True
    ):
        if mesh.path in lit:
            assert found == pytest.approx(wanted, rel=0.03, abs=0.03 * wanted.mean())
            assert found.mean() == pytest.approx(wanted.mean(), rel=2e-3)
        else:
            assert not found.any()


FAR = surface(rectangle((-9, -9, -9), (1, 0, 0), (0, 1, 0), 1.0), path="/Far")


@pytest.mark.parametrize("links", LINKS.values(), ids=LINKS)
def test_photons_bring_the_direct_light_that_shadow_rays_find(links):
    tracing = traced(MESHES, [linked(**links), OTHER])
    ends = tracing.buckets.ends
    assert ends["emitted"] + ends["split"] == (
        ends["absorbed"] + ends["back_absorbed"] + ends["escaped"] + ends["unlit"]
    )
    assert ends["escaped"] == 0 or "shadow" in links
    by_rays = of_mesh(tracing.scene, direct_light(tracing.scene, 0.003) * tracing.areas)
    by_photons = of_mesh(tracing.scene, tracing.hits[:, 0])
    for rays, photons in zip(by_rays, by_photons, strict=True):
        flux, count = rays.sum(), photons.sum()
        # Vertices stand for their surroundings to some percent where there are shadows.
        assert flux == pytest.approx(
            count * tracing.photon_flux, rel=0.03, abs=4 * np.sqrt(count) * tracing.photon_flux
        )


@pytest.mark.parametrize("links", list(LINKS.values())[3::2], ids=list(LINKS)[3::2])
def test_indirect_light_is_what_lit_surfaces_reflect(links):
    """Radiosity takes its direct light from shadow rays; the gather's rays look for it themselves:
    they agree with photons on each mesh."""
    tracing = traced(MESHES, [linked(**links), OTHER])
    scene = tracing.scene

    def means(lux):
        return [
            np.average(part, weights=areas)
            for part, areas in zip(of_mesh(scene, lux), of_mesh(scene, tracing.areas), strict=True)
        ]

    truth = means(tracing.illuminance[:, 1])
    radiosity = _core.ProgressiveRadiosity(scene, 1, 0.05)
    positions, normals = radiosity.receivers()
    lighting = _core.DirectLighting(scene, 1, 0.01)
    meshes = radiosity.receiver_meshes()
    radiosity.begin(lighting.illuminate(positions, normals, NONE, 2, meshes)["illuminance"])
    radiosity.advance(10**10, 2)
    found = radiosity.indirect(scene.receiver_positions, scene.vertex_normals, 2)
    assert means(found["illuminance"] @ LUMINANCE_WEIGHTS) == pytest.approx(truth, rel=0.04)
    total = np.ascontiguousarray(tracing.buckets.illuminance(scene).sum(axis=1))
    gathered = _core.FinalGather(scene, 1).advance(total, 500_000, 2)
    assert means(gathered["indirect"] @ LUMINANCE_WEIGHTS) == pytest.approx(truth, rel=0.04)


def test_a_luminaire_that_lights_nothing_and_shadows_nothing_is_not_there():
    """All light of the other lamp, direct and indirect."""
    both = traced(MESHES, [linked(lit=set()), OTHER])
    alone = traced(MESHES, [OTHER], photons=both.buckets.ends["emitted"] * 600 // 1600)
    for a, b in zip(
        of_mesh(both.scene, both.illuminance * both.areas[:, None]),
        of_mesh(alone.scene, alone.illuminance * alone.areas[:, None]),
        strict=True,
    ):
        noise = 6 * np.sqrt(a.sum(axis=0) * both.photon_flux)
        assert (np.abs(a.sum(axis=0) - b.sum(axis=0)) <= noise).all()


def test_linked_lamps_among_many_are_looked_at_one_by_one():
    places = [(x, y, 0.7) for x in np.linspace(-0.8, 0.8, 8) for y in np.linspace(-0.8, 0.8, 5)]
    lamps = [luminaire(25.0, at) for at in places]
    half = [linked(lamp, lit={TABLE}) if i % 2 else lamp for i, lamp in enumerate(lamps)]
    half += lamps  # enough for a tree
    room, table, _ = of_mesh(built(MESHES, half), direct_light(built(MESHES, half)))
    unlinked = built(MESHES, [*lamps, *lamps[::2]])
    expected_room, _, _ = of_mesh(unlinked, direct_light(unlinked))
    every = built(MESHES, [*lamps, *lamps])
    _, expected_table, _ = of_mesh(every, direct_light(every))
    assert room == pytest.approx(expected_room, rel=0.05, abs=0.5)
    assert table == pytest.approx(expected_table, rel=0.05, abs=0.5)


def test_a_see_through_mesh_that_casts_no_shadow_takes_its_light_and_lets_all_pass():
    veil = replace(MESHES[1], opacity=np.array([0.4], np.float32))
    meshes = [MESHES[0], veil, MESHES[2]]
    tracing = traced(meshes, [linked(shadow={ROOM, BALL})])
    bare = traced(MESHES, [linked(shadow={ROOM, BALL})])
    on_veil = tracing.illuminance[tracing.front(1), 0].mean()
    assert on_veil == pytest.approx(bare.illuminance[bare.front(1), 0].mean(), rel=0.03)
    assert np.array_equal(direct_light(tracing.scene), direct_light(bare.scene))


@pytest.mark.parametrize("method", ["composite", "ddl+hpr", "ddl+idept"])
def test_every_method_honours_links(method):
    """The solver hands the mesh of each receiver on, those of refined edges too."""
    scene = replace(scene_of(MESHES), luminaires=(linked(lit={TABLE}),))
    settings = SolverSettings(method=method, time_budget=1.0, output_mode="refined")
    *_, last = ProgressiveSolver(scene, settings).stages()
    direct = last.direct if last.refined is None else last.direct[: last.refined.vertex_count]
    for mesh in MESHES:
        layout = last.layouts[mesh.path]
        assert direct[layout.front].any() == (mesh.path == TABLE)
    stage = last.stage
    ends = stage.absorbed + stage.back_absorbed + stage.escaped + stage.absorbed_by_links
    assert ends == stage.photons + stage.split_by_links
    assert (stage.absorbed_by_links > 0) == (stage.photons > 0)


@pytest.mark.parametrize(
    "lamp",
    [distant(300.0), distant(300.0, 0.4), dome(100.0), replace(LAMP, shape="mesh", path=TABLE)],
    ids=["parallel light", "a wide cone", "dome", "mesh"],
)
def test_light_from_afar_and_from_meshes_is_linked(lamp):
    """Lit alone, a mesh gets as much by photons as by shadow rays, and the others get nothing."""
    meshes = [
        surface(rectangle((-1, -1, -1), (2, 0, 0), (0, 2, 0), 0.25), path=ROOM),
        replace(MESHES[1], emission=np.full((1, 3), 100.0, np.float32)),
        surface(rectangle((0.5, 0.5, 0.5), (0.3, 0, 0), (0, 0.3, 0), 0.1), path=BALL),
    ]
    lamps = [linked(lamp, lit={ROOM}, shadow={ROOM, BALL})]
    photons = traced(meshes, lamps)
    by_photons = of_mesh(photons.scene, photons.hits[:, 0] * photons.photon_flux)
    assert not np.concatenate(by_photons[1:]).any()
    assert not np.concatenate(of_mesh(photons.scene, direct_light(photons.scene))[1:]).any()
    # On an even grid, in which the shadow is 12 by 12 of 6400 points.
    along = (np.arange(80) + 0.5) / 40 - 1
    x, y = np.meshgrid(along, along)
    found = _core.DirectLighting(photons.scene, 1, 0.01).illuminate(
        np.stack([x, y, np.full_like(x, -1)], axis=-1).reshape(-1, 3),
        np.tile(np.array([0, 0, 1], np.float32), (6400, 1)),
        NONE,
        2,
        np.zeros(6400, np.int32),
    )
    by_rays = 4 * (found["illuminance"] @ LUMINANCE_WEIGHTS).mean()
    sigma = np.sqrt(by_photons[0].sum() * photons.photon_flux)
    assert by_rays == pytest.approx(by_photons[0].sum(), abs=4 * sigma + 2e-3 * by_rays)
