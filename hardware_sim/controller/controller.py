"""State and 2-ms tick of the controller: the arm, the program that it runs, its outputs and its stops.

Each tick: due orders → watchdogs → the program's turn → motion and collisions → values for the clients. Motion advances
by the speed factor × 2 ms; everything else keeps wall time. The controller has no sockets; the ports call it between
ticks.
"""

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from hardware_sim.controller import program_store, publication
from hardware_sim.controller.arm import Arm
from hardware_sim.controller.collisions import Collisions
from hardware_sim.controller.compiler import CompiledProgram, compile_program
from hardware_sim.controller.disturbances import Disturbances
from hardware_sim.controller.force import ForceMotion
from hardware_sim.controller.freedrive import HandMove
from hardware_sim.controller.functions import VOCABULARY, table
from hardware_sim.controller.interpreter import Interpreter
from hardware_sim.controller.kinematics import ArmModel
from hardware_sim.controller.messages import MessageType, RobotMessage
from hardware_sim.controller.modes import RuntimeState, SafetyMode
from hardware_sim.controller.motion import Motion, MotionError
from hardware_sim.controller.program import Program, ScriptError
from hardware_sim.controller.program_store import LoadedProgram
from hardware_sim.controller.registers import Registers
from hardware_sim.controller.safety import Safety
from hardware_sim.controller.script_links import ScriptLinks
from hardware_sim.controller.script_values import STEP_TIME
from hardware_sim.controller.signals import DIGITAL_OUTPUTS, Inputs, Outputs
from hardware_sim.controller.syntax import ScriptSyntaxError
from hardware_sim.controller.watchdogs import Watchdogs

LOG = logging.getLogger("hardware_sim.controller")

VERSION = (5, 11, 1, 108318)
VERSION_X = (10, 14, 0, 0)
"""First version of PolyScope X with the whole Robot API that `robot_api` serves; its build number is not published."""
PROGRAM_STOP_DECELERATION = 6.0  # rad/s², if a program ends during a move
SAFETY_STOP_DECELERATION = 15.0  # rad/s²
_PACE_RATE = 5.0  # per s: a pause from full speed takes 0.2 s
SERIAL = "20215500042"
_LONGEST_STEP = 0.008  # s of motion: large speed factors take several steps per tick
Record = Callable[["Controller", float], None]


