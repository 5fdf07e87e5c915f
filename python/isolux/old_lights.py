"""Lights of the time before USD 21.02, whose inputs had no `inputs:` before their names."""

from __future__ import annotations

from pxr import Usd

from .reading_context import ReadingContext

PREFIX = "inputs:"


def note_old_inputs(prim: Usd.Prim, context: ReadingContext) -> None:
    """Say which inputs of a light are authored under their old names, and thus mean nothing."""
    names = {attribute.GetName() for attribute in prim.GetAuthoredAttributes()}
    inputs = prim.GetPrimDefinition().GetPropertyNames()
    # A mesh that shines has attributes of its own, and came after the old names.
    old = sorted(
        name.removeprefix(PREFIX)
        for name in inputs
        if name.startswith(PREFIX)
        and name.removeprefix(PREFIX) in names
        and name.removeprefix(PREFIX) not in inputs
        and name not in names
    )
    if old:
        reason = f"{', '.join(old)}: named as before USD 21.02, and not read without {PREFIX}"
        context.note(prim, "old inputs", "skipped", reason)
