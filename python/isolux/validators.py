"""UsdValidation's validators of what Isolux reads, for every host that validates stages.

plugin/plugInfo.json lists them by name, and USD's registry imports this module when it wants to run
them. It reads the list once, when it is first used; `import isolux` leaves it alone, so that
packages which bring validators after Isolux are not shut out. There the plugin has a root of its
own, as USD knows one Python plugin a root. Before USD 26.5 it ran none that are written in Python.

What the solver can't use is an error, what may have been meant otherwise is a warning. Each looks
at the earliest sample of an attribute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdValidation, Vt

from .errors import IsoluxError, PhotometryError
from .photometry import LARGEST_FILE, inline_diagram, luminous_flux, read_photometric_bytes
from .plugin_registration import (
    LUMINAIRE_API,
    PLUGIN_PATH_VARIABLE,
    SOLVER_API,
    plugin_folder,
)
from .reading_context import read_asset
from .settings import settings_from_stage

# Largest extent of a place that is lit, m: of a showcase, of a stadium. A room in the wrong unit,
# centimetres for metres or the other way, lies beyond.
SMALLEST_SCENE = 0.2
LARGEST_SCENE = 300.0
# lm: a pilot lamp; floodlights of a stadium together.
LEAST_FLUX = 0.1
MOST_FLUX = 1e8
# cd/m^2, a little above the sun's disk (1.6e9) [Thompson and Thompson 2008].
MOST_LUMINANCE = 2e9

_PROFILE = "inputs:shaping:ies:file"
_FILE = "inputs:isolux:file"
_DIAGRAM = ("gammaAngles", "cAngles", "candela")

_Finding = tuple[str, str, str, str]  # name, "Error" or "Warn", property ("": the prim), message
_PrimCheck = Callable[[Usd.Prim], Iterator[_Finding]]
_StageCheck = Callable[[Usd.Stage], Iterator[_Finding]]


def _prim_task(check: _PrimCheck) -> Callable[..., list[UsdValidation.ValidationError]]:
    def task(prim: Usd.Prim, _: object) -> list[UsdValidation.ValidationError]:
        return [_error(prim.GetStage(), prim.GetPath(), *finding) for finding in check(prim)]

    return task


def _stage_task(check: _StageCheck) -> Callable[..., list[UsdValidation.ValidationError]]:
    def task(stage: Usd.Stage, _: object) -> list[UsdValidation.ValidationError]:
        root = Sdf.Path.absoluteRootPath
        return [_error(stage, root, *finding) for finding in check(stage)]

    return task


def _error(
    stage: Usd.Stage, path: Sdf.Path, name: str, severity: str, attribute: str, message: str
) -> UsdValidation.ValidationError:
    place = path.AppendProperty(attribute) if attribute else path
    site = UsdValidation.ValidationErrorSite(stage, place)
    kind = getattr(UsdValidation.ValidationErrorType, severity)
    return UsdValidation.ValidationError(name, kind, [site], f"<{place}>: {message}")


def _value(prim: Usd.Prim, name: str) -> Any:
    attribute = prim.GetAttribute(name)
    return attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None


def _number(prim: Usd.Prim, name: str, fallback: float) -> float:
    value = _value(prim, name)
    return float(value) if isinstance(value, int | float) else fallback


def _numbers(prim: Usd.Prim, name: str) -> NDArray[np.float64]:
    """None where the attribute has another type, of which USD's own validators tell."""
    value = _value(prim, name)
    is_array = isinstance(value, Vt.FloatArray | Vt.DoubleArray)
    return np.array(value, np.float64) if is_array else np.zeros(0)


