"""The one place that chooses devices: from settings and cell file to a service that can run.

Nothing is connected here. The runner connects the devices when it can, so that the service starts when one is absent
and says which.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from anyio import CapacityLimiter

from acquisition import config
from acquisition.compute import Compute
from acquisition.config import CellConfig
from acquisition.devices import Rig
from acquisition.devices.camera_sim import SimCamera
from acquisition.devices.ur.arm import UrArm
from acquisition.devices.ur.lamp import UrLamp
from acquisition.errors import ErrorCode
from acquisition.results import Resolving
from acquisition.runner import Runner
from acquisition.safety import Latch, SafetyMonitor
from acquisition.store import Store
from acquisition.types import Calibration, FloatArray
from acquisition.waypoints import kinematics
from api.settings import Settings


@dataclass(frozen=True)
class Limits:
    """How many threads each kind of slow request may occupy, so that none starves the others."""

    start: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(4))  # start and resume wait for devices
    stop: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(8))
    reach: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    pictures: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(2))
    view: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))
    exports: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))


@dataclass(frozen=True)
class Service:
    """What the routes serve."""

    cell: CellConfig
    calibration: Calibration
    rig: Rig
    store: Store
    runner: Runner
    resolving: Resolving
    limits: Limits = field(default_factory=Limits)

    def open(self) -> None:
        """Starts the runner and whatever solves again; nothing moves."""
        self.runner.open()
        self.resolving.open()

    def close(self) -> None:
        """Halts, ends the runner and closes the journal."""
        self.runner.shut()
        self.resolving.close()
        self.runner.close()
        self.store.close()


def build(settings: Settings) -> Service:
    """The service of these settings. Raises RigError config.invalid, store.locked, store.corrupt."""
    cell = config.load(settings.cell)
    calibration = config.load_calibration(settings.cell.parent / cell.calibration)
    rig = build_rig(cell)
    store = Store(settings.data)

    def safety_changed(latch: Latch | None) -> None:
        if latch is not None:
            runner.latched(latch)

    monitor = SafetyMonitor(rig.arm, safety_changed, _latched(store))
    compute = Compute()
    runner = Runner(store, rig, calibration, compute, monitor)
    return Service(cell, calibration, rig, store, runner, Resolving(store, compute))


def build_rig(cell: CellConfig) -> Rig:
    """The devices that the cell file names, not connected. Raises RigError config.invalid."""
    model = kinematics.arm_model(cell.arm.model)
    flange_from_tool = cell.arm.flange_from_tool.matrix

    def expected_pose(joints: Sequence[float]) -> FloatArray:
        base_from_flange = kinematics.forward(model, np.array([joints], dtype=float))[0, -1]
        return base_from_flange @ flange_from_tool

    arm = UrArm(cell.arm, cell.lamp.output, expected_pose)
    return Rig(arm, UrLamp(arm, cell.lamp), SimCamera(cell.camera), cell)


def _latched(store: Store) -> Latch | None:
    """A fault that the last service left unacknowledged."""
    faults = store.journal.latched()
    if not faults:
        return None
    oldest = faults[0]
    return Latch(ErrorCode(oldest["code"]), oldest["detail"], oldest["since"])
