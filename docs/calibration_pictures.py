"""Takes the pictures of the calibration targets in the docs: `python docs/calibration_pictures.py`, in half a minute.

They are frames of a perturbed cell's camera: the board on the flange under the room's light, the mirror sphere
and the matt plane under the lamp. A path as an argument takes the pictures somewhere else.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from acquisition.formats.frames import FolderFrames
from acquisition.models import cell_config
from acquisition.models.calibration_recipe import BoardRecipe
from acquisition.models.shot import Observations
from acquisition.runner import board_jobs
from acquisition.waypoints import mounted_tool
from hardware_sim import nominal
from hardware_sim.world import ExposureInterval, World

PICTURES = Path(__file__).parent / "pictures"
PIXELS, SEED = 480, 1
LIT = (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423)
"""Joints, rad, at which the lamp lights the object's place from the side."""

QUALITY, BRIGHTEST_PERCENT = 80, 99.8


def take(target: str, joints: tuple[float, ...], exposure_s: float, *, lit: bool) -> np.ndarray:
    """A frame (H, W), 8 bits, of a target in the perturbed cell, its brightest pixels white."""
    cell = cell_config.load(nominal.default_cell_file())
    world = World(cell, nominal.calibration(PIXELS), target, SEED, "realistic", perturbed=True)
    frame = world.frame([ExposureInterval(1.0, joints, float(lit))], exposure_s, 0).astype(float)
    dark, bright = float(frame.min()), float(np.percentile(frame, BRIGHTEST_PERCENT))
    return (255 * np.clip((frame - dark) / max(bright - dark, 1.0), 0, 1) ** (1 / 2.2)).astype(np.uint8)


def board_view() -> tuple[float, ...]:
    """Joints, rad, of the first view that a hand–eye session of this cell plans."""
    cell, calibration = cell_config.load(nominal.default_cell_file()), nominal.calibration(PIXELS)
    recipe = BoardRecipe(kind="hand-eye")
    nothing = Observations.of([], FolderFrames(Path()))
    plan = board_jobs.board_poses(recipe, mounted_tool.with_tool(cell, "board"), calibration, nothing, None)
    assert plan.joints is not None  # noqa: S101 - views have joints
    return plan.joints[0]


def main(folder: Path) -> None:
    """Takes the pictures, side by side."""
    shown = [
        take("charuco@flange", board_view(), 0.4, lit=False),
        take("mirror-sphere", LIT, 2e-2, lit=True),
        take("matt-plane", LIT, 2e-2, lit=True),
        take("matt-plane#1", LIT, 2e-2, lit=True),
    ]
    path = folder / "calibration-targets.webp"
    cv2.imwrite(str(path), np.hstack(shown), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    print(f"{path.name} {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES)
