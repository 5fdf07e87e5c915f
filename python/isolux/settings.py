"""The solver's settings: on a stage as IsoluxSolverAPI, in Python as SolverSettings.

Each field but `threads` is the attribute `isolux:<fieldInCamelCase>` of the schema, with the same
default and range. The solver stops at whichever active stopping criterion it meets first;
`target_error`, `time_budget` and `photons` are active where above 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, Literal, get_args

from pxr import Usd, UsdRender

from .errors import SettingsError
from .plugin_registration import SOLVER_API, require_schema

Instances = Literal["expand", "summary"]
FilterInterval = Literal["corrected", "paper"]
Method = Literal["auto", "composite", "dept", "ddl+idept", "ddl+hpr"]
OutputMode = Literal["vertex", "refined"]

# Up to it doubles, in which the goals of stages are counted, hold every whole number.
MOST_PHOTONS = 2**53
MOST_THREADS = 2**16
# The value of display_view that needs no OpenColorIO.
TUMBLIN_RUSHMEIER = "tumblin-rushmeier"


def _number(default: float, minimum: float, maximum: float = math.inf) -> Any:
    return field(default=default, metadata={"minimum": minimum, "maximum": maximum})


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """Settings of one run of the solver. Raises SettingsError for a value out of its range.

    method : the solver's components: the composite, photons alone, or direct lighting with photons
        or with radiosity for the indirect light; auto: the composite
    target_error : relative RMS error of the illuminance at which to stop; 0.05, not 5 %
    time_budget : s of solving after which to stop
    photons : number of emitted photons at which to stop
    seed : of the counter-based random numbers
    stages : number of progressive stages
    filter_accuracy : relative deviation at which a filter support stops growing
    filter_sharing : d_f, fraction of the support radius within which vertices share a value
    filter_interval : confidence interval of a photon count, corrected or as in the paper
    output_mode : vertex: the meshes as they are; refined: with the adaptive mesh of direct lighting
    instances : expand: results make a prim of each instance, with primvars of its own; summary:
        instances stay, each with one value of each primvar
    subdivision_threshold : difference of displayed brightness, 1 from black to white, that the
        adaptive mesh may lose
    subdivision_iterations : of the adaptive mesh
    surface_level : most levels to which subdivision surfaces are refined, fewer where less is
        curved; 0: their control cages as they are
    crease_angle : degrees between adjacent faces above which an edge without authored normals
        is a crease
    display_view : what displayColor is seen by: "tumblin-rushmeier", or DISPLAY/VIEW of the
        OpenColorIO configuration; see `display_view`
    display_adaptation : luminance to which the eye that displayColor is made for is adapted,
        cd/m^2; 0: that of the scene's lit surfaces, in a shot those of its first frame
    threads : 0 for all processors; no attribute of a stage, since it belongs to the machine
    """

    method: Method = field(default="auto", metadata={"choices": get_args(Method)})
    target_error: float = _number(0.05, 0.0, 1.0)
    time_budget: float = _number(0.0, 0.0)
    photons: int = _number(0, 0, MOST_PHOTONS)
    seed: int = _number(0, 0, 2**31 - 1)
    stages: int = _number(8, 1, 64)
    filter_accuracy: float = _number(0.05, 0.001, 1.0)
    filter_sharing: float = _number(0.25, 0.0, 1.0)
    filter_interval: FilterInterval = field(
        default="corrected", metadata={"choices": get_args(FilterInterval)}
    )
    output_mode: OutputMode = field(default="vertex", metadata={"choices": get_args(OutputMode)})
    instances: Instances = field(default="expand", metadata={"choices": get_args(Instances)})
    subdivision_threshold: float = _number(0.05, 0.001, 1.0)
    subdivision_iterations: int = _number(3, 0, 8)
    surface_level: int = _number(2, 0, 6)
    crease_angle: float = _number(40.0, 0.0, 180.0)
    display_view: str = TUMBLIN_RUSHMEIER
    display_adaptation: float = _number(0.0, 0.0)
    threads: int = _number(0, 0, MOST_THREADS)

    def __post_init__(self) -> None:
        for setting in fields(self):
            _check(setting, getattr(self, setting.name))
        if self.target_error == self.time_budget == self.photons == 0:
            raise SettingsError(
                "target_error, time_budget and photons", "0 for all three", "one of them above 0"
            )

    def with_budget(
        self,
        *,
        target_error: float | None = None,
        time_budget: float | None = None,
        photons: int | None = None,
    ) -> SolverSettings:
        """The settings with these stopping criteria and no others; None for all: unchanged."""
        if target_error is None and time_budget is None and photons is None:
            return self
        return replace(
            self,
            target_error=0.0 if target_error is None else target_error,
            time_budget=0.0 if time_budget is None else time_budget,
            photons=0 if photons is None else photons,
        )


def override_settings(settings: SolverSettings, options: Mapping[str, Any]) -> SolverSettings:
    """The settings with the given options; those that are None change nothing.

    raises : SettingsError for more than one stopping criterion, or a value out of its range
    """
    given = {name: value for name, value in options.items() if value is not None}
    budget = {
        name: given.pop(name)
        for name in ("photons", "time_budget", "target_error")
        if name in given
    }
    if len(budget) > 1:
        names = " and ".join("--" + name.replace("_", "-") for name in budget)
        raise SettingsError(names, "more than one stopping criterion", "one of them")
    return replace(settings.with_budget(**budget), **given)


def attribute_name(field_name: str) -> str:
    """Schema attribute of a field: filter_accuracy gives isolux:filterAccuracy."""
    first, *others = field_name.split("_")
    return "isolux:" + first + "".join(word.capitalize() for word in others)


def settings_from_stage(stage: Usd.Stage) -> SolverSettings:
    """Settings on the RenderSettings prim that the stage's renderSettingsPrimPath names.

    Defaults where the stage names none, or one without IsoluxSolverAPI. Raises SettingsError,
    naming the attribute, for a value out of its range, a view that is not there or one authored
    without IsoluxSolverAPI, and where the named prim is missing.
    """
    require_schema()
    path = stage.GetMetadata("renderSettingsPrimPath")
    if not path:
        return SolverSettings()
    render_settings = UsdRender.Settings.GetStageRenderSettings(stage)
    if not render_settings:
        raise SettingsError(
            path, "no RenderSettings prim", "the prim that renderSettingsPrimPath names"
        )
    prim = render_settings.GetPrim()
    attributes = {
        setting.name: prim.GetAttribute(attribute_name(setting.name))
        for setting in fields(SolverSettings)
        if setting.name != "threads"
    }
    if not prim.HasAPI(SOLVER_API):
        for attribute in attributes.values():
            if attribute and attribute.HasAuthoredValue():
                raise SettingsError(
                    str(attribute.GetPath()), f"no {SOLVER_API} on its prim", "it in apiSchemas"
                )
        return SolverSettings()
    values = {name: attribute.Get() for name, attribute in attributes.items()}
    try:
        # A blocked attribute has no value: the default holds.
        settings = SolverSettings(**{name: v for name, v in values.items() if v is not None})
        if settings.display_view != TUMBLIN_RUSHMEIER:
            from .ocio_view import view_steps  # not without need: it loads OpenColorIO

            view_steps(settings.display_view)  # raises where there is none
        return settings
    except SettingsError as error:
        attribute = attributes.get(error.subject)
        subject = str(attribute.GetPath()) if attribute else f"{path}: {error.subject}"
        raise SettingsError(subject, error.found, error.wanted) from None


def _check(setting: Field[Any], value: Any) -> None:
    """Raise SettingsError unless the value has the type of the default and lies in the range."""
    choices = setting.metadata.get("choices")
    if choices is not None:
        if value not in choices:
            raise SettingsError(setting.name, repr(value), " or ".join(choices))
        return
    if isinstance(setting.default, str):  # a name: whoever uses it knows which there are
        if not isinstance(value, str):
            raise SettingsError(setting.name, repr(value), "a name")
        return
    minimum, maximum = setting.metadata["minimum"], setting.metadata["maximum"]
    whole = isinstance(setting.default, int)
    right_type = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
    if not (right_type and minimum <= value < math.inf and value <= maximum):
        kind = "an int" if whole else "a float"
        interval = f"[{minimum}, inf)" if maximum == math.inf else f"[{minimum}, {maximum}]"
        raise SettingsError(setting.name, repr(value), f"{kind} in {interval}")
