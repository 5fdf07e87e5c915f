"""The generated scenes: sound meshes, complete luminaires, the same text each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux, UsdValidation
from usd_scenes.auditorium.generate import generate as generate_auditorium
from usd_scenes.box_room.generate import expected_illuminance as box_illuminance
from usd_scenes.box_room.generate import generate as generate_box_room
from usd_scenes.cornell_box.generate import LUMINOUS_FLUX as CORNELL_FLUX
from usd_scenes.cornell_box.generate import generate as generate_cornell_box
from usd_scenes.flat.generate import generate as generate_flat
from usd_scenes.furnace_sphere.generate import expected_illuminance as sphere_illuminance
from usd_scenes.furnace_sphere.generate import generate as generate_furnace_sphere
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.hall.generate import LUMINOUS_FLUX as HALL_FLUX
from usd_scenes.hall.generate import generate as generate_hall
from usd_scenes.hills.generate import generate as generate_hills
from usd_scenes.office.generate import generate as generate_office
from usd_scenes.photometry import generate as photometry
from usd_scenes.spot_room.generate import generate as generate_spot_room
from usd_scenes.study.generate import COARSE_STEP, STEP
from usd_scenes.study.generate import generate as generate_study

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage

GENERATORS = {
    "office": lambda path: generate_office(path, density=0.5),
    "furnace_sphere": generate_furnace_sphere,
    "box_room": generate_box_room,
    "spot_room": generate_spot_room,
    "cornell_box": generate_cornell_box,
    "hall": lambda path: generate_hall(path, luminaires=33, density=0.5),
    "flat": lambda path: generate_flat(path, density=0.5),
    "study": generate_study,
    "hills": lambda path: generate_hills(path, faces=1000, meshes=4, normals=True),
    "auditorium": lambda path: generate_auditorium(path, rows=2),
    "auditorium of points": lambda path: generate_auditorium(path, "points", rows=2),
}

# Meshes that bound no solid: walls and panes seen from one side, canvases, the rug, boxes without
# the side that touches floor or wall.
OPEN_MESHES = {
    *("Floor", "Ceiling", "BackWall", "FrontWall", "RightWall", "LeftWall"),
    *("Reveals", "Glass", "Canvas", "Rug", "ShortBox", "TallBox"),
    *("Tile0", "Tile1", "Tile2", "Tile3"),
    *("Desk", "Sofa", "Cupboard", "LowShelf", "HighShelf"),
    "Steps",
}
AUDITORIA = ("auditorium", "auditorium of points")


@pytest.fixture(scope="module")
def stages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Usd.Stage]:
    folder = tmp_path_factory.mktemp("scenes")
    opened = {}
    for name, generate in GENERATORS.items():
        generate(folder / f"{name}.usda")
        opened[name] = Usd.Stage.Open(str(folder / f"{name}.usda"))
    return opened


def meshes(stage: Usd.Stage) -> list[UsdGeom.Mesh]:
    return [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]


def corner_triangles(mesh: UsdGeom.Mesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points in metres, and faces as fans of triangles (T, 3)."""
    points = np.array(mesh.GetPointsAttr().Get(), float)
    points *= UsdGeom.GetStageMetersPerUnit(mesh.GetPrim().GetStage())
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    triangles = []
    for first, count in zip(np.cumsum(counts) - counts, counts, strict=True):
        triangles += [indices[[first, first + i, first + i + 1]] for i in range(1, count - 1)]
    return points, np.array(triangles)


@pytest.mark.parametrize("name", GENERATORS)
def test_usd_itself_finds_nothing_wrong(stages: dict[str, Usd.Stage], name: str) -> None:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stages[name])
    messages = [f"{error.GetName()}: {error.GetMessage()}" for error in errors]
    assert messages == []


@pytest.mark.parametrize("name", GENERATORS)
def test_the_same_parameters_give_the_same_text(stages: dict[str, Usd.Stage], name: str) -> None:
    first = Path(stages[name].GetRootLayer().realPath)
    again = first.with_name(f"{name}_again.usda")
    GENERATORS[name](again)
    assert again.read_bytes() == first.read_bytes()


@pytest.mark.parametrize("name", GENERATORS)
def test_meshes_are_sound(stages: dict[str, Usd.Stage], name: str) -> None:
    for mesh in meshes(stages[name]):
        path = mesh.GetPath()
        points, triangles = corner_triangles(mesh)
        p, q, r = points[triangles].transpose(1, 0, 2)
        area_normals = np.cross(q - p, r - p) / 2
        areas = np.linalg.norm(area_normals, axis=1)
        assert np.isfinite(points).all(), path
        assert areas.min() > 1e-9, path  # m^2
        assert mesh.GetExtentAttr().HasAuthoredValue(), path
        normals = np.array(mesh.GetNormalsAttr().Get() or [[0, 0, 1]], float)
        assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5, path


