"""Writes the illumination of a shot: a layer a frame, and a root layer that plays them back.

`OUT.usda` lays `OUT.results.usdc` over the source, as for a single time, and that layer plays the
frames back by value clips: at the time code of a frame the primvars are those of its own layer,
`OUT.frames/OUT.0101.usdc`. What doesn't change over time (types and interpolations) is said once,
in `OUT.results.usdc`, which also declares the clips' attributes. A frame that failed has no
illumination: its clip is empty.

All frames are on the meshes as they are: of a mesh that deforms, each frame has values and indices
of its own, `faceVarying`, since creases may come and go.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from .display_view import DisplayView
from .errors import SceneError
from .layer_authoring import export_layer
from .output_fields import OUTPUT_FIELDS
from .reading_context import may_change
from .results import ResultsWriter
from .scene_description import MeshDescription, SceneDescription
from .settings import SolverSettings
from .solution import Solution

CLIP_SET = "isolux"

# What a change of these over time does to the points and creases of a mesh.
_SHAPE_ATTRIBUTES = (
    "cornerIndices",
    "cornerSharpnesses",
    "creaseIndices",
    "creaseLengths",
    "creaseSharpnesses",
    "faceVertexCounts",
    "faceVertexIndices",
    "holeIndices",
    "normals",
    "orientation",
    "points",
    "primvars:normals",
)


class FramesWriter:
    """Writes the frames of one source stage as they come.

    source : the stage, open
    output : the root layer to make; its folder must exist
    settings : of the display and the output mode
    """

    def __init__(self, source: Usd.Stage, output: Path, settings: SolverSettings) -> None:
        self._source = source
        self._settings = settings
        self._display = DisplayView.of(settings, hold=True)
        self._output = output.absolute()
        self._results = self._output.with_suffix(".results.usdc")
        self._folder = self._output.with_suffix(".frames")
        self._playback: Sdf.Layer | None = None
        self._root: Sdf.Layer | None = None
        self._clips: dict[float, Path | None] = {}
        self._changes: dict[str, bool] = {}

    def write(
        self,
        frame: float,
        scene: SceneDescription,
        solution: Solution,
        provenance: Mapping[str, Any],
    ) -> Path:
        """Write the solution of one frame, and the root that plays back all frames so far.

        frame : time code at which the scene was read
        provenance : as for `ResultsWriter`
        returns : the layer of the frame
        raises : SceneError where a file can't be written
        """
        settings = self._settings
        writer = ResultsWriter(
            self._source,
            self._output,
            scene,
            provenance,
            self._display,
            settings.output_mode,
            settings.instances,
        )
        writer.add(solution)
        layer = writer.layer
        meshes = {mesh.path: mesh for mesh in scene.meshes}
        for path in _prims(layer):
            if path.pathString in meshes and self._may_change(meshes[path.pathString]):
                _spread_to_corners(layer.GetPrimAtPath(path), meshes[path.pathString])
        lasting = Sdf.Layer.CreateAnonymous(".usda")
        lasting.TransferContent(layer)
        for attribute in _varying_attributes(lasting):
            _clear(attribute)
        for attribute in _varying_attributes(layer):
            _hold_at(attribute, frame)
        self._join(lasting, frame)
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise SceneError(str(self._folder), str(error.strerror), "a folder to make") from error
        clip = self._folder / f"{self._output.stem}.{frame_label(frame)}.usdc"
        writer.write_flattened_source()
        export_layer(layer, clip)
        self._clips[frame] = clip
        self._root = writer.root
        self._write_root()
        return clip

    def leave_out(self, frame: float) -> None:
        """Show a frame without light: it has no solution."""
        self._clips[frame] = None
        self._write_root()

    def _may_change(self, mesh: MeshDescription) -> bool:
        """Whether a mesh's layout of values may be another at another time."""
        if mesh.path not in self._changes:
            prim = self._source.GetPrimAtPath(mesh.source_path or mesh.path)
            # What parts the values of a subdivision surface is authored: its points don't.
            self._changes[mesh.path] = mesh.cage is None and (
                self._shading_changes
                or not (prim and prim.IsA(UsdGeom.Mesh))
                or any("skel:" in name for name in prim.GetPropertyNames())
                or _any_varies(prim, _SHAPE_ATTRIBUTES)
            )
        return self._changes[mesh.path]

    @cached_property
    def _shading_changes(self) -> bool:
        """Whether faces of one colour may have several at another time."""
        prims = Usd.PrimRange.Stage(self._source, Usd.TraverseInstanceProxies())
        return any(
            _any_varies(prim, prim.GetAuthoredPropertyNames())
            if prim.IsA(UsdShade.Shader) or prim.IsA(UsdShade.NodeGraph)
            else _any_varies(prim, ("primvars:displayColor",))
            for prim in prims
        )

    def _join(self, lasting: Sdf.Layer, frame: float) -> None:
        """Add what an earlier frame hadn't (meshes that have become visible)."""
        if self._playback is None:
            self._playback = lasting
        else:
            for attribute in _varying_attributes(lasting):
                before = self._playback.GetAttributeAtPath(attribute.path)
                kinds = [spec.GetInfo("interpolation") for spec in (before, attribute) if spec]
                if len(set(kinds)) > 1:
                    raise SceneError(
                        str(attribute.path),
                        f"{kinds[1]} values in frame {frame:g}",
                        f"{kinds[0]} ones as in the frames before",
                    )
            UsdUtils.StitchLayers(self._playback, lasting)
        self._playback.customLayerData = lasting.customLayerData

    def _write_root(self) -> None:
        if self._playback is None or self._root is None:
            return
        frames = sorted(self._clips)
        lit = [frame for frame in frames if self._clips[frame] is not None]
        self._playback.customLayerData = {
            "isolux": {
                **self._playback.customLayerData["isolux"],
                "frames": Vt.DoubleArray(lit),
                "frameLayers": Vt.StringArray([self._asset(self._clips[f]) for f in lit]),
            }
        }
        empty = self._asset(None)
        assets = [
            empty,
            *(asset for asset in map(self._asset, self._clips.values()) if asset != empty),
        ]
        active = [Gf.Vec2d(f, assets.index(self._asset(self._clips[f]))) for f in frames]
        for prim in self._playback.rootPrims:
            clips = {
                "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(asset) for asset in assets]),
                "manifestAssetPath": Sdf.AssetPath(empty),
                "primPath": str(prim.path),
                "active": Vt.Vec2dArray(active),
            }
            prim.SetInfo("clips", {CLIP_SET: clips})
        export_layer(self._playback, self._results)
        self._root.startTimeCode, self._root.endTimeCode = frames[0], frames[-1]
        export_layer(self._root, self._output)

    def _asset(self, clip: Path | None) -> str:
        """Beside the results layer; no clip: that layer itself, which has no samples."""
        if clip is None:
            return f"./{self._results.name}"
        return f"./{clip.relative_to(self._output.parent).as_posix()}"


