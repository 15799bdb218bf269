"""The world as a process: builds the scene, writes the truth, and serves the camera until its parent is gone.

It also writes `surroundings.npz` into the folder: the solid bodies for the controller's collision check.

Run as `python -m hardware_sim.world_process FOLDER OBJECT SEED PROFILE [perturbed]`, with `cell.toml` and
`calibration.json` in the folder; OBJECT is `ObjectSpec.as_json`. Prints one JSON line, `{"ready": true}` or
`{"error": sentence}`. A request at the camera's port replaces the object or target; truth and bodies are then written
again. The process ends when its standard input ends, which happens however its parent dies.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import cast

import cv2

from acquisition import process_priority
from acquisition.models import cell_config
from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import object_spec, solids
from hardware_sim.camera import CameraServer
from hardware_sim.controller.control import ControlClient
from hardware_sim.disturbed import Disturbances, DisturbedWorld
from hardware_sim.object_spec import ObjectSpec
from hardware_sim.real_time_controller import as_rig_errors
from hardware_sim.shutter import CellState
from hardware_sim.world import ProfileName, World


class ControllerState:
    """Arm and lamp as the controller's control port reports them."""

    def __init__(self, address: str, lamp_output: int) -> None:
        self._address, self._output = address, lamp_output
        with as_rig_errors():
            self._client: ControlClient | None = ControlClient(address)
            state = self._client.state()
        self.disturbances: Disturbances = state["disturbances"]
        self.calibration: tuple[int | None, float] = (state["calibration_seed"], state["calibration_error_m"])

    def surround(self, path: Path) -> None:
        """Sends the solid bodies to the controller. Raises RigError device.disconnected, request.invalid."""
        with as_rig_errors(), ControlClient(self._address) as client:
            client.surround(path)

    def state(self) -> CellState:
        """The present state. Raises RigError device.disconnected; the next call connects again."""
        with as_rig_errors():
            if self._client is None:
                self._client = ControlClient(self._address)
            try:
                state = self._client.state()
            except ConnectionError:
                self._client.close()
                self._client = None
                raise
        self.disturbances = state["disturbances"]
        return CellState(
            joints=tuple(state["joints"]),
            lamp_on=bool(state["digital_outputs"] >> self._output & 1),
            lamp_age_s=float(state["output_age_s"][self._output]),
            speed_factor=float(state["speed_factor"]),
            clock_s=float(state["timestamp"]),
        )


def main(folder: Path, spec: ObjectSpec, seed: int, profile: ProfileName, *, perturbed: bool) -> None:
    """Serves one world until standard input ends."""
    cv2.setNumThreads(1)  # the other core belongs to the service
    process_priority.set_niceness(
        process_priority.BACKGROUND
    )  # rendering waits for the controller's tick, never the other way round
    try:
        cell = cell_config.load(folder / "cell.toml")
        if not isinstance(cell.camera, SimCameraConfig):
            raise RigError(ErrorCode.CONFIG_INVALID, "A simulated cell needs a camera of kind 'sim'.")
        calibration = cell_config.load_calibration(folder / cell.calibration)
        source = ControllerState(cell.arm.address, cell.lamp.output)

        def maker(spec: ObjectSpec) -> Callable[[CellConfig], World]:
            return lambda cell: World(
                cell, calibration, spec, seed, profile, arm_calibration=source.calibration, perturbed=perturbed
            )

        disturbed = DisturbedWorld(cell, maker(spec), seed)

        def publish() -> None:
            world = disturbed.world
            world.truth().save(folder / "truth.npz")
            world.save_calibration_truth(folder / "calibration_truth.json")
            solids.surroundings(cell, world.scene.mesh).save(folder / "surroundings.npz")
            source.surround(folder / "surroundings.npz")

        def place(name: str) -> str:
            chosen = object_spec.as_spec(name)
            disturbed.place(maker(chosen))
            publish()
            return chosen.label

        publish()
        server = CameraServer(
            cell.camera,
            calibration,
            lambda moments, exposure_s, attempt: disturbed.frame(moments, exposure_s, attempt, source.disturbances),
            source,
            place,
        )
    except RigError as error:
        print(json.dumps({"error": error.detail}), flush=True)
        raise SystemExit(1) from error
    except OSError as error:
        print(json.dumps({"error": f"the camera's port cannot be opened: {error}"}), flush=True)
        raise SystemExit(1) from error
    with server:
        print(json.dumps({"ready": True}), flush=True)
        sys.stdin.buffer.read()


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        ObjectSpec.from_json(sys.argv[2]),
        int(sys.argv[3]),
        cast(ProfileName, sys.argv[4]),
        perturbed="perturbed" in sys.argv[5:],
    )
