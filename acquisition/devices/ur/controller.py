"""The controller as the driver process uses it: one generator method per request, one `sample`, one `stop`.

Requests are generators that yield once per turn of the driver's loop, so that readings, halts, lease and watchdog are
attended to during a move. Rules that keep a person safe: only asynchronous moves; no command is ever sent twice; the
control program is uploaded when `take_control` is requested and never by itself; a program that ended stays ended.
"""

import logging
import math
import time
from collections.abc import Generator
from typing import cast

from acquisition.devices.ur import protocol, states
from acquisition.devices.ur.interfaces import Constructors, Control, Outputs, Receive
from acquisition.devices.ur.protocol import Done, Link, Vector6
from acquisition.devices.ur.tcp import refuse_foreign
from acquisition.models.errors import ErrorCode, RigError
from acquisition.process_priority import RealTime

_log = logging.getLogger(__name__)

Task = Generator[None, None, Done]

START_S = 1.0  # within which an accepted move shows its operation's number
STALL_S = 5.0  # after which a move that comes no nearer to its goal has failed
REST_WITHIN_S = 1.0
REST_SAMPLES = 5
CONFIRM_S = 0.5  # within which an output is read back
PREDECESSOR_S = 1.0  # within which the watchdog ends the program of a driver that died
UPLOAD_S = 5.0
NEWER_S = 0.06  # data newer than an event by this much show the event on both interfaces
FRESH_S = 0.01  # data newer by this much show the level of an output
SLEPT_S = 0.1  # longer between two turns: this process had no core, or a call of ur-rtde was slow
AWAKE_S = 0.1  # within which ur-rtde's own thread reads what came while the process slept


