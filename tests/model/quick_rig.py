"""A service whose devices and compute jobs answer in milliseconds: the real runner, journal and HTTP over a small arm.

The arm goes where it is sent in a few milliseconds, stops when it is halted and in a protective stop, and says truly
how fast it moves; the camera sees grey when the lamp is on. The jobs give lights, ways and results of the right shape.
"""

import threading
import time
from collections import deque
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.devices import (
    ArmIdentity,
    ArmReading,
    Finding,
    Frame,
    MotionLimits,
    RecoveryStep,
    Rig,
    StopToken,
    TrackPoint,
)
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.models import cell_config
from acquisition.models.base import Vector3, as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.camera import CameraCapabilities
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.result import ResultSummary
from acquisition.models.route import JointPath, Route, Waypoint
from acquisition.runner.compute import Compute
from acquisition.store import Store
from api.rest import keys, server, settings, wiring
from api.rest.keys import KeyRing, Role
from api.rest.server import Server
from hardware_sim import nominal

PIXELS = 32
LEG_S = 0.004
JOB_S = 0.002
JOG_WALL = 3.2  # rad of any joint
NORMAL, PROTECTIVE_STOP = 0b1, 0b101
CELL_FILE = Path(__file__).parents[2] / "tests" / "data" / "cell.test.toml"


class QuickArm:
    """Six joints that move evenly; `reading` is true at every moment."""

    def __init__(self, home: Sequence[float]) -> None:
        self._changing = threading.Lock()
        self._joints = tuple(home)
        self._moving = False
        self._stopping = threading.Event()
        self._safety_bits = NORMAL
        self.lamp = False
        self.moves: list[float] = []  # when each began, time.monotonic()
        self._points: deque[TrackPoint] = deque(maxlen=1000)

    @property
    def reading(self) -> ArmReading:
        moving = self._moving
        return ArmReading(
            connected=True,
            joints=self._joints,
            joint_speeds=(1.0 if moving else 0.0,) * 6,
            base_from_tool=np.eye(4),
            timestamp=time.monotonic(),
            robot_mode=7,
            safety_bits=self._safety_bits,
            runtime_state=2,
            program_running=True,
            speed_fraction=1.0,
            digital_outputs=int(self.lamp),
            received_at=time.monotonic(),
        )

    def track(self, seconds: float) -> list[TrackPoint]:
        now = time.monotonic()
        self._points.append(TrackPoint(now, now, self._joints, np.eye(4)))
        return [point for point in self._points if point.received_at >= now - seconds]

    def connect(self, *, take_control: bool = True) -> ArmIdentity:
        return ArmIdentity("UR5", "1", "5.12")

    def prepare(self) -> None:
        if self._safety_bits != NORMAL:
            raise RigError(ErrorCode.ARM_PROTECTIVE_STOP, "The arm is in a protective stop")

    def set_payload(self, mass_kg: float, center_m: Vector3) -> None:
        return

    def preflight(self) -> Sequence[Finding]:
        return []

    def recover(self, step: RecoveryStep) -> None:
        raise RigError(ErrorCode.SAFETY_RECOVERY_REFUSED, f"This arm has no {step}")

    def move(self, path: Sequence[Sequence[float]], limits: Sequence[MotionLimits], stop: StopToken) -> None:
        self._stopping.clear()
        self.moves.append(time.monotonic())
        try:
            for corner in path:
                self._moving = True
                for share in (0.5, 1.0):
                    if stop.wait(LEG_S / 2):
                        raise Halted
                    if self._stopping.is_set() or self._safety_bits != NORMAL:
                        raise RigError(ErrorCode.ARM_MOVE_FAILED, "The arm was stopped on its way")
                    joints = np.array(self._joints)
                    self._joints = tuple((joints + share * (np.array(corner) - joints)).tolist())
        finally:
            self._moving = False

    def halt(self) -> None:
        self._stopping.set()
        self.lamp = False

    def close(self) -> None:
        self.halt()

    def stop_protectively(self) -> None:
        """Causes a protective stop, as a push against the arm does."""
        self._safety_bits = PROTECTIVE_STOP

    def unlock(self) -> None:
        """Unlocks the protective stop, as a person does at the pendant."""
        self._safety_bits = NORMAL


class QuickLamp:
    """The arm's output."""

    def __init__(self, arm: QuickArm) -> None:
        self._arm = arm

    def connect(self) -> None:
        self._arm.lamp = False

    def set(self, on: bool) -> None:
        self._arm.lamp = on

    def close(self) -> None:
        self._arm.lamp = False


class QuickCamera:
    """Grey while the lamp is on, black otherwise."""

    def __init__(self, arm: QuickArm, calibration: Calibration) -> None:
        self._arm = arm
        self._sensor = calibration.sensor

    def connect(self) -> CameraCapabilities:
        return CameraCapabilities(
            name="quick", width=PIXELS, height=PIXELS, bits=self._sensor.bits, triggers=("software",),
            min_exposure_s=1e-5, max_exposure_s=10.0,
        )  # fmt: skip

    def restart(self) -> None:
        pass

    def expose(self, exposure_s: float, attempt: int, stop: StopToken) -> Frame:
        if stop.wait(0.001):
            raise Halted
        level = self._sensor.black_level_dn + (0.7 * self._sensor.full_scale_dn if self._arm.lamp else 0)
        pixels = np.full((PIXELS, PIXELS), round(level), np.uint16)
        return Frame(pixels=pixels, exposure_s=exposure_s, taken_at=time.time())

    def close(self) -> None:
        pass


