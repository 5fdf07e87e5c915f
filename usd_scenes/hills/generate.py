"""Write a closed hall over hilly ground of very many faces, in one mesh or split over many.

python -m usd_scenes.hills.generate OUT.usdc [--faces N] [--meshes M] [--normals]

The hall is 100 x 20 x 100 m: +Y up, one luminaire under the middle of its ceiling.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom, UsdLux, UsdShade, Vt

from .. import stage_writing
from ..shapes import box
from ..stage_writing import Part, add_model

SIZE, HEIGHT = 100.0, 20.0  # m
AMPLITUDE, WAVELENGTH = 2.0, 25.0  # m, of the hills
LAMP = 4.0  # m, edge of the luminaire
LUMINOUS_FLUX = 500_000.0  # lm
REFLECTANCES = {"Walls": (0.7, 0.7, 0.7), "Ground": (0.35, 0.30, 0.22)}


def generate(
    path: str | Path, faces: int = 1_000_000, meshes: int = 1, normals: bool = False
) -> None:
    """Write the stage to `path`.

    faces : quads of the ground, at least; the hall has 280 more
    meshes : square tiles of the ground along both edges, at least so many in all
    normals : author smooth normals at its points
    """
    stage = stage_writing.new_stage(path, metres_per_unit=1.0, up_axis="Y")
    stage_writing.add_materials(stage, REFLECTANCES)
    hall = box((SIZE, HEIGHT, SIZE), SIZE / 10).flipped().moved(y=HEIGHT / 2 - AMPLITUDE)
    add_model(stage, "/World/Hall", [Part("Shell", hall, "Walls", creased=False)])
    UsdGeom.Xform.Define(stage, "/World/Ground").AddTranslateOp().Set((-SIZE / 2, 0, -SIZE / 2))
    tiles = int(np.ceil(np.sqrt(meshes)))
    cells = int(np.ceil(np.sqrt(faces) / tiles))
    for number, (points, upward) in enumerate(_tiles(tiles, cells)):
        mesh = UsdGeom.Mesh.Define(stage, f"/World/Ground/Tile{number}")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray(cells**2, 4))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(_quads(cells)))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
        if normals:
            mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(upward))
            mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        material = UsdShade.Material.Get(stage, "/World/Materials/Ground")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage_writing.add_light(
        stage, "/World/Luminaire", UsdLux.RectLight, {"width": LAMP, "height": LAMP},
        (0, HEIGHT - AMPLITUDE - 0.1, 0), turn=(-90, 0, 0),
        luminance=LUMINOUS_FLUX / (np.pi * LAMP**2),
    )  # fmt: skip
    stage_writing.add_render_settings(stage)
    stage.Save()


def _tiles(tiles: int, cells: int) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Points and normals (P, 3) of each tile, row by row; neighbours share their border."""
    along = np.linspace(0.0, SIZE, tiles * cells + 1)
    wave = 2 * np.pi / WAVELENGTH
    for row in range(tiles):
        for column in range(tiles):
            z, x = np.meshgrid(
                along[row * cells : (row + 1) * cells + 1],
                along[column * cells : (column + 1) * cells + 1],
                indexing="ij",
            )
            y = AMPLITUDE * np.sin(wave * x) * np.sin(wave * z)
            upward = np.stack(
                [
                    -AMPLITUDE * wave * np.cos(wave * x) * np.sin(wave * z),
                    np.ones_like(x),
                    -AMPLITUDE * wave * np.sin(wave * x) * np.cos(wave * z),
                ],
                axis=-1,
            )
            upward /= np.linalg.norm(upward, axis=-1, keepdims=True)
            yield (
                np.stack([x, y, z], axis=-1).astype(np.float32).reshape(-1, 3),
                upward.astype(np.float32).reshape(-1, 3),
            )


def _quads(cells: int) -> NDArray[np.int32]:
    """Corners of (cells x cells) quads over a grid of points, fronts upwards."""
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    at = i * (cells + 1) + j
    corners = np.stack([at, at + cells + 1, at + cells + 2, at + 1], axis=-1)
    return corners.astype(np.int32).reshape(-1)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write a hall over ground of very many faces.")
    parser.add_argument("path", type=Path, metavar="OUT.usdc")
    parser.add_argument("--faces", type=int, default=1_000_000)
    parser.add_argument("--meshes", type=int, default=1, help="tiles that share the faces")
    parser.add_argument("--normals", action="store_true", help="author normals at the points")
    arguments = parser.parse_args()
    generate(arguments.path, arguments.faces, arguments.meshes, arguments.normals)


if __name__ == "__main__":
    main()
