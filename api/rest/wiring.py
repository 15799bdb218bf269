"""Composition root: builds runner and service from settings and cell file, and is the only module that chooses devices.

Nothing is connected here. The runner connects the devices when it can, so that the service starts although one is
absent, and reports which.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from anyio import CapacityLimiter

from acquisition.archive.sender_process import SenderProcess
from acquisition.devices import CameraDriver, CameraFault, Rig
from acquisition.devices.camera_aravis import AravisCamera
from acquisition.devices.camera_folder import FolderCamera
from acquisition.devices.camera_gphoto import GphotoCamera
from acquisition.devices.camera_micromanager import MicromanagerCamera
from acquisition.devices.camera_pylon import PylonCamera
from acquisition.devices.camera_sim import SimCamera
from acquisition.devices.frame_accounting import AccountedCamera
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from acquisition.models import cell_config
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.camera_config import (
    AnyCamera,
    AravisCameraConfig,
    FolderCameraConfig,
    GphotoCameraConfig,
    MicromanagerCameraConfig,
    PylonCameraConfig,
    SimCameraConfig,
)
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.process_priority import RealTime
from acquisition.runner.compute import Compute
from acquisition.runner.re_solve import ReSolveService
from acquisition.runner.runner import Runner
from acquisition.runner.safety_monitor import Latch, SafetyMonitor
from acquisition.runner.session_queue import SessionQueue
from acquisition.store import Store
from acquisition.waypoints import calibrated_kinematics, kinematics
from api.rest.settings import Settings

SHARE = 0.5
"""Share of a core that this process may use in real time while the arm moves; with a session alone it uses 0.05."""


@dataclass(frozen=True)
class Limits:
    """Numbers of threads that each kind of slow request may occupy, so that no kind starves the others."""

    start: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(4))  # start and resume wait for devices
    stop: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(8))  # halts, then waits for the journal
    pause: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(8))  # waits for the journal
    jog: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(8))
    release: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(8))  # waits until the arm is at rest
    queue: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    reach: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    forecasts: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    pictures: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    view: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    exports: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))


@dataclass(frozen=True)
class Service:
    """The parts that the routes use."""

    cell: CellConfig
    rig: Rig
    store: Store
    runner: Runner
    resolving: ReSolveService
    queue: SessionQueue
    limits: Limits = field(default_factory=Limits)
    sender: SenderProcess | None = None

    @property
    def calibration(self) -> Calibration:
        """The calibration in use."""
        return self.runner.choices.calibration

    def open(self) -> None:
        """Starts the runner, the re-solving and the queue in its stopped state. Nothing moves."""
        self.runner.open()
        self.resolving.open()
        self.queue.open()
        if self.sender is not None:
            self.sender.open()

    def close(self) -> None:
        """Halts the arm, ends the runner and closes the journal."""
        self.runner.begin_shutdown()
        if self.sender is not None:
            self.sender.close()
        self.queue.close()
        self.resolving.close()
        self.runner.close()
        self.store.close()


def build(settings: Settings) -> Service:
    """Builds the service of these settings. Raises RigError config.invalid, store.locked, store.corrupt."""
    cell = cell_config.load(settings.cell)
    calibration = cell_config.load_calibration(settings.cell.parent / cell.calibration)
    sender = None
    if settings.archive is not None:
        sender = SenderProcess(settings.data.resolve(), settings.archive, settings.archive_catalogue)
    service = assemble(Store(settings.data), build_rig(cell), calibration, Compute())
    service.store.journal.set_archive(settings.archive)
    return replace(service, sender=sender)


def assemble(store: Store, rig: Rig, calibration: Calibration, compute: Compute) -> Service:
    """Assembles the service from its parts."""

    def safety_changed(latch: Latch | None) -> None:
        if latch is not None:
            runner.handle_fault(latch)

    def camera_fault(fault: CameraFault) -> None:
        holder = store.journal.holder()
        body = {"kind": fault.kind, "detail": fault.detail, "retaken": fault.retaken}
        store.journal.announce(None if holder is None else holder.id, "camera.fault", body)

    rig.camera.listen(camera_fault)
    monitor = SafetyMonitor(rig.arm, safety_changed, _latched(store))
    runner = Runner(store, rig, calibration, compute, monitor)
    return Service(rig.cell, rig, store, runner, ReSolveService(store, compute), SessionQueue(store, runner))


def build_rig(cell: CellConfig) -> Rig:
    """Builds the devices of the cell file, not connected. Raises RigError config.invalid."""
    arm = build_arm(cell)
    if getattr(cell.camera, "trigger_output", None) == cell.lamp.output:
        detail = f"Output {cell.lamp.output} switches the lamp: it cannot trigger the camera too"
        raise RigError(ErrorCode.CONFIG_INVALID, detail)
    return Rig(arm, UrLamp(arm, cell.lamp), build_camera(cell.camera, arm.pulse_output), cell)


def build_arm(cell: CellConfig) -> UrArm:
    """Builds the arm of the cell file, not connected. Raises RigError config.invalid."""
    model = kinematics.arm_model(cell.arm.model)
    flange_from_tool = cell.arm.flange_from_tool.matrix
    chain = None if cell.arm.kinematics is None else calibrated_kinematics.chain(cell.arm.kinematics)

    def expected_pose(joints: Sequence[float]) -> FloatArray:
        batch = np.array([joints], dtype=float)
        frames = kinematics.forward(model, batch) if chain is None else calibrated_kinematics.forward(chain, batch)
        return frames[0, -1] @ flange_from_tool

    return UrArm(cell.arm, cell.lamp.output, expected_pose, real_time=RealTime(SHARE))


def build_camera(camera: AnyCamera, pulse_output: Callable[[int], None] | None = None) -> AccountedCamera:
    """Builds the camera of a kind, not connected. Raises RigError config.invalid when its library is not installed.

    Without `pulse_output`, which pulses an output of the arm's controller, it is triggered by software.
    """
    return AccountedCamera(_driver(camera, pulse_output), camera)


def _driver(camera: AnyCamera, pulse_output: Callable[[int], None] | None) -> CameraDriver:
    match camera:
        case SimCameraConfig():
            return SimCamera(camera)
        case PylonCameraConfig():
            return PylonCamera(camera, _pulse(pulse_output, camera.trigger_output))
        case AravisCameraConfig():
            return AravisCamera(camera, _pulse(pulse_output, camera.trigger_output))
        case MicromanagerCameraConfig():
            return MicromanagerCamera(camera)
        case GphotoCameraConfig():
            return GphotoCamera(camera)
        case FolderCameraConfig():
            return FolderCamera(camera, _pulse(pulse_output, camera.trigger_output))


def _pulse(pulse_output: Callable[[int], None] | None, output: int | None) -> Callable[[], None] | None:
    """Returns the pulse of one output; None without an arm, or if the camera is not wired to it."""
    return None if pulse_output is None or output is None else partial(pulse_output, output)


def _latched(store: Store) -> Latch | None:
    """Returns a fault that the last service left unacknowledged, or None."""
    faults = store.journal.unacknowledged_faults()
    if not faults:
        return None
    oldest = faults[0]
    return Latch(ErrorCode(oldest["code"]), oldest["detail"], oldest["since"])