class QuickCompute(Compute):
    """Jobs of the right shape, in this process."""

    def run(
        self, stop: threading.Event, job: str, *arguments: Any, preemptible: bool = False,
        while_waiting: threading.Event | None = None,
    ) -> Any:  # fmt: skip
        """Does the job named."""
        if stop.wait(JOB_S):
            raise Halted
        return getattr(self, f"_{job}")(*arguments)

    def close(self) -> None:
        """Nothing runs."""

    def _first_lights(self, recipe: Any, *_: Any) -> LightPlan:
        return _plan(recipe.pilot_lights)

    def _further_lights(self, recipe: Any, *_: Any) -> tuple[LightPlan, list[bytes]]:
        return _plan(recipe.planned_lights), []

    def _plan_route(self, lights: list[Light], start: Sequence[float], cell: CellConfig, _: Any) -> Route:
        waypoints = [
            Waypoint(light=light, path=[_place(cell, number + 1)], speeds=[1.0], seconds=LEG_S)
            for number, light in enumerate(lights)
        ]
        return Route(
            start=as_joints(start),
            waypoints=waypoints,
            light_numbers=list(range(len(lights))),
            home_path=[cell.arm.home],
            home_speeds=[1.0],
            seconds=LEG_S * len(lights),
            lower_bound_s=LEG_S * len(lights),
        )

    def _plan_route_on_the_way(self, *known: Any) -> Route:
        return self._plan_route(*known)

    def _rejoin_route(self, *_: Any) -> Route:
        raise RigError(ErrorCode.WAYPOINTS_COLLISION, "There is no way back to the route")

    def _plan_retreat(self, _: Any, cell: CellConfig, *__: Any) -> JointPath:
        return JointPath(path=[cell.arm.home], speeds=[1.0], seconds=LEG_S)

    def _jog_step(self, joints: Sequence[float], motion: JogMotion, *_: Any) -> JointPath:
        goal = np.array(joints)
        goal[motion.joint or 0] += motion.direction * 0.001
        if abs(goal[motion.joint or 0]) > JOG_WALL:
            raise RigError(ErrorCode.WAYPOINTS_COLLISION, "the way is blocked by the wall", reason="hits-obstacle")
        return JointPath(path=[as_joints(goal)], speeds=[1.0], seconds=LEG_S)

    def _plan_return(self, _: Any, joints: Sequence[float], *__: Any) -> JointPath:
        return JointPath(path=[as_joints(joints)], speeds=[1.0], seconds=LEG_S)

    def _solve_normals(self, observations: Any, *arguments: Any) -> ResultSummary:
        folder: Path
        *_, folder, _check = arguments
        folder.mkdir(parents=True)
        (folder / "normals.png").write_bytes(b"normals")
        return ResultSummary(
            images=len(observations.shots), object_pixels=9, solved_pixels=9, mean_sigma_deg=1.0, median_sigma_deg=1.0,
            predicted_sigma_deg=None, predicted_median_deg=None, fewer_than_three_lights=0.0, intensity_factors=[],
            noise={},
        )  # fmt: skip


def _plan(count: int) -> LightPlan:
    lights = [Light(position=(0.01 * number, 0.0, -0.4), axis=(0.0, 0.0, -1.0)) for number in range(count)]
    return LightPlan(lights=lights, method="optimal", reasons=["quick"] * count)


def _place(cell: CellConfig, number: int) -> Any:
    first, *others = cell.arm.home
    return (first + 0.02 * number, *others)


@contextmanager
def quick_service(
    folder: Path, host: str, *, with_keys: bool = True, cell_file: Path = CELL_FILE, compute: Compute | None = None
) -> Generator[tuple[Server, QuickArm, str, dict[Role, str]]]:
    """A running service over a quick rig; with it its arm, its address, and a key for each role, if it asks for any."""
    cell = cell_config.load(cell_file)
    calibration = nominal.calibration(PIXELS)
    chosen = settings.read(cell=cell_file, data=folder / "data", host=host, port=0)
    secrets = {role: keys.add(keys.path_in(chosen.data), str(role), role) for role in Role if with_keys}
    arm = QuickArm(cell.arm.home)
    rig = Rig(arm, QuickLamp(arm), AccountedCamera(QuickCamera(arm, calibration), cell.camera), cell)
    service = wiring.assemble(Store(chosen.data), rig, calibration, compute or QuickCompute())
    listening: list[str] = []
    ready = threading.Event()

    def say(address: str) -> None:
        listening.append(address)
        ready.set()

    made = server.create_for(service, chosen, KeyRing(keys.path_in(chosen.data)), say)
    thread = threading.Thread(target=made.run)
    thread.start()
    try:
        assert ready.wait(60)
        yield made, arm, listening[0], secrets
    finally:
        made.should_exit = True
        thread.join(60)
        assert not thread.is_alive()