@pytest.mark.parametrize("name", GENERATORS)
def test_solids_are_closed_and_face_outwards(stages: dict[str, Usd.Stage], name: str) -> None:
    for mesh in meshes(stages[name]):
        if mesh.GetPrim().GetName() in OPEN_MESHES or mesh.GetDoubleSidedAttr().Get():
            continue
        points, triangles = corner_triangles(mesh)
        edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
        forward = {tuple(edge) for edge in edges}
        assert {(b, a) for a, b in forward} == forward, f"{mesh.GetPath()} has a border"
        p, q, r = points[triangles].transpose(1, 0, 2)
        volume = np.einsum("ij,ij->", p, np.cross(q, r)) / 6
        # The closed rooms are seen from inside.
        inside_out = name in ("furnace_sphere", "box_room")
        inside_out |= name in ("hall", "hills", *AUDITORIA) and mesh.GetPrim().GetName() == "Shell"
        inside_out |= str(mesh.GetPath()) == "/World/Rooms/Envelope"
        assert (volume < 0) == inside_out, f"{mesh.GetPath()}: {volume} m^3"


def test_the_office_has_no_gap_for_a_photon(stages: dict[str, Usd.Stage]) -> None:
    """Walls, reveals and glass meet edge on edge, to the last bit of the stage's points."""
    edges = set()
    for mesh in meshes(stages["office"]):
        if mesh.GetPrim().GetName() in OPEN_MESHES - {"Canvas", "Rug"}:
            points = [tuple(point) for point in mesh.GetPointsAttr().Get()]
            for quad in np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4):
                corners = [points[i] for i in quad]
                edges |= set(zip(corners, corners[1:] + corners[:1], strict=True))
    assert {(b, a) for a, b in edges} == edges


def test_the_office_is_read_whole(stages: dict[str, Usd.Stage]) -> None:
    scene = read_stage(stages["office"])
    assert scene.findings == ()
    assert len(scene.meshes) == len(meshes(stages["office"]))
    flux = {luminaire.path: luminaire.luminous_flux for luminaire in scene.luminaires}
    assert flux["/World/WallWasher1/Light"] == pytest.approx(0.8 * 620, rel=1e-3)
    assert flux["/World/Pendant/Light"] == pytest.approx(1300, rel=1e-3)
    assert flux["/World/DownlightDoor"] == pytest.approx(0.35 * 1200, rel=1e-3)
    assert flux["/World/DownlightWindow"] == pytest.approx(0.35 * 900, rel=1e-3)
    assert flux["/World/DeskLamp/Light"] == pytest.approx(380)
    assert flux["/World/FloorLamp/Light"] == pytest.approx(800)


