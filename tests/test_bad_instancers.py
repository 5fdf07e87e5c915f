"""A bad instancer is named and skipped; the rest of the stage is read."""

import pytest

from instanced_stages import WEDGE, instancer, matrix, prim
from isolux.errors import SceneError
from usda_stage import found, read_usda

GOOD = f"""rel prototypes = </Field/A>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    {WEDGE.replace("Wedge", "A")}"""


def field(*changes: tuple[str, str]) -> str:
    arrays = GOOD
    for old, new in changes:
        assert old in arrays
        arrays = arrays.replace(old, new)
    return prim("Field", arrays, kind="def PointInstancer")


# Stage; paths of the meshes that are left; finding.
HOSTILE = {
    "index out of range": (
        field(("[0, 0]", "[0, 1000000000]")),
        ["/Field/Copy0"],
        ("/Field", "protoIndices", "skipped"),
    ),
    "negative index": (
        field(("[0, 0]", "[-1, 0]")),
        ["/Field/Copy1"],
        ("/Field", "protoIndices", "skipped"),
    ),
    "too few positions": (
        field(("(0, 0, 0), ", "")),
        [],
        ("/Field", "PointInstancer", "skipped"),
    ),
    "too many scales": (
        field(("int[]", "float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]\nint[]")),
        [],
        ("/Field", "PointInstancer", "skipped"),
    ),
    "a scale of 0": (
        field(("int[]", "float3[] scales = [(1, 0, 1), (1, 1, 1)]\nint[]")),
        ["/Field/Copy1"],
        ("/Field", "PointInstancer", "skipped"),
    ),
    "a position that is no number": (
        field(("(1, 0, 0)", "(nan, 0, 0)")),
        ["/Field/Copy0"],
        ("/Field", "PointInstancer", "skipped"),
    ),
    "an orientation that is not finite": (
        field(("int[]", "quath[] orientations = [(inf, 0, 0, 0), (1, 0, 0, 0)]\nint[]")),
        ["/Field/Copy1"],
        ("/Field", "PointInstancer", "skipped"),
    ),
    "a position out of reach": (
        field(("(1, 0, 0)", "(1e30, 0, 0)")),
        ["/Field/Copy0"],
        ("/Field/A", "Mesh", "skipped"),
    ),
    "missing prototype": (
        field(("</Field/A>", "</Field/B>")),
        [],
        ("/Field", "prototypes", "skipped"),
    ),
    "no prototypes": (
        field(("rel prototypes = </Field/A>", "")),
        [],
        ("/Field", "protoIndices", "skipped"),
    ),
    "itself": (field(("</Field/A>", "</Field>")), [], ("/Field", "prototypes", "skipped")),
    "wrong number of ids": (
        field(("int[]", "int64[] ids = [7]\nint64[] invisibleIds = [1]\nint[]")),
        ["/Field/Copy0"],
        ("/Field", "ids", "repaired"),
    ),
    "two that hold each other": (
        instancer("X", "/Y", [(0, 0, 0)], "", matrix()) + instancer("Y", "/X", [(1, 0, 0)])
        + prim("Z", WEDGE),
        ["/Z/Wedge"],
        ("/X", "prototypes", "skipped"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE)
def test_a_bad_instancer_is_named(case: str) -> None:
    stage, paths, finding = HOSTILE[case]
    scene = read_usda(stage)
    assert [mesh.path for mesh in scene.meshes] == paths
    assert finding in found(scene)


def test_nesting_that_multiplies_without_end_is_refused() -> None:
    """Ten levels of a hundred each, in two kilobytes."""
    hundred = [(0, 0, 0)] * 100
    levels = "".join(instancer(f"L{i}", f"/L{i + 1}", hundred) for i in range(10))
    with pytest.raises(SceneError, match=r"/L\d+: found more than 500,000 instances"):
        read_usda(levels + prim("L10", WEDGE))
