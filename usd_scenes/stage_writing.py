"""Shapes, materials and luminaires as prims of a stage, in the stage's own unit of length.

The stages need no Isolux to be opened: its applied schemas are named as text, and their attributes
are ordinary ones. Stock usd-core is all that this module asks for.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, Vt

from .shapes import Shape, corner_normals

PHOTOMETRY = Path(__file__).parent / "photometry"
LUMINAIRE_API = "IsoluxLuminaireAPI"
SOLVER_API = "IsoluxSolverAPI"

Vector = Sequence[float]


@dataclass(frozen=True, slots=True)
class Part:
    """One mesh of a model.

    material : name of a material under /World/Materials; None: `face_colours` say it all
    double_sided : both sides are surfaces; for sheets of no thickness
    creased : author corner normals; flat surfaces do without
    face_colours : (F, 3) linear Rec. 709 diffuse reflectance
    """

    name: str
    shape: Shape
    material: str | None
    double_sided: bool = False
    creased: bool = True
    face_colours: NDArray[np.float32] | None = None


def new_stage(path: str | Path, metres_per_unit: float, up_axis: str) -> Usd.Stage:
    """A stage of its own with /World as default prim; saved with `stage.Save()`."""
    Path(path).unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    UsdGeom.SetStageUpAxis(stage, up_axis)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    stage.SetDefaultPrim(world)
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    return stage


def add_materials(stage: Usd.Stage, reflectances: Mapping[str, Vector]) -> None:
    """UsdPreviewSurface materials under /World/Materials.

    reflectances : diffuse reflectance by name, linear Rec. 709
    """
    UsdGeom.Scope.Define(stage, "/World/Materials")
    for name, reflectance in reflectances.items():
        material = UsdShade.Material.Define(stage, f"/World/Materials/{name}")
        shader = UsdShade.Shader.Define(stage, f"/World/Materials/{name}/Surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
        colour.Set(Gf.Vec3f(*reflectance))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
        surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(surface)


def add_model(
    stage: Usd.Stage, path: str, parts: Sequence[Part], at: Vector = (0, 0, 0), turn: float = 0.0
) -> None:
    """A component of meshes, placed at a point (m) and turned about +Y (degrees)."""
    model = UsdGeom.Xform.Define(stage, path)
    Usd.ModelAPI(model.GetPrim()).SetKind(Kind.Tokens.component)
    _place(stage, model, at, (0, turn, 0))
    for part in parts:
        add_mesh(stage, f"{path}/{part.name}", part)


def add_light(
    stage: Usd.Stage,
    path: str,
    schema: Any,
    size: Mapping[str, float],
    at: Vector,
    *,
    turn: Vector = (0, 0, 0),
    temperature: float = 6500.0,
    luminance: float = 1.0,
) -> UsdLux.LightAPI:
    """A UsdLux light.

    schema : UsdLux.SphereLight, DiskLight, RectLight or CylinderLight
    size : the schema's own lengths by attribute name, such as {"radius": 0.05}, m
    at, turn : position, m, and rotation about X, then Y, then Z, degrees
    temperature : K; 6500 K is white
    luminance : cd/m^2; no matter where a goniometric diagram is applied
    """
    light = schema.Define(stage, path)
    for name, metres in size.items():
        light.GetPrim().GetAttribute(f"inputs:{name}").Set(metres * _units(stage))
    light.CreateIntensityAttr(luminance)
    if temperature != 6500.0:
        light.CreateEnableColorTemperatureAttr(True)
        light.CreateColorTemperatureAttr(temperature)
    _place(stage, light, at, turn)
    _author_extent(light)
    return UsdLux.LightAPI(light)


def add_bulb(stage: Usd.Stage, path: str, at: Vector, radius: float, luminous_flux: float) -> None:
    """A warm white sphere of a radius, m, that shines alike in all directions, lm."""
    luminance = luminous_flux / (4 * np.pi**2 * radius**2)
    add_light(
        stage, path, UsdLux.SphereLight, {"radius": radius}, at,
        temperature=2700.0, luminance=luminance,
    )  # fmt: skip


def add_photometric_file(light: UsdLux.LightAPI, file_name: str, dimming: float = 1.0) -> None:
    """Give a light the absolute photometry of a file in `usd_scenes/photometry`."""
    prim = light.GetPrim()
    prim.AddAppliedSchema(LUMINAIRE_API)
    layer = Path(prim.GetStage().GetRootLayer().realPath)
    relative = Path(os.path.relpath(PHOTOMETRY / file_name, layer.parent)).as_posix()
    if not relative.startswith("."):
        relative = "./" + relative  # anchored to the layer, not searched for
    _author(prim, "inputs:isolux:file", Sdf.ValueTypeNames.Asset, Sdf.AssetPath(relative))
    if dimming != 1.0:
        _author(prim, "inputs:isolux:dimming", Sdf.ValueTypeNames.Float, dimming)


def add_diagram(
    light: UsdLux.LightAPI,
    gamma: ArrayLike,
    c_angles: ArrayLike,
    candela: ArrayLike,
    luminous_flux: float = 0.0,
) -> None:
    """Give a light an inline goniometric diagram.

    gamma, c_angles : (G,) and (H,), degrees
    candela : (H, G), cd
    luminous_flux : lm to which the diagram is scaled; 0: as the diagram gives
    """
    prim = light.GetPrim()
    prim.AddAppliedSchema(LUMINAIRE_API)
    for name, values in (("gammaAngles", gamma), ("cAngles", c_angles), ("candela", candela)):
        flat = Vt.FloatArray(np.asarray(values, float).reshape(-1).tolist())
        _author(prim, f"inputs:isolux:{name}", Sdf.ValueTypeNames.FloatArray, flat)
    if luminous_flux:
        _author(prim, "inputs:isolux:luminousFlux", Sdf.ValueTypeNames.Float, luminous_flux)


def add_view(
    stage: Usd.Stage, eye: Vector, target: Vector, focal_length: float, aspect: float = 16 / 9
) -> None:
    """Render settings with a camera of 36 mm film width at `eye`, looking at `target` (m), Y up.

    focal_length : mm
    aspect : width over height of the picture
    """
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    view = Gf.Matrix4d().SetLookAt(_scaled(stage, eye), _scaled(stage, target), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(view.GetInverse())
    tenths = 0.01 * _units(stage)  # USD counts focal lengths in tenths of the stage unit; from mm
    camera.CreateFocalLengthAttr(focal_length * tenths)
    camera.CreateHorizontalApertureAttr(36.0 * tenths)
    camera.CreateVerticalApertureAttr(36.0 / aspect * tenths)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.05 * _units(stage), 100 * _units(stage)))
    settings = add_render_settings(stage)
    settings.CreateCameraRel().SetTargets([camera.GetPath()])
    settings.CreateResolutionAttr(Gf.Vec2i(1280, 720))


def add_render_settings(stage: Usd.Stage) -> UsdRender.Settings:
    """Render settings with the solver's defaults; the stage's metadata points at them."""
    UsdGeom.Scope.Define(stage, "/Render")
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.GetPrim().AddAppliedSchema(SOLVER_API)
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    return settings


def add_mesh(stage: Usd.Stage, path: str, part: Part) -> None:
    """One mesh below a prim that is there."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    shape = part.shape
    points = (shape.points * _units(stage)).astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(shape.counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(shape.indices))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if part.creased:
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(corner_normals(shape)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    if part.double_sided:
        mesh.CreateDoubleSidedAttr(True)
    if part.face_colours is not None:
        colours = Vt.Vec3fArray.FromNumpy(np.asarray(part.face_colours, np.float32))
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform).Set(colours)
    if part.material is not None:
        material = UsdShade.Material.Get(stage, f"/World/Materials/{part.material}")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    _author_extent(mesh)


def density_options(description: str) -> argparse.ArgumentParser:
    """The command line of a generator of stages that may be finer: OUT.usda and --density."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("path", type=Path, metavar="OUT.usda")
    parser.add_argument("--density", type=float, default=1.0, help="edge lengths are divided by it")
    return parser


def _place(stage: Usd.Stage, prim: UsdGeom.Xformable, at: Vector, turn: Vector) -> None:
    if any(at):
        prim.AddTranslateOp().Set(_scaled(stage, at))
    if any(turn):
        prim.AddRotateXYZOp().Set(Gf.Vec3f(*turn))


def _author_extent(boundable: UsdGeom.Boundable) -> None:
    extent = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode.Default())
    boundable.CreateExtentAttr(extent)


def _author(prim: Usd.Prim, name: str, value_type: Sdf.ValueTypeName, value: object) -> None:
    prim.CreateAttribute(name, value_type, custom=False).Set(value)


def _units(stage: Usd.Stage) -> float:
    """Stage units in a metre."""
    return 1.0 / UsdGeom.GetStageMetersPerUnit(stage)


def _scaled(stage: Usd.Stage, metres: Vector) -> Gf.Vec3d:
    return Gf.Vec3d(*metres) * _units(stage)
