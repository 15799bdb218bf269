"""The controller: the arm, its modes, the program it runs, its outputs, in ticks of 2 ms.

Each tick: due orders → watchdogs → the program's turn → motion → values for the clients. Motion advances by the speed
factor × 2 ms, everything else keeps wall time. Nothing here knows sockets; the ports call in between ticks.
"""

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from hardware_sim.controller import publication
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.compiler import CompiledProgram, compile_program
from hardware_sim.controller.functions import VOCABULARY, table
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.modes import RobotMode, RuntimeState, SafetyMode
from hardware_sim.controller.motion import Motion, MotionError
from hardware_sim.controller.outputs import Outputs
from hardware_sim.controller.program import Program, ScriptError
from hardware_sim.controller.registers import Registers
from hardware_sim.controller.script_values import STEP_TIME
from hardware_sim.controller.syntax import ScriptSyntaxError

LOG = logging.getLogger("hardware_sim.controller")

VERSION = (5, 11, 1, 108318)
UNLOCK_AFTER = 5.0  # s between a protective stop and its unlocking
PROGRAM_STOP_DECELERATION = 6.0  # rad/s², where a program ends in mid-move
SAFETY_STOP_DECELERATION = 15.0  # rad/s²
_PACE_RATE = 5.0  # per s: a pause from full speed takes 0.2 s
_LONGEST_STEP = 0.008  # s of motion: large speed factors take several steps per tick
SampleSink = Callable[[float, Sequence[float]], None]


@dataclass
class _Watchdog:
    """Set by a program: a variable must arrive at least this often."""

    period: float
    action: str
    last: float


