"""Starts and ends a simulated cell: controller and world as two child processes, and the files that describe them.

Both children end when their standard input does, so neither outlives the process that started the cell. The folder
receives `cell.toml` and `calibration.json` (nominal values). It also receives, for graders only, `truth.npz` (of the
object) and `calibration_truth.json` (of camera, lamp and arm, and of a calibration target).
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Literal, get_args

from acquisition.models.camera_config import SimCameraConfig
from acquisition.models.errors import ErrorCode, RigError
from hardware_sim import nominal, object_spec, placing, real_time_controller
from hardware_sim.controller.control import ControlClient
from hardware_sim.controller.options import ControllerOptions
from hardware_sim.controller.process import ControllerProcess
from hardware_sim.nominal import FULL_PIXELS
from hardware_sim.object_spec import ObjectSpec
from hardware_sim.status import StatusLines
from hardware_sim.world import ProfileName

READY_WITHIN_S = 600.0
"""Time limit, s, until controller and world are ready: usually 10 s, over 120 s if twenty programs share two cores."""

STATUS_EVERY_S = 0.05

CELL_FILE, CALIBRATION_FILE, CALIBRATION_TRUTH_FILE = "cell.toml", "calibration.json", "calibration_truth.json"
"""Names of the files of a simulated cell; cells that no simulator wrote do not have the last one."""


@dataclass(frozen=True)
class CellOptions:
    """Contents and address of a simulated cell.

    `address`: loopback address of controller and camera. `spec`, `seed`: the object that `object_spec.build` makes; a
    text is the name of a built-in one. `profile`: how the world differs from its calibration (`world.PROFILES`).
    `speed`: motion time per wall time. `pixels`: edge of the camera's square image. `cell_file`: the cell to simulate;
    None is the default simulated cell. `calibration_seed`: seed of an arm that differs from its nominal kinematics;
    None is the nominal arm. `record`: file that receives every tick. `programs`: folder of programs that the dashboard
    can load. `perturbed`: the calibration's values are as wrong as those of a cell that was never calibrated
    (`true_cell.perturbed`), in a way that the seed determines. `polyscope`: the controller's software, "5" or "x"; None
    takes that of the cell file.
    """

    address: str
    spec: ObjectSpec | str
    seed: int
    profile: str
    speed: float
    pixels: int = FULL_PIXELS
    cell_file: Path | None = None
    calibration_seed: int | None = None
    record: Path | None = None
    programs: Path | None = None
    perturbed: bool = False
    polyscope: Literal["5", "x"] | None = None


class Cell:
    """A running cell, as a context manager whose entry returns when controller and camera accept connections.

    The constructor raises RigError request.invalid for an object that cannot be made, an unknown profile, or a size or
    speed out of range, folder.invalid for a folder with the files of another cell, and config.invalid for a bad cell
    file or an object that protrudes from its keep-out. Entry raises request.invalid for an unwritable record,
    device.disconnected if the controller does not start, and service.fault, with the reason, for the world.
    """

    def __init__(self, options: CellOptions, folder: Path) -> None:
        """`folder` receives the cell's files."""
        cell_file = options.cell_file or nominal.default_cell_file()
        spec = object_spec.as_spec(options.spec)
        _check(options)
        _refuse_other_cell(folder)
        object_spec.check(spec, options.seed, cell_file)
        self.address = options.address
        self.folder = folder
        self.cell_file = folder / CELL_FILE
        self.calibration_file = folder / CALIBRATION_FILE
        self.truth_file = folder / "truth.npz"
        self.config = nominal.write(folder, options.address, options.pixels, cell_file, options.polyscope)
        self._options, self._spec = options, spec
        self._controller: ControllerProcess | None = None
        self._world: subprocess.Popen[bytes] | None = None
        self._control: ControlClient | None = None

    def __enter__(self) -> "Cell":
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        options = self._options
        if options.record is not None:
            _refuse_unwritable(options.record)
        self._controller = real_time_controller.start(
            options.address,
            ControllerOptions(
                home=self.config.arm.home,
                model=self.config.arm.model,
                calibration_seed=options.calibration_seed,
                speed=options.speed,
                low_when_stopped=(self.config.lamp.output,),
                record=options.record,
                programs=options.programs,
                polyscope=self.config.arm.polyscope,
                robot_api_port=self.config.arm.robot_api_port,
            ),
            log_level="INFO",  # why a program ended is the first question about a stopped move
        )
        world = [str(self.folder), self._spec.as_json(), str(options.seed), options.profile]
        world += ["perturbed"] * options.perturbed
        try:
            self._world = subprocess.Popen(  # noqa: S603 - our own module, arguments checked
                [sys.executable, "-m", "hardware_sim.world_process", *world],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )
            self._await_world(self._world)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._control is not None:
            self._control.close()
            self._control = None
        if self._world is not None:
            _end(self._world)
            self._world = None
        if self._controller is not None:
            self._controller.close()
            self._controller = None

    def state(self) -> dict[str, Any]:
        """The state that the controller's control port reports. Raises RigError device.disconnected."""
        with real_time_controller.as_rig_errors():
            if self._control is None:
                self._control = ControlClient(self.address)
            return self._control.state()

    def place(self, name: str) -> str:
        """Puts another object or target into the running cell, and returns its label: see `placing.place`."""
        assert isinstance(self.config.camera, SimCameraConfig)  # noqa: S101 - the world has refused any other
        return placing.place(self.config.camera.address, self.config.camera.port, name)

    @property
    def alive(self) -> bool:
        """Whether both processes run."""
        processes = [self._world, self._controller and self._controller.process]
        return all(process is not None and process.poll() is None for process in processes)

    @property
    def world_pid(self) -> int:
        """Process id of the world, which is the camera too. Raises RigError service.fault outside the context."""
        if self._world is None:
            raise RigError(ErrorCode.SERVICE_FAULT, "the simulated cell is not running")
        return self._world.pid

    def _await_world(self, world: "subprocess.Popen[bytes]") -> None:
        assert world.stdout is not None  # noqa: S101 - it is a pipe
        overdue = threading.Timer(READY_WITHIN_S, world.kill)  # ends the wait for its line
        overdue.start()
        try:
            line = world.stdout.readline()
        finally:
            overdue.cancel()
        answer = json.loads(line) if line else {"error": "it ended before it was ready"}
        if "error" in answer:
            raise RigError(ErrorCode.SERVICE_FAULT, f"the simulated world did not start: {answer['error']}")


