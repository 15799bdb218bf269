"""Proxy of the arm in the service: starts the driver process, sends it requests, and can stop the arm without it.

The driver is started as `python -m`, neither forked nor by `multiprocessing`: it must not inherit a half-made state or
import the program that runs the service. The proxy answers `reading` and `halt` from shared memory. Everything else is
one request at a time with a deadline, in the runner's thread. A driver that misses a deadline is killed and its program
is ended by the second halt path; only an explicit `connect` starts the next one.
"""

import contextlib
import logging
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import cast

from acquisition.devices import ArmIdentity, ArmReading, DriverPriority, Finding, MotionLimits, RecoveryStep, StopToken
from acquisition.devices.ur import motion_limits, preflight, primary, probe, protocol, readings, states
from acquisition.devices.ur.program_stop import ProgramStop
from acquisition.devices.ur.protocol import Done, Failed, Field, Inspection, Interrupted, Sample, SharedMemory
from acquisition.models.base import FloatArray, Vector3
from acquisition.models.cell_config import ArmConfig, JointGeometry
from acquisition.models.errors import ErrorCode, Halted, RigError
from acquisition.process_priority import Priority, RealTime

_log = logging.getLogger(__name__)

OPEN_DEADLINE_S = 15.0  # for starting Python and importing on a busy machine
CONTROL_DEADLINE_S = 12.0  # ur-rtde waits up to 5 s for its program
REQUEST_DEADLINE_S = 5.0
SHUTDOWN_DEADLINE_S = 3.0
LATENESS_KEPT = 10_000


