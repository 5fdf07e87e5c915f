"""What is written into layers: attributes, dictionaries, files that are replaced whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Vt

from .atomic_file import replace_atomically
from .errors import SceneError
from .usd_messages import usd_message


def author(
    prim: Sdf.PrimSpec,
    name: str,
    type_name: Sdf.ValueTypeName,
    value: object,
    variability: Sdf.Variability = Sdf.VariabilityVarying,
) -> Sdf.AttributeSpec:
    """Give an attribute a default value; it is made where there is none."""
    attribute = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, type_name, variability)
    attribute.default = value
    return attribute


def layer_value(value: Any) -> Any:
    """The same in the types that a layer's dictionary stores."""
    if isinstance(value, Mapping):
        return {key: layer_value(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        if all(isinstance(item, int) for item in value):
            return Vt.Int64Array(list(value))
        if all(isinstance(item, int | float) for item in value):
            return Vt.DoubleArray([float(item) for item in value])
        return Vt.StringArray([str(item) for item in value])
    return value if isinstance(value, bool | int | float) else str(value)


def export_layer(layer: Sdf.Layer, path: Path) -> None:
    """Replace a file by a layer; raises SceneError where it can't be written."""
    with replace_atomically(path) as temporary:
        try:
            layer.Export(str(temporary))
        except Tf.ErrorException as error:
            raise SceneError(str(path), usd_message(error), "a file to write") from error
