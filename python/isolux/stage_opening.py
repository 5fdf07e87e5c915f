"""How a stage is opened: variants chosen, payloads left out, a part of it alone.

Choices of variants lie in the session layer, and in the root layer of the results: the source is
not edited.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from .errors import SceneError, SettingsError
from .usd_messages import usd_message


@dataclass(frozen=True, slots=True)
class VariantChoice:
    """One variant of one variant set.

    path : prim path
    """

    path: str
    variant_set: str
    variant: str

    @classmethod
    def parse(cls, text: str) -> VariantChoice:
        """From "/Prim:set=variant"; raises SettingsError where it is none."""
        path, colon, choice = text.partition(":")
        variant_set, equals, variant = choice.partition("=")
        if not (colon and equals and variant_set and _is_prim_path(path)):
            raise SettingsError("--variant", repr(text), "/Prim:set=variant")
        return cls(path, variant_set, variant)

    def __str__(self) -> str:
        return f"{self.path}:{self.variant_set}={self.variant}"


@dataclass(frozen=True, slots=True)
class StageOpening:
    """What of a stage is opened.

    variants : later ones may lie within earlier ones
    payloads : whether payloads are loaded
    mask : prim paths of the part to open, with all that it points to (materials); empty: all
    """

    variants: tuple[VariantChoice, ...] = ()
    payloads: bool = True
    mask: tuple[str, ...] = ()

    @classmethod
    def parse(cls, variants: Iterable[str], load: str | None, mask: Iterable[str]) -> StageOpening:
        """From the text of a command line; raises SettingsError."""
        if load not in (None, "all", "none"):
            raise SettingsError("--load", repr(load), "all or none")
        for path in mask:
            if not _is_prim_path(path):
                raise SettingsError("--mask", repr(path), "the absolute path of a prim")
        choices = tuple(VariantChoice.parse(text) for text in variants)
        return cls(choices, load != "none", tuple(mask))

    def record(self) -> dict[str, Any]:
        """For the provenance of results; empty where all is opened as it stands."""
        record: dict[str, Any] = {}
        if self.variants:
            record["variants"] = [str(choice) for choice in self.variants]
        if not self.payloads:
            record["load"] = "none"
        if self.mask:
            record["mask"] = list(self.mask)
        return record


AS_IT_STANDS = StageOpening()


def open_stage(path: str | Path, opening: StageOpening = AS_IT_STANDS) -> Usd.Stage:
    """Open a stage without messages of USD's own on stderr.

    raises : SceneError where it is none, SettingsError where it hasn't what `opening` names
    """
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        return open_noisily(str(path), opening)
    finally:
        diagnostics.TakeUncoalescedDiagnostics()


def open_noisily(name: str, opening: StageOpening = AS_IT_STANDS) -> Usd.Stage:
    """The same; what USD warns of is left to the caller's diagnostic delegate."""
    if not Ar.GetResolver().Resolve(name):
        raise SceneError(name, "no such file", "a USD stage")
    try:
        stage = _open(name, opening)
    except Tf.ErrorException as error:
        reason = f"no readable USD ({usd_message(error)})"
        raise SceneError(name, reason, "a USD stage") from None
    for choice in opening.variants:
        _require_variant(stage, choice)
    for path in opening.mask:
        if not stage.GetPrimAtPath(path):
            raise SettingsError("--mask", f"no prim {path} in {name}", "a prim of the stage")
    return stage


def _open(name: str, opening: StageOpening) -> Usd.Stage:
    load = Usd.Stage.LoadAll if opening.payloads else Usd.Stage.LoadNone
    if not (opening.variants or opening.mask):
        return Usd.Stage.Open(name, load)
    root = Sdf.Layer.FindOrOpen(name)
    session = Sdf.Layer.CreateAnonymous("session")
    for choice in opening.variants:
        prim = Sdf.CreatePrimInLayer(session, choice.path)
        prim.variantSelections[choice.variant_set] = choice.variant
    if not opening.mask:
        return Usd.Stage.Open(root, session, load)
    paths = list(opening.mask)
    settings = root.pseudoRoot.GetInfo("renderSettingsPrimPath")
    if settings:
        paths.append(settings)
    stage = Usd.Stage.OpenMasked(root, session, Usd.StagePopulationMask(paths), load)
    stage.ExpandPopulationMask()
    return stage


def _is_prim_path(text: str) -> bool:
    if not Sdf.Path.IsValidPathString(text)[0]:
        return False
    path = Sdf.Path(text)
    return path.IsAbsolutePath() and path.IsPrimPath()


def _require_variant(stage: Usd.Stage, choice: VariantChoice) -> None:
    prim = stage.GetPrimAtPath(choice.path)
    if not (prim and prim.IsDefined()):  # the choice itself has made an over
        raise SettingsError(f"--variant {choice}", f"no prim {choice.path}", "a prim of the stage")
    sets = prim.GetVariantSets()
    if choice.variant_set not in sets.GetNames():
        names = ", ".join(sets.GetNames()) or "a prim with variant sets"
        raise SettingsError(
            f"--variant {choice}", f"no variant set {choice.variant_set}", f"one of {names}"
        )
    variants = sets.GetVariantSet(choice.variant_set).GetVariantNames()
    if choice.variant not in variants:
        raise SettingsError(
            f"--variant {choice}", f"no variant {choice.variant}", f"one of {', '.join(variants)}"
        )


def variant_selections(layer: Sdf.Layer) -> dict[str, dict[str, str]] | None:
    """Variants that a layer chooses, by prim path; None where it says anything else as well."""
    if layer.subLayerPaths or set(layer.pseudoRoot.ListInfoKeys()) - {"primChildren"}:
        return None
    selections: dict[str, dict[str, str]] = {}
    waiting = list(layer.rootPrims)
    while waiting:
        prim = waiting.pop()
        says = set(prim.ListInfoKeys()) - {"specifier", "variantSelection"}
        if says or prim.specifier != Sdf.SpecifierOver or prim.properties or prim.variantSets:
            return None
        if prim.variantSelections:
            selections[str(prim.path)] = dict(prim.variantSelections)
        waiting += list(prim.nameChildren)
    return selections
