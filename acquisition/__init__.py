"""Photometric stereo with planned lights: the work itself, without the web and without the simulator.

pilot       positions of the first lights
waypoints   collision-free joint paths that reach the lights
capture     move, wait for rest, expose, check: one image per light
normals     images → normal map, albedo, depth and the uncertainty of each pixel
plan        optimal further lights for the least uncertainty; none: finished
`runner` repeats these in a session; `session_state` and `session` define its states and next step; `store` keeps the
journal.

The names of `__all__` are the public interface for scripts. They are loaded when first used (PEP 562), so that neither
the arm's driver process nor the command line loads a numerical kernel that it does not need.
"""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acquisition.formats.export import read as read_result
    from acquisition.formats.export import write as write_result
    from acquisition.formats.folders import read as read_folder
    from acquisition.formats.folders.session_folder import read as read_session
    from acquisition.models.calibration import Calibration
    from acquisition.models.errors import ErrorCode, RigError
    from acquisition.models.light_plan import Light, LightPlan
    from acquisition.models.recipe import Recipe
    from acquisition.models.result import NormalMap, ResultSummary, SolveSettings
    from acquisition.normals.distant import solve as solve_distant
    from acquisition.normals.images.image_set import ImageSet
    from acquisition.normals.near_light import solve as solve_near
    from acquisition.session_state import State

__all__ = [
    "Calibration", "ErrorCode", "ImageSet", "Light", "LightPlan", "NormalMap", "Recipe", "ResultSummary", "RigError",
    "SolveSettings", "State", "read_folder", "read_result", "read_session", "solve_distant", "solve_near",
    "write_result",
]  # fmt: skip

# Threads that wait for the next parallel loop have to sleep. OpenMP lets them spin, which takes the cores from the
# driver's kicks and all other processes: on two busy cores a plan took three times as long. The first loop reads this.
# OpenMP is preferred because TBB, which numba takes wherever the system has it, yields in a loop instead of sleeping.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp tbb workqueue")

_SOURCES: dict[str, tuple[str, str]] = {
    "Calibration": ("models.calibration", "Calibration"),
    "ErrorCode": ("models.errors", "ErrorCode"),
    "ImageSet": ("normals.images.image_set", "ImageSet"),
    "Light": ("models.light_plan", "Light"),
    "LightPlan": ("models.light_plan", "LightPlan"),
    "NormalMap": ("models.result", "NormalMap"),
    "Recipe": ("models.recipe", "Recipe"),
    "ResultSummary": ("models.result", "ResultSummary"),
    "RigError": ("models.errors", "RigError"),
    "SolveSettings": ("models.result", "SolveSettings"),
    "State": ("session_state", "State"),
    "read_folder": ("formats.folders", "read"),
    "read_result": ("formats.export", "read"),
    "read_session": ("formats.folders.session_folder", "read"),
    "solve_distant": ("normals.distant", "solve"),
    "solve_near": ("normals.near_light", "solve"),
    "write_result": ("formats.export", "write"),
}
"""Public name → module below `acquisition` and the name there; the same as the imports for type checkers above."""

if not TYPE_CHECKING:  # a type checker would accept any name of a module with __getattr__

    def __getattr__(name: str) -> Any:
        if name not in _SOURCES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, attribute = _SOURCES[name]
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
