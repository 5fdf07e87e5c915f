"""Write a closed sphere with a source in its centre: illuminance is known in closed form.

    python -m usd_scenes.furnace_sphere.generate OUT.usda [--reflectance R] [--level N]

Of all light that is reflected in a closed room the share 1 - R is absorbed at each bounce, so that
the mean illuminance is flux / (area (1 - R)); by symmetry each point of the sphere has it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from pxr import UsdLux

from .. import stage_writing
from ..shapes import Shape, from_triangles
from ..stage_writing import Part, add_model

RADIUS = 1.0  # m
LUMINOUS_FLUX = 1000.0  # lm, isotropic


def generate(path: str | Path, reflectance: float = 0.5, level: int = 4) -> None:
    """Write the stage to `path`.

    reflectance : of the sphere, grey, in [0, 1)
    level : subdivisions of the icosahedron; 20 * 4**level triangles
    """
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Z")
    stage_writing.add_materials(stage, {"Grey": (reflectance,) * 3})
    sphere = Part("Surface", icosphere(level).flipped(), "Grey")  # seen from the inside
    add_model(stage, "/World/Sphere", [sphere])
    light = stage_writing.add_light(
        stage, "/World/Source", UsdLux.SphereLight, {"radius": 1e-3}, (0, 0, 0)
    )
    candela = LUMINOUS_FLUX / (4 * np.pi)
    stage_writing.add_diagram(light, [0.0, 180.0], [0.0], [candela, candela])
    stage_writing.add_render_settings(stage)
    stage.Save()


def icosphere(level: int) -> Shape:
    """An icosahedron, each triangle split in four `level` times, points on the sphere of RADIUS."""
    golden = (1 + 5**0.5) / 2
    plane = [(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    corners = np.array([np.roll(corner, turn) for turn in range(3) for corner in plane])
    a, b, c = np.array(np.meshgrid(*[range(12)] * 3, indexing="ij")).reshape(3, -1)
    p, q, r = corners[a], corners[b], corners[c]
    edge = np.isclose([np.linalg.norm(p - q, axis=1), np.linalg.norm(q - r, axis=1),
                       np.linalg.norm(r - p, axis=1)], 2.0).all(axis=0)  # fmt: skip
    outward = np.einsum("ij,ij->i", np.cross(q - p, r - p), p) > 0
    once = (a < b) & (a < c)  # each triangle from its lowest corner
    triangles = corners[np.stack([a, b, c], axis=1)[edge & outward & once]]
    for _ in range(level):
        p, q, r = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        pq, qr, rp = (p + q) / 2, (q + r) / 2, (r + p) / 2
        parts = [(p, pq, rp), (pq, q, qr), (rp, qr, r), (pq, qr, rp)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
        triangles *= RADIUS / np.linalg.norm(triangles, axis=-1, keepdims=True)
    return from_triangles(triangles)


def expected_illuminance(shape: Shape, reflectance: float) -> float:
    """Mean illuminance over the facets, lx; the mesh's own area, not that of the true sphere."""
    return LUMINOUS_FLUX / (shape.area() * (1 - reflectance))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description="Write a closed sphere with a source in its centre."
    )
    parser.add_argument("path", type=Path, metavar="OUT.usda")
    parser.add_argument("--reflectance", type=float, default=0.5)
    parser.add_argument("--level", type=int, default=4, help="subdivisions of the icosahedron")
    arguments = parser.parse_args()
    generate(arguments.path, arguments.reflectance, arguments.level)
    area = icosphere(arguments.level).area()
    expected = expected_illuminance(icosphere(arguments.level), arguments.reflectance)
    print(f"area {area:.6f} m2, expected mean illuminance {expected:.4f} lx")


if __name__ == "__main__":
    main()
