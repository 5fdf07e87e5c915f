"""Writes progressive solutions into USD, one time sample a stage, and leaves the source as it is.

`OUT.usda` is a small root layer that lays `OUT.results.usdc` over the source stage; it is made by
`results_root`. The results layer holds `over`s of the meshes with the primvars of `output_fields`,
the solver's report on a RenderSettings prim, and in its customLayerData what is needed to replay
the run.

Where a solution comes with a refined mesh, the meshes with splits are written as triangles, by
`refined_results`. All stages share that one topology: those before it are interpolated to it, which
leaves them the same functions, and written again.

Both files are replaced whole after each stage: whoever opens them meanwhile reads the stages so
far. The samples of all stages stay in memory, and each stage writes them all again.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from .adaptation import SceneAdaptation
from .cage_results import CageFits, CageOutput, fit_cages
from .display_view import DisplayView
from .instanced_results import (
    InstanceSummary,
    instance_of_meshes,
    instances_finding,
    write_expanded,
)
from .layer_authoring import layer_value
from .output_fields import (
    OUTPUT_FIELDS,
    MeshCorners,
    MeshOutput,
    OutputField,
    VertexIlluminance,
    surface_look,
)
from .refined_cage import RefinedCageTopology
from .refined_results import write_refined_mesh
from .refined_topology import RefinedTopology, refined_topologies, unsplit_mesh
from .results_meshes import local_shape, stage_of_mesh, write_as_mesh
from .results_root import ResultsRoot
from .scene_description import Finding, MeshDescription, SceneDescription
from .schedule import steps_record
from .settings import Instances, OutputMode
from .solution import MeshLayout, ProgressiveStage, RefinedMesh, Solution

# Of values of one or two dimensions: numbers, colours.
_ARRAY_TYPES = {
    1: (Vt.FloatArray, Sdf.ValueTypeNames.FloatArray),
    2: (Vt.Vec3fArray, Sdf.ValueTypeNames.Color3fArray),
}

_REPORT_TYPES = {
    "int": Sdf.ValueTypeNames.Int64,
    "float": Sdf.ValueTypeNames.Double,
    "str": Sdf.ValueTypeNames.Token,
}


def _camel_case(name: str) -> str:
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)


# Report attribute of each field of ProgressiveStage; the index is the time code itself.
REPORT_ATTRIBUTES = {
    field.name: (f"isolux:report:{_camel_case(field.name)}", _REPORT_TYPES[str(field.type)])
    for field in fields(ProgressiveStage)
    if field.name != "index"
}


class ResultsWriter:
    """Writes the stages of one solution over one source stage.

    `findings` tells what of the source could not be carried over to the refined mesh as it is, and
    where the control cage of a subdivision surface can't give the solver's illuminance again.

    source : the stage that was solved, or its file
    output : the root layer to make: .usda, .usd or .usdc; its folder must exist
    scene : what was read of the source
    provenance : what is needed to replay the run: version, settings, seed, threads; text, numbers,
        lists of one type, or such a dict again (None is left out)
    display : the view that displayColor is made for
    output_mode : refined: subdivision surfaces are written as polygons of their limit surface from
        the first stage on, whether or not a solution comes with an adaptive mesh
    instances : whether each gets prims of its own, or a value of each primvar
    raises : SceneError where the output is a layer of the source, no USD file or not writable
    """

    def __init__(
        self,
        source: Usd.Stage | str | Path,
        output: str | Path,
        scene: SceneDescription,
        provenance: Mapping[str, Any],
        display: DisplayView | None = None,
        output_mode: OutputMode = "vertex",
        instances: Instances = "expand",
    ) -> None:
        self._display = display or DisplayView()
        stage = source if isinstance(source, Usd.Stage) else Usd.Stage.Open(str(source))
        self._layer = Sdf.Layer.CreateAnonymous(".usda")
        self._files = ResultsRoot(stage, Path(output), self._layer)
        self._report_prim = self._files.define_report_prim(stage)
        self._stage = stage
        self._scene = scene
        # Without the time code, a reader couldn't read the source as it was solved.
        self._provenance = dict(provenance) | {
            "sourceHash": scene.source_hash,
            "timeCode": scene.time_code,
        }
        self._shape_findings: list[Finding] = []
        self._refined_findings: list[Finding] = []
        read_at = scene.time_code
        self._time = Usd.TimeCode.EarliestTime() if read_at is None else Usd.TimeCode(read_at)
        self._instances = instances
        self._meshes_written = scene.meshes
        self._summary: InstanceSummary | None = None
        self._instance_findings: list[Finding] = []
        self._begun = False
        self._stages: list[VertexIlluminance] = []
        self._meshes: dict[str, MeshOutput | CageOutput] = {}
        self._refined: RefinedMesh | None = None
        self._refined_paths: set[str] = set()
        self._double_sided = any(mesh.double_sided for mesh in scene.meshes)
        self._as_polygons = output_mode == "refined"
        self._cages = {mesh.path for mesh in scene.meshes if mesh.cage is not None}

    @property
    def findings(self) -> list[Finding]:
        """What the results don't tell as the solver did."""
        outputs = (self._meshes.get(path) for path in sorted(self._cages))
        cages = (output.finding() for output in outputs if isinstance(output, CageOutput))
        return (
            self._instance_findings
            + self._shape_findings
            + self._refined_findings
            + [finding for finding in cages if finding]
        )

    @property
    def layer(self) -> Sdf.Layer:
        """The results layer, with the stages so far."""
        return self._layer

    @property
    def root(self) -> Sdf.Layer:
        """The root layer that lays the results over the source."""
        return self._files.layer

    def write_flattened_source(self) -> None:
        """Where the source lies in no file as it stands, write it into one."""
        self._files.write_flattened_source()

    def write(self, solution: Solution) -> None:
        """Add one stage at its integer time code and replace the files.

        raises : SceneError naming the file that can't be written; the earlier stages stay readable
        """
        self.add(solution)
        self._files.write(float(solution.stage.index))

    def add(self, solution: Solution) -> None:
        """Add one stage to `layer`; no file is written."""
        if self._as_polygons and self._cages and solution.refined is self._refined is None:
            unsplit = unsplit_mesh(self._scene.meshes, solution.layouts)
            solution = replace(solution, refined=unsplit)
        if not self._begun:
            self._begun = True
            if self._scene.instanced:
                self._begin_instances(solution)
            fits = CageFits(solution.vertex_areas)
            for mesh in self._meshes_written:
                layout = solution.layout(mesh.path)
                if mesh.cage is not None:
                    if self._as_polygons:
                        continue  # comes with the refined mesh
                    self._meshes[mesh.path] = CageOutput(mesh, layout, fits)
                    continue
                corners = MeshCorners.of_authored(mesh, layout)
                self._meshes[mesh.path] = MeshOutput(mesh.path, surface_look(mesh), corners)
                self._write_shape(mesh)
            self._adaptation = SceneAdaptation(self._scene.meshes, solution.layouts)
        stage = VertexIlluminance(
            float(solution.stage.index),
            solution.direct,
            solution.indirect,
            solution.relative_deviation,
            self._display.adapted_to(
                self._adaptation.luminance(
                    solution.direct + solution.indirect, solution.vertex_areas
                )
            ),
        )
        with Sdf.ChangeBlock():
            if solution.refined is not None:
                self._refine(solution.refined, solution.layouts)
            elif self._refined is not None:
                stage = stage.on(self._refined)
            self._stages.append(stage)
            cages = (output for output in self._meshes.values() if isinstance(output, CageOutput))
            fit_cages(list(cages), stage)
            for output in self._meshes.values():
                self._write_primvars(output, stage)
            if self._summary is not None:
                light = solution.solved_light
                of_light = replace(
                    stage,
                    direct=light.direct,
                    indirect=light.indirect,
                    relative_deviation=light.relative_deviation,
                )
                self._write_summary(self._summary, of_light)
            self._write_report(solution)

    def _begin_instances(self, solution: Solution) -> None:
        """Make prims of the instances, or leave out their meshes; say what that costs."""
        instanced = instance_of_meshes(self._scene)
        if self._instances == "summary":
            self._summary = InstanceSummary(self._scene, solution)
            self._meshes_written = tuple(
                mesh for mesh in self._scene.meshes if mesh.path not in instanced
            )
        else:
            with Sdf.ChangeBlock():
                write_expanded(self._layer, self._stage, self._scene.instanced)
        self._instance_findings.append(instances_finding(self._scene, solution, self._instances))

    def _write_summary(self, summary: InstanceSummary, stage: VertexIlluminance) -> None:
        for item, field, values in summary.primvars(stage):
            interpolation = "constant" if item.copies is None else "vertex"
            self._write_values(item.path, field, interpolation, None, values, stage.time_code)

    def _refine(self, refined: RefinedMesh, layouts: Mapping[str, MeshLayout]) -> None:
        """Put all stages so far on this refinement."""
        if self._refined is not None and np.array_equal(refined.elements, self._refined.elements):
            return
        known = None if self._refined is None else refined.common_vertices(self._refined)
        self._refined = refined
        topologies = refined_topologies(
            self._meshes_written, layouts, refined, also=self._refined_paths | self._cages
        )
        borrowers = self._borrowers(topologies)
        if borrowers:
            topologies = refined_topologies(
                self._meshes_written, layouts, refined, also={*topologies, *borrowers}
            )
        self._refined_paths = set(topologies)
        self._stages = [stage.on(refined, known) for stage in self._stages]
        self._refined_findings = []
        if self._summary is not None:
            reason = "meshes of instances stay as they are: an adaptive mesh wants them expanded"
            self._refined_findings.append(Finding("/", "outputMode", "approximated", reason))
        for mesh in self._meshes_written:
            if mesh.path in topologies:
                self._write_refined_mesh(mesh, topologies[mesh.path])
                corners = MeshCorners.of_refined(topologies[mesh.path])
                output = MeshOutput(mesh.path, surface_look(mesh), corners)
                self._meshes[mesh.path] = output
                for stage in self._stages:
                    self._write_primvars(output, stage)

    def _borrowers(self, refined: Container[str]) -> set[str]:
        """Meshes to which composition would carry the topology of a refined one.

        Those that come by a reference to it within the stage: they have to tell their own.
        """
        return {
            mesh.path
            for mesh in self._meshes_written
            if mesh.path not in refined
            and any(path in refined for path in _sites(self._source_prim(mesh)))
        }

    def _source_prim(self, mesh: MeshDescription) -> Usd.Prim:
        return self._stage.GetPrimAtPath(mesh.source_path or mesh.path)

    def _write_refined_mesh(self, mesh: MeshDescription, topology: RefinedTopology) -> None:
        """Replace the mesh's faces, and the primvars that were written for the former ones."""
        prim = self._layer.GetPrimAtPath(mesh.path)
        for field in OUTPUT_FIELDS:
            for name in (f"primvars:{field.name}", f"primvars:{field.name}:indices"):
                if prim and name in prim.attributes:
                    prim.RemoveProperty(prim.attributes[name])
        source = self._source_prim(mesh)
        if not source.IsA(UsdGeom.Mesh):
            alone = stage_of_mesh(source, mesh)
            source = alone.GetPrimAtPath(mesh.path)
        own_normals = mesh.cage is None and not mesh.is_posed
        solved = None if own_normals else local_shape(mesh)
        shown = topology if mesh.cage is None else RefinedCageTopology(topology, mesh.cage)
        self._refined_findings += write_refined_mesh(
            self._layer, source, mesh.path, self._time, shown, solved, mesh.is_posed
        )

    def _write_shape(self, mesh: MeshDescription) -> None:
        """Where the source has a shape and no mesh, make it one."""
        prim = self._source_prim(mesh)
        if prim and not prim.IsA(UsdGeom.Mesh):
            self._shape_findings += write_as_mesh(self._layer, prim, mesh)

    def _write_primvars(self, output: MeshOutput | CageOutput, stage: VertexIlluminance) -> None:
        for field, layout, values in output.primvars(stage):
            if values is not None:
                self._write_values(
                    output.path,
                    field,
                    layout.interpolation,
                    layout.indices,
                    values,
                    stage.time_code,
                )
            elif self._double_sided:
                self._block_primvar(output.path, field)

    def _write_values(
        self,
        owner: str,
        field: OutputField,
        interpolation: str,
        picked: NDArray[np.int32] | None,
        values: NDArray[np.float32],
        time_code: float,
    ) -> None:
        """One stage of a primvar. picked : the primvar's indices; None: it has none"""
        array_type, value_type = _ARRAY_TYPES[values.ndim]
        path = Sdf.Path(f"{owner}.primvars:{field.name}")
        attribute = self._layer.GetAttributeAtPath(path)
        if not attribute:
            prim = Sdf.CreatePrimInLayer(self._layer, owner)
            attribute = Sdf.AttributeSpec(prim, path.name, value_type)
            attribute.SetInfo("interpolation", interpolation)
            indices = Sdf.AttributeSpec(prim, f"{path.name}:indices", Sdf.ValueTypeNames.IntArray)
            # Without indices of ours, those of the source or of a mesh that this one references
            # would pick from our values.
            indices.default = Sdf.ValueBlock() if picked is None else Vt.IntArray.FromNumpy(picked)
        sample = array_type.FromNumpy(np.ascontiguousarray(values))
        self._layer.SetTimeSample(path, time_code, sample)
        # For readers at the default time; equal arrays are stored once.
        attribute.default = sample

    def _block_primvar(self, mesh: str, field: OutputField) -> None:
        """Keep out what a mesh that this one references has and this one has not."""
        name = f"primvars:{field.name}"
        prim = Sdf.CreatePrimInLayer(self._layer, mesh)
        if name not in prim.attributes:
            Sdf.AttributeSpec(
                prim, name, Sdf.ValueTypeNames.Color3fArray
            ).default = Sdf.ValueBlock()

    def _write_report(self, solution: Solution) -> None:
        stage = solution.stage
        prim = self._layer.GetPrimAtPath(self._report_prim)
        for field, (name, value_type) in REPORT_ATTRIBUTES.items():
            path = self._report_prim.AppendProperty(name)
            if not self._layer.GetAttributeAtPath(path):
                Sdf.AttributeSpec(prim, name, value_type, Sdf.VariabilityVarying, True)
            self._layer.SetTimeSample(path, float(stage.index), getattr(stage, field))
        self._layer.customLayerData = {
            "isolux": layer_value(
                {
                    **self._provenance,
                    "reportPrim": str(self._report_prim),
                    "steps": steps_record(solution.steps),
                }
            )
        }


def _sites(prim: Usd.Prim) -> Iterator[str]:
    """Paths on the stage itself where opinions about a prim may lie, its own among them.

    They may have none yet: the results layer is going to write there.
    """
    root = prim.GetStage().GetRootLayer()
    for arc in Usd.PrimCompositionQuery(prim).GetCompositionArcs():
        if arc.GetTargetLayer() == root:
            yield str(arc.GetTargetPrimPath())
