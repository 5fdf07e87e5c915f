"""Meshes of any numbers, in any precision, on stages of any unit: read, skipped or refused.

Also where numbers that are finite aren't so in single precision: by `tools/fuzz/targets.py`.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st
from tools.fuzz.targets import read_stage_text

UNITS = [1e-12, 0.01, 1e30]  # m
NUMBERS = ["0", "1", "-2.5", "1e-310", "1e-45", "3e38", "1e39", "-1e155", "1e308", "inf", "nan"]
PRECISIONS = ["h", "f", "d"]
SCHEMES = ["none", "catmullClark", "loop"]


def triples(count):
    """So many points or colours, most of them of everyday numbers."""
    usual = st.sampled_from(["0", "1"])
    number = st.one_of(usual, usual, usual, st.sampled_from(NUMBERS))
    return st.lists(st.tuples(number, number, number), min_size=count, max_size=count).map(
        lambda rows: ", ".join(f"({', '.join(row)})" for row in rows)
    )


@given(
    st.sampled_from(UNITS),
    st.sampled_from(PRECISIONS),
    st.sampled_from(SCHEMES),
    st.booleans(),
    triples(4),
    triples(4),
    triples(1),
    triples(1),
    triples(1),
    triples(1),
    st.sampled_from(NUMBERS),
)
def test_meshes_of_extreme_numbers_are_read_skipped_or_refused(
    unit, precision, scheme, is_square, points, normals, colour, emission, scale, place, sharpness
):
    corners = "(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)" if is_square else points
    stage = f"""#usda 1.0
(
    metersPerUnit = {unit!r}
)
def Mesh "Mesh" {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3{precision}[] points = [{corners}]
    normal3{precision}[] normals = [{normals}] ( interpolation = "vertex" )
    color3{precision}[] primvars:displayColor = [{colour}] ( interpolation = "constant" )
    uniform token subdivisionScheme = "{scheme}"
    int[] creaseIndices = [0, 1]
    int[] creaseLengths = [2]
    double[] creaseSharpnesses = [{sharpness}]
    double3 xformOp:translate = {place}
    double3 xformOp:scale = {scale}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    rel material:binding = </Paint>
}}
def Material "Paint" {{
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3{precision} inputs:emissiveColor = {emission}
    }}
}}
"""
    with TemporaryDirectory() as folder:
        read_stage_text(stage.encode(), Path(folder))
