"""Options of a controller: one value for `serve`, for the process that runs it and for its command line."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from hardware_sim.controller.calibration import TYPICAL_ERROR_M

HOME = (0.0, -1.9, 1.9, -1.57, -1.57, 0.0)
"""Default of the initial joints, rad."""


class RealTime(Protocol):
    """Gives a process the processor before others.

    `enter` is called once, when the start-up work is done, and `keep_share` once a turn of the event loop.
    """

    def enter(self) -> None: ...
    def keep_share(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """The arm, its surroundings and its files.

    `home`: initial joints (6,) in rad. `model`: name of the arm's model. `calibration_seed`: seed of an arm that
    differs from its nominal kinematics by `calibration_error_m` (rms of the flange's position, see `calibration`); None
    is the nominal arm. `speed`: motion time per wall time. `low_when_stopped`: digital outputs held low while no
    program plays. `surroundings`: file of the bodies that the arm can touch (`surroundings`). `programs`: folder of
    programs that the dashboard can load (`program_store`). `record`: file that receives every tick (`trace`).
    `for_urx`: the secondary port sends robot mode data as before software 3.5; otherwise urx 0.11.0 ends each move that
    waits with "Robot stopped", as with a real controller of this version (its issues 41, 64, 112). `polyscope`: "5", or
    "x" with its Robot API on `robot_api_port` in place of the dashboard.
    """

    home: Sequence[float] = HOME
    model: str = "ur5e"
    calibration_seed: int | None = None
    calibration_error_m: float = TYPICAL_ERROR_M
    speed: float = 1.0
    low_when_stopped: Iterable[int] = ()
    surroundings: Path | None = None
    programs: Path | None = None
    record: Path | None = None
    for_urx: bool = False
    polyscope: str = "5"
    robot_api_port: int = 80
