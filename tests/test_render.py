"""Pictures show L = reflectance * E / pi of the baked illuminance, seen through a real camera."""

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from isolux.colour import exposure_value
from isolux.errors import SceneError, SettingsError
from isolux.image_io import check_picture, write_picture
from isolux.render import render_picture

GREY = (0.5, 0.5, 0.5)


def add_mesh(stage, path, points, faces, *, colour=GREY, double_sided=False):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([index for face in faces for index in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateDoubleSidedAttr(double_sided)
    mesh.CreateDisplayColorAttr([colour])
    return mesh


def add_square(stage, path="/Square", **options):
    """A square of 2 m in the plane z = 0 that faces +Z."""
    points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    return add_mesh(stage, path, points, [(0, 1, 2, 3)], **options)


def bake(mesh, values, *, side="illuminance", interpolation="vertex", times=(1.0,)):
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        f"isolux:{side}", Sdf.ValueTypeNames.Color3fArray, interpolation
    )
    for time in times:
        primvar.Set([Gf.Vec3f(*np.multiply(value, time)) for value in values], time)
    return primvar


def add_camera(stage, position, *, turned_about_y=0.0, projection="perspective", **attributes):
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateProjectionAttr(projection)
    for name, value in {"horizontalAperture": 20.0, "verticalAperture": 20.0, **attributes}.items():
        camera.GetPrim().GetAttribute(name).Set(value)
    placed = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 1, 0), turned_about_y))
    camera.AddTransformOp().Set(placed * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*position)))
    return camera


@pytest.fixture
def stage():
    made = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(made, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(made, 1.0)
    return made


@pytest.fixture
def lit_square(stage):
    """A square of reflectance 0.5 at 100, 200, 400 lx in the middle half of a 4 m wide picture."""
    bake(add_square(stage), [(100.0, 200.0, 400.0)] * 4, times=(1.0, 2.0))
    add_camera(stage, (0, 0, 10))
    return stage


def test_luminance_is_reflectance_times_illuminance_over_pi(lit_square, tmp_path):
    picture = render_picture(lit_square, time=1, width=16)
    write_picture(picture, tmp_path / "square.exr")

    with OpenEXR.File(str(tmp_path / "square.exr")) as file:
        rgba = file.channels()["RGBA"].pixels
        header = dict(file.header())
    middle = rgba[4:12, 4:12]
    expected = 0.5 * np.array([100.0, 200.0, 400.0]) / np.pi
    assert middle[..., :3] == pytest.approx(np.broadcast_to(expected, (8, 8, 3)), rel=1e-6)
    assert (middle[..., 3] == 1.0).all()
    assert (rgba[0, 0] == 0.0).all()
    assert header["whiteLuminance"] == 1.0
    assert header["isolux:camera"] == "/Camera"
    assert header["isolux:time"] == 1.0


def test_coverage_is_the_solid_share_of_the_picture(lit_square):
    assert render_picture(lit_square, width=64).coverage.mean() == pytest.approx(0.25)


def test_the_last_progressive_stage_is_shown_unless_another_is_asked_for(lit_square):
    first = render_picture(lit_square, time=1, width=4)
    last = render_picture(lit_square, width=4)
    assert (first.time, last.time) == (1.0, 2.0)
    assert last.rgb == pytest.approx(2 * first.rgb)


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying", "faceVarying, indexed"])
def test_illuminance_is_linear_across_a_face(stage, interpolation):
    interpolation, _, indexed = interpolation.partition(", ")
    by_x = [(100.0,) * 3, (300.0,) * 3]
    if indexed:
        bake(add_square(stage), by_x, interpolation=interpolation).SetIndices([0, 1, 1, 0])
    else:
        bake(add_square(stage), [by_x[k] for k in (0, 1, 1, 0)], interpolation=interpolation)
    # Orthographic, 2 units (20 tenths) wide: the square fills the picture exactly.
    add_camera(stage, (0, 0, 3), projection="orthographic")

    picture = render_picture(stage, width=10)

    x = np.linspace(-0.9, 0.9, 10)
    expected = 0.5 * (200.0 + 100.0 * x) / np.pi
    assert picture.rgb[..., 0] == pytest.approx(np.broadcast_to(expected, (10, 10)), rel=1e-5)
    assert (picture.coverage == 1.0).all()


def test_the_two_sides_of_a_double_sided_mesh_have_their_own_light(stage):
    square = add_square(stage, double_sided=True)
    bake(square, [(100.0,) * 3] * 4)
    bake(square, [(7.0,) * 3] * 4, side="backIlluminance")
    add_camera(stage, (0, 0, -3), turned_about_y=180.0)
    assert render_picture(stage, width=4).rgb == pytest.approx(
        np.full((4, 4, 3), 0.5 * 7.0 / np.pi), rel=1e-6
    )


def test_one_looks_through_the_backs_of_one_sided_walls(stage):
    """Three walls show their backs; the fourth behind them shows its front."""
    for k in range(3):
        near = add_square(stage, f"/Near{k}")
        near.AddTransformOp().Set(
            Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 1, 0), 180))
            * Gf.Matrix4d().SetTranslate(Gf.Vec3d(0, 0, 0.1 + 0.001 * k))
        )
        bake(near, [(9.0,) * 3] * 4)
    bake(add_square(stage, "/Far"), [(100.0,) * 3] * 4)
    add_camera(stage, (0, 0, 3))
    assert render_picture(stage, width=4).rgb == pytest.approx(
        np.full((4, 4, 3), 50.0 / np.pi), rel=1e-6
    )