def frame_label(frame: float) -> str:
    """ "0101", "0101.5": sorts as frames do."""
    whole, dot, part = f"{frame:.6f}".rstrip("0").partition(".")
    sign = "-" if whole.startswith("-") else ""
    return f"{sign}{whole.lstrip('-'):0>4}{dot + part if part else ''}"


def _any_varies(prim: Usd.Prim, names: Iterable[str]) -> bool:
    return any(
        prim.HasAttribute(name) and may_change(prim.GetAttribute(name).ValueMightBeTimeVarying)
        for name in names
    )


def _prims(layer: Sdf.Layer) -> list[Sdf.Path]:
    paths: list[Sdf.Path] = []
    layer.Traverse(
        Sdf.Path.absoluteRootPath, lambda path: paths.append(path) if path.IsPrimPath() else None
    )
    return paths


def _varying_attributes(layer: Sdf.Layer) -> list[Sdf.AttributeSpec]:
    """Attributes with a value that may change over time."""
    return [
        attribute
        for path in _prims(layer)
        for attribute in layer.GetPrimAtPath(path).attributes
        if attribute.variability == Sdf.VariabilityVarying
        and not isinstance(attribute.default, Sdf.ValueBlock)
    ]


def _samples(attribute: Sdf.AttributeSpec) -> list[float]:
    return list(attribute.layer.ListTimeSamplesForPath(attribute.path))


def _clear(attribute: Sdf.AttributeSpec) -> None:
    attribute.ClearDefaultValue()
    for time in _samples(attribute):
        attribute.layer.EraseTimeSample(attribute.path, time)


def _hold_at(attribute: Sdf.AttributeSpec, frame: float) -> None:
    """The last value of an attribute, at the frame's time code alone."""
    layer, path = attribute.layer, attribute.path
    times = _samples(attribute)
    value = layer.QueryTimeSample(path, times[-1]) if times else attribute.default
    _clear(attribute)
    if value is not None:
        layer.SetTimeSample(path, frame, value)


def _spread_to_corners(prim: Sdf.PrimSpec, mesh: MeshDescription) -> None:
    """Turn values by point into values by corner: the same array, picked by indices."""
    points = mesh.face_vertex_indices
    for field in OUTPUT_FIELDS:
        attribute = prim.attributes.get(f"primvars:{field.name}")
        if attribute is None or attribute.GetInfo("interpolation") != UsdGeom.Tokens.vertex:
            continue
        attribute.SetInfo("interpolation", UsdGeom.Tokens.faceVarying)
        indices = prim.attributes[f"primvars:{field.name}:indices"]
        indices.default = Vt.IntArray.FromNumpy(points)