class Controller:
    """A powered-on e-Series controller without sockets."""

    def __init__(
        self,
        model: ArmModel,
        home: Sequence[float],
        *,
        now: float,
        speed_factor: float = 1.0,
        low_when_stopped: Iterable[int] = (0,),
        serial: str = "20215500042",
        sample: SampleSink | None = None,
    ) -> None:
        """`now` is time.monotonic(); `sample` is called with motion's time stamp and the true joints."""
        self.arm = Arm(model, home)
        self.registers = Registers()
        self.outputs = Outputs(low_when_stopped, now)
        self.serial = serial
        self.speed_factor = speed_factor
        self.slider = 1.0
        self.ticks = 0
        self.now = now
        self.robot_mode = RobotMode.RUNNING
        self.safety_mode = SafetyMode.NORMAL
        self.runtime_state = RuntimeState.STOPPED
        self.remote_control = True
        self.popup: str | None = None
        self.program_name = ""
        self.force_mode_settings: dict[str, float] = {}
        self.messages: deque[str] = deque(maxlen=500)
        self.exceptions: deque[str] = deque(maxlen=16)  # not yet sent to clients
        self._sample = sample
        self._program: Program | None = None
        self._secondary: list[Program] = []
        self._in_secondary = False
        self._claimed = False
        self._own_brake: Motion | None = None
        self._watchdogs: dict[str, _Watchdog] = {}
        self._stopped_at = -math.inf
        self._pace = 1.0
        self._orders: list[tuple[Callable[[], bool], Callable[[], None]]] = []
        self._functions = table(self)
        publication.steady(self.registers)
        self.tool_changed()
        publication.modes(self, self._pace)

    # --- the program -----------------------------------------------------------------------------------------

    @property
    def timestamp(self) -> float:
        """Seconds since power-on, as RTDE clients see them."""
        return self.ticks * STEP_TIME

    @property
    def playing(self) -> bool:
        """Whether a program plays."""
        return self.runtime_state is RuntimeState.PLAYING

    @property
    def may_run(self) -> bool:
        """Whether modes allow a program."""
        return self.robot_mode is RobotMode.RUNNING and self.safety_mode in (SafetyMode.NORMAL, SafetyMode.REDUCED)

    def load(self, text: str) -> None:
        """Compiles a program and starts it."""
        try:
            self.start(compile_program(text, VOCABULARY))
        except ScriptSyntaxError as error:
            self.refuse(error)

    def refuse(self, error: ScriptSyntaxError) -> None:
        """Says why a program could not be compiled; what runs goes on."""
        self.runtime_exception(f"program refused: {error}")

    def start(self, compiled: CompiledProgram) -> None:
        """Starts a program in place of the running one, a `sec` beside it."""
        if not self.remote_control:
            self.report("program refused: the robot is in local control")
            return
        if compiled.secondary:
            self._secondary.append(Program(compiled, self._functions))
            return
        if not self.may_run:
            self.report(f"program {compiled.name} refused: {self.robot_mode.name}, {self.safety_mode.name}")
            return
        self._end_program()
        self._program = Program(compiled, self._functions)
        self.program_name = compiled.name
        self.runtime_state = RuntimeState.PLAYING
        self.report(f"program {compiled.name} started", logging.INFO)

    def stop_program(self, why: str) -> None:
        """Ends the program, if one runs or is paused; its motion brakes."""
        if self._program is not None:
            self.report(f"program {self._program.name} stopped: {why}", logging.INFO)
        self._end_program()

    def _end_program(self) -> None:
        program, self._program = self._program, None
        self._watchdogs.clear()
        self.runtime_state = RuntimeState.STOPPED
        if program is not None:
            program.close()
        self.arm.corner = None
        self.outputs.tick(self.now, False)

    def pause(self) -> bool:
        """Pauses the program; returns whether one was playing."""
        if self.runtime_state is not RuntimeState.PLAYING:
            return False
        self.runtime_state = RuntimeState.PAUSING
        return True

    def play(self) -> bool:
        """Resumes a paused program; returns whether there was one that may run."""
        if self._program is None or self.runtime_state not in (RuntimeState.PAUSED, RuntimeState.PAUSING):
            return False
        if not self.may_run or not self.remote_control:
            return False
        self.runtime_state = RuntimeState.RESUMING
        return True

    def claim(self) -> None:
        """Called by a program's motion function in each tick in which it wants its motion to go on."""
        self._claimed = True

    def tool_changed(self) -> None:
        """Publishes the pose after the TCP was set while the arm stands."""
        publication.pose(self.arm, self.registers)

    def require_main_program(self) -> None:
        """Raises ScriptError where a secondary program tries to move the arm."""
        if self._in_secondary:
            raise ScriptError("a secondary program must not move the arm")

    def set_watchdog(self, variable: str, frequency: float, action: str) -> None:
        """Arms a watchdog for the program's life; frequency in Hz."""
        self._watchdogs[variable] = _Watchdog(1.0 / frequency, action, self.now)

    def inputs_arrived(self, names: frozenset[str], now: float) -> None:
        """Feeds the watchdogs with the names of a packet."""
        for variable, watchdog in self._watchdogs.items():
            if variable in names:
                watchdog.last = now

    # --- modes -----------------------------------------------------------------------------------------------

    def protective_stop(self, why: str) -> None:
        """Brakes at once and pauses the program until somebody unlocks."""
        self._safety_stop(SafetyMode.PROTECTIVE_STOP, why)

    def safeguard_stop(self, why: str) -> None:
        """Brakes at once and pauses the program until the safeguard is closed again."""
        self._safety_stop(SafetyMode.SAFEGUARD_STOP, why)

    def _safety_stop(self, mode: SafetyMode, why: str) -> None:
        if not self.may_run:
            return
        self.report(f"{mode.name}: {why}")
        self.safety_mode = mode
        self._stopped_at = self.now
        if self._program is not None:
            self.runtime_state = RuntimeState.PAUSED
        self._close_secondary()
        self._brake(SAFETY_STOP_DECELERATION)

    def unlock(self) -> str | None:
        """Ends a protective stop; returns why not, or None when done."""
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return "Cannot unlock protective stop: there is none"
        if self.now - self._stopped_at < UNLOCK_AFTER:
            return "Cannot unlock protective stop until 5s after occurrence. Always inspect cause before unlocking"
        self.safety_mode = SafetyMode.NORMAL
        return None

    def release_safeguard(self) -> None:
        """Ends a safeguard stop."""
        if self.safety_mode is SafetyMode.SAFEGUARD_STOP:
            self.safety_mode = SafetyMode.NORMAL

    def emergency_stop(self, why: str, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP) -> None:
        """Brakes, ends the program, takes the power away; also violation and fault."""
        self.report(f"{mode.name}: {why}")
        self.safety_mode = mode
        self._power_down()

    def release_emergency_stop(self) -> None:
        """Ends an emergency stop; the arm stays without power."""
        if self.safety_mode in (SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP):
            self.safety_mode = SafetyMode.NORMAL

    def restart_safety(self) -> None:
        """Ends a violation or a fault; the arm stays without power."""
        if self.safety_mode in (SafetyMode.VIOLATION, SafetyMode.FAULT):
            self.safety_mode = SafetyMode.NORMAL
            self.robot_mode = RobotMode.POWER_OFF

    def clear(self) -> None:
        """Makes everything normal again, as after a visit of somebody with time: powered, released, no fault left."""
        self.safety_mode = SafetyMode.NORMAL
        self.robot_mode = RobotMode.RUNNING
        self.remote_control = True
        self.slider = 1.0
        self.arm.joint_offset = [0.0] * 6
        for number in list(self.outputs.stuck):
            self.outputs.stick(number, None)

    def power_off(self) -> None:
        """Takes the power away; the program ends."""
        self._power_down()

    def _power_down(self) -> None:
        self.stop_program("power off")
        self._close_secondary()
        self._brake(SAFETY_STOP_DECELERATION)
        self.robot_mode = RobotMode.POWER_OFF

    def power_on(self) -> None:
        """Powers the joints; the brakes stay closed."""
        if self.robot_mode is RobotMode.POWER_OFF and self.safety_mode in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            self.robot_mode = RobotMode.IDLE

    def release_brakes(self) -> None:
        """Opens the brakes, powering on first where needed."""
        self.power_on()
        if self.robot_mode is RobotMode.IDLE and not self.arm.moving:
            self.robot_mode = RobotMode.RUNNING

    def _close_secondary(self) -> None:
        for program in self._secondary:
            program.close()
        self._secondary.clear()

    def _brake(self, deceleration: float) -> None:
        self._own_brake = self.arm.brake(deceleration)

    # --- time ------------------------------------------------------------------------------------------------

    def order(self, when: Callable[[], bool], action: Callable[[], None]) -> None:
        """Does something between two ticks, as soon as `when` holds."""
        self._orders.append((when, action))

    def jump_in_time(self, seconds: float) -> None:
        """Makes the time stamps jump forward; nothing else notices."""
        self.ticks += round(seconds / STEP_TIME)

    def report(self, message: str, level: int = logging.WARNING) -> None:
        """Writes to the log and keeps the message for the control port."""
        self.messages.append(f"{self.timestamp:.3f} {message}")
        LOG.log(level, "%.3f %s", self.timestamp, message)

    def runtime_exception(self, message: str) -> None:
        """Reports why a program was refused or ended by itself: to the log, and by the ports to clients that listen."""
        self.report(message)
        self.exceptions.append(message)

    def tick(self, now: float) -> None:
        """Advances by one tick; `now` is time.monotonic()."""
        self.now = now
        self.ticks += 1
        if self._orders:
            waiting = self._orders
            self._orders = []
            for when, action in waiting:
                if when():
                    action()
                else:
                    self._orders.append((when, action))
        if self._watchdogs and self.playing:
            self._check_watchdogs()
        self._claimed = False
        self._take_turns()
        self._move()
        self.outputs.tick(now, self.playing)
        publication.modes(self, self._pace)

    def _check_watchdogs(self) -> None:
        for variable, watchdog in list(self._watchdogs.items()):
            if self.now - watchdog.last > watchdog.period:
                watchdog.last = self.now
                if watchdog.action == "stop":
                    self.stop_program(f"watchdog: {variable} did not arrive for {watchdog.period:.3f} s")
                    return
                if watchdog.action == "pause":
                    self.pause()

    def _take_turns(self) -> None:
        if self.runtime_state is RuntimeState.RESUMING:
            self.runtime_state = RuntimeState.PLAYING
        program = self._program
        if program is not None and self.playing:
            try:
                program.turn()
            except ScriptError as error:
                self.runtime_exception(f"runtime exception in {program.name}: {error}")
                self._end_program()
            else:
                if program.finished and self._program is program:
                    self.stop_program("finished")
        if self._secondary:
            self._in_secondary = True
            for secondary in self._secondary:
                try:
                    secondary.turn()
                except ScriptError as error:
                    self.runtime_exception(f"runtime exception in {secondary.name}: {error}")
                    secondary.close()
            self._secondary = [s for s in self._secondary if not s.finished]
            self._in_secondary = False

    def _move(self) -> None:
        arm = self.arm
        paused = self.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED)
        if arm.motion is None:
            self._own_brake = None
        elif not self._claimed and not paused and arm.motion is not self._own_brake and arm.corner is None:
            self._brake(PROGRAM_STOP_DECELERATION)
        wanted = 0.0 if paused else self.slider
        dt = self.speed_factor * STEP_TIME
        if arm.motion is None:
            self._pace = wanted
        else:
            steps = max(1, math.ceil(dt / _LONGEST_STEP - 1e-9))
            for number in range(1, steps + 1):
                change = _PACE_RATE * dt / steps
                self._pace += max(-change, min(change, wanted - self._pace))
                try:
                    arm.step(dt / steps, self._pace)
                except MotionError as fault:
                    self.protective_stop(str(fault))
                if self._sample is not None:
                    self._sample(self.timestamp + (number / steps - 1.0) * STEP_TIME, arm.true_joints)
            publication.pose(arm, self.registers)
        arm.end_tick()
        if self.runtime_state is RuntimeState.PAUSING and not arm.moving:
            self.runtime_state = RuntimeState.PAUSED
