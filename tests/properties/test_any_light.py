"""Lights of any kind, size and scale on stages of any unit: read, skipped or refused.

Also where numbers that are finite have products that are not: by `tools/fuzz/targets.py`.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st
from tools.fuzz.targets import read_stage_text

KINDS = [
    "SphereLight", "DiskLight", "RectLight", "CylinderLight", "DistantLight", "DomeLight",
    "PortalLight", "Mesh",
]  # fmt: skip
UNITS = [1e-12, 0.01, 1.0, 1e9, 1e30]  # m
NUMBERS = [0.0, 1e-45, 1e-30, 1.0, 1e9, 3e38]  # of single precision, its ends as well
SCALES = [0.0, 1e-310, 1e-150, 1e-31, 1e-11, -1.0, 1.0, 1e29, 1e150]
SQUARE = """int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]"""


@given(
    st.sampled_from(KINDS),
    st.sampled_from(UNITS),
    st.fixed_dictionaries(
        {
            name: st.sampled_from(NUMBERS)
            for name in ("intensity", "radius", "width", "height", "length")
        }
    ),
    st.tuples(*[st.sampled_from(SCALES)] * 3),
    st.tuples(*[st.sampled_from(SCALES)] * 3),
    st.booleans(),
    st.booleans(),
)
def test_lights_of_extreme_numbers_are_read_skipped_or_refused(
    kind, unit, inputs, scale, place, normalised, has_cone
):
    body = "\n    ".join(f"float inputs:{name} = {value!r}" for name, value in inputs.items())
    api = "MeshLightAPI" if kind == "Mesh" else "ShapingAPI"
    stage = f"""#usda 1.0
(
    metersPerUnit = {unit!r}
)
def Mesh "Floor" {{
    {SQUARE}
}}
def {kind} "Light" ( prepend apiSchemas = ["{api}"] ) {{
    {SQUARE if kind == "Mesh" else ""}
    {body}
    bool inputs:normalize = {int(normalised)}
    {"float inputs:shaping:cone:angle = 9" if has_cone else ""}
    double3 xformOp:translate = {place}
    double3 xformOp:scale = {scale}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}}
"""
    with TemporaryDirectory() as folder:
        read_stage_text(stage.encode(), Path(folder))
