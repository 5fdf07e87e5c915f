"""Two surfaces change parts: each gives the other what it would get from it.

With the same exitance M the mean illuminance that A as a source gives B is M F_BA, and that of B on
A is M F_AB: by area both are one flux, whatever stands between them and however often surfaces
around them reflect it, since A_A F_AB = A_B F_BA holds of each path of light.
"""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from core_scenes import build, luminaire, shining, surface, trace
from isolux import _core
from isolux.solution import LUMINANCE_WEIGHTS
from solved_scenes import mean, solved
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

LUMINANCE = 100.0  # cd/m²
PANEL = rectangle((-0.9, -0.6, 2.9), (0, 1.0, 0), (0.7, 0, 0), 0.1)  # faces down
DOOR = rectangle((1.9, -0.2, 0.1), (0, 0, 1.6), (0, 1.3, 0), 0.1)  # faces -X
ROOM = surface(box((4, 3.6, 3), 0.2).flipped().moved(z=1.5), (0.7, 0.6, 0.4), path="/Room")
BLOCKER = surface(
    rectangle((0, -0.9, 1.2), (1.1, 0.4, 0), (0, 1.0, 0.6), 0.2), 0.5, double_sided=True,
    path="/Blocker",
)  # fmt: skip
REFLECTANCES = {"/Panel": 0.2, "/Door": 0.6}


def scene_with(source):
    """Meshes and luminaires; the flux that arrives at the other patch is asked for."""
    patches = [
        shining(shape, LUMINANCE, path=path, reflectance=REFLECTANCES[path])
        for path, shape in (("/Panel", PANEL), ("/Door", DOOR))
    ]
    meshes = [
        ROOM,
        BLOCKER,
        *(m if m.path == source else replace(m, emission=None) for m in patches),
    ]
    return meshes, [replace(luminaire(shape="mesh"), path=source)]


AREAS = {"/Panel": PANEL.area(), "/Door": DOOR.area()}
OTHER = {"/Panel": "/Door", "/Door": "/Panel"}


def test_direct_light_past_a_blocker(validation):
    """By shadow rays at the middles of both patches' elements."""
    flux = {}
    for source, receiver in OTHER.items():
        meshes, lamps = scene_with(source)
        shape = PANEL if receiver == "/Panel" else DOOR
        corners = shape.points[shape.indices].reshape(-1, 4, 3)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1)
        found = _core.DirectLighting(build(meshes, lamps), 1, 0.001).illuminate(
            corners.mean(axis=1),
            (normal / area[:, None]).astype(np.float32),
            np.zeros(0, np.float32),
            2,
        )
        flux[source] = found["illuminance"].astype(float) @ LUMINANCE_WEIGHTS @ area
    validation.check(
        "flux of the door to the panel, and of the panel to the door: direct",
        *(flux["/Panel"], flux["/Door"]),
        relative=2e-3,
        unit="lm",
    )


def test_photons(validation):
    """Direct and indirect; each of N photons arrives or doesn't, some more than once."""
    photons, flux, variance = 200_000, {}, {}
    for source, receiver in OTHER.items():
        meshes, lamps = scene_with(source)
        traced = trace(meshes, lamps, photons)
        number = [m.path for m in meshes].index(receiver)
        counts = traced.hits[traced.front(number)].sum(axis=0)
        flux[source] = counts * traced.photon_flux
        variance[source] = counts * traced.photon_flux**2
    for i, component in enumerate(("direct", "indirect")):
        validation.check(
            f"flux of the door to the panel, and of the panel to the door: {component}, photons",
            *(flux["/Panel"][i], flux["/Door"][i]),
            sigma=np.sqrt(1.3 * (variance["/Panel"][i] + variance["/Door"][i])),
            unit="lm",
        )


def test_composite(validation):
    flux = {}
    for source, receiver in OTHER.items():
        solution = solved(*scene_with(source), method="composite", photons=50_000)
        flux[source] = mean(solution, path=receiver) * AREAS[receiver]
    validation.check(
        "flux of the door to the panel, and of the panel to the door: composite",
        *(flux["/Panel"], flux["/Door"]),
        relative=0.02,
        unit="lm",
    )
