"""Which prims of a stage are rendered: by purpose, visibility of a purpose and level of detail.

Purposes are those that the stage's RenderSettings include, `default` and `render` where it says
nothing. What a viewer shows in place of a model (draw modes) has no part: light falls on geometry.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pxr import Sdf, Usd, UsdGeom, UsdRender, Vt

try:
    from pxr import UsdLod
except ImportError:  # usd-core before 26.08
    UsdLod = None

from .errors import SceneError

if TYPE_CHECKING:
    from .reading_context import ReadingContext

_RENDERED = (str(UsdGeom.Tokens.default_), str(UsdGeom.Tokens.render))
_DRAW_MODES = (UsdGeom.Tokens.bounds, UsdGeom.Tokens.cards, UsdGeom.Tokens.origin)


class PrimSelection:
    """The choice for one stage; grows with the levels of detail met."""

    def __init__(self, stage: Usd.Stage, context: ReadingContext) -> None:
        self._context = context
        render_settings = UsdRender.Settings.GetStageRenderSettings(stage)
        included = render_settings.GetIncludedPurposesAttr().Get() if render_settings else None
        if included is not None and not isinstance(included, Vt.TokenArray):
            path = str(render_settings.GetPath())
            raise SceneError(path, f"includedPurposes = {included!r:.60}", "tokens")
        self._purposes = {str(purpose) for purpose in included or _RENDERED}
        self._other_levels: dict[Sdf.Path, str] = {}
        self._with_proxy: set[Sdf.Path] = set()

    def is_rendered(self, prim: Usd.Prim) -> bool:
        """Whether a Gprim's purpose is rendered and visible; a finding says why not."""
        imageable = UsdGeom.Imageable(prim)
        purpose = imageable.ComputePurpose()
        if purpose not in self._purposes:
            reason = f"{purpose} geometry is not rendered"
            self._context.note(prim, f"purpose {purpose}", "skipped", reason)
            return False
        if purpose != UsdGeom.Tokens.default_:
            visibility = imageable.ComputeEffectiveVisibility(purpose, self._context.time)
            if visibility == UsdGeom.Tokens.invisible:
                self._context.note(prim, f"{purpose}Visibility", "skipped", "invisible")
                return False
            self._note_proxy(imageable)
        return True

    def _note_proxy(self, imageable: UsdGeom.Imageable) -> None:
        """Once a prim that others stand for in viewers: they show no light."""
        found = imageable.ComputeProxyPrim()
        if not found:
            return
        proxy, rendered = found
        if rendered.GetPath() not in self._with_proxy:
            self._with_proxy.add(rendered.GetPath())
            reason = f"{proxy.GetPath()} stands for it in viewers and isn't baked"
            self._context.note(rendered, "proxyPrim", "noted", reason)

    def leaves_out(self, prim: Usd.Prim) -> bool:
        """Whether a prim and what is below it is another level of detail than the one that is read.

        Looks at what else is said at a model or a group of its display.
        """
        if prim.GetPath() in self._other_levels:
            reason = self._other_levels[prim.GetPath()]
            self._context.note(prim, "LOD", "skipped", reason)
            return True
        if not prim.GetAppliedSchemas():
            return False
        if prim.HasAPI(UsdGeom.ModelAPI):
            self._note_draw_mode(prim)
        if UsdLod and prim.HasAPI(UsdLod.RootAPI):
            self._choose_level(prim)
        return False

    def _note_draw_mode(self, prim: Usd.Prim) -> None:
        mode = UsdGeom.ModelAPI(prim).GetModelDrawModeAttr().Get()
        if mode in _DRAW_MODES:
            reason = f"{mode} are for viewers: its geometry is read in full"
            self._context.note(prim, "model:drawMode", "noted", reason)

    def _choose_level(self, prim: Usd.Prim) -> None:
        """Light doesn't depend on where it is seen from: the level that needs no viewpoint."""
        levels = [level.GetPath() for level in prim.GetChildren()]
        if not levels:
            return
        default = self._context.value(prim, "lod:default:index", 0)
        chosen = levels[max(0, min(default, len(levels) - 1))]
        reason = f"another level of detail than {chosen.name}"
        self._other_levels |= {level: reason for level in levels if level != chosen}