def run(
    options: CellOptions,
    *,
    folder: Path | None = None,
    json_status: bool = False,
    say: Callable[[str], None] = print,
) -> None:
    """Runs a cell until SIGTERM or SIGINT; says `ready …` when clients can connect, then status lines if wanted.

    Must be called in the main thread. Without `folder` the files go to a temporary one that is deleted with the cell.
    Raises RigError as `Cell` does, and service.fault if one of its processes ends by itself.
    """
    ending = threading.Event()

    def end(_: int, __: FrameType | None) -> None:
        ending.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with (
            tempfile.TemporaryDirectory(prefix="lightpose-sim-") as temporary,
            Cell(options, folder or Path(temporary)) as cell,
        ):
            label = object_spec.as_spec(options.spec).label
            sys.stderr.write(
                "A table, a camera and an object surround the arm: a program that moves freely will touch them,"
                " which causes a protective stop.\n"
                f"Without them: python -m hardware_sim.controller --address {options.address}\n"
            )
            say(
                f"ready cell={cell.cell_file} address={options.address} object={label}"
                f" seed={options.seed} profile={options.profile}"
            )
            lines = StatusLines() if json_status else None
            while not ending.wait(0.5 if lines is None else STATUS_EVERY_S):
                if not cell.alive:
                    raise RigError(ErrorCode.SERVICE_FAULT, "a process of the simulated cell ended unexpectedly")
                if lines is not None:
                    line = lines.line(cell.state(), time.monotonic())
                    if line is not None:
                        say(line)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _check(options: CellOptions) -> None:
    """Raises RigError request.invalid that names the invalid value."""
    if options.profile not in get_args(ProfileName):
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"there is no profile {options.profile!r}: choose one of {', '.join(get_args(ProfileName))}",
        )
    if not 0.1 <= options.speed <= 100:
        raise RigError(ErrorCode.REQUEST_INVALID, f"speed is {options.speed}: it must lie between 0.1 and 100")
    if not 32 <= options.pixels <= 4096:
        raise RigError(ErrorCode.REQUEST_INVALID, f"pixels is {options.pixels}: it must lie between 32 and 4096")


def _refuse_unwritable(record: Path) -> None:
    """Raises RigError request.invalid for a record that cannot be written, with which the controller does not start."""
    place = record if record.exists() else record.absolute().parent
    if place.is_dir() == record.exists() or not os.access(place, os.W_OK):  # a file or a new file in a folder
        raise RigError(
            ErrorCode.REQUEST_INVALID,
            f"--record {record}: cannot be written: name a file in an existing folder",
            file=str(record),
        )


def _refuse_other_cell(folder: Path) -> None:
    """Raises RigError folder.invalid if the folder holds files of a cell that no simulator wrote.

    Their calibration may have been measured. A simulated cell that did not start has no truth, but is nominal.
    """
    held = [name for name in (CELL_FILE, CALIBRATION_FILE) if (folder / name).exists()]
    if held and not (folder / CALIBRATION_TRUTH_FILE).exists() and not nominal.is_nominal(folder / CALIBRATION_FILE):
        raise RigError(
            ErrorCode.FOLDER_INVALID,
            f"{folder}: holds {' and '.join(held)} of another cell, which the simulated cell would replace: name a new "
            "folder",
            file=str(folder),
        )


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Ends a process by closing its standard input, or kills it after 5 s."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
