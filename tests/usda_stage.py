"""Stages written out in the tests that read them."""

from pxr import Sdf, Usd

from isolux.scene_description import SceneDescription
from isolux.stage_reader import read_stage

METRES = '(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
# Of two joints on two rows of three points, the middle ones bent by both.
INFLUENCES = """
    int[] primvars:skel:jointIndices = [0,1, 0,1, 0,1, 0,1, 0,1, 0,1] (
        elementSize = 2
        interpolation = "vertex"
    )
    float[] primvars:skel:jointWeights = [1,0, 0.5,0.5, 0,1, 1,0, 0.5,0.5, 0,1] (
        elementSize = 2
        interpolation = "vertex"
    )
"""


def open_usda(text: str, metadata: str = METRES) -> Usd.Stage:
    """A stage in memory, in metres and Z-up unless `metadata` says otherwise."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(f"#usda 1.0\n{metadata}\n{text}")
    return Usd.Stage.Open(layer)


def read_usda(
    text: str, metadata: str = METRES, time_code: float | None = None
) -> SceneDescription:
    return read_stage(open_usda(text, metadata), time_code)


def found(scene: SceneDescription) -> list[tuple[str, str, str]]:
    """(path, kind, action) of all findings."""
    return [(finding.path, finding.kind, finding.action) for finding in scene.findings]