def test_the_results_own_colours_are_not_taken_for_reflectance(tmp_path, stage):
    """The results layer paints displayColor; the reflectance stays the source's."""
    add_square(stage, colour=(0.25, 0.25, 0.25))
    add_camera(stage, (0, 0, 3))
    stage.Export(str(tmp_path / "source.usda"))
    results = Usd.Stage.CreateNew(str(tmp_path / "results.usda"))
    painted = UsdGeom.Mesh(results.OverridePrim("/Square"))
    painted.CreateDisplayColorAttr([(0.9, 0.1, 0.1)])
    bake(painted, [(100.0,) * 3] * 4)
    results.GetRootLayer().customLayerData = {"isolux": {"seed": 1}}  # as the results writer does
    results.Save()
    composed = Usd.Stage.CreateNew(str(tmp_path / "out.usda"))
    composed.GetRootLayer().subLayerPaths = ["./results.usda", "./source.usda"]

    picture = render_picture(composed, width=4)

    assert picture.rgb == pytest.approx(np.full((4, 4, 3), 25.0 / np.pi), rel=1e-6)
    assert composed.GetMutedLayers() == []


def test_a_moving_stage_is_shown_as_it_was_when_solved(stage):
    """Progressive stage 3 is no frame 3: camera and meshes stay at the solved time."""
    bake(add_square(stage), [(100.0,) * 3] * 4, times=(1.0, 2.0, 3.0))
    camera = add_camera(stage, (0, 0, 3))
    turn = UsdGeom.Xformable(camera).AddRotateYOp()
    turn.Set(0.0, 1001.0)
    turn.Set(180.0, 1002.0)
    assert render_picture(stage, width=4).coverage.all()


LAMPS = {
    "sphere": (UsdLux.SphereLight, {"inputs:radius": 0.5}),
    "disk": (UsdLux.DiskLight, {"inputs:radius": 0.5}),
    "rect": (UsdLux.RectLight, {"inputs:width": 0.5, "inputs:height": 2.0}),
    "cylinder": (UsdLux.CylinderLight, {"inputs:radius": 0.25, "inputs:length": 2.0}),
}


@pytest.mark.parametrize(("schema", "inputs"), LAMPS.values(), ids=LAMPS.keys())
def test_lamps_are_seen_as_bright_as_usd_lux_says(stage, schema, inputs):
    """UsdLux: a light's luminance is its intensity, whatever its shape; it shines to -Z."""
    bake(add_square(stage), [(1.0,) * 3] * 4)
    light = schema.Define(stage, "/Lamp")
    light.CreateIntensityAttr(1234.0)
    for name, value in inputs.items():
        light.GetPrim().GetAttribute(name).Set(value)
    UsdGeom.Xformable(light).AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    add_camera(stage, (0, 0, 3.5), turned_about_y=180.0, focalLength=1000.0)
    assert render_picture(stage, width=2, time=1).rgb == pytest.approx(
        np.full((2, 2, 3), 1234.0), rel=1e-5
    )


