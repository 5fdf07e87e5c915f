"""Indirect light by radiosity against what is known of closed rooms, and against photons.

In a closed room of one reflectance ρ the mean indirect illuminance is ρ E / (1 - ρ) for a mean
direct illuminance E, whatever the room's form: CIE 171:2006, case 5.8, tabulates it.
"""

import numpy as np
import pytest
from usd_scenes.box_room.generate import LUMINOUS_FLUX, SIZE
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import build, luminaire, relative_rms, surface, trace
from isolux import _core
from isolux.solution import LUMINANCE_WEIGHTS

NO_LIGHT = np.zeros(0, np.float32)
ACCURACY = 0.01
# Boxes of six quads: the leaves of the solver are all the mesh there is.
WALLS = box((SIZE, SIZE, SIZE), SIZE).flipped()
BLOCKS = (
    box((1, 1.5, 1), 10.0).turned(y=20).moved(-0.6, -1.0, 0.4),
    box((1, 0.8, 1), 10.0).turned(y=-30).moved(0.8, -1.2, -0.4),
)


def begun(scene, direct=None, accuracy=ACCURACY):
    """Radiosity before its first shot; direct : lx, everywhere alike, or as the luminaires give."""
    radiosity = _core.ProgressiveRadiosity(scene, 1, accuracy)
    positions, normals = radiosity.receivers()
    if direct is None:
        lighting = _core.DirectLighting(scene, 1, 0.01)
        light = lighting.illuminate(positions, normals, NO_LIGHT, 2)["illuminance"]
    else:
        light = np.full((len(positions), 3), direct, np.float32)
    radiosity.begin(light)
    return radiosity


def solved(scene, direct=None, accuracy=ACCURACY):
    radiosity = begun(scene, direct, accuracy)
    radiosity.advance(10**10, 2)
    return radiosity


def at_vertices(scene, radiosity):
    """(V,) photometric indirect illuminance, lx."""
    found = radiosity.indirect(scene.receiver_positions, scene.vertex_normals, 2)
    return found["illuminance"] @ LUMINANCE_WEIGHTS