def _has_api(prim: Usd.Prim, name: str) -> bool:
    return name in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def check_attribute_range(prim: Usd.Prim) -> Iterator[_Finding]:
    """Limits and allowed values are those of the schema."""
    api = LUMINAIRE_API if prim.HasAPI(UsdLux.LightAPI) else SOLVER_API
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(api)
    if definition is None:
        return
    for name in definition.GetPropertyNames():
        attribute = prim.GetAttribute(name)
        if not attribute or not attribute.HasAuthoredValue():
            continue
        if not _has_api(prim, api):
            yield "MissingAPI", "Error", name, f"it is not read without {api} on its prim"
            continue
        value = _value(prim, name)
        allowed = attribute.GetMetadata("allowedTokens")
        if allowed and value not in allowed:
            yield "OutOfRange", "Error", name, f'"{value}" is none of {", ".join(allowed)}'
        if isinstance(value, int | float):
            limits = attribute.GetHardLimits()
            low, high = limits.GetMinimum(), limits.GetMaximum()
            too_low = low is not None and value < low
            too_high = high is not None and value > high
            if too_low or too_high or not math.isfinite(value):
                interval = f"[{low}, {'inf)' if high is None else f'{high}]'}"
                yield "OutOfRange", "Error", name, f"{value:g} lies outside {interval}"


def check_luminaire_prim(prim: Usd.Prim) -> Iterator[_Finding]:
    if not prim.HasAPI(UsdLux.LightAPI):
        kind = prim.GetTypeName() or "prim without a type"
        message = f"{LUMINAIRE_API} on a {kind}, which is no light: it is not read"
        yield "NotALight", "Error", "", message


def check_solver_prim(prim: Usd.Prim) -> Iterator[_Finding]:
    if not prim.IsA(UsdRender.Settings):
        kind = prim.GetTypeName() or "prim without a type"
        message = f"{SOLVER_API} on a {kind}, which is no RenderSettings: it is not read"
        yield "NotRenderSettings", "Error", "", message
    elif prim.GetStage().GetMetadata("renderSettingsPrimPath") != str(prim.GetPath()):
        yield "NotInUse", "Warn", "", "renderSettingsPrimPath does not name it: it is not read"


def check_render_settings(stage: Usd.Stage) -> Iterator[_Finding]:
    path = stage.GetMetadata("renderSettingsPrimPath")
    if path and not UsdRender.Settings.GetStageRenderSettings(stage):
        message = f'renderSettingsPrimPath = "{path}" names no RenderSettings prim'
        yield "NoRenderSettings", "Error", "", message
        return
    try:
        settings_from_stage(stage)
    except IsoluxError as error:
        yield "UnusableSettings", "Error", "", f"the solver refuses {error}"


def check_photometric_file(prim: Usd.Prim) -> Iterator[_Finding]:
    yield from _photometry(prim)[0]


def _photometry(prim: Usd.Prim) -> tuple[list[_Finding], float]:
    """What is wrong with a light's diagram, and its luminous flux, lm; 0 where it has none."""
    is_absolute = _has_api(prim, LUMINAIRE_API)
    gamma, c_angles, candela = (_numbers(prim, f"inputs:isolux:{name}") for name in _DIAGRAM)
    if is_absolute and (len(gamma) or len(c_angles) or len(candela)):
        try:
            return [], luminous_flux(inline_diagram(gamma, c_angles, candela, ""))
        except PhotometryError as error:
            message = f"found {error.found}; wanted {error.wanted}"
            return [("UnusableDiagram", "Error", "inputs:isolux:candela", message)], 0.0
    for name in (_FILE, _PROFILE) if is_absolute else (_PROFILE,):
        asset = _value(prim, name)
        if isinstance(asset, Sdf.AssetPath) and asset.path:
            contents = read_asset(asset, LARGEST_FILE + 1)
            if contents is None:
                return [("MissingFile", "Error", name, f"no file {asset.path}")], 0.0
            findings, flux = _file_photometry(contents, asset.path)
            return [(kind, severity, name, told) for kind, severity, told in findings], flux
    if is_absolute and _number(prim, "inputs:isolux:luminousFlux", 0.0) == 0:
        message = f"{LUMINAIRE_API} without a file, an inline diagram or a luminous flux"
        return [("NoPhotometry", "Error", "", message)], 0.0
    return [], 0.0


