"""Diffuse reflectance of a mesh: from the bound material, else displayColor, else 0.18.

A material's reflectance is its base colour, of metals as well: the solver is diffuse, and the
light that a metal reflects stays in the scene. Textures are read as their mean colour; primvars
given at vertices or corners as their mean over each face. Colours are linear Rec. 709.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade

from .errors import SceneError
from .mesh_topology import MeshTopology
from .reading_context import ReadingContext, triple
from .scene_description import FindingAction
from .texture_mean import mean_colour

DEFAULT_REFLECTANCE = 0.18
# A closed room of reflectance 1 never absorbs; at 0.99 a photon still bounces 100 times.
MAX_REFLECTANCE = 0.99
# What single precision and 8-bit textures may add to an honest 1.
REFLECTANCE_ROUNDING = 1e-4


@dataclass(frozen=True, slots=True)
class SurfaceModel:
    """Where a shader keeps its base colour; each with the value it has where not authored."""

    colour: str
    colour_default: float
    metallic: str
    weight: str | None = None
    emission: str = "emissiveColor"


STANDARD_SURFACE = SurfaceModel("base_color", 0.8, "metalness", "base", "emission")
SURFACE_MODELS = {
    "UsdPreviewSurface": SurfaceModel("diffuseColor", 0.18, "metallic"),
    "ND_UsdPreviewSurface_surfaceshader": SurfaceModel("diffuseColor", 0.18, "metallic"),
    "ND_standard_surface_surfaceshader": STANDARD_SURFACE,
    "arnold:standard_surface": STANDARD_SURFACE,
    "ND_open_pbr_surface_surfaceshader": SurfaceModel(
        "base_color", 0.8, "base_metalness", "base_weight", "emission_luminance"
    ),
}


@dataclass(frozen=True, slots=True)
class ReadColour:
    """A shader input: one colour, or the primvar that gives it on each mesh.

    colour : (3,) float64; where `primvar` is given, its fallback
    """

    colour: NDArray[np.float64]
    primvar: str | None = None


@dataclass(frozen=True, slots=True)
class ReadMaterial:
    """path: of the shader; weight: of its base colour."""

    path: Sdf.Path
    base: ReadColour
    weight: float


class MaterialReader:
    """Reads each material once, each mesh's reflectance from it."""

    def __init__(self, context: ReadingContext) -> None:
        self._context = context
        self._materials: dict[Sdf.Path, ReadMaterial | None] = {}
        self._clamped: set[Sdf.Path] = set()

    def reflectance(self, mesh: UsdGeom.Mesh, topology: MeshTopology) -> NDArray[np.float32]:
        """(1, 3) or (F, 3) float32 diffuse reflectance of a mesh's faces, each in [0, 0.99].

        Faces in a material subset take its material, the others the mesh's own.
        Raises SceneError where a reflectance is outside [0, 1] or NaN.
        """
        face_count = len(topology.counts)
        subsets = UsdGeom.Subset.GetGeomSubsets(
            mesh, UsdGeom.Tokens.face, UsdShade.Tokens.materialBind
        )
        if not subsets:
            return self._bound_reflectance(mesh.GetPrim(), mesh, topology)
        faces = np.zeros((face_count, 3), np.float32)
        uncovered = np.ones(face_count, bool)
        for subset in subsets:
            authored = subset.GetIndicesAttr().Get(self._context.time)
            indices = np.asarray(authored if authored else [], dtype=np.int64)
            inside = indices[(indices >= 0) & (indices < face_count)]
            if len(inside) < len(indices):
                reason = f"{len(indices) - len(inside)} indices name no face and are ignored"
                self._context.note(subset.GetPrim(), "GeomSubset", "repaired", reason)
            if len(inside) == 0:
                continue
            own = self._bound_reflectance(subset.GetPrim(), mesh, topology)
            faces[inside] = own if len(own) == 1 else own[inside]
            uncovered[inside] = False
        if uncovered.any():
            own = self._bound_reflectance(mesh.GetPrim(), mesh, topology)
            faces[uncovered] = own if len(own) == 1 else own[uncovered]
        return faces

    def _bound_reflectance(
        self, prim: Usd.Prim, mesh: UsdGeom.Mesh, topology: MeshTopology
    ) -> NDArray[np.float32]:
        """Reflectance by the material bound to a mesh or one of its subsets."""
        binding = UsdShade.MaterialBindingAPI(prim)
        material, _ = binding.ComputeBoundMaterial(UsdShade.Tokens.full)
        read = self._material(material) if material else None
        if read is None:
            values = self._primvar(mesh, "displayColor", topology)
            if values is None:
                return np.full((1, 3), DEFAULT_REFLECTANCE, np.float32)
            return self._checked(values, mesh.GetPath())
        values = read.base.colour[None, :]
        if read.base.primvar:
            found = self._primvar(mesh, read.base.primvar, topology)
            values = values if found is None else found
        return self._checked(values * read.weight, read.path)

    def _checked(self, values: NDArray[np.floating], path: Sdf.Path) -> NDArray[np.float32]:
        """Reflectances in range; raises SceneError where they are none."""
        wrong = ~((values >= 0) & (values <= 1 + REFLECTANCE_ROUNDING)).all(axis=1)
        if wrong.any():
            found = f"reflectance {triple(values[wrong][0])}"
            raise SceneError(str(path), found, "each channel in [0, 1]")
        if (values > MAX_REFLECTANCE).any() and path not in self._clamped:
            self._clamped.add(path)
            reason = f"reflectance {values.max():.4g} taken as {MAX_REFLECTANCE}"
            self._context.note(path, "reflectance", "repaired", reason)
        return np.minimum(values, MAX_REFLECTANCE).astype(np.float32)

    def _primvar(
        self, mesh: UsdGeom.Mesh, name: str, topology: MeshTopology
    ) -> NDArray[np.floating] | None:
        """(1, 3) or (F, 3) colours of a primvar, inherited ones too; None where there is none."""
        primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
        if not (primvar and primvar.HasAuthoredValue()):
            return None
        flattened = primvar.ComputeFlattened(self._context.time)
        values = np.asarray([] if flattened is None else flattened, dtype=np.float32)
        is_colour = values.ndim > 0 and values.shape[-1] == 3
        values = values.reshape(-1, 3) if is_colour else values.reshape(-1, 1).repeat(3, axis=1)
        interpolation = str(primvar.GetInterpolation())
        if not topology.has_values(values, interpolation):
            wanted = topology.value_count(interpolation)
            reason = f"{len(values)} {interpolation} values, {wanted} wanted: ignored"
            self._context.note(mesh.GetPrim(), name, "repaired", reason)
            return None
        return topology.to_faces(values, interpolation)

    def _material(self, material: UsdShade.Material) -> ReadMaterial | None:
        """What the solver needs of a material; None where its network isn't understood."""
        path = material.GetPath()
        if path not in self._materials:
            self._materials[path] = self._read_material(material)
        return self._materials[path]

    def _read_material(self, material: UsdShade.Material) -> ReadMaterial | None:
        outputs = [output.GetBaseName() for output in material.GetSurfaceOutputs()]
        renderers = ["", "mtlx", *(name.split(":")[0] for name in outputs if ":" in name)]
        found = (material.ComputeSurfaceSource(renderer)[0] for renderer in renderers)
        shaders = [shader for shader in found if shader]
        known = [shader for shader in shaders if shader.GetShaderId() in SURFACE_MODELS]
        if not known:
            names = {shader.GetShaderId() or "a shader without id" for shader in shaders}
            reason = f"surface of {', '.join(sorted(names)) or 'no shader'} is not read"
            self._note_fallback(material.GetPrim(), "Material", reason)
            return None
        shader, model = known[0], SURFACE_MODELS[known[0].GetShaderId()]
        self._note_what_is_not_read(shader, model)
        base = self._input(shader, model.colour, model.colour_default)
        if base is None:
            return None
        weight = self._scalar(shader, model.weight, 1.0) if model.weight else 1.0
        if not self._scalar(shader, "useSpecularWorkflow", 0.0):
            metallic = self._scalar(shader, model.metallic, 0.0)
            if metallic > 0:
                reason = f"metallic {metallic:.3g}: its specular reflection is taken as diffuse"
                self._context.note(shader.GetPrim(), model.metallic, "approximated", reason)
        return ReadMaterial(shader.GetPath(), base, weight)

    def _note_fallback(self, prim: Usd.Prim, kind: str, reason: str) -> None:
        rest = f"displayColor or {DEFAULT_REFLECTANCE} instead"
        self._context.note(prim, kind, "approximated", f"{reason}: {rest}")

    def _note_what_is_not_read(self, shader: UsdShade.Shader, model: SurfaceModel) -> None:
        opacity = self._constant(shader, "opacity", 1.0)
        if opacity is None or (opacity < 1).any():
            self._context.note(shader.GetPrim(), "opacity", "approximated", "taken as opaque")
        emission = self._constant(shader, model.emission, 0.0)
        if emission is None or (emission > 0).any():
            reason = "emissive surfaces are not luminaires yet"
            self._context.note(shader.GetPrim(), model.emission, "skipped", reason)

    def _scalar(self, shader: UsdShade.Shader, name: str, default: float) -> float:
        read = self._input(shader, name, default)
        return default if read is None else float(read.colour[0])

    def _input(self, shader: UsdShade.Shader, name: str, default: float) -> ReadColour | None:
        """A shader input's constant, texture mean or primvar; None, and noted, where it is none."""
        constant = self._constant(shader, name, default)
        if constant is not None:
            return ReadColour(constant)
        source = _source(shader, name)
        assert source is not None  # an input without a source has its default for a constant
        node = UsdShade.Shader(source.GetPrim())
        kind = node.GetShaderId() or "a shader without id"
        if kind == "UsdUVTexture":
            return ReadColour(self._texture(node, channel=source.GetName().split(":")[-1]))
        if kind in ("UsdPrimvarReader_float", "UsdPrimvarReader_float3"):
            fallback = self._constant(node, "fallback", 0.0)
            varname = str(self._value(node, "varname", ""))
            return ReadColour(np.zeros(3) if fallback is None else fallback, varname)
        self._note_fallback(shader.GetPrim(), name, f"its value from {kind} is not read")
        return None

    def _constant(
        self, shader: UsdShade.Shader, name: str, default: float
    ) -> NDArray[np.float64] | None:
        """(3,) float64 of an input; None where a node computes it or it is no colour or number."""
        value = np.asarray(self._value(shader, name, default))
        if value.dtype.kind not in "biuf" or value.size not in (1, 3):
            return None
        return np.broadcast_to(value.astype(np.float64).reshape(-1), 3)

    def _value(self, shader: UsdShade.Shader, name: str, default: Any) -> Any:
        """What an input holds, through the interface of its material; None: a node computes it."""
        source = _source(shader, name)
        if source is None:
            return default
        if UsdShade.Utils.GetType(source.GetName()) == UsdShade.AttributeType.Output:
            return None
        value = source.Get(self._context.time)
        return default if value is None else value

    def _texture(self, node: UsdShade.Shader, channel: str) -> NDArray[np.float64]:
        """(3,) float64 mean of a UsdUVTexture's output."""
        grey = (DEFAULT_REFLECTANCE,) * 3
        asset = self._value(node, "file", None) or Sdf.AssetPath()
        action: FindingAction = "approximated"
        reason = "texture read as its mean colour"
        try:
            texels = mean_colour(asset, str(self._value(node, "sourceColorSpace", "auto")))
            scale = np.array(self._value(node, "scale", (1, 1, 1, 1)), float)
            texels = texels * scale + np.array(self._value(node, "bias", (0, 0, 0, 0)), float)
        except SceneError as error:
            texels = np.array(self._value(node, "fallback", (*grey, 1.0)), float)
            action = "skipped"
            reason = (
                f"texture {asset.path or 'without a file'}: {error.found}; its fallback instead"
            )
        self._context.note(node.GetPrim(), "UsdUVTexture", action, reason)
        is_single = channel in ("r", "g", "b", "a")
        return np.repeat(texels["rgba".index(channel)], 3) if is_single else texels[:3]


def _source(shader: UsdShade.Shader, name: str) -> Usd.Attribute | None:
    """The attribute that gives an input its value: an input, or the output of another node."""
    shader_input = shader.GetInput(name)
    sources = shader_input.GetValueProducingAttributes() if shader_input else []
    return sources[0] if sources else None