class Controller:
    """A powered-on e-Series controller without sockets."""

    def __init__(
        self,
        model: ArmModel,
        home: Sequence[float],
        *,
        now: float,
        speed_factor: float = 1.0,
        low_when_stopped: Iterable[int] = (),
        polyscope: str = "5",
        programs: Path | None = None,
        record: Record | None = None,
    ) -> None:
        """`now` is time.monotonic(), `programs` the dashboard's folder; `record` receives each step's time stamp."""
        self.arm = Arm(model, home)
        self.registers, self.inputs = Registers(), Inputs()
        self.links, self.interpreter = ScriptLinks(), Interpreter()
        self.outputs = Outputs(low_when_stopped, now)
        self.serial = SERIAL
        self.version = VERSION_X if polyscope == "x" else VERSION
        self.speed_factor = speed_factor
        self.slider = 1.0
        self.ticks, self.now = 0, now
        self.safety = Safety(now)
        self.collisions = Collisions(model)
        self.disturbances = Disturbances()
        self.runtime_state = RuntimeState.STOPPED
        self.program_name = ""
        self.loaded: LoadedProgram | None = None
        self.force_mode_settings: dict[str, float] = {}
        self.messages: deque[str] = deque(maxlen=500)
        self.announcements: deque[RobotMessage] = deque(maxlen=256)  # not yet sent to clients
        self.programs = programs
        self._record = record
        self._program: Program | None = None
        self._secondary: list[Program] = []
        self._in_secondary = self._claimed = False
        self._unclaimed: Motion | None = None  # continues although no program claims it
        self.watchdogs = Watchdogs()
        self._could_run_before = True
        self._pace = 1.0
        self._orders: list[tuple[Callable[[], bool], Callable[[], object]]] = []
        self._functions = table(self)
        publication.steady(self.registers)
        self.tool_changed()
        publication.modes(self, self._pace)

    @property
    def timestamp(self) -> float:
        """Seconds since power-on, as RTDE clients see them."""
        return self.ticks * STEP_TIME

    @property
    def playing(self) -> bool:
        """Whether a program plays."""
        return self.runtime_state is RuntimeState.PLAYING

    def load(self, text: str) -> None:
        """Compiles a program and starts it."""
        try:
            self.start(compile_program(text, VOCABULARY))
        except ScriptSyntaxError as error:
            self.refuse(error)

    def refuse(self, error: ScriptSyntaxError) -> None:
        """Reports why a program could not be compiled; the running one continues."""
        self.runtime_exception(f"program refused: {error}")

    def start(self, compiled: CompiledProgram) -> None:
        """Starts a program in place of the running one, or a `sec` program beside it."""
        if not self.safety.remote_control:
            self.report("program refused: the robot is in local control")
            return
        if compiled.secondary:
            self._secondary.append(Program(compiled, self._functions))
            return
        if not self.safety.may_run:
            self.report(
                f"program {compiled.name} refused: {self.safety.robot_mode.name}, {self.safety.safety_mode.name}"
            )
            return
        self._end_program()
        self._program = Program(compiled, self._functions)
        self.program_name = compiled.name
        self.runtime_state = RuntimeState.PLAYING
        self.report(f"program {compiled.name} started", logging.INFO)
        self.announce(RobotMessage(MessageType.KEY, compiled.name, "PROGRAM_XXX_STARTED"))

    def stop_program(self, why: str) -> None:
        """Ends the program, if one runs or is paused; its motion brakes."""
        if self._program is not None:
            self.report(f"program {self._program.name} stopped: {why}", logging.INFO)
        self._end_program()

    def _end_program(self) -> None:
        program, self._program = self._program, None
        self.watchdogs.clear()
        self.runtime_state = RuntimeState.STOPPED
        if program is not None:
            program.close()
            self.announce(RobotMessage(MessageType.KEY, program.name, "PROGRAM_XXX_STOPPED"))
            self.links.close_all()
        self.arm.corner = None
        self.arm.freedrive = None
        self.outputs.tick(self.now, False)

    def pause(self) -> bool:
        """Pauses the program; returns whether one was playing."""
        if self.runtime_state is not RuntimeState.PLAYING:
            return False
        self.runtime_state = RuntimeState.PAUSING
        return True

    def load_file(self, name: str) -> bool:
        """Loads a program from the folder of programs, in place of the running one; False if there is none."""
        program = program_store.find(self.programs, name)
        if program is None:
            return False
        self.stop_program(f"{name} is loaded")
        self.loaded, self.program_name = program, program.name
        return True

    def play(self) -> bool:
        """Resumes a paused program or starts the loaded one; returns whether there was one that may run."""
        if not self.safety.may_run:
            return False
        if self._program is not None:
            if self.runtime_state not in (RuntimeState.PAUSED, RuntimeState.PAUSING):
                return False
            self.runtime_state = RuntimeState.RESUMING
            return True
        if self.loaded is None:
            return False
        self.load(self.loaded.text)
        if self._program is not None:
            self.program_name = self.loaded.name
        return self._program is not None

    def claim(self) -> None:
        """Lets the motion continue in this tick; a program's motion function calls it in each tick."""
        self._claimed = True

    def tool_changed(self) -> None:
        """Publishes the pose after the TCP was set while the arm stands."""
        publication.pose(self.arm, self.registers)

    def require_main_program(self) -> None:
        """Raises ScriptError if a secondary program tries to move the arm."""
        if self._in_secondary:
            raise ScriptError("a secondary program must not move the arm")

    def protective_stop(self, why: str) -> None:
        """Brakes at once and pauses the program until the stop is unlocked."""
        self._safety_stop(SafetyMode.PROTECTIVE_STOP, why)

    def safeguard_stop(self, why: str) -> None:
        """Brakes at once and pauses the program until the safeguard is closed again."""
        self._safety_stop(SafetyMode.SAFEGUARD_STOP, why)

    def _safety_stop(self, mode: SafetyMode, why: str) -> None:
        if not self.safety.stop(mode, why):
            return
        self.report(f"{mode.name}: {why}")
        if self._program is not None:
            self.runtime_state = RuntimeState.PAUSED
        self._close_secondary()
        self._brake(SAFETY_STOP_DECELERATION)

    def emergency_stop(self, why: str, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP) -> None:
        """Brakes, ends the program and takes the power away; `mode` may also be a violation or a fault."""
        self.report(f"{mode.name}: {why}")
        self.power_off()
        self.safety.emergency(mode, why)

    def power_off(self) -> None:
        """Takes the power away; the program ends."""
        self.stop_program("power off")
        self._close_secondary()
        self._brake(SAFETY_STOP_DECELERATION)
        self.safety.power_off()

    def clear(self) -> None:
        """Clears all faults: power on, brakes released, safety normal."""
        self.safety.reset()
        self.slider = 1.0
        self.arm.joint_offset = [0.0] * 6
        self.disturbances.light()
        for number in list(self.outputs.stuck):
            self.outputs.stick(number, None)

    def reboot(self) -> None:
        """Restarts as after a power cycle: the controller boots, then has no arm power; the arm stands still."""
        self.report("the controller restarts")
        self.power_off()
        self.outputs.write((1 << DIGITAL_OUTPUTS) - 1, 0)
        self.arm.set_tcp([0.0] * 6)
        self.arm.payload, self.slider, self.ticks = 0.0, 1.0, 0
        self.loaded, self.program_name = None, ""
        self.registers.values[:] = Registers().values
        publication.steady(self.registers)
        self.tool_changed()
        self.safety.boot()

    def move_by_hand(self, joints: Sequence[float], seconds: float) -> None:
        """Moves the arm by hand to joints (6,) in rad; pushing an arm that a program holds is a protective stop."""
        if self.arm.freedrive is not None:
            resists = self.arm.freedrive.resists(self.arm.base_from_tool, self.arm.tool_at(joints))
            if resists is not None:
                self.report(resists)
                return
        elif self.playing:
            self.protective_stop("somebody pushes the arm")
        self.report("the arm is moved by hand")
        if seconds == 0.0:
            self.collisions.reset()  # there is no path on which it could touch anything
        self._unclaimed = self.arm.steer(HandMove(self.arm.joints, joints, seconds))

    def offset_joints(self, offsets: Sequence[float]) -> None:
        """Makes the true joints differ from the reported ones by (6,) rad."""
        self.arm.joint_offset = list(offsets)
        self.collisions.reset()

    def nudge_object(self, shift_m: Sequence[float], turn_rad: float) -> None:
        """Moves the object by (3,) m and turns it about its own axis."""
        self.disturbances.nudge(shift_m, turn_rad)
        self.collisions.nudge_object(shift_m, turn_rad)

    def jump(self, seconds: float) -> None:
        """Makes time stamps jump ahead."""
        self.ticks += round(seconds / STEP_TIME)

    def _close_secondary(self) -> None:
        for program in self._secondary:
            program.close()
        self._secondary.clear()

    def _brake(self, deceleration: float) -> None:
        self._unclaimed = self.arm.brake(deceleration)

    def order(self, when: Callable[[], bool], action: Callable[[], object]) -> None:
        """Schedules an action for the first tick in which `when` holds."""
        self._orders.append((when, action))

    def report(self, message: str, level: int = logging.WARNING) -> None:
        """Writes to the log and keeps the message for the control port."""
        self.messages.append(f"{self.timestamp:.3f} {message}")
        LOG.log(level, "%.3f %s", self.timestamp, message)

    def runtime_exception(self, message: str) -> None:
        """Reports why a program was refused or ended by itself, to the log and through the ports to clients."""
        self.report(message)
        self.announce(RobotMessage(MessageType.RUNTIME_EXCEPTION, message))

    def announce(self, message: RobotMessage) -> None:
        """Queues a message that the ports send to their clients."""
        self.announcements.append(message)

    def tick(self, now: float) -> None:
        """Advances by one tick; `now` is time.monotonic()."""
        self.now = now
        self.ticks += 1
        self.safety.tick(now)
        if self._orders:
            waiting, self._orders = self._orders, []
            for when, action in waiting:
                if when():
                    action()
                else:
                    self._orders.append((when, action))
        late = self.watchdogs.expired(now) if self.playing else None
        if late is not None and late[0] == "stop":
            self.stop_program(late[1])
        elif late is not None and late[0] == "pause":
            self.pause()
        self._claimed = False
        self._run_programs()
        if self.safety.may_run and not self._could_run_before:
            self.collisions.reset()
        self._could_run_before = self.safety.may_run
        self._move()
        self.outputs.tick(now, self.playing)
        if self._record is not None:
            self._record(self, self.timestamp)
        self.registers.set("script_control_line", 0 if self._program is None else self._program.line)
        publication.modes(self, self._pace)

    def _run_programs(self) -> None:
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
            self._unclaimed = None
        elif self._program is not None and isinstance(arm.motion, ForceMotion):
            pass  # force mode goes on without further calls
        elif not self._claimed and not paused and arm.motion is not self._unclaimed and arm.corner is None:
            self._brake(PROGRAM_STOP_DECELERATION)
        wanted = 0.0 if paused else self.slider
        dt = self.speed_factor * STEP_TIME
        if arm.motion is None:
            self._pace = wanted
            if self.collisions.due:
                self._check_collisions()
        else:
            steps = max(1, math.ceil(dt / _LONGEST_STEP - 1e-9))
            for number in range(1, steps + 1):
                change = _PACE_RATE * dt / steps
                self._pace += max(-change, min(change, wanted - self._pace))
                try:
                    arm.step(dt / steps, self._pace)
                except MotionError as fault:
                    self.protective_stop(str(fault))
                self._check_collisions()
                if self._record is not None and number < steps:  # the last one is the tick's own row
                    self._record(self, self.timestamp + (number / steps - 1.0) * STEP_TIME)
            publication.pose(arm, self.registers)
        arm.end_tick()
        if self.runtime_state is RuntimeState.PAUSING and not arm.moving:
            self.runtime_state = RuntimeState.PAUSED

    def _check_collisions(self) -> None:
        """Stops protectively if the arm has begun to touch a body."""
        collision = self.collisions.advance(self.arm.true_joints, self.timestamp)
        if collision is not None:
            self.report(f"COLLISION: {collision.parts}")
            self.protective_stop(collision.parts)