def closed_room(stage):
    """A room of 4 x 3 x 6 m whose walls face in."""
    x, y, z = 2.0, 3.0, 3.0
    points = [(a, b, c) for a in (-x, x) for b in (0, y) for c in (-z, z)]
    inward = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return add_mesh(stage, "/Room", points, inward)


def test_a_stage_without_camera_is_framed_on_its_lit_inside(stage):
    bake(closed_room(stage), [(100.0,) * 3] * 8)
    picture = render_picture(stage, width=32)
    assert picture.camera == ""
    assert picture.rgb.shape == (18, 32, 3)
    assert picture.coverage.mean() > 0.95


def test_framing_prefers_the_lit_room_to_the_dark_one(stage):
    bake(closed_room(stage), [(0.0,) * 3] * 8)
    bake(add_square(stage), [(100.0,) * 3] * 4)
    assert (render_picture(stage, width=32).rgb > 0).any()


def test_framing_is_not_misled_by_faces_without_area_and_loose_points(stage):
    """The room at the origin fills the picture, whatever can't be seen far away."""
    bake(closed_room(stage), [(100.0,) * 3] * 8)
    stray = [(-500, -500, -500), (500, 500, 500), (-500, 500, 0)]
    bake(add_mesh(stage, "/Stray", stray, [(0, 1, 0), (1, 1, 1)]), [(0.0,) * 3] * 3)
    assert render_picture(stage, width=32).coverage.mean() > 0.95


def test_samples_soften_edges_and_change_nothing_else(lit_square):
    single, many = (render_picture(lit_square, width=9, samples=n) for n in (1, 16))
    assert set(np.unique(single.coverage)) <= {0.0, 1.0}
    assert ((many.coverage > 0) & (many.coverage < 1)).any()
    assert many.coverage.mean() == pytest.approx(0.25, abs=0.03)
    assert many.rgb[4, 4] == pytest.approx(single.rgb[4, 4], rel=1e-6)


def test_a_png_is_exposed_as_asked(lit_square, tmp_path):
    picture = render_picture(lit_square, time=1, width=8)
    luminance = float(picture.rgb[4, 4] @ [0.2126, 0.7152, 0.0722])
    used = write_picture(picture, tmp_path / "square.png")
    assert used == pytest.approx(exposure_value(luminance) - 1.0, abs=1e-4)
    assert write_picture(picture, tmp_path / "brighter.png", used - 1.0) == used - 1.0
    with Image.open(tmp_path / "square.png") as image, Image.open(tmp_path / "brighter.png") as two:
        assert image.size == (8, 8)
        assert image.text["isolux:camera"] == "/Camera"
        assert (np.asarray(two)[2:6, 2:6] > np.asarray(image)[2:6, 2:6]).all()


@pytest.mark.parametrize("time", [None, 3.0])
def test_a_stage_that_was_not_baked_is_told_what_to_do(stage, time):
    add_square(stage)
    with pytest.raises(SceneError, match="run `isolux solve` first"):
        render_picture(stage, time=time)


def test_a_mesh_that_changed_after_the_bake_is_named(stage):
    bake(add_square(stage), [(100.0,) * 3] * 3)
    with pytest.raises(SceneError, match="/Square: found 3 vertex values"):
        render_picture(stage)


def test_a_mesh_that_was_added_after_the_bake_is_named(lit_square):
    add_square(lit_square, "/New")
    with pytest.raises(SceneError, match=r"/New: found no primvar isolux:illuminance"):
        render_picture(lit_square)


def test_an_unknown_camera_is_answered_with_those_there_are(lit_square):
    with pytest.raises(SceneError, match=r"/Camra: found no camera; wanted /Camera"):
        render_picture(lit_square, camera="/Camra")


@pytest.mark.parametrize("name", ["picture.jpg", "picture", "picture.png.gz"])
def test_other_formats_are_refused(tmp_path, name):
    with pytest.raises(SettingsError, match=r"\.png or \.exr"):
        check_picture(tmp_path / name, None)


def test_an_exr_takes_no_exposure(lit_square, tmp_path):
    with pytest.raises(SettingsError, match="EXR keeps cd/m²"):
        write_picture(render_picture(lit_square, width=2), tmp_path / "square.exr", 5.0)
    assert list(tmp_path.iterdir()) == []
