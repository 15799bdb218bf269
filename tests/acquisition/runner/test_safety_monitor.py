"""The safety monitor on a scripted arm: which states latch a fault and which clear the latch."""

import threading
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from acquisition.devices import ArmIdentity, ArmReading, Finding, MotionLimits, RecoveryStep, StopToken, TrackPoint
from acquisition.models.base import Vector3
from acquisition.models.errors import ErrorCode, RigError
from acquisition.runner.safety_monitor import Latch, SafetyMonitor, classify

NORMAL = ArmReading(
    connected=True,
    joints=(0.0,) * 6,
    joint_speeds=(0.0,) * 6,
    base_from_tool=np.eye(4),
    timestamp=1.0,
    robot_mode=7,
    safety_bits=1,
    runtime_state=2,
    program_running=True,
    speed_fraction=1.0,
    digital_outputs=0,
    received_at=0.0,
)
PROTECTIVE = replace(NORMAL, safety_bits=1 << 2 | 1 << 10, runtime_state=4)
EMERGENCY = replace(NORMAL, safety_bits=1 << 6 | 1 << 7 | 1 << 10, robot_mode=3, runtime_state=1)
LOST = replace(NORMAL, connected=False, lost="the controller sends nothing")


class ScriptedArm:
    """An arm whose reading the test sets."""

    def __init__(self, reading: ArmReading) -> None:
        self.reading = reading

    def track(self, seconds: float) -> list[TrackPoint]:
        raise NotImplementedError

    def connect(self, *, take_control: bool = True) -> ArmIdentity:
        raise NotImplementedError

    def prepare(self) -> None:
        raise NotImplementedError

    def set_payload(self, mass_kg: float, center_m: Vector3) -> None:
        return

    def preflight(self) -> Sequence[Finding]:
        raise NotImplementedError

    def recover(self, step: RecoveryStep) -> None:
        raise NotImplementedError

    def move(self, path: Sequence[Sequence[float]], limits: Sequence[MotionLimits], stop: StopToken) -> None:
        raise NotImplementedError

    def halt(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError


class Watched:
    """A monitor polled by the test, and the events it announced."""

    def __init__(self, reading: ArmReading = NORMAL, latched: Latch | None = None) -> None:
        self.arm = ScriptedArm(reading)
        self.announced: list[Latch | None] = []
        self.monitor = SafetyMonitor(self.arm, self.announced.append, latched)

    def see(self, reading: ArmReading) -> None:
        self.arm.reading = reading
        self.monitor.poll()


def test_monitor_normal_arm_is_clear() -> None:
    watched = Watched()
    watched.see(NORMAL)
    watched.monitor.require_clear()
    assert watched.announced == []
    assert watched.monitor.latch is None


def test_monitor_powered_off_arm_is_no_fault() -> None:
    assert classify(replace(NORMAL, robot_mode=3, program_running=False)) is None


@pytest.mark.parametrize(
    ("reading", "code"),
    [(PROTECTIVE, ErrorCode.ARM_PROTECTIVE_STOP), (EMERGENCY, ErrorCode.ARM_EMERGENCY_STOP)],
)
def test_monitor_stop_latches_until_ended_and_acknowledged(reading: ArmReading, code: ErrorCode) -> None:
    watched = Watched()
    watched.see(NORMAL)
    watched.see(reading)
    with pytest.raises(RigError) as present:
        watched.monitor.require_clear()
    assert present.value.code == code
    with pytest.raises(RigError) as refused:
        watched.monitor.acknowledge("ada")
    assert refused.value.code == ErrorCode.SAFETY_STILL_FAULTED

    watched.see(NORMAL)
    with pytest.raises(RigError) as latched:
        watched.monitor.require_clear()
    assert latched.value.code == ErrorCode.SAFETY_NOT_ACKNOWLEDGED

    opened = watched.monitor.acknowledge("ada")
    assert opened is not None
    assert opened.code == code
    watched.monitor.require_clear()
    assert [None if latch is None else latch.code for latch in watched.announced] == [code, None]


def test_monitor_first_fault_is_kept_and_announced_once() -> None:
    watched = Watched()
    watched.see(PROTECTIVE)
    watched.see(PROTECTIVE)
    watched.see(EMERGENCY)
    assert len(watched.announced) == 1
    assert watched.monitor.latch is not None
    assert watched.monitor.latch.code == ErrorCode.ARM_PROTECTIVE_STOP


def test_monitor_arm_never_connected_is_no_fault() -> None:
    watched = Watched(LOST)
    watched.see(LOST)
    assert watched.monitor.latch is None


def test_monitor_lost_link_can_be_acknowledged_while_lost() -> None:
    watched = Watched()
    watched.see(NORMAL)
    watched.see(LOST)
    assert watched.monitor.latch is not None
    assert watched.monitor.latch.code == ErrorCode.DEVICE_DISCONNECTED
    assert "the controller sends nothing" in watched.monitor.latch.detail
    watched.monitor.acknowledge("ada")
    watched.see(LOST)  # still away: the same loss is not latched again
    assert watched.monitor.latch is None
    watched.see(NORMAL)
    watched.see(LOST)
    assert watched.monitor.latch is not None


def test_monitor_latch_outlives_the_service() -> None:
    latch = Latch(ErrorCode.ARM_PROTECTIVE_STOP, "Protective stop.", 1.0)
    watched = Watched(latched=latch)
    with pytest.raises(RigError) as caught:
        watched.monitor.require_clear()
    assert caught.value.code == ErrorCode.SAFETY_NOT_ACKNOWLEDGED
    assert watched.monitor.acknowledge("ada") == latch


def test_monitor_acknowledge_without_latch_announces_nothing() -> None:
    watched = Watched()
    assert watched.monitor.acknowledge("ada") is None
    assert watched.announced == []


def test_monitor_thread_latches_a_stop() -> None:
    arm = ScriptedArm(NORMAL)
    observed = threading.Event()
    monitor = SafetyMonitor(arm, lambda latch: observed.set())
    monitor.start()
    try:
        arm.reading = PROTECTIVE
        assert observed.wait(60.0)
    finally:
        monitor.close()
    assert monitor.latch is not None


def test_monitor_driver_that_takes_control_is_silent_but_not_lost() -> None:
    watched = Watched()
    watched.see(NORMAL)
    watched.see(replace(LOST, taking_control=True))
    assert watched.monitor.latch is None
    watched.see(LOST)
    assert watched.monitor.latch is not None


def test_monitor_fault_that_comes_and_goes_while_acknowledged_is_latched() -> None:
    arm = ScriptedArm(EMERGENCY)
    monitor = SafetyMonitor(arm, lambda _: None)
    monitor.poll()
    arm.reading = NORMAL

    def record() -> None:
        arm.reading = PROTECTIVE
        monitor.poll()
        arm.reading = NORMAL

    assert monitor.acknowledge("a", record=record) is None
    assert monitor.latch is not None
    assert monitor.latch.code is ErrorCode.ARM_PROTECTIVE_STOP
