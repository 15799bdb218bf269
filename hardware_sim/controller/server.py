"""Event loop of the controller: sockets between ticks, ticks on absolute deadlines, one thread.

One thread needs no locks and gives every packet the values of exactly one tick; long tasks run elsewhere. After a delay
the missed ticks are caught up, so that time stamps stay 2 ms × ticks. After a long freeze (a stopped process) the time
is lost instead. A real controller has a machine of its own. While this process has no core, its clients on the same
machine have none either, so their watchdogs do not count that time.
"""

import logging
import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable

from hardware_sim.controller import control_port, dashboard, interpreter_port, rtde, streams
from hardware_sim.controller.calibration import calibrated
from hardware_sim.controller.control_port import ControlConnection
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.dashboard import DashboardConnection
from hardware_sim.controller.delay import Delay
from hardware_sim.controller.dynamics import Dynamics
from hardware_sim.controller.interpreter_port import InterpreterConnection
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.messages import MessageType, RobotMessage
from hardware_sim.controller.modes import RobotMode
from hardware_sim.controller.options import ControllerOptions, RealTime
from hardware_sim.controller.program_loader import ProgramLoader
from hardware_sim.controller.robot_api import RobotApiConnection
from hardware_sim.controller.rtde import RtdeConnection
from hardware_sim.controller.safety import BOOT_SECONDS
from hardware_sim.controller.script_values import STEP_TIME
from hardware_sim.controller.scripts import ReadOnlyConnection, ScriptConnection
from hardware_sim.controller.sockets import Connection, Port
from hardware_sim.controller.trace import Recorder

LOG = logging.getLogger("hardware_sim.controller")
_LONGEST_CATCH_UP = 1.0  # s
_FROZEN = 0.05  # s; a loop that is later than this had no core meanwhile
_SWEEP = 50  # ticks
_STATES = (streams.PRIMARY, streams.SECONDARY)
_STREAMS = (*_STATES, streams.REAL_TIME)
_AT_ONCE = 8  # descriptors served before the clock is read again; epoll gives the others their turn next


