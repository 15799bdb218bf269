"""The arm's driver process: the only importer of ur-rtde.

ur-rtde's constructors hold the interpreter lock, its calls can block for minutes, and its destructors can abort the
process. So it lives alone in this process, which is left by `os._exit`. There is one loop and no thread: publish the
newest reading, obey a halt, advance the request in progress by one step, check the lease, kick the controller's
watchdog, receive. Nothing in it blocks but ur-rtde's own short calls. If one hangs, the heartbeat in the shared memory
stands still, the kicks cease, the controller's watchdog ends the program, and the service halts by its own path.

All threads of the process are in the real-time class where that is permitted: the loop and the library's readers take
an eighth of a core. Starting Python and the library's constructors stay outside of that class, because they would keep
a core from all other processes for seconds (decision 53).

A lost link ends the process: ur-rtde would reconnect after a while and might send the move again.
"""

import faulthandler
import logging
import os
import signal
import socket
import sys
import time
import traceback
from multiprocessing.connection import Connection
from typing import NoReturn, cast

import rtde_control
import rtde_io
import rtde_receive

from acquisition import process_priority
from acquisition.devices.ur import protocol
from acquisition.devices.ur.controller import Controller, Task
from acquisition.devices.ur.interfaces import Constructors, Control, Outputs, Receive
from acquisition.devices.ur.protocol import Done, Failed, Field, Interrupted, Link, Request, SharedMemory
from acquisition.models.errors import ErrorCode, RigError
from acquisition.process_priority import Priority, RealTime

_log = logging.getLogger(__name__)

DATA_HZ = 125.0  # at the controller's full 500 Hz the library alone takes a quarter of a core
DATA = (
    "timestamp actual_q actual_qd actual_TCP_pose target_speed_fraction robot_mode safety_status_bits runtime_state "
    "actual_digital_output_bits payload payload_cog"
)
"""Requested variables: those that `interfaces.Receive` reads. By default ur-rtde requests no payload of PolyScope X."""

LEAVE_S = 2.0
SHARE = 0.4
"""Share of a core in real time; 0.12 is used at 125 Hz of data, and three drivers leave one of two cores free."""
LINK_LOST_STOP_S = 0.5  # to stop over a link lost in one direction; 2.5 s after the last data ur-rtde would reconnect


class LinkLostError(Exception):
    """The controller's data stand still, or a connection is closed."""


