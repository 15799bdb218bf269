"""The folder of a completed session of a small scene of known truth, written without a service."""

import json
from pathlib import Path

import numpy as np

from acquisition.formats.frames import FolderFrames
from acquisition.models import cell_config
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.models.shot import Observations, Shot
from acquisition.runner import jobs
from acquisition.store.folder import write_frame, write_manifest, write_value
from tests.acquisition import scenes

CELLS = Path(__file__).parents[2] / "hardware_sim" / "cells"
SIZE = 64
LIGHTS = [*scenes.ring(3, 20.0), *scenes.ring(3, 50.0, 0.5)]


def cell() -> CellConfig:
    return cell_config.load(CELLS / "cell.sim.toml")


def calibration():
    """A camera of few pixels above the place where that cell's object stands."""
    x, y, z = cell().object.keep_out.base_from_object.position_m
    above = ((1.0, 0.0, 0.0, x), (0.0, -1.0, 0.0, y), (0.0, 0.0, -1.0, z + scenes.TABLE_DEPTH), (0.0, 0.0, 0.0, 1.0))
    return scenes.calibration(SIZE, valid_days=36500.0, base_from_camera=above)


def scene() -> scenes.Scene:
    return scenes.scene(scenes.bumps, calibration())


def make(folder: Path) -> Path:
    """Two passes of three lights each; each has a result, solved from all images so far."""
    known, true = calibration(), scene()
    captured = scenes.capture(true, LIGHTS, exposure_s=0.05)
    (dark,) = captured.darks.values()
    write_value(folder / "recipe.json", Recipe(pilot_lights=3, planned_lights=3))
    write_value(folder / "cell.json", cell())
    write_value(folder / "calibration.json", known)
    shots: list[Shot] = []
    for number, part in enumerate((captured.shots[:3], captured.shots[3:])):
        plan = LightPlan(lights=[shot.light for shot in part if shot.light], method="user", reasons=[""] * len(part))
        write_value(folder / f"passes/{number}/plan.json", plan)
        for index, shot in enumerate([*part, dark]):
            frame = write_frame(folder, f"passes/{number}/shots/{index}.tiff", captured.frames.stored[shot.frame.path])  # type: ignore[attr-defined]
            key = shot.key.model_copy(update={"pass_number": number, "number": index})
            shots.append(shot.model_copy(update={"key": key, "frame": frame}))
        lit = [shot for shot in shots if shot.kind == "light"]
        solve_input = Observations(lit, {dark.exposure_s: shots[-1]}, FolderFrames(folder))
        jobs.solve_normals(solve_input, cell(), known, SolveSettings(), plan, None, folder / "results" / str(number))
    write_manifest(folder, {"session_id": "small", "shots": [json.loads(shot.model_dump_json()) for shot in shots]})
    return folder


def error_deg(normals: np.ndarray) -> float:
    """Mean error at the scene's graded pixels."""
    return float(np.mean(scene().error_deg(normals)))