class Server:
    """All ports of one controller on one address."""

    def __init__(
        self, controller: Controller, address: str, *, for_urx: bool = False, robot_api_port: int | None = None
    ) -> None:
        """`robot_api_port` is that of PolyScope X, in place of the dashboard. Raises OSError if a port is in use."""
        self.controller = controller
        self._poll = select.epoll()
        self._owners: dict[str, object] = {}
        self._loader = ProgramLoader(controller)
        self._stall_ends: dict[int, float] = {}
        self._ports: dict[int, Port] = {}
        self._dynamics = Dynamics(controller.arm, controller.registers)
        self._safety_mode = controller.safety.safety_mode
        self._for_urx = for_urx
        accepts: dict[int, Callable[[socket.socket], Connection]] = {
            rtde.PORT: lambda s: RtdeConnection(s, controller, self._owners),
            **dict.fromkeys(_STREAMS, lambda s: ScriptConnection(s, controller, self._loader)),
            **{number + streams.READ_ONLY: ReadOnlyConnection for number in _STREAMS},
            interpreter_port.PORT: lambda s: InterpreterConnection(s, controller, self._loader),
            control_port.PORT: lambda s: ControlConnection(s, controller, self),
        }
        for number in (*_STATES, *(number + streams.READ_ONLY for number in _STATES)):
            accepts[number] = self._greeting(accepts[number])
        if robot_api_port is None:
            accepts[dashboard.PORT] = lambda s: DashboardConnection(s, controller, self.shut_down)
        else:
            accepts[robot_api_port] = lambda s: RobotApiConnection(s, controller, self.shut_down)
        try:
            for number, accept in accepts.items():
                self._ports[number] = Port(self._poll, address, number, accept)
        except OSError:
            self.close()
            raise
        self._ports[rtde.PORT].quick_acknowledge = True
        for number in _STREAMS:
            self._ports[number].may_stay_unread = True
        self._slow: list[Port] = []
        self._off = False
        self._reopen_at = 0.0

    def _greeting(self, accept: Callable[[socket.socket], Connection]) -> Callable[[socket.socket], Connection]:
        def take(stream: socket.socket) -> Connection:
            connection = accept(stream)
            connection.send(streams.version_message(self.controller.version, self.controller.timestamp))
            return connection

        return take

    def numbers(self) -> list[int]:
        """The ports of a real controller, without the control port, which cannot be cut."""
        return [number for number in self._ports if number != control_port.PORT]

    def cut(self, port: int) -> None:
        """Closes all connections of a port."""
        self._ports[port].cut()

    def stall(self, port: int, seconds: float) -> None:
        """Freezes a port for `seconds` of wall time."""
        self._ports[port].stall(True)
        self._stall_ends[port] = time.monotonic() + seconds

    def send_half_a_packet(self) -> None:
        """Sends half a data packet to RTDE clients and hangs up."""
        rtde.send_half_a_packet(self._rtde_connections(), self.controller)
        self._ports[rtde.PORT].sweep()

    def delay(self, port: int, latency: float, jitter: float, seed: int) -> None:
        """Holds back all bytes of a port, both ways, by `latency` + up to `jitter` seconds."""
        self._ports[port].delay(Delay(latency, jitter, seed) if latency or jitter else None)
        if self._ports[port] not in self._slow:
            self._slow.append(self._ports[port])

    def shut_down(self) -> None:
        """Switches the controller off: its ports close; only `restart` opens them again."""
        self.controller.power_off()
        self._reopen_at = math.inf
        self._off = True

    def restart(self) -> None:
        """Ends all connections and boots, which leaves the arm without power; the ports open half-way through that."""
        self.controller.reboot()
        self._reopen_at = time.monotonic() + BOOT_SECONDS / 2
        self._off = True

    def _switch(self, now: float) -> None:
        """Closes or opens the ports of a controller that was switched off, between two ticks."""
        ports = [self._ports[number] for number in self.numbers()]
        if now < self._reopen_at:
            for port in ports:
                if port.open:
                    port.shut()
            return
        self._off = False
        for port in ports:
            if not port.open:
                port.reopen()

    def _rtde_connections(self) -> list[RtdeConnection]:
        return [c for c in self._ports[rtde.PORT].connections.values() if isinstance(c, RtdeConnection)]

    def run(
        self, stop: Callable[[], bool], stop_descriptor: int | None, keep_share: Callable[[], None] = lambda: None
    ) -> None:
        """Serves until `stop` returns True or `stop_descriptor` reaches its end of file; `keep_share` once a turn."""
        if stop_descriptor is not None:
            self._poll.register(stop_descriptor, select.EPOLLIN)
        deadline = time.monotonic()
        while not stop():
            wait = deadline - time.monotonic()
            if wait > 0.0:
                # select waits in microseconds, epoll only in milliseconds.
                select.select([self._poll.fileno()], [], [], wait)
            late = time.monotonic() - deadline
            if late > _FROZEN:  # before the data that have arrived meanwhile are read
                self.controller.watchdogs.postpone(late)
            for descriptor, event in self._poll.poll(0, _AT_ONCE):
                if descriptor == stop_descriptor:
                    if not os.read(descriptor, 4096):
                        return
                    continue
                self._serve(descriptor, event)
            now = time.monotonic()
            if now - deadline > _LONGEST_CATCH_UP:
                LOG.warning("the loop was late: %.3f s of controller time skipped", now - deadline)
                deadline = now
            while deadline <= now:
                deadline += STEP_TIME
                self._tick(now)
            keep_share()

    def _serve(self, descriptor: int, event: int) -> None:
        for port in self._ports.values():
            if descriptor == port.listener.fileno() or descriptor in port.connections:
                port.ready(descriptor, event)
                return

    def _tick(self, now: float) -> None:
        if self._stall_ends:
            for number in [n for n, end in self._stall_ends.items() if end <= now]:
                del self._stall_ends[number]
                self._ports[number].stall(False)
        if self._off:
            self._switch(now)
        for port in self._slow:
            if not port.stalled:
                port.pass_on(now)
        self._loader.start_compiled()
        self.controller.tick(now)
        self._announce()
        self._publish()
        if self.controller.ticks % _SWEEP == 0:
            for port in self._ports.values():
                port.sweep()

    def _announce(self) -> None:
        controller = self.controller
        if controller.safety.safety_mode is not self._safety_mode:
            self._safety_mode = controller.safety.safety_mode
            controller.announce(RobotMessage(MessageType.SAFETY_MODE, "", number=self._safety_mode))
        while controller.announcements:
            said = controller.announcements.popleft()
            if said.type is MessageType.RUNTIME_EXCEPTION:
                rtde.announce(self._rtde_connections(), said.text)
            for connection in self._readers(streams.PRIMARY):
                connection.offer(streams.message(said, controller.timestamp))

    def _readers(self, number: int) -> list[Connection]:
        """The clients of a stream and of its read-only twin that have read everything sent to them."""
        ports = (self._ports[number], self._ports[number + streams.READ_ONLY])
        return [c for port in ports if not port.stalled for c in port.connections.values() if not c.unsent]

    def _publish(self) -> None:
        """Sends the tick's values; only those that a client reads are computed and packed."""
        controller = self.controller
        port = self._ports[rtde.PORT]
        clients = [] if port.stalled else self._rtde_connections()
        real_time = self._readers(streams.REAL_TIME)
        due = controller.ticks % streams.STATE_TICKS == 0
        states = {number: self._readers(number) for number in _STATES} if due else {}
        if real_time or any(states.values()) or any(c.reads_dynamics for c in clients):
            self._dynamics.publish(controller.timestamp, controller.safety.robot_mode is RobotMode.RUNNING)
        rtde.broadcast(clients, controller)
        if real_time:
            packet = streams.real_time_packet(controller.registers)
            for connection in real_time:
                connection.offer(packet)
        for number, readers in states.items():
            if readers:
                short = self._for_urx and number == streams.SECONDARY
                packet = streams.robot_state(controller, short_mode=short)
                for connection in readers:
                    connection.offer(packet)

    def close(self) -> None:
        self._loader.close()
        for port in self._ports.values():
            port.close()
        self._poll.close()


