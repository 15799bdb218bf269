"""Fault injection into the world: faults of lamp, camera or object, ordered at the controller's control port.

All faults of a cell are ordered in one place. The world applies its own when it reads the controller's state for an
exposure. Faults with a number of frames are counted from the world's start, so that each happens once.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim.world import ExposureInterval, World

Disturbances = dict[str, Any]
"""The fields of `controller.disturbances.Disturbances`."""


class DisturbedWorld:
    """Captures frames of a world under the present `disturbances`."""

    def __init__(self, cell: CellConfig, make: Callable[[CellConfig], World], seed: int) -> None:
        """`make` builds the world of a cell; it is built again after the object is nudged or another is placed."""
        self._cell, self._make, self._seed = cell, make, seed
        self.world = make(cell)
        self._nudge: tuple[float, ...] = (0.0,) * 4
        self._dropped = self._saturated = self._exposures = 0

    def place(self, make: Callable[[CellConfig], World]) -> None:
        """Places what another `make` builds at its nominal pose; earlier nudges belonged to the last object."""
        self.world, self._make = make(self._cell), make

    def frame(
        self, intervals: Sequence[ExposureInterval], exposure_s: float, attempt: int, disturbances: Disturbances
    ) -> npt.NDArray[np.uint16]:
        """The camera's frame (H, W). Raises RigError camera.timeout for one that is dropped."""
        self._exposures += 1
        nudge = (*disturbances["object_shift_m"], disturbances["object_turn_rad"])
        if nudge != self._nudge:
            self._nudge = nudge
            self.world = self._make(nudged(self._cell, nudge[:3], nudge[3]))
        if self._dropped < disturbances["dropped_frames"]:
            self._dropped += 1
            raise RigError(ErrorCode.CAMERA_TIMEOUT, "the frame was lost on its way")
        if self._saturated < disturbances["saturated_frames"]:
            self._saturated += 1
            full = 2**self.world.calibration.sensor.bits - 1
            return np.full((self.world.lens.height, self.world.lens.width), full, dtype=np.uint16)
        share = disturbances["lamp_fraction"] * (1.0 - disturbances["lamp_flicker"] * self._uniform())
        lit = [replace(moment, lamp_level=moment.lamp_level * share) for moment in intervals]
        return self.world.frame(lit, exposure_s, attempt)

    def _uniform(self) -> float:
        """Random number from 0 to 1 for this exposure, the same in every run that captures the same frames."""
        digest = hashlib.sha256(f"flicker {self._seed} {self._exposures}".encode()).digest()
        return int.from_bytes(digest[:4], "big") / 2**32


def nudged(cell: CellConfig, shift_m: Sequence[float], turn_rad: float) -> CellConfig:
    """The cell with its object shifted by (3,) in the base frame and turned about its own axis."""
    pose = cell.object.keep_out.base_from_object.matrix @ geometry.pose((0.0, 0.0, 0.0), (0.0, 0.0, turn_rad))
    turn = cv2.Rodrigues(pose[:3, :3])[0].ravel().tolist()
    moved = cell.object.keep_out.base_from_object.model_copy(
        update={"position_m": tuple((pose[:3, 3] + shift_m).tolist()), "rotation_vector_rad": tuple(turn)}
    )
    keep_out = cell.object.keep_out.model_copy(update={"base_from_object": moved})
    return cell.model_copy(update={"object": cell.object.model_copy(update={"keep_out": keep_out})})