class Controller:
    """The ur-rtde objects, and whether the control program is ours, running and guarded by its watchdog."""

    def __init__(self, constructors: Constructors, real_time: RealTime) -> None:
        """`real_time` is left during a constructor, which may occupy a core for seconds."""
        self._real_time = real_time
        self._constructors = constructors
        self._open_request: protocol.Open | None = None
        self._receive: Receive | None = None
        self._outputs: Outputs | None = None
        self._control: Control | None = None
        self._armed = False  # once lost, only take_control restores it
        self._lamp_confirmed: bool | None = None  # level read back since the lamp was last written; None: not yet
        self._kicked_at = 0.0
        self._timestamp = -1.0
        self._received_at = 0.0
        self._sampled_at = self._awake_since = time.monotonic()
        self._slept_s = 0.0

    # ------------------------------------------------------------------------------------------------------- each turn

    def sample(self) -> protocol.Sample | None:
        """Returns the newest values; None before `open`, and if nothing has changed since the last call."""
        receive = self._receive
        if receive is None:
            return None
        timestamp, was_armed = receive.getTimestamp(), self._armed
        now = time.monotonic()
        is_new = timestamp != self._timestamp
        if is_new:
            self._timestamp, self._received_at = timestamp, now
        if now - self._sampled_at > SLEPT_S:
            self._awake_since, self._slept_s = now, now - self._sampled_at
        self._sampled_at = now
        self._armed = self._armed and self._control is not None and self._control.isProgramRunning()
        link = self._link(receive, now)
        if not is_new and self._armed == was_armed and link is Link.OK:
            return None  # in half of the turns; reading everything again would double the load of the process
        return protocol.Sample(
            joints=tuple(receive.getActualQ()),
            joint_speeds=tuple(receive.getActualQd()),
            base_from_tool=tuple(receive.getActualTCPPose()),
            timestamp=timestamp,
            speed_fraction=receive.getTargetSpeedFraction(),
            received_at=self._received_at,
            robot_mode=receive.getRobotMode(),
            safety_bits=receive.getSafetyStatusBits(),
            runtime_state=int(receive.getRuntimeState()),
            digital_outputs=receive.getActualDigitalOutputBits(),
            program_running=self._armed,
            link=link,
        )

    def kick(self) -> None:
        """Kicks the controller's watchdog; also at rest, because the watchdog guards the program's whole life."""
        now = time.monotonic()
        if self._armed and self._control is not None and now - self._kicked_at > protocol.KICK_S:
            self._kicked_at = now
            self._control.kickWatchdog()

    def stop(self) -> bool:
        """Switches the lamp off (sent at once), then stops synchronously; harmless at rest and without a program.
        Returns whether the program still runs, and so has ended its move."""
        unwritten: RuntimeError | None = None
        if self._open_request is None:
            return False
        if self._outputs is not None:
            try:
                self._write_lamp(False)
            except RuntimeError as error:  # a dead connection; without a program the controller switches the lamp off
                unwritten = error
        if self._control is not None and self._control.isProgramRunning():
            self._control.stopJ(self._open_request.stop_deceleration_rad_s2)
        if unwritten is not None:  # logged last, because a log may block
            _log.error("the lamp's output cannot be written: %s", unwritten)
        return self._control is not None and self._control.isProgramRunning()

    # -------------------------------------------------------------------------------------------------------- requests

    def open(self, request: protocol.Open) -> Task:
        """Connects the receive and output interfaces and switches the lamp off; takes no control, stops no program."""
        refuse_foreign(request.address)
        self._open_request = request
        try:
            self._receive = self._constructors.receive(request.address)
            self._outputs = self._constructors.outputs(request.address)
        except RuntimeError as error:
            raise _refusal(error, request.address) from error
        self._real_time.enter()
        yield
        self._write_lamp(False)
        return Done()

    def take_control(self, request: protocol.TakeControl) -> Task:
        """Uploads the program unless ours runs, sets TCP and payload, arms the watchdog."""
        opened, receive = self._require_open()
        if self._armed:
            yield from self._await_newer_data()  # the program may have ended since the last data
        if not self._armed:
            self._require_power_and_safety(receive)
            # A running program is a stranger's, or that of a driver that died: its watchdog is about to end it.
            deadline = time.monotonic() + PREDECESSOR_S
            while receive.getRuntimeState() == states.PROGRAM_PLAYING:
                if time.monotonic() > deadline:
                    raise RigError(
                        ErrorCode.ARM_IN_USE, "Another program runs on the controller; the service stops only its own."
                    )
                yield
            control = yield from self._upload(opened.address)
        else:
            control = self._require_control()
        tool, payload, center = request.flange_from_tool, request.payload_kg, request.payload_center_m
        if not (control.setTcp(list(tool)) and control.setPayload(payload, list(center))):
            raise (yield from self._failure_cause("The controller refused the TCP or the payload."))
        if not self._armed:
            if not control.setWatchdog(protocol.WATCHDOG_HZ):
                raise (yield from self._failure_cause("The controller refused the watchdog."))
            self._kicked_at = time.monotonic()
            self._armed = True
        yield from self._await_newer_data()
        return Done()

    def inspect(self) -> Task:
        """Returns what preflight compares with the cell file."""
        yield
        _, receive = self._require_open()
        control = self._require_control()
        inspection = protocol.Inspection(
            flange_from_tool=_vector6(control.getTCPOffset()),
            payload_kg=receive.getPayload(),
            payload_center_m=cast(tuple[float, float, float], tuple(receive.getPayloadCog())),
            base_from_tool_forward=_vector6(control.getForwardKinematics()),
            base_from_tool_measured=_vector6(receive.getActualTCPPose()),
        )
        return Done(inspection)

    def set_lamp(self, on: bool) -> Task:
        """Switches the lamp and waits until the controller's own data show it."""
        opened, receive = self._require_open()

        def is_on() -> bool:
            return bool(receive.getActualDigitalOutputBits() >> opened.lamp_output & 1)

        was_on = is_on()
        if was_on == on == self._lamp_confirmed:
            yield from self._await_newer_data(FRESH_S)
            if is_on() == on:
                return Done()
        self._write_lamp(on)
        deadline = time.monotonic() + CONFIRM_S
        if was_on == on:  # the level does not change, so only newer data are evidence
            yield from self._await_newer_data()
        while is_on() != on:
            if time.monotonic() > deadline:
                self._write_lamp(False)
                number = opened.lamp_output
                raise RigError(ErrorCode.LAMP_NOT_CONFIRMED, _unswitched(str(number), on), output=number)
            yield
        self._lamp_confirmed = on
        return Done()

    def pulse_output(self, output: int) -> Task:
        """Lowers the output if it is high, raises it until the controller's own data show it, and lowers it.

        Raises RigError camera.timeout if an edge is not read back.
        """
        _, receive = self._require_open()

        def is_high() -> bool:
            return bool(receive.getActualDigitalOutputBits() >> output & 1)

        for level in (False, True, False) if is_high() else (True, False):
            self._write_output(output, level)
            deadline = time.monotonic() + CONFIRM_S
            while is_high() != level:
                if time.monotonic() > deadline:
                    self._write_output(output, False)
                    raise RigError(ErrorCode.CAMERA_TIMEOUT, _unswitched(f"{output}, the camera's trigger,", level))
                yield
        return Done()

    def move(self, move: protocol.Move) -> Task:
        """Sends one asynchronous moveJ after the other, none unless the controller finds every goal within its safety
        limits, then waits for rest at the last goal."""
        control = self._require_control()
        for goal in move.path:
            if not control.isJointsWithinSafetyLimits(list(goal)):
                detail = f"The joint angles {_degrees(goal)} degrees are outside the controller's safety limits."
                raise (yield from self._failure_cause(detail))
            yield
        for goal, (speed, acceleration) in zip(move.path, move.limits, strict=True):
            control = self._require_control()
            before = control.getAsyncOperationProgressEx().operationId()
            if not control.moveJ(list(goal), speed, acceleration, True):
                raise (yield from self._failure_cause("The controller refused a move."))
            yield from self._follow(control, before, goal)
        yield from self._await_rest(move.path[-1])
        return Done()

    # ---------------------------------------------------------------------------------------------------------- pieces

    def _upload(self, address: str) -> Generator[None, None, Control]:
        if self._control is None:
            self._real_time.leave()
            try:
                self._control = self._constructors.control(address)  # uploads, and waits for the program
            except RuntimeError as error:
                raise _refusal(error, address) from error
            finally:
                self._real_time.enter()  # its threads too; before the watchdog is armed
            return self._control
        control = self._control
        control.reuploadScript()  # returns before the program runs
        deadline = time.monotonic() + UPLOAD_S
        while not control.isProgramRunning():
            if time.monotonic() > deadline:
                raise (yield from self._failure_cause("The control program did not start."))
            yield
        return control

    def _follow(self, control: Control, before: int, goal: tuple[float, ...]) -> Generator[None, None, None]:
        """Waits for the end of an operation.

        "Not yet started", "finished" and "the program died" look alike in the status word. So the operation's number
        must first change, then stop running, with the program running and safety normal throughout.
        """
        _, receive = self._require_open()
        started = nearer_at = time.monotonic()
        nearest = float("inf")
        while True:
            yield
            now = time.monotonic()
            if not self._armed or states.safety_fault(receive.getSafetyStatusBits()) is not None:
                detail = "The control program ended during the move. Was it stopped at the pendant?"
                raise (yield from self._failure_cause(detail))
            status = control.getAsyncOperationProgressEx()
            if status.operationId() != before:
                if not status.isAsyncOperationRunning():
                    return
            elif now - started > START_S:
                detail = f"The controller accepted a move but did not start it within {START_S:g} s."
                raise RigError(ErrorCode.ARM_MOVE_FAILED, detail)
            distance = _distance(receive.getActualQ(), goal)
            if distance < nearest - 1e-4:
                nearest, nearer_at = distance, now
            elif now - nearer_at > STALL_S:
                detail = f"The arm makes no progress, {distance:.3f} rad from its goal. Is the speed slider at 0?"
                raise RigError(ErrorCode.ARM_MOVE_FAILED, detail)

    def _await_rest(self, goal: tuple[float, ...]) -> Generator[None, None, None]:
        """Waits for REST_SAMPLES readings at the goal and at rest; the two interfaces' packets are not in step."""
        _, receive = self._require_open()
        deadline = time.monotonic() + REST_WITHIN_S
        rest_samples, last_timestamp = 0, -1.0
        while rest_samples < REST_SAMPLES:
            yield
            if not self._armed:
                raise (yield from self._failure_cause("The control program ended before the arm was at rest."))
            if self._timestamp == last_timestamp:
                continue
            last_timestamp = self._timestamp
            distance = _distance(receive.getActualQ(), goal)
            speed = max(map(abs, receive.getActualQd()))
            at_rest = distance < protocol.GOAL_TOLERANCE_RAD and speed < protocol.REST_SPEED_RAD_S
            rest_samples = rest_samples + 1 if at_rest else 0
            if time.monotonic() > deadline:
                raise (
                    yield from self._failure_cause(
                        f"The move ended {distance:.4f} rad from its goal, at {speed:.4f} rad/s."
                    )
                )

    def _failure_cause(self, otherwise: str) -> Generator[None, None, RigError]:
        """Returns the reason of a failure from newer data: the packets of the two interfaces are not in step."""
        _, receive = self._require_open()
        yield from self._await_newer_data()
        fault = states.safety_fault(receive.getSafetyStatusBits()) or states.power_fault(receive.getRobotMode())
        if fault is not None:
            return RigError(fault.code, fault.detail)
        return RigError(ErrorCode.ARM_MOVE_FAILED, otherwise)

    def _await_newer_data(self, by_s: float = NEWER_S) -> Generator[None, None, None]:
        """Waits for data newer than the last event; the driver's loop detects a lost link."""
        since = self._timestamp
        while self._timestamp < since + by_s:
            yield

    def _write_lamp(self, on: bool) -> None:
        opened, _ = self._require_open()
        self._lamp_confirmed = None
        self._write_output(opened.lamp_output, on)

    def _write_output(self, number: int, on: bool) -> None:
        if self._outputs is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The controller's outputs are not connected.")
        if number < 8:
            written = self._outputs.setStandardDigitalOut(number, on)
        elif number < 16:
            written = self._outputs.setConfigurableDigitalOut(number - 8, on)
        else:
            written = self._outputs.setToolDigitalOut(number - 16, on)
        if not written:
            raise RuntimeError(f"the command for output {number} was not sent")

    def _link(self, receive: Receive, now: float) -> Link:
        """Returns the state of the link and logs a lost one; the limit is longer just after this process slept."""
        awake_s = now - self._awake_since
        if not receive.isConnected():
            link = Link.READING_CLOSED
        elif now - self._received_at > (protocol.LINK_AT_MOST_S if awake_s < AWAKE_S else protocol.LINK_S):
            link = Link.SILENT
        elif self._control is not None and not self._control.isConnected():
            link = Link.CONTROL_CLOSED
        else:
            return Link.OK
        values = link.name, now - self._received_at, self._slept_s, awake_s
        _log.error("link lost (%s): data are %.2f s old; the driver slept for %.2f s, %.2f s ago", *values)
        return link

    def _require_open(self) -> tuple[protocol.Open, Receive]:
        if self._open_request is None or self._receive is None:
            raise RigError(ErrorCode.DEVICE_DISCONNECTED, "The arm is not connected.")
        return self._open_request, self._receive

    def _require_control(self) -> Control:
        _, receive = self._require_open()
        self._require_power_and_safety(receive)
        if self._control is None or not self._armed:
            raise RigError(ErrorCode.ARM_NOT_READY, "The control program is not running. Connect to the arm again.")
        return self._control

    def _require_power_and_safety(self, receive: Receive) -> None:
        fault = states.safety_fault(receive.getSafetyStatusBits()) or states.power_fault(receive.getRobotMode())
        if fault is not None:
            raise RigError(fault.code, fault.detail)


def _refusal(error: RuntimeError, address: str) -> RigError:
    text = str(error).replace("ur_rtde:", "").strip()
    if "already in use" in text:
        detail = "Another program controls the arm: the RTDE registers are already in use."
        return RigError(ErrorCode.ARM_IN_USE, detail, address=address)
    if "start control script" in text:
        return RigError(ErrorCode.ARM_NOT_READY, "The controller did not start the control program.", address=address)
    return RigError(ErrorCode.ARM_UNREACHABLE, f"The controller at {address} refused: {text}", address=address)


def _unswitched(output: str, on: bool) -> str:
    wanted, still = ("on", "off") if on else ("off", "on")
    return f"Output {output} was set {wanted}, but the controller still reports it {still} after {CONFIRM_S:g} s."


def _degrees(joints: tuple[float, ...]) -> str:
    return ", ".join(f"{math.degrees(joint):.1f}" for joint in joints)


def _distance(joints: list[float], goal: tuple[float, ...]) -> float:
    return max(abs(joint - wanted) for joint, wanted in zip(joints, goal, strict=True))


def _vector6(values: list[float]) -> Vector6:
    return cast(Vector6, tuple(values))
