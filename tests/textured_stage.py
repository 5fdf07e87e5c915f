"""Textured meshes written out in the tests that read them."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from isolux.scene_description import SceneDescription
from isolux.stage_reader import read_stage
from usda_stage import METRES

READER = """
    def Shader "Reader" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }"""
BY_READER = "float2 inputs:st.connect = </Paint/Reader.outputs:result>"
FLAT = "diffuseColor.connect = </Paint/Texture.outputs:rgb>"


def png(texels: np.ndarray) -> bytes:
    """A PNG file of (H, W) or (H, W, C) uint8, the first row on top."""
    contents = io.BytesIO()
    Image.fromarray(np.asarray(texels, np.uint8)).save(contents, "png")
    return contents.getvalue()


def texture(
    inputs: str = "", file: str = "texture.png", st: str = BY_READER, name: str = "Texture"
) -> str:
    """A node that reads `file` without any conversion, unless `inputs` say how."""
    raw = "" if "sourceColorSpace" in inputs else 'token inputs:sourceColorSpace = "raw"'
    return f"""
    def Shader "{name}" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        {st}
        {raw}
        {inputs}
        float3 outputs:rgb
        float outputs:r
        float outputs:g
        float outputs:b
        float outputs:a
    }}"""


def material(nodes: str, surface: str = "color3f inputs:" + FLAT, kind="UsdPreviewSurface") -> str:
    return f"""
def Material "Paint" {{
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "{kind}"
        {surface}
        token outputs:surface
    }}
    {nodes}
    {READER}
}}
"""


def values(rows) -> str:
    return ", ".join("(" + ", ".join(f"{float(v):.9g}" for v in row) + ")" for row in rows)


def mesh(points, counts, indices, st=None, interpolation="vertex", extra: str = "") -> str:
    """A mesh that is bound to the material; points: (P, 2) in the plane z = 0."""
    points = [(*point[:2], point[2] if len(point) > 2 else 0.0) for point in points]
    primvar = (
        f'texCoord2f[] primvars:st = [{values(st)}] ( interpolation = "{interpolation}" )'
        if st is not None
        else ""
    )
    return f"""
def Mesh "Floor" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    int[] faceVertexCounts = {list(counts)}
    int[] faceVertexIndices = {list(indices)}
    point3f[] points = [{values(points)}]
    uniform token subdivisionScheme = "none"
    rel material:binding = </Paint>
    {primvar}
    {extra}
}}
"""


SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))


def quad(st=SQUARE, extra: str = "") -> str:
    """A unit square of one face."""
    return mesh(SQUARE, [4], [0, 1, 2, 3], st, extra=extra)


def grid(size: int, extra: str = "") -> str:
    """size x size faces, row by row from the lower left; st is (0, 0) to (1, 1) across it."""
    across = np.arange(size + 1) / size
    points = [(x, y) for y in across for x in across]
    corners = np.array([0, 1, size + 2, size + 1])
    first = (np.arange(size)[:, None] * (size + 1) + np.arange(size)).ravel()
    indices = (first[:, None] + corners).ravel().tolist()
    return mesh(points, [4] * size**2, indices, points, extra=extra)


def read_at(folder: Path, text: str, **files: bytes) -> SceneDescription:
    """Read a stage that lies in a folder beside its files; `texture` becomes texture.png."""
    for name, contents in files.items():
        (folder / f"{name}.png").write_bytes(contents)
    (folder / "stage.usda").write_text(f"#usda 1.0\n{METRES}{text}")
    return read_stage(folder / "stage.usda")