class UrArm:
    """A UR arm behind a driver process; see the Protocol `Arm`."""

    def __init__(
        self,
        config: ArmConfig,
        lamp_output: int,
        expected_pose: Callable[[Sequence[float]], FloatArray] | None = None,
        halt_by_driver: bool = True,
        halt_by_program_stop: bool = True,
        real_time: RealTime | None = None,
    ) -> None:
        """`real_time` is the class that this process is in while the arm moves.

        `expected_pose` gives base_from_tool (4, 4) by nominal kinematics at joints in rad, for preflight. Each halt
        path can be switched off, so that the other can be tested alone. Raises RigError config.invalid if a stop from
        full speed would outlast the controller's watchdog.
        """
        if config.max_joint_speed_rad_s / config.stop_deceleration_rad_s2 > protocol.STOP_WITHIN_S:
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"A stop from arm.max_joint_speed_rad_s must take at most {protocol.STOP_WITHIN_S} s: set "
                f"arm.stop_deceleration_rad_s2 to at least {config.max_joint_speed_rad_s / protocol.STOP_WITHIN_S:.2f}",
            )
        self._config = config
        self._software = probe.software_of(config)
        self._lamp_output = lamp_output
        self.expected_pose = expected_pose
        self._halt_by_driver = halt_by_driver
        self._halt_by_program_stop = halt_by_program_stop
        self._real_time = real_time or RealTime(0.0)
        self._priority_logged = False
        self._memory = SharedMemory.create()
        self._last_sample: Sample | None = None
        self._halt_requested = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._taking_control = self._took_control = False  # at present; whether this driver has ever taken control
        self._reported: list[JointGeometry] | None = None  # the arm's factory calibration, by the controller
        self._lost_reason = ""  # why the last driver was lost
        self._pipe_lock = threading.Lock()  # arm and lamp share the pipe; halt and reading do not take it
        self._program_stop: ProgramStop | None = None
        self.lateness_s: deque[float] = deque(maxlen=LATENESS_KEPT)
        """How late each renewal of the lease was, s; the newest of all moves, for monitoring."""

    # ------------------------------------------------------------------------------------------ any thread, never waits

    @property
    def reading(self) -> ArmReading:
        """The newest reading; not connected if the driver or the link is lost."""
        sample = self._memory.sample() or self._last_sample
        if sample is None:
            return readings.NO_READING
        self._last_sample = sample
        fresh = self.is_open and time.monotonic() - sample.received_at < protocol.HEARTBEAT_S
        return readings.reading_of(sample, fresh, self._lost_reason, self._priority, self._taking_control)

    def track(self, seconds: float) -> readings.Track:
        """Returns the arm's positions of the newest `seconds`; see the Protocol `Arm`."""
        return [readings.point_of(values) for values in self._memory.track(seconds)]

    @property
    def wakeups(self) -> dict[float, int]:
        """How often the driver woke up late, by upper bound of the lateness, s; for monitoring."""
        return dict(zip(protocol.LATENESS_BOUNDS_S, self._memory.wakeups(), strict=True))

    @property
    def _priority(self) -> DriverPriority | None:
        priority = self._memory.read(Field.PRIORITY)
        return readings.PRIORITIES[Priority(priority)] if priority and self.is_open else None

    @property
    def is_open(self) -> bool:
        """Whether a driver has been started and has not been given up."""
        return self._process is not None

    @property
    def driver_pid(self) -> int | None:
        """The driver's process number."""
        process = self._process
        return None if process is None else process.pid

    def halt(self) -> None:
        """Stops the arm and switches the lamp off by both paths; any thread, signal handlers, harmless at rest."""
        self._halt_requested = time.monotonic_ns()
        if self._halt_by_driver:
            self._memory.write(Field.HALT_REQUESTED, self._halt_requested)
        program_stop = self._program_stop
        if program_stop is not None:
            program_stop.notify_halt()

    # --------------------------------------------------------------------------------------------- the runner's thread

    def connect(self, *, take_control: bool = True) -> ArmIdentity:
        """Starts the driver unless it lives, switches the lamp off, and takes control if asked and the arm is ready.

        An arm that is not ready (power, safety, local control) is connected without control: `preflight` reports why,
        and `prepare` or another `connect` takes control later. Moves nothing. Raises RigError arm.unreachable within 3
        s if nobody answers, config.invalid if the controller runs another software than the cell file states,
        arm.in_use, driver.lost.
        """
        probe.probe(self._config, self._software)
        state = self._software.state()
        if self._program_stop is None:
            self._program_stop = ProgramStop(
                self._software, lambda: self._memory.halt_state(self._halt_requested), self._halt_by_program_stop
            )
        with self._pipe_lock:
            if not self._driver_answers():
                self._start_driver()
        reading = self.reading
        fault = states.safety_fault(reading.safety_bits) or states.power_fault(reading.robot_mode)
        if take_control and state.remote_control and fault is None:
            self.prepare()
        return state.identity

    def prepare(self) -> None:
        """Takes control: the control program runs, TCP and payload are set, the controller's watchdog is armed.

        This explicit step makes moves possible again after the program has ended for whatever reason; harmless while it
        runs. Raises RigError arm.not_ready, arm.protective_stop, arm.emergency_stop, arm.in_use, driver.lost.
        """
        tool = self._config.flange_from_tool
        with self._pipe_lock:
            if self._process is not None and self._program_stop is not None and not self._took_control:
                self._took_control = True
                self._program_stop.watch(self._process.pid)
                self._program_stop.reopen()
        request = protocol.TakeControl(
            (*tool.position_m, *tool.rotation_vector_rad), self._config.payload_kg, self._config.payload_center_m
        )
        self._taking_control = True
        try:
            self._done(self._request(request, CONTROL_DEADLINE_S, watch_loop=False))
        finally:
            self._taking_control = False
        self._log_priority()

    def set_payload(self, mass_kg: float, center_m: Vector3) -> None:
        """States the payload; see the Protocol `Arm`."""
        self._config = self._config.model_copy(update={"payload_kg": mass_kg, "payload_center_m": center_m})

    def _log_priority(self) -> None:
        """Logs, once, that this machine does not grant real time, which keeps the arm moving beside other programs."""
        if self._priority != "real-time" and not self._priority_logged:
            self._priority_logged = True
            _log.warning(
                "the arm's driver is not allowed to run in real time (granted: %s). If other programs on this machine "
                "delay it, it may stop the arm during a move, safely. Grant LimitRTPRIO=1 or CAP_SYS_NICE",
                self._priority,
            )

    def preflight(self) -> list[Finding]:
        """Compares the arm with the cell file; moves, unlocks and powers nothing. Raises RigError driver.lost."""
        state, reading = self._software.state(), self.reading
        inspection: Inspection | None = None
        if reading.program_running:
            inspection = self._done(self._request(protocol.Inspect(), REQUEST_DEADLINE_S)).value
        expected = None if self.expected_pose is None else self.expected_pose(reading.joints)
        answers = preflight.Answers(
            state.identity, state.remote_control, reading, inspection, expected, self._kinematics()
        )
        return preflight.findings(self._config, answers)

    def _kinematics(self) -> list[JointGeometry] | None:
        """Returns the arm's factory calibration, read once for each driver if the cell file states kinematics."""
        if self._config.kinematics is not None and self._reported is None:
            self._reported = primary.kinematics(self._config.address)
        return self._reported

    def recover(self, step: RecoveryStep) -> None:
        """Carries out one step out of a stop; see the Protocol `Arm`."""
        self._software.recover(step)

    def limits(self) -> tuple[str, ...]:
        """Lists what cannot be done, or cannot be checked, with the controller's software."""
        return self._software.limits()

    def move(self, path: Sequence[Sequence[float]], limits: Sequence[MotionLimits], stop: StopToken) -> None:
        """Moves through joint configurations (rad), one straight joint segment each; see the Protocol `Arm`.

        Renews the driver's lease while it waits. Raises Halted if the token was set; RigError arm.protective_stop,
        arm.emergency_stop, arm.not_ready, arm.move_failed, device.disconnected, driver.lost.
        """
        if stop.is_set():
            raise Halted
        move = protocol.Move(
            tuple(tuple(map(float, q)) for q in path), motion_limits.checked(self._config, path, limits)
        )
        if not move.path:
            return
        start, slowest = self.reading.joints, self.reading.speed_fraction
        halted, renewed_at = False, None

        def renew_lease() -> float:
            nonlocal halted, renewed_at, slowest
            self._memory.write(Field.LEASE, time.monotonic_ns())
            now = time.monotonic()
            if renewed_at is not None:
                self.lateness_s.append(now - renewed_at - protocol.LEASE_RENEWAL_S)
            renewed_at = now
            if stop.is_set() and not halted:
                halted = True
                self.halt()
            self._real_time.keep_share()
            slowest = min(slowest, self.reading.speed_fraction)  # a person may turn the slider down in mid-move
            return REQUEST_DEADLINE_S + 2.0 * move.seconds(start, slowest) + protocol.ACKNOWLEDGE_S

        self._real_time.enter()  # else other programs may delay this process until the lease runs out
        try:
            reply = self._request(move, REQUEST_DEADLINE_S, renew_lease)
        except RigError:
            if stop.is_set():
                raise Halted from None
            raise
        finally:
            self._real_time.leave()
        match reply:
            case Done():
                return
            case Failed(error):
                may_go_on = error.code != ErrorCode.ARM_NOT_READY  # which refuses a move before it begins
            case Interrupted(program_runs):
                may_go_on, error = not program_runs, RigError(ErrorCode.ARM_MOVE_FAILED, "A halt ended the move.")
        if may_go_on:
            self._stop_program()  # the move is over: nothing at the pendant may continue it
        if stop.is_set():
            raise Halted from error
        raise error

    def set_output(self, output: int, on: bool) -> None:
        """Sets the lamp's output and waits for its read-back; for `UrLamp`."""
        if output != self._lamp_output:
            detail = f"The arm's driver was set up for lamp output {self._lamp_output}, not {output}."
            raise RigError(ErrorCode.CONFIG_INVALID, detail)
        self._switch(protocol.SetLamp(on), halts=on)

    def pulse_output(self, output: int) -> None:
        """Raises and lowers an output, the trigger of a camera; returns when both levels were read back."""
        self._switch(protocol.PulseOutput(output), halts=True)

    def _switch(self, request: protocol.SetLamp | protocol.PulseOutput, *, halts: bool) -> None:
        reply = self._request(request, REQUEST_DEADLINE_S)
        if isinstance(reply, Interrupted) and halts:
            raise Halted
        if isinstance(reply, Failed):
            raise reply.error

    def close(self) -> None:
        """Ends the driver; the arm stands still, the lamp is off."""
        with self._pipe_lock:
            if self._process is not None and self._connection is not None:
                if self._program_stop is not None:
                    self._program_stop.unwatch()
                with contextlib.suppress(OSError):
                    self._connection.send((time.monotonic_ns(), protocol.Shutdown()))
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(SHUTDOWN_DEADLINE_S)
                self._kill_driver()
        program_stop, self._program_stop = self._program_stop, None
        if program_stop is not None:
            program_stop.close()

    # --------------------------------------------------------------------------------------------------------- driver

    def _start_driver(self) -> None:
        """Called with the pipe's lock held."""
        self._kill_driver()
        ours, theirs = socket.socketpair()
        with theirs:
            pipe, memory = theirs.fileno(), self._memory.descriptor
            self._process = subprocess.Popen(  # noqa: S603 - our own module, with two numbers as arguments
                [sys.executable, "-m", "acquisition.devices.ur.driver", str(pipe), str(memory)],
                pass_fds=(pipe, memory),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # ur-rtde prints there; its errors go to our standard error
            )
        self._connection, self._lost_reason = Connection(ours.detach()), ""
        opening = protocol.Open(self._config.address, self._lamp_output, self._config.stop_deceleration_rad_s2)
        reply = self._exchange(opening, OPEN_DEADLINE_S, None, watch_loop=False)
        if not isinstance(reply, Done):
            self._kill_driver()
            self._done(reply)
        deadline = time.monotonic() + protocol.HEARTBEAT_S
        while not self.reading.connected and time.monotonic() < deadline:
            time.sleep(protocol.TICK_S)

    def _driver_answers(self) -> bool:
        return (
            self._process is not None
            and self._process.poll() is None
            and self._memory.age_s(Field.HEARTBEAT) < protocol.HEARTBEAT_S
            and self.reading.connected
        )

    def _request(
        self,
        request: protocol.Request,
        deadline_s: float,
        while_waiting: Callable[[], float] | None = None,
        watch_loop: bool = True,
    ) -> protocol.Reply:
        with self._pipe_lock:
            return self._exchange(request, deadline_s, while_waiting, watch_loop)

    def _exchange(
        self, request: protocol.Request, deadline_s: float, while_waiting: Callable[[], float] | None, watch_loop: bool
    ) -> protocol.Reply:
        """Sends one request and returns its reply; `while_waiting`, called every LEASE_RENEWAL_S, gives its deadline.

        `watch_loop` is off where the driver is expected to block in a constructor of ur-rtde.
        """
        connection = self._connection
        if self._process is None or connection is None:
            raise RigError(ErrorCode.DRIVER_LOST, "The arm is not connected.")
        number, begun = time.monotonic_ns(), time.monotonic()
        try:
            if while_waiting is not None:
                deadline_s = while_waiting()
            connection.send((number, request))
            while True:
                if connection.poll(protocol.LEASE_RENEWAL_S):
                    answered, reply = cast(tuple[int, protocol.Reply], connection.recv())
                    if answered == number:
                        return reply
                if while_waiting is not None:
                    deadline_s = while_waiting()
                if watch_loop and self._memory.age_s(Field.HEARTBEAT) > protocol.HEARTBEAT_S:
                    raise self._declare_lost("The arm's driver hangs.")
                if time.monotonic() - begun > deadline_s:
                    raise self._declare_lost(f"The arm's driver did not answer within {deadline_s:.0f} s.")
        except (EOFError, ConnectionError) as error:
            raise self._declare_lost("The arm's driver ended.") from error

    def _declare_lost(self, detail: str) -> RigError:
        """Ends the driver's program, kills the driver, and returns the error that reports it."""
        self._lost_reason = detail.removesuffix(".")
        if self._took_control:  # otherwise a program that moves the arm is not ours to stop
            self._stop_program()
        self._kill_driver()
        return RigError(ErrorCode.DRIVER_LOST, detail)

    def _stop_program(self) -> None:
        if self._program_stop is not None:
            self._program_stop.stop_at_once()

    def _kill_driver(self) -> None:
        process, self._process = self._process, None
        connection, self._connection = self._connection, None
        self._took_control, self._reported = False, None
        if process is not None:
            process.kill()
            process.wait()
        if connection is not None:
            connection.close()

    def _done(self, reply: protocol.Reply) -> Done:
        if isinstance(reply, Failed):
            raise reply.error
        if isinstance(reply, Interrupted):
            raise RigError(ErrorCode.ARM_NOT_READY, "A halt interrupted the request.")
        return reply