def test_the_office_is_complete(stages: dict[str, Usd.Stage]) -> None:
    stage = stages["office"]
    lights = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI)]
    absolute = [
        prim
        for prim in lights
        if "IsoluxLuminaireAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    ]
    files = [prim.GetAttribute("inputs:isolux:file").Get() for prim in absolute]
    found = {Path(file.resolvedPath).name for file in files if file}
    assert found == set(photometry.FILES)
    assert any(prim.GetAttribute("inputs:isolux:candela").Get() for prim in absolute)
    assert len(absolute) == 7 and len(lights) == 8
    settings = stage.GetPrimAtPath(stage.GetMetadata("renderSettingsPrimPath"))
    assert "IsoluxSolverAPI" in settings.GetPrimTypeInfo().GetAppliedAPISchemas()
    [camera] = settings.GetRelationship("camera").GetTargets()
    focal_length = UsdGeom.Camera(stage.GetPrimAtPath(camera)).GetFocalLengthAttr().Get()
    assert 24 <= focal_length <= 28  # mm, on a stage in centimetres


def test_the_spot_room_is_as_fine_as_the_papers(stages: dict[str, Usd.Stage]) -> None:
    scene = read_stage(stages["spot_room"])
    assert scene.findings == ()
    triangles = sum((mesh.face_vertex_counts - 2).sum() for mesh in scene.meshes)
    assert triangles == pytest.approx(30_200, rel=0.01)  # [Volevich 2000, §4]
    assert [light.luminous_flux for light in scene.luminaires] == pytest.approx([450.0] * 8)


@pytest.mark.parametrize(("density", "triangles"), [(0.5, 37_500), (1.0, 100_000)])
def test_density_sets_the_number_of_triangles(
    tmp_path: Path, density: float, triangles: int
) -> None:
    generate_office(tmp_path / "office.usdc", density)
    stage = Usd.Stage.Open(str(tmp_path / "office.usdc"))
    counts = [np.array(mesh.GetFaceVertexCountsAttr().Get()) for mesh in meshes(stage)]
    assert sum((count - 2).sum() for count in counts) == pytest.approx(triangles, rel=0.05)


def test_the_cornell_box_is_read_whole(stages: dict[str, Usd.Stage]) -> None:
    scene = read_stage(stages["cornell_box"])
    assert scene.findings == ()
    triangles = sum((mesh.face_vertex_counts - 2).sum() for mesh in scene.meshes)
    assert triangles == pytest.approx(30_000, rel=0.05)
    [light] = scene.luminaires
    assert light.luminous_flux == pytest.approx(CORNELL_FLUX, rel=1e-3)


def test_the_flat_is_read_whole_and_as_large_as_the_papers(tmp_path: Path) -> None:
    generate_flat(tmp_path / "flat.usdc")
    scene = read_stage(tmp_path / "flat.usdc")
    assert scene.findings == ()
    triangles = sum((mesh.face_vertex_counts - 2).sum() for mesh in scene.meshes)
    assert triangles == pytest.approx(130_000, rel=0.05)
    assert len(scene.luminaires) == 10
    # Two rooms have neither lamp nor window: a point in each sees no luminaire.
    core = build_core_scene(scene, SolverSettings(), -1)
    dark = np.array([[9.0, 1.2, 1.0], [5.3, 1.2, 8.8]])
    lighting = _core.DirectLighting(core, 1, 0.01)
    up = np.tile(np.array([0, 1, 0], np.float32), (2, 1))
    found = lighting.illuminate(dark, up, np.zeros(2, np.float32), -1)
    assert found["illuminance"].max() == 0


def test_the_study_is_the_same_room_in_few_polygons_or_many(tmp_path: Path) -> None:
    polygons, area = {}, {}
    for step in (COARSE_STEP, STEP):
        generate_study(tmp_path / "study.usdc", step)
        scene = read_stage(tmp_path / "study.usdc")
        assert scene.findings == ()
        assert [round(light.luminous_flux) for light in scene.luminaires] == [
            1300,
            620,
            620,
            600,
            700,
        ]
        polygons[step] = sum(len(mesh.face_vertex_counts) for mesh in scene.meshes)
        area[step] = 0.0
        for mesh in scene.meshes:
            p = mesh.points[mesh.face_vertex_indices.reshape(-1, 4)]
            edges = p[:, 1] - p[:, 0], p[:, 3] - p[:, 0]
            area[step] += float(np.linalg.norm(np.cross(*edges), axis=1).sum())
    assert polygons[COARSE_STEP] < 500 < 20_000 < polygons[STEP]
    assert area[STEP] == pytest.approx(area[COARSE_STEP])


def test_expected_values_are_those_of_the_closed_forms() -> None:
    sphere = icosphere(4)
    assert len(sphere.counts) == 20 * 4**4
    assert sphere.area() == pytest.approx(4 * np.pi, rel=2e-3)  # facets lie inside the sphere
    assert sphere_illuminance(sphere, 0.5) == pytest.approx(1000 / (4 * np.pi * 0.5), rel=2e-3)
    assert box_illuminance(0.5) == pytest.approx((104.2, 104.2), rel=1e-3)  # CIE 171, 5.8
    assert box_illuminance(0.9)[1] == pytest.approx(937, rel=1e-3)


@pytest.mark.parametrize("file_name", photometry.FILES)
def test_photometric_files_are_those_of_their_formulas(file_name: str) -> None:
    committed = (photometry.HERE / file_name).read_bytes()
    assert committed == photometry.FILES[file_name]().encode("ascii")


@pytest.mark.parametrize("luminaires", [1, 10, 47])
def test_the_hall_has_one_flux_whatever_its_luminaires(tmp_path: Path, luminaires: int) -> None:
    generate_hall(tmp_path / "hall.usdc", luminaires, density=0.2)
    scene = read_stage(tmp_path / "hall.usdc")
    assert len(scene.luminaires) == luminaires
    assert sum(light.luminous_flux for light in scene.luminaires) == pytest.approx(HALL_FLUX)


def test_the_auditorium_is_the_same_however_its_seats_are_placed(tmp_path: Path) -> None:
    scenes = []
    for instancing in ("none", "scenegraph", "points"):
        generate_auditorium(tmp_path / "auditorium.usdc", instancing, rows=2)
        scenes.append(read_stage(tmp_path / "auditorium.usdc"))
    for scene in scenes:
        assert scene.findings == ()
        assert len(scene.meshes) == 2 + 200 * 2
        for mesh, other in zip(scene.meshes, scenes[0].meshes, strict=True):
            # A point instancer keeps places and turns in less than single precision.
            assert mesh.points == pytest.approx(other.points, abs=1e-3)
