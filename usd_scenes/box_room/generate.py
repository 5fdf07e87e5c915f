"""Write the closed cube of CIE 171:2006, case 5.8, with its source: indirect light is known.

python -m usd_scenes.box_room.generate OUT.usda [--reflectance R] [--cells N]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from pxr import UsdLux

from .. import stage_writing
from ..shapes import box
from ..stage_writing import Part, add_model

SIZE = 4.0  # m, inner edge of the cube
LUMINOUS_FLUX = 10_000.0  # lm, isotropic


def generate(path: str | Path, reflectance: float = 0.5, cells: int = 16) -> None:
    """Write the stage to `path`.

    reflectance : of all six walls, grey, in [0, 1)
    cells : quads along each edge of the cube
    """
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Z")
    stage_writing.add_materials(stage, {"Grey": (reflectance,) * 3})
    walls = box((SIZE, SIZE, SIZE), SIZE / cells).flipped().moved(z=SIZE / 2)
    add_model(stage, "/World/Room", [Part("Walls", walls, "Grey")])
    light = stage_writing.add_light(
        stage, "/World/Source", UsdLux.SphereLight, {"radius": 1e-3}, (0, 0, SIZE / 2)
    )
    candela = LUMINOUS_FLUX / (4 * np.pi)
    stage_writing.add_diagram(light, [0.0, 180.0], [0.0], [candela, candela])
    stage_writing.add_render_settings(stage)
    stage.Save()


def expected_illuminance(reflectance: float) -> tuple[float, float]:
    """Direct and indirect mean illuminance over the six walls, lx."""
    direct = LUMINOUS_FLUX / (6 * SIZE**2)
    return direct, direct * reflectance / (1 - reflectance)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write the closed cube of CIE 171, case 5.8.")
    parser.add_argument("path", type=Path, metavar="OUT.usda")
    parser.add_argument("--reflectance", type=float, default=0.5)
    parser.add_argument("--cells", type=int, default=16, help="quads along each edge")
    arguments = parser.parse_args()
    generate(arguments.path, arguments.reflectance, arguments.cells)
    direct, indirect = expected_illuminance(arguments.reflectance)
    print(f"expected mean illuminance: direct {direct:.4f} lx, indirect {indirect:.4f} lx")


if __name__ == "__main__":
    main()
