"""The root layer of the results, which lays them over the source, and the files of both.

`OUT.usda` has two sublayers: `OUT.results.usdc` and the source, or where that lies in no file as it
stands, `OUT.source.usdc`.
"""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom, UsdRender

from .errors import SceneError
from .layer_authoring import export_layer
from .stage_opening import variant_selections

# Stage metadata that a stage takes from its root layer alone.
_ROOT_METADATA = (
    "defaultPrim",
    "endTimeCode",
    "expressionVariables",
    "framesPerSecond",
    "kilogramsPerUnit",
    "renderSettingsPrimPath",
    "startTimeCode",
    "timeCodesPerSecond",
)
# A sublayer with another rate would have its time samples rescaled.
_TIME_RATES = ("framesPerSecond", "timeCodesPerSecond")


class ResultsRoot:
    """The root layer, `layer`, and the files that it, the results and a flattened source go to.

    source : the stage that was solved
    output : the root layer's file
    results : the layer with the results
    raises : SceneError where the output is a layer of the source, no USD file or not writable
    """

    def __init__(self, source: Usd.Stage, output: Path, results: Sdf.Layer) -> None:
        self._output = output.absolute()
        self._results_file = self._output.with_suffix(".results.usdc")
        self._flattened_file = self._output.with_suffix(".source.usdc")
        self._flattened: Sdf.Layer | None = None
        self._results = results
        self._check_output(source)
        self._source_has_range = source.HasAuthoredTimeCodeRange()
        self._written = ""
        self.layer = self._compose(source)

    def write(self, time_code: float) -> None:
        """Replace the files after the stage of this time code.

        raises : SceneError naming the file that can't be written
        """
        try:
            self.write_flattened_source()
            export_layer(self._results, self._results_file)
            self._write_layer(time_code)
        except SceneError:
            if not self._output.exists():  # then nothing points to the other files
                self._results_file.unlink(missing_ok=True)
                self._flattened_file.unlink(missing_ok=True)
            raise

    def write_flattened_source(self) -> None:
        """Where the source lies in no file as it stands, write it into one."""
        if self._flattened:
            export_layer(self._flattened, self._flattened_file)
            self._flattened = None

    def define_report_prim(self, source: Usd.Stage) -> Sdf.Path:
        """The stage's own RenderSettings prim, else a new one that the root layer points to."""
        authored = source.GetMetadata("renderSettingsPrimPath")
        if authored and UsdRender.Settings(source.GetPrimAtPath(authored)):
            path = Sdf.Path(authored)
            Sdf.CreatePrimInLayer(self._results, path)
            return path
        scope = Sdf.Path("/Render")
        while source.GetPrimAtPath(scope):
            scope = Sdf.Path(f"/Isolux{scope.name}")
        path = scope.AppendChild("Isolux")
        for prim_path, type_name in ((scope, "Scope"), (path, "RenderSettings")):
            prim = Sdf.CreatePrimInLayer(self._results, prim_path)
            prim.specifier = Sdf.SpecifierDef
            prim.typeName = type_name
        self.layer.pseudoRoot.SetInfo("renderSettingsPrimPath", str(path))
        return path

    def _check_output(self, stage: Usd.Stage) -> None:
        if self._output.suffix not in (".usda", ".usd", ".usdc"):
            raise SceneError(
                str(self._output), f'suffix "{self._output.suffix}"', ".usda, .usd or .usdc"
            )
        folder = self._output.parent
        if not (folder.is_dir() and os.access(folder, os.W_OK)):
            raise SceneError(str(self._output), f"no writable folder {folder}", "a file to write")
        used = {Path(layer.realPath).resolve() for layer in stage.GetUsedLayers() if layer.realPath}
        for path in (self._output, self._results_file, self._flattened_file):
            if path.resolve() in used:
                raise SceneError(str(path), "a layer of the source stage", "another output file")

    def _compose(self, stage: Usd.Stage) -> Sdf.Layer:
        """The root layer but for its time range, which grows with the stages."""
        source = stage.GetRootLayer()
        root = Sdf.Layer.CreateAnonymous(".usda")
        root.subLayerPaths = [f"./{self._results_file.name}", self._source_asset(stage, root)]
        for key in _ROOT_METADATA:
            if source.pseudoRoot.HasInfo(key):
                root.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
        # Also where the source leaves them to the fallback, which may differ at the reader's site.
        root.pseudoRoot.SetInfo("metersPerUnit", UsdGeom.GetStageMetersPerUnit(stage))
        root.pseudoRoot.SetInfo("upAxis", UsdGeom.GetStageUpAxis(stage))
        for key in _TIME_RATES:
            if source.pseudoRoot.HasInfo(key):
                self._results.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
        return root

    def _source_asset(self, stage: Usd.Stage, root: Sdf.Layer) -> str:
        """Path of the source from the output's folder.

        Variants that the session chooses go into `root`. A stage that otherwise lies in no file as
        it stands (in memory, unsaved edits, session opinions, muted layers) is flattened into a
        file of its own.
        """
        layer, session = stage.GetRootLayer(), stage.GetSessionLayer()
        selections = variant_selections(session) if session else {}
        in_files = selections is not None and not stage.GetMutedLayers()
        in_files = in_files and all(
            used.empty or used == session if used.anonymous else not used.dirty
            for used in stage.GetUsedLayers()
        )
        if in_files and not layer.anonymous:
            for path, chosen in (selections or {}).items():
                Sdf.CreatePrimInLayer(root, path).variantSelections.update(chosen)
            if not layer.realPath:
                return str(layer.identifier)
            relative = os.path.relpath(layer.realPath, self._output.parent)
            return Path(relative).as_posix() if relative.startswith("..") else f"./{relative}"
        self._flattened = stage.Flatten()
        return f"./{self._flattened_file.name}"

    def _write_layer(self, time_code: float) -> None:
        """After the results layer, so that the root layer never points to nothing."""
        if not self._source_has_range:
            self.layer.startTimeCode = 1.0
            self.layer.endTimeCode = time_code
        text = self.layer.ExportToString()
        if text != self._written:
            export_layer(self.layer, self._output)
            self._written = text
