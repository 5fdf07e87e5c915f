"""What USD's own validators and those of Isolux say of a stage, repeated messages told once.

Left out, since they say nothing about geometry or light as the solver reads them:

- usdPhysicsValidators, usdMediaValidators: of rigid bodies, of sound and authorship
- shaders that USD does not know (MissingShaderIdInRegistry): those of renderers that are not
  installed where the check runs; how many is told
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pxr import Tf, Usd, UsdUtils, UsdValidation

from .usd_messages import usd_message

KEYWORD = "IsoluxValidators"  # of ours, in plugin/plugInfo.json

_LEFT_OUT_PLUGINS = ("usdPhysicsValidators", "usdMediaValidators")
_LEFT_OUT_MESSAGES = {
    "usdShadeValidators:ShaderSdrCompliance.MissingShaderIdInRegistry": (
        "shaders of renderers that are not installed here"
    )
}

Severity = Literal["error", "warning", "note"]

_SEVERITIES: dict[UsdValidation.ValidationErrorType, Severity] = {
    UsdValidation.ValidationErrorType.Error: "error",
    UsdValidation.ValidationErrorType.Warn: "warning",
    UsdValidation.ValidationErrorType.Info: "note",
}
# In messages, where they keep equal ones apart: </World/Chair>, /World/Chair.points.
_PATHS = re.compile(r"<[^>]*>|(?<!\w)/[^\s'\",;]+")
_ORDER: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True, slots=True)
class Complaint:
    """One message of one validator, whichever prims it names.

    severity : as the validator has it
    name : validator and kind of message, such as "isolux.validators:PhotometricFile.MissingFile"
    paths : of the prims or properties that it is about, by name
    message : the first of them
    """

    severity: Severity
    name: str
    paths: tuple[str, ...]
    message: str


@dataclass(frozen=True, slots=True)
class StageCheck:
    """What all validators say.

    complaints : errors first
    left_out : reason, and how often
    """

    complaints: tuple[Complaint, ...]
    left_out: dict[str, int]


def check_stage(stage: Usd.Stage) -> StageCheck:
    """Run all validators that USD knows here over a stage, those of other plugins included."""
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # keeps USD from writing to stderr
    try:
        checked = _grouped(_validate(stage))
        if not hasattr(UsdValidation.ValidationRegistry, "RegisterPluginPrimValidator"):
            ours = UsdValidation.ValidationRegistry().GetValidatorMetadataForKeyword(KEYWORD)
            checked.left_out["validators of Isolux, which need USD 26.5"] = len(ours)
        return checked
    finally:
        diagnostics.TakeUncoalescedDiagnostics()


_Told = tuple[Severity, str, str, str]  # severity, name, path, message


def _validate(stage: Usd.Stage) -> list[_Told]:
    registry = UsdValidation.ValidationRegistry()
    names = [
        metadata.name
        for metadata in registry.GetAllValidatorMetadata()
        if not metadata.isSuite
        and not (metadata.plugin and metadata.plugin.name in _LEFT_OUT_PLUGINS)
    ]
    told: list[_Told] = []
    validators = registry.GetOrLoadValidatorsByName(names)
    try:
        return _run(stage, validators)
    except Exception:  # a validator that fails takes all with it: find out which
        for validator in validators:
            try:
                told += _run(stage, [validator])
            except Exception as error:
                name = validator.GetMetadata().name
                told.append(("error", name, "/", f"could not finish: {_reason(error)}"))
    return told


def _reason(error: Exception) -> str:
    return usd_message(error) if isinstance(error, Tf.ErrorException) else str(error)


def _run(stage: Usd.Stage, validators: Sequence[UsdValidation.Validator]) -> list[_Told]:
    return [
        (
            _SEVERITIES[error.GetType()],
            str(error.GetIdentifier()),
            _place(error),
            error.GetMessage(),
        )
        for error in UsdValidation.ValidationContext(validators).Validate(stage)
        if not error.HasNoError()
    ]


def _place(error: UsdValidation.ValidationError) -> str:
    """Path of the first prim or property that an error is about."""
    for site in error.GetSites():
        if site.IsProperty():
            return str(site.GetProperty().GetPath())
        if site.IsPrim():
            return str(site.GetPrim().GetPath())
        spec = site.GetPropertySpec() or site.GetPrimSpec()
        if spec:
            return str(spec.path)
    # Some sites of USD's own name a layer that holds no such prim; the message has the path.
    named = re.search(r"<(/[^>]*)>", error.GetMessage())
    return named[1] if named else "/"


def _grouped(told: Sequence[_Told]) -> StageCheck:
    groups: dict[tuple[Severity, str, str], list[tuple[str, str]]] = {}
    left_out: dict[str, int] = {}
    for severity, name, path, message in told:
        reason = _LEFT_OUT_MESSAGES.get(name)
        if reason:
            left_out[reason] = left_out.get(reason, 0) + 1
        else:
            message = " ".join(message.split()).removeprefix(f"<{path}>: ")
            words = _PATHS.sub("", message)
            groups.setdefault((severity, name, words), []).append((path, message))
    complaints = []
    for (severity, name, _), sites in groups.items():
        sites.sort()  # validators run side by side, in no order
        paths = tuple(dict.fromkeys(path for path, _ in sites))
        complaints.append(Complaint(severity, name, paths, sites[0][1]))
    complaints.sort(key=lambda row: (_ORDER.index(row.severity), row.name, row.paths))
    return StageCheck(tuple(complaints), left_out)
