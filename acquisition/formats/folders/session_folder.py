"""Session folders, read as plain files. The journal is not needed, so a folder can be moved to another machine.

`manifest.json` lists the shots as they were measured. Recipe, cell and calibration are beside it.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquisition import image_values
from acquisition.formats.folders.refusal import refusal, text, value
from acquisition.formats.frames import FolderFrames
from acquisition.formats.session_files import CALIBRATION, CELL, MANIFEST, RECIPE
from acquisition.models.base import BoolArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.shot import FrameRef, FrameSource, Observations, Shot
from acquisition.normals.images.image_set import Camera, ImageSet, NearLights, StoredValues


@dataclass(frozen=True)
class SessionCapture:
    """A session's shots with their recipe, cell, calibration and plans, and the numbers of its results."""

    folder: Path
    recipe: Recipe
    cell: CellConfig
    calibration: Calibration
    shots: tuple[Shot, ...]
    plans: tuple[LightPlan, ...]
    results: tuple[int, ...]

    def observations(self, last_pass: int) -> Observations:
        """The images of the passes up to `last_pass`, with the order and the lamp-off frames of the solve after it."""
        used = (shot for shot in self.shots if shot.key.pass_number <= last_pass)
        return Observations.of(used, FolderFrames(self.folder))


def read(folder: Path) -> SessionCapture:
    """Reads the folder of a session. Raises RigError folder.invalid naming the file that is missing or damaged."""
    shots = _shots(folder / MANIFEST)
    passes = 1 + max((shot.key.pass_number for shot in shots), default=0)
    results = [int(path.parent.name) for path in folder.glob("results/*/normals.tiff") if path.parent.name.isdigit()]
    return SessionCapture(
        folder=folder,
        recipe=value(folder / RECIPE, Recipe),
        cell=value(folder / CELL, CellConfig),
        calibration=value(folder / CALIBRATION, Calibration),
        shots=shots,
        plans=tuple(value(folder / f"passes/{number}/plan.json", LightPlan) for number in range(passes)),
        results=tuple(sorted(results)),
    )


@dataclass(frozen=True)
class SessionRows:
    """The lit frames of a session less their lamp-off frames, as a RowReader; picklable."""

    frames: FrameSource
    lit: tuple[FrameRef, ...]
    dark: tuple[FrameRef, ...]

    def __call__(self, image: int, start: int, stop: int) -> StoredValues:
        """Rows [start, stop) of one image, uint16, never below zero."""
        lit, dark = (self.frames.rows(frames[image], start, stop) for frames in (self.lit, self.dark))
        return np.maximum(lit, dark) - dark


def images(observations: Observations, calibration: Calibration, mask: BoolArray) -> ImageSet:
    """Makes an image set of a session: near lights whose intensities include exposure; `mask` (H, W) is the object.

    Raises RigError folder.invalid when a lamp-off frame is missing.
    """
    sensor = calibration.sensor
    lit = [(shot, shot.light) for shot in observations.shots if shot.light is not None]
    for shot, _ in lit:
        if shot.exposure_s not in observations.darks:
            raise refusal(Path(shot.frame.path), "has no lamp-off frame of its exposure time: take one")
    return ImageSet(
        names=tuple(shot.frame.path for shot, _ in lit),
        height=calibration.height,
        width=calibration.width,
        channels=1,
        rows=SessionRows(
            observations.frames,
            tuple(shot.frame for shot, _ in lit),
            tuple(observations.darks[shot.exposure_s].frame for shot, _ in lit),
        ),
        full_scale=sensor.full_scale_dn,
        saturated_from=(image_values.clipping_dn(sensor) - sensor.black_level_dn) / sensor.full_scale_dn,
        lights=NearLights(
            np.array([light.position for _, light in lit]),
            np.array([shot.exposure_s * calibration.lamp_intensity for shot, _ in lit]),
            calibration.reference_m,
        ),
        mask=mask,
        camera=Camera(np.array(calibration.camera_matrix), np.array(calibration.distortion)),
        notes={"format": "session", "warnings": []},
    )


def _shots(manifest: Path) -> tuple[Shot, ...]:
    try:
        listed = json.loads(text(manifest))["shots"]
        return tuple(Shot.model_validate_json(json.dumps(shot)) for shot in listed)
    except (ValueError, KeyError, TypeError) as error:
        raise refusal(manifest, f"does not list the session's shots: {error}; was the session completed?") from error