class Driver:
    """The loop: one controller, one request at a time."""

    def __init__(
        self, connection: Connection, memory: SharedMemory, controller: Controller, real_time: RealTime
    ) -> None:
        """`controller` enters and leaves `real_time` around its constructors."""
        self._connection = connection
        self._memory = memory
        self._controller = controller
        self._real_time = real_time
        self._leaving = False
        self._issued = 0
        self._request: Request | None = None
        self._task: Task | None = None

    def run(self) -> None:
        """Runs until the service ends, the link is lost, or a signal requests the end."""
        self._memory.write(
            Field.HALT_DONE, self._memory.read(Field.HALT_ACCEPTED)
        )  # the last driver may have died between the two
        while not self._leaving:
            self._memory.write(Field.HEARTBEAT, time.monotonic_ns())
            try:
                self._publish()
                self._carry_out_halt()
                self._advance()
                self._controller.kick()
                self._real_time.keep_share()
            except LinkLostError as error:
                self._reply(Failed(RigError(ErrorCode.DEVICE_DISCONNECTED, str(error))))
                self.end(LINK_LOST_STOP_S)
            self._accept()

    def leave(self, *_: object) -> None:
        """Ends the loop; a signal handler."""
        self._leaving = True

    def end(self, within_s: float = LEAVE_S) -> NoReturn:
        """Stops and leaves the process, within the given time whatever ur-rtde does."""
        faulthandler.dump_traceback_later(within_s, exit=True)
        try:
            self._controller.stop()
        finally:
            os._exit(0)

    def _publish(self) -> None:
        sample = self._controller.sample()
        if sample is not None:
            self._memory.publish(sample)
            if sample.link is not Link.OK:
                raise LinkLostError(f"The link to the arm is lost: {sample.lost}. Nothing moves until it is restored.")

    def _carry_out_halt(self) -> None:
        requested = self._memory.read(Field.HALT_REQUESTED)
        if requested == self._memory.read(Field.HALT_ACCEPTED):
            return
        self._memory.write(Field.HALT_ACCEPTED, requested)
        program_runs = self._controller.stop()
        self._memory.write(Field.HALT_DONE, requested)
        self._interrupt(program_runs)

    def _interrupt(self, program_runs: bool) -> None:
        if isinstance(self._request, protocol.Move | protocol.SetLamp | protocol.PulseOutput):
            self._reply(Interrupted(program_runs))

    def _advance(self) -> None:
        if self._task is None:
            return
        moving = isinstance(self._request, protocol.Move)
        try:
            if moving and self._memory.age_s(Field.LEASE) > protocol.LEASE_S:
                detail = "The service stopped responding during the move, so the driver stopped the arm."
                raise RigError(ErrorCode.ARM_MOVE_FAILED, detail)
            next(self._task)
        except StopIteration as finished:
            self._publish()  # whoever reads after the reply sees the effect of the request
            if self._real_time.granted:
                self._memory.write(Field.PRIORITY, Priority.REAL_TIME)
            self._reply(cast(Done, finished.value))
        except RigError as error:
            if moving:
                self._controller.stop()
            self._reply(Failed(error))
        except RuntimeError as error:  # what ur-rtde raises
            self._controller.stop()
            self._reply(Failed(RigError(ErrorCode.DEVICE_DISCONNECTED, f"The controller's interface failed: {error}")))

    def _accept(self) -> None:
        """Waits one tick for the next request; the end of the pipe means the end of the service."""
        try:
            due = time.monotonic() + protocol.TICK_S
            if not self._connection.poll(protocol.TICK_S):
                self._memory.count_wakeup(time.monotonic() - due)
                return
            issued, request = cast(tuple[int, Request], self._connection.recv())
        except (EOFError, ConnectionError):
            _log.warning("the service has ended: the arm is stopped")
            self._leaving = True
            return
        if self._task is not None:  # the service has abandoned the last request; it gets no reply
            self._controller.stop()
            self._task.close()
            self._task = None
        self._carry_out_halt()
        self._issued, self._request, self._task = issued, request, self._begin(request)
        if self._memory.read(Field.HALT_ACCEPTED) > issued:  # requested later than the request, but seen before it
            self._interrupt(program_runs=True)  # it holds no move of this request

    def _begin(self, request: Request) -> Task | None:
        match request:
            case protocol.Open():
                return self._controller.open(request)
            case protocol.TakeControl():
                return self._controller.take_control(request)
            case protocol.Move():
                return self._controller.move(request)
            case protocol.SetLamp():
                return self._controller.set_lamp(request.on)
            case protocol.PulseOutput():
                return self._controller.pulse_output(request.output)
            case protocol.Inspect():
                return self._controller.inspect()
            case protocol.Shutdown():
                self._leaving = True
                return None

    def _reply(self, reply: protocol.Reply) -> None:
        if self._task is None:
            return
        self._task.close()
        self._task, self._request = None, None
        try:
            self._connection.send((self._issued, reply))
        except ConnectionError:
            self._leaving = True


def _control(address: str) -> Control:
    # The service checks remote control itself, at every address; the library's own check leaves out loopback.
    interface = rtde_control.RTDEControlInterface
    flags = interface.FLAG_UPLOAD_SCRIPT.value | interface.FLAG_DISABLE_REMOTE_CONTROL_CHECK.value
    return cast(Control, interface(address, DATA_HZ, flags))


def _receive(address: str) -> Receive:
    return cast(Receive, rtde_receive.RTDEReceiveInterface(address, DATA_HZ, DATA.split()))


def _outputs(address: str) -> Outputs:
    return cast(Outputs, rtde_io.RTDEIOInterface(address))


def main() -> None:
    """Runs `python -m acquisition.devices.ur.driver PIPE MEMORY`; both are inherited file descriptors."""
    logging.basicConfig(stream=sys.stderr, format="%(asctime)s %(name)s %(message)s")
    pipe, memory = int(sys.argv[1]), int(sys.argv[2])
    may_be_nice, shared = process_priority.set_niceness(process_priority.DRIVER), SharedMemory(memory)
    shared.write(Field.PRIORITY, Priority.NICENESS if may_be_nice else Priority.ORDINARY)
    real_time = RealTime(SHARE)
    real_time.end_what_spins()
    controller = Controller(Constructors(control=_control, receive=_receive, outputs=_outputs), real_time)
    driver = Driver(Connection(socket.socket(fileno=pipe).detach()), shared, controller, real_time)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the service, which halts and then leaves
    signal.signal(signal.SIGTERM, driver.leave)
    signal.signal(signal.SIGHUP, driver.leave)
    try:
        driver.run()
    finally:
        if sys.exc_info()[0] is not None:
            traceback.print_exc()  # os._exit prints nothing
        driver.end()


if __name__ == "__main__":
    main()
