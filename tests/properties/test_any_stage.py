"""Any primvar that is legal reaches its corners and faces; any settings come back as they were."""

from __future__ import annotations

from dataclasses import asdict, fields
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdRender

from cages import mesh_usda
from isolux import SolverSettings, settings_from_stage
from isolux.layer_authoring import layer_value
from isolux.plugin_registration import SOLVER_API
from isolux.report import recorded_settings
from isolux.schedule import StagePlan, recorded_steps, steps_record
from isolux.settings import attribute_name
from isolux.solve_command import provenance_of
from usda_stage import read_usda

seeds = st.integers(0, 2**32 - 1)

# --- primvars -----------------------------------------------------------------------------------


@st.composite
def flat_meshes(draw):
    """Points and faces of three, four and five corners beside each other, points in any order."""
    sizes = draw(st.lists(st.sampled_from([3, 4, 5]), min_size=1, max_size=4))
    points, faces = [], []
    for i, size in enumerate(sizes):
        start = max(0, len(points) - draw(st.sampled_from([0, 1])))  # some share a point
        outline = [(0, 0), (0.9, 0), (0.9, 1), (0.4, 1.3), (0, 1)][:size]
        corners = list(range(start, start + size))
        if start < len(points):
            outline = [(points[start][0] - i, points[start][1]), *outline[1:]]
        points[start:] = [(i + x, y, 0.0) for x, y in outline]
        faces.append(corners)
    number = draw(st.permutations(range(len(points))))
    placed = [points[number.index(i)] for i in range(len(points))]
    return placed, [[number[c] for c in face] for face in faces]


@st.composite
def primvars(draw, mesh, values):
    """How it is authored, and its value at each corner, expanded by hand.

    values : strategy of one value, a tuple of numbers
    """
    points, faces = mesh
    interpolation = draw(
        st.sampled_from(["constant", "uniform", "vertex", "varying", "faceVarying"])
    )
    corner = iter(range(10**6))
    element_of = {  # of each corner: face by face
        "constant": lambda f, p: 0,
        "uniform": lambda f, p: f,
        "vertex": lambda f, p: p,
        "varying": lambda f, p: p,
        "faceVarying": lambda f, p: next(corner),
    }[interpolation]
    elements = [[element_of(f, p) for p in face] for f, face in enumerate(faces)]
    count = {"constant": 1, "uniform": len(faces), "faceVarying": sum(map(len, faces))}.get(
        interpolation, len(points)
    )
    if draw(st.booleans()):
        stored = draw(st.lists(values, min_size=1, max_size=4))
        indices = draw(st.lists(st.integers(0, len(stored) - 1), min_size=count, max_size=count))
        flat = [stored[i] for i in indices]
    else:
        flat = stored = draw(st.lists(values, min_size=count, max_size=count))
        indices = None
    expanded = [[flat[e] for e in face] for face in elements]
    return interpolation, stored, indices, expanded


def usda_of(name, type_name, primvar):
    interpolation, stored, indices, _ = primvar
    shown = ", ".join(str(v if len(v) > 1 else v[0]) for v in stored)
    text = f'{type_name}[] primvars:{name} = [{shown}] (interpolation = "{interpolation}")'
    return text if indices is None else f"{text}\n int[] primvars:{name}:indices = {indices}"


hundredths = st.integers(0, 90).map(lambda i: i / 100)
COLOURS = st.tuples(hundredths, hundredths, hundredths)
OPACITIES = st.tuples(st.integers(1, 100).map(lambda i: i / 100))
UPWARD = st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.integers(3, 9))


@given(st.data(), flat_meshes())
def test_any_interpolation_and_indexing_means_what_it_expands_to(data, mesh):
    colours = data.draw(primvars(mesh, COLOURS))
    opacities = data.draw(primvars(mesh, OPACITIES))
    normals = data.draw(primvars(mesh, UPWARD))
    extra = "\n".join(
        [
            usda_of("displayColor", "color3f", colours),
            usda_of("displayOpacity", "float", opacities),
            usda_of("normals", "normal3f", normals),
        ]
    )
    read = read_usda(mesh_usda(*mesh, extra, scheme="none")).meshes[0]
    means = np.array([np.mean(face, axis=0) for face in colours[3]])
    faces = len(means)
    found = np.broadcast_to(read.reflectance, (faces, 3))
    np.testing.assert_allclose(found, means, atol=1e-6)
    shares = np.array([np.mean(face) for face in opacities[3]])
    found = np.ones(faces) if read.opacity is None else np.broadcast_to(read.opacity, faces)
    np.testing.assert_allclose(found, shares, atol=1e-6)
    corners = np.array([v for face in normals[3] for v in face], float)
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    np.testing.assert_allclose(read.corner_normals, corners, atol=1e-6)


# --- settings -----------------------------------------------------------------------------------


def legal_values(setting):
    choices = setting.metadata.get("choices")
    if choices:
        return st.sampled_from(choices)
    if isinstance(setting.default, str):
        return st.just(setting.default)
    low, high = setting.metadata["minimum"], setting.metadata["maximum"]
    if isinstance(setting.default, int):
        return st.integers(low, None if high == np.inf else high)
    return st.floats(low, None if high == np.inf else high, allow_infinity=False)


# One of the three stops has to be there.
SETTINGS = st.builds(
    dict, **{f.name: legal_values(f) for f in fields(SolverSettings)}
).filter(lambda v: v["target_error"] or v["time_budget"] or v["photons"]).map(
    lambda v: SolverSettings(**v)
)  # fmt: skip


@given(SETTINGS)
def test_any_legal_settings_come_back_from_a_stage(written):
    stage = Usd.Stage.CreateInMemory()
    prim = UsdRender.Settings.Define(stage, "/Render/Settings").GetPrim()
    prim.ApplyAPI(SOLVER_API)
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name, value in asdict(written).items():
        if name != "threads":  # no attribute: it belongs to the machine
            prim.GetAttribute(attribute_name(name)).Set(value)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(stage.GetRootLayer().ExportToString())
    read = settings_from_stage(Usd.Stage.Open(layer))
    assert asdict(read) | {"threads": written.threads} == asdict(written)


counts = st.integers(0, 2**63 - 1)
STEPS = st.lists(
    st.builds(
        StagePlan,
        component=st.sampled_from(["DEPT", "DDL", "IDEPT", "gather", "HPR"]),
        photons=counts,
        rays=counts,
        iteration=st.integers(0, 8),
        shown=st.booleans(),
    ),
    min_size=1,
    max_size=5,
)


@given(SETTINGS, STEPS, st.sampled_from([".usda", ".usdc"]))
@settings(max_examples=60)
def test_what_a_layer_keeps_of_a_run_is_enough_to_make_it_again(solved, steps, suffix):
    layer = Sdf.Layer.CreateAnonymous(suffix)
    kept = {**provenance_of(solved), "steps": steps_record(steps)}
    layer.customLayerData = {"isolux": layer_value(kept)}
    with TemporaryDirectory() as folder:
        path = f"{folder}/results{suffix}"
        layer.Export(path)
        read = Sdf.Layer.OpenAsAnonymous(path).customLayerData["isolux"]
    assert recorded_settings(read) == solved
    assert recorded_steps(read["steps"]) == tuple(steps)
