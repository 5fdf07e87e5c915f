"""Reflectance, opacity and emission of a mesh's faces, from the materials bound to them.

Without a material that is understood: displayColor and displayOpacity, else 0.18 and opaque.
Textures and primvars count by their mean over each face. Colours are linear Rec. 709.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade

from .attribute_values import ArrayError, number_array
from .errors import SceneError
from .face_values import FaceValues, TextureMeans
from .material_binding import MaterialBinding
from .mesh_topology import MeshTopology
from .reading_context import ReadingContext, triple
from .scene_description import FindingAction
from .shader_network import ShaderNetwork
from .shader_values import Constant, PrimvarValue
from .subdivision import RefinedSurface
from .surface_models import SURFACE_MODELS, Surface, SurfaceReader

DEFAULT_REFLECTANCE = 0.18
# A closed room of reflectance 1 never absorbs; at 0.99 a photon still bounces 100 times.
MAX_REFLECTANCE = 0.99
# What single precision and 8-bit textures may add to an honest 1.
REFLECTANCE_ROUNDING = 1e-4
OPACITY_ROUNDING = 1e-4


@dataclass(frozen=True, slots=True)
class FaceSurfaces:
    """Of the faces of a mesh, each by face or one value for all.

    reflectance : (F, 3) or (1, 3) float32 in [0, 0.99], of the light that the face stops
    opacity : (F,) or (1,) float32 in [0, 1]; None: all opaque
    emission : (F, 3) or (1, 3) float32, cd/m² by channel; None: none shines
    """

    reflectance: NDArray[np.float32]
    opacity: NDArray[np.float32] | None = None
    emission: NDArray[np.float32] | None = None


class MaterialReader:
    """Reads each material once, the surfaces of each mesh from it."""

    def __init__(self, context: ReadingContext) -> None:
        self._context = context
        self._surfaces: dict[Sdf.Path, Surface | None] = {}
        self._uniform: dict[Sdf.Path, FaceSurfaces] = {}  # those of materials without textures
        self._noted: set[tuple[Sdf.Path, str]] = set()
        instead = f"displayColor or {DEFAULT_REFLECTANCE} instead"
        self._reader = SurfaceReader(context, ShaderNetwork(context), instead)
        self._instead = instead
        self._means = TextureMeans()
        self._binding = MaterialBinding()

    def surfaces(
        self,
        mesh: UsdGeom.Gprim,
        topology: MeshTopology,
        refined: RefinedSurface | None = None,
    ) -> FaceSurfaces:
        """Reflectance, opacity and emission of a mesh's faces.

        refined : a subdivision surface, whose refined faces are meant in place of the cage's

        Faces in a material subset take its material, the others the mesh's own.
        Raises SceneError where a reflectance is outside [0, 1] or NaN.
        """
        values = FaceValues(mesh.GetPrim(), topology, self._context, self._means, refined)
        parts = self._parts(mesh, topology)
        if not parts:
            return self._bound(mesh.GetPrim(), mesh, values, None)
        face_count = len(topology.counts)
        owner = np.full(face_count, -1)
        for number, (subset, faces) in enumerate(parts):
            twice = np.count_nonzero(owner[faces] >= 0)
            if twice:
                reason = f"{twice} faces lie in an earlier subset too: this one counts"
                self._context.note(subset, "GeomSubset", "repaired", reason)
            owner[faces] = number
        if refined is not None:
            owner = owner[refined.cage_faces]
            face_count = len(owner)
        reflectance = np.zeros((face_count, 3), np.float32)
        opacity, emission = np.ones(face_count, np.float32), np.zeros((face_count, 3), np.float32)
        for number, prim in [(-1, mesh.GetPrim()), *((i, p) for i, (p, _) in enumerate(parts))]:
            faces = np.flatnonzero(owner == number)
            if len(faces) == 0:
                continue
            own = self._bound(prim, mesh, values, faces)
            reflectance[faces] = own.reflectance
            if own.opacity is not None:
                opacity[faces] = own.opacity
            if own.emission is not None:
                emission[faces] = own.emission
        return FaceSurfaces(
            reflectance,
            opacity if (opacity < 1).any() else None,
            emission if (emission > 0).any() else None,
        )

    def _parts(
        self, mesh: UsdGeom.Gprim, topology: MeshTopology
    ) -> list[tuple[Usd.Prim, NDArray[np.int64]]]:
        """Material subsets of a mesh with their faces."""
        parts = []
        for subset in UsdGeom.Subset.GetAllGeomSubsets(mesh):
            prim = subset.GetPrim()
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                continue
            if subset.GetFamilyNameAttr().Get() != UsdShade.Tokens.materialBind:
                if UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel().HasAuthoredTargets():
                    reason = "its family is not materialBind: its material is not used"
                    self._context.note(prim, "GeomSubset", "skipped", reason)
                continue
            try:
                indices = number_array(subset.GetIndicesAttr(), self._context.time, np.int32)
            except ArrayError as error:
                self._context.note(prim, "GeomSubset", "repaired", f"{error} and are ignored")
                continue
            inside = np.unique(indices[(indices >= 0) & (indices < len(topology.counts))])
            outside = np.count_nonzero((indices < 0) | (indices >= len(topology.counts)))
            if outside:
                reason = f"{outside} indices name no face and are ignored"
                self._context.note(prim, "GeomSubset", "repaired", reason)
            if len(inside):
                parts.append((prim, inside))
        return parts

    def _bound(
        self,
        prim: Usd.Prim,
        mesh: UsdGeom.Gprim,
        values: FaceValues,
        faces: NDArray[np.int64] | None,
    ) -> FaceSurfaces:
        """The surface of some faces, by the material bound to a mesh or one of its subsets."""
        surface = self._surface(prim)
        if surface is None:
            return self._displayed(mesh, values, faces)
        if surface.path in self._uniform:
            return self._uniform[surface.path]
        stopped = values.of(surface.opacity, faces)
        if not isinstance(surface.opacity, Constant) and ((stopped > 0) & (stopped < 1)).any():
            reason = "a cut-out is taken as its mean over each face"
            self._note_once(surface.path, "opacity", reason, "approximated")
        reflected = _three_channels(values.of(surface.reflected, faces))
        # What is cut out has no colour: the mean is that of the rest.
        reflectance = reflected / np.where(stopped > OPACITY_ROUNDING, stopped, 1.0)
        found = FaceSurfaces(
            self._checked(reflectance, surface.path),
            self._opacity(stopped, surface.path),
            self._emission(_three_channels(values.of(surface.emission, faces)), surface.path),
        )
        if all(
            isinstance(v, Constant) for v in (surface.reflected, surface.opacity, surface.emission)
        ):
            self._uniform[surface.path] = found
        return found

    def _displayed(
        self, mesh: UsdGeom.Gprim, values: FaceValues, faces: NDArray[np.int64] | None
    ) -> FaceSurfaces:
        """displayColor and displayOpacity of some faces."""
        colour = values.of(PrimvarValue("displayColor", np.full(3, DEFAULT_REFLECTANCE)), faces)
        opacity = values.of(PrimvarValue("displayOpacity", np.ones(1)), faces)
        path = mesh.GetPath()
        return FaceSurfaces(
            self._checked(_three_channels(colour), path), self._opacity(opacity[:, :1], path)
        )

    def _opacity(self, opacity: NDArray[np.floating], path: Sdf.Path) -> NDArray[np.float32] | None:
        found = opacity[:, 0]
        if not ((found >= 0) & (found <= 1)).all():
            reason = "displayOpacity outside of [0, 1] is clamped to it"
            self._note_once(path, "displayOpacity", reason)
            found = np.clip(np.nan_to_num(found), 0.0, 1.0)
        return found.astype(np.float32) if (found < 1 - OPACITY_ROUNDING).any() else None

    def _emission(
        self, emission: NDArray[np.floating], path: Sdf.Path
    ) -> NDArray[np.float32] | None:
        emission = emission.astype(np.float32)
        shines = np.isfinite(emission) & (emission >= 0)
        if not shines.all():
            self._note_once(path, "emission", "emission that is negative or not finite is left out")
            emission = np.where(shines, emission, np.float32(0))
        return emission if (emission > 0).any() else None

    def _note_once(
        self, path: Sdf.Path, kind: str, reason: str, action: FindingAction = "repaired"
    ) -> None:
        if (path, kind) not in self._noted:
            self._noted.add((path, kind))
            self._context.note(path, kind, action, reason)

    def _checked(self, values: NDArray[np.floating], path: Sdf.Path) -> NDArray[np.float32]:
        """Reflectances in range; raises SceneError where they are none."""
        wrong = ~((values >= 0) & (values <= 1 + REFLECTANCE_ROUNDING)).all(axis=1)
        if wrong.any():
            found = f"reflectance {triple(values[wrong][0])}"
            raise SceneError(str(path), found, "each channel in [0, 1]")
        if (values > MAX_REFLECTANCE).any():
            reason = f"reflectance {values.max():.4g} taken as {MAX_REFLECTANCE}"
            self._note_once(path, "reflectance", reason)
        return np.minimum(values, MAX_REFLECTANCE).astype(np.float32)

    def _surface(self, prim: Usd.Prim) -> Surface | None:
        """The surface bound to a prim; None where there is none or it isn't understood."""
        material = self._binding.material(prim)
        if material is None:
            return None
        path = material.GetPath()
        if path not in self._surfaces:
            self._surfaces[path] = self._read(material)
        return self._surfaces[path]

    def _read(self, material: UsdShade.Material) -> Surface | None:
        outputs = [output.GetBaseName() for output in material.GetSurfaceOutputs()]
        renderers = ["", "mtlx", *(name.split(":")[0] for name in outputs if ":" in name)]
        found = (material.ComputeSurfaceSource(renderer)[0] for renderer in renderers)
        shaders = [shader for shader in found if shader]
        known = [shader for shader in shaders if shader.GetShaderId() in SURFACE_MODELS]
        if known:
            return self._reader.surface(known[0])
        names = {shader.GetShaderId() or "a shader without id" for shader in shaders}
        reason = f"surface of {', '.join(sorted(names)) or 'no shader'} is not read"
        self._context.note(
            material.GetPrim(), "Material", "approximated", f"{reason}: {self._instead}"
        )
        return None


def _three_channels(values: NDArray[np.floating]) -> NDArray[np.floating]:
    return values[:, :3] if values.shape[1] >= 3 else values[:, :1].repeat(3, axis=1)