def serve(
    address: str,
    options: ControllerOptions,
    *,
    stop: Callable[[], bool] = lambda: False,
    stop_descriptor: int | None = None,
    real_time: RealTime | None = None,
) -> None:
    """Runs a controller until `stop` returns True, `stop_descriptor` ends or the process is interrupted.

    With `real_time` its ticks come before the machine's other work, as on a machine of its own.

    Prints `ready <address>` when clients can connect. Never call it in a process that also holds `ur-rtde` objects: the
    library's constructors hold the interpreter lock while they wait for this loop. Raises OSError if a port is in use
    or a file cannot be opened, and ValueError if a file is invalid.
    """
    recorder = None if options.record is None else Recorder(options.record)
    controller = Controller(
        calibrated(MODELS[options.model], options.calibration_seed, options.calibration_error_m),
        options.home,
        now=time.monotonic(),
        speed_factor=options.speed,
        low_when_stopped=options.low_when_stopped,
        polyscope=options.polyscope,
        programs=options.programs,
        record=recorder,
    )
    if options.surroundings is not None:
        controller.collisions.surround(options.surroundings)
    robot_api_port = options.robot_api_port if options.polyscope == "x" else None
    server = Server(controller, address, for_urx=options.for_urx, robot_api_port=robot_api_port)
    try:
        sys.stdout.write(f"ready {address}\n")
        sys.stdout.flush()
        if real_time is None:
            server.run(stop, stop_descriptor)
        else:
            real_time.enter()
            server.run(stop, stop_descriptor, real_time.keep_share)
    finally:
        server.close()
        if recorder is not None:
            recorder.close()
