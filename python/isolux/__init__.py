"""Isolux bakes physically based global illumination into USD stages.

Importing the package registers its schemas with USD: import it before the first prim is used.
"""

from . import _core
from .errors import IsoluxError, PhotometryError, SceneError, SettingsError
from .plugin_registration import register_plugin
from .progress import SolveProgress
from .scene_description import SceneDescription
from .settings import SolverSettings, settings_from_stage
from .solution import ProgressiveStage, Solution
from .solver import ProgressiveSolver, solve
from .stage_reader import read_stage

register_plugin()

# Asking the installed package for it would take 0.03 s of every start.
__version__ = _core.version or "unknown"

__all__ = [
    "IsoluxError",
    "PhotometryError",
    "ProgressiveSolver",
    "ProgressiveStage",
    "SceneDescription",
    "SceneError",
    "SettingsError",
    "Solution",
    "SolveProgress",
    "SolverSettings",
    "__version__",
    "read_stage",
    "settings_from_stage",
    "solve",
]
