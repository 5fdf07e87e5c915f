"""Makes the Isolux schemas and the compute plugin known to USD.

USD reads the schemas of all known plugins once, when the first typed prim is looked at. So the
package registers its plugin at import and names it in PXR_PLUGINPATH_NAME for child processes. A
host that sets that variable itself needs no import:
`Plug.Registry().GetPluginWithName("isolux").Load()` imports the package.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from pxr import Plug, Usd

from .errors import IsoluxError

LUMINAIRE_API = "IsoluxLuminaireAPI"
SOLVER_API = "IsoluxSolverAPI"
PLUGIN_PATH_VARIABLE = "PXR_PLUGINPATH_NAME"


def plugin_folder() -> Path:
    """Folder of the plugInfo.json that describes the plugin and includes the schemas."""
    # An editable install leaves the Python files in the checkout and puts the resources beside
    # the compiled module; find_spec locates that without loading it.
    compiled = importlib.util.find_spec("isolux._core")
    if compiled is not None and compiled.origin is not None:
        return Path(compiled.origin).resolve().parent / "plugin"
    return Path(__file__).resolve().parents[2] / "plugin"  # a checkout that is not built yet


def register_plugin() -> None:
    """Register the plugin here and, by the environment, in child processes."""
    folder = str(plugin_folder())
    Plug.Registry().RegisterPlugins(folder)
    known = [path for path in os.environ.get(PLUGIN_PATH_VARIABLE, "").split(os.pathsep) if path]
    if folder not in known:
        os.environ[PLUGIN_PATH_VARIABLE] = os.pathsep.join([*known, folder])


def require_schema() -> None:
    """Raise IsoluxError where USD read its schemas before Isolux registered its own.

    Asked for when a stage is read rather than at import, because asking makes USD read its schemas
    and would shut out any package that registers some after Isolux.
    """
    if Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(LUMINAIRE_API) is None:
        raise IsoluxError(
            "USD schema registry",
            f"no {LUMINAIRE_API}, as a prim was looked at before isolux was imported",
            f"`import isolux` before any prim is used, or {plugin_folder()} "
            f"in {PLUGIN_PATH_VARIABLE}",
        )