@lru_cache(maxsize=16)  # thousands of lights share a handful of files
def _file_photometry(contents: bytes, path: str) -> tuple[list[tuple[str, str, str]], float]:
    """Name, severity and message of what is wrong; luminous flux, lm."""
    try:
        photometric = read_photometric_bytes(contents, path)
    except IsoluxError as error:
        return [("UnreadableFile", "Error", str(error))], 0.0
    doubts = [("DoubtfulFile", "Warn", f"{path}: {told}") for told in photometric.warnings]
    return doubts, luminous_flux(photometric.diagram)


def check_luminaire_flux(prim: Usd.Prim) -> Iterator[_Finding]:
    if _has_api(prim, LUMINAIRE_API):
        yield from _check_absolute_flux(prim)
        return
    intensity = _number(prim, "inputs:intensity", 1.0)
    exposure = _number(prim, "inputs:exposure", 0.0)
    luminance = intensity * 2.0 ** min(exposure, 1000.0)
    if _value(prim, "inputs:normalize"):
        # Over the area in stage units: pi L A for a flat source, as a measure.
        flux = math.pi * luminance * UsdGeom.GetStageMetersPerUnit(prim.GetStage()) ** 2
        if flux > MOST_FLUX:
            message = f"normalised, it gives {flux:.3g} lm, more than a stadium's floodlights"
            yield "ImplausibleFlux", "Warn", "inputs:intensity", message
    elif luminance > MOST_LUMINANCE:
        message = f"its luminance is {luminance:.3g} cd/m^2, above the sun's"
        yield "ImplausibleLuminance", "Warn", "inputs:intensity", message


def _check_absolute_flux(prim: Usd.Prim) -> Iterator[_Finding]:
    declared = _number(prim, "inputs:isolux:luminousFlux", 0.0)
    flux = declared or _photometry(prim)[1]
    flux *= _number(prim, "inputs:isolux:dimming", 1.0)
    if (0 < flux < LEAST_FLUX or flux > MOST_FLUX) and math.isfinite(flux):
        attribute = "inputs:isolux:luminousFlux" if declared else ""
        message = f"its luminous flux is {flux:.3g} lm, that of no luminaire"
        yield "ImplausibleFlux", "Warn", attribute, message


def check_scene_scale(stage: Usd.Stage) -> Iterator[_Finding]:
    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), purposes, useExtentsHint=True)
    box = bounds.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    metres_per_unit = UsdGeom.GetStageMetersPerUnit(stage)
    if box.IsEmpty():
        return
    size = [length * metres_per_unit for length in box.GetSize()]
    if not math.isfinite(sum(size)):
        return  # the reader says which prim
    if 0 < max(size) < SMALLEST_SCENE or max(size) > LARGEST_SCENE:
        shown = " x ".join(f"{length:.3g}" for length in size)
        message = f"the scene measures {shown} m: is metersPerUnit = {metres_per_unit:g} meant?"
        yield "ImplausibleSize", "Warn", "", message


_PRIM_CHECKS: dict[str, _PrimCheck] = {
    "AttributeRange": check_attribute_range,
    "LuminaireFlux": check_luminaire_flux,
    "LuminairePrim": check_luminaire_prim,
    "PhotometricFile": check_photometric_file,
    "SolverPrim": check_solver_prim,
}
_STAGE_CHECKS: dict[str, _StageCheck] = {
    "RenderSettings": check_render_settings,
    "SceneScale": check_scene_scale,
}


def _register() -> None:
    """Raise IsoluxError where USD read the list of validators before Isolux was on it."""
    registry = UsdValidation.ValidationRegistry()
    if not hasattr(registry, "RegisterPluginPrimValidator"):
        return  # USD before 26.5
    if registry.GetValidatorMetadata(f"{__name__}:{next(iter(_PRIM_CHECKS))}") is None:
        raise IsoluxError(
            "USD validation registry",
            "no validators of Isolux, as it was used before isolux was imported",
            f"`import isolux` before, or {plugin_folder()} in {PLUGIN_PATH_VARIABLE}",
        )
    for name, check_prim in _PRIM_CHECKS.items():
        registry.RegisterPluginPrimValidator(f"{__name__}:{name}", _prim_task(check_prim))
    for name, check_stage in _STAGE_CHECKS.items():
        registry.RegisterPluginStageValidator(f"{__name__}:{name}", _stage_task(check_stage))


_register()
