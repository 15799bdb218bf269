"""Second halt path: a watchdog thread that ends the controller's program over a connection opened in advance.

The connection is to the dashboard (PolyScope 5) or to the primary interface (PolyScope X); neither needs RTDE, ur-rtde
or the driver.

The thread sleeps on a socket. Waking it is one `send`, which takes no lock and may be done in a signal handler.
(threading.Event takes a lock, which a handler could find held by the very thread that it interrupts.) Woken by a halt,
the thread gives the driver ACKNOWLEDGE_S to accept it and then stops the arm itself. Woken by the death of the driver,
or by a failure, its own included, it stops the arm at once and logs afterwards. Without its program the arm brakes, and
only an explicit connect can move it again.
"""

import contextlib
import logging
import os
import select
import socket
import threading
import time
from collections.abc import Callable, Iterable

from acquisition.devices.ur import protocol
from acquisition.devices.ur.software import Software, StopConnection

_log = logging.getLogger(__name__)

_HALT, _STOP, _WATCH, _REOPEN, _QUIT = b"h", b"s", b"w", b"o", b"q"
_REOPEN_S = 1.0
_OPEN_TIMEOUT_S = 0.3
_CARRY_OUT_S = 0.6  # time limit for an accepted halt to be carried out; after it this path stops the arm too


class ProgramStop:
    """A thread that holds a connection of the controller's software and watches over the driver."""

    def __init__(self, software: Software, halt_state: Callable[[], tuple[bool, bool]], enabled: bool = True) -> None:
        """`halt_state` returns whether the driver has accepted, and carried out, the newest halt."""
        self._software = software
        self._halt_state = halt_state
        self._enabled = enabled
        self._connection: StopConnection | None = None
        self._process: int | None = None  # a pid's descriptor, readable when the process has ended
        self._new_process: int | None = None
        self._try_open_at = 0.0
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_write.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="arm-program-stop", daemon=True)
        self._thread.start()

    def notify_halt(self) -> None:
        """Reports that a halt was requested; any thread, signal handlers included."""
        self._wake(_HALT)

    def stop_at_once(self) -> None:
        """Stops the program without waiting for the driver."""
        self._wake(_STOP)

    def watch(self, process_id: int) -> None:
        """Stops the program when this process ends."""
        self._new_process = os.pidfd_open(process_id)
        self._wake(_WATCH)

    def unwatch(self) -> None:
        """Ends watching: the process is about to end on purpose."""
        self._new_process = None
        self._wake(_WATCH)

    def reopen(self) -> None:
        """Opens the connection anew: one opened in local control is never obeyed, and remote control is granted now."""
        self._wake(_REOPEN)

    def close(self) -> None:
        """Ends the thread and closes the connection."""
        self._wake(_QUIT)
        self._thread.join(timeout=3.0)

    def _wake(self, reason: bytes) -> None:
        with contextlib.suppress(OSError):  # full: the thread is about to wake anyway; closed: there is no arm
            self._wake_write.send(reason)

    def _run(self) -> None:
        while True:
            try:
                if not self._serve():
                    break
            except Exception:  # noqa: BLE001 - only this thread stops an arm whose driver hangs: it must live on
                with contextlib.suppress(Exception):  # on a new connection: the old one may be what has failed
                    self._drop()
                    self._stop()
                _log.exception("the second halt path failed: the arm is stopped")
                time.sleep(protocol.ACKNOWLEDGE_S)
        self._new_process = None
        self._replace_process()
        self._drop()
        self._wake_write.close()
        self._wake_read.close()

    def _serve(self) -> bool:
        """Waits for one event and handles it; returns False if the thread is to end."""
        self._keep_open()
        wake = self._wake_read.fileno()
        connection = None if self._connection is None else self._connection.socket.fileno()
        sources = [one for one in (wake, self._process, connection) if one is not None]
        ready = _readable(sources, _REOPEN_S)
        reasons = self._wake_read.recv(4096) if wake in ready else b""
        if _WATCH in reasons:
            self._replace_process()
        elif self._process is not None and self._process in ready:
            os.close(self._process)
            self._process = None
            self._stop()
            _log.error("the driver has ended: the arm is stopped")
        if _STOP in reasons:
            self._stop()
        elif _HALT in reasons:
            self._supervise_halt()
        elif connection is not None and connection in ready:
            self._read_unasked()
        if _REOPEN in reasons:  # after any stop, which is faster over the old connection
            self._drop()
            self._try_open_at = 0.0
        return _QUIT not in reasons

    def _replace_process(self) -> None:
        if self._process is not None and self._process != self._new_process:
            os.close(self._process)
        self._process = self._new_process

    def _supervise_halt(self) -> None:
        if not self._await(lambda: self._halt_state()[0], protocol.ACKNOWLEDGE_S):
            late = f"accepted a halt within {protocol.ACKNOWLEDGE_S:g} s"
        elif not self._await(lambda: self._halt_state()[1], _CARRY_OUT_S):
            late = f"carried out a halt within {_CARRY_OUT_S:g} s"
        else:
            return
        self._stop()
        _log.warning("the driver has not %s", late)

    def _await(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Returns whether the condition becomes true in time; False as soon as the driver has ended."""
        deadline = time.monotonic() + seconds
        watched = [] if self._process is None else [self._process]
        while not condition():
            if _readable(watched, protocol.TICK_S):
                return False
            if time.monotonic() > deadline:
                return condition()  # once more, since this thread itself may have been late
        return True

    def _stop(self) -> None:
        """Ends the program; without a confirmation, once more on a new connection: stopping twice is harmless."""
        if not self._enabled:
            return
        unconfirmed = "cannot be reached"
        for _ in range(2):
            self._try_open_at = 0.0
            self._keep_open()
            if self._connection is None:
                break
            try:
                reply = self._connection.stop()
            except OSError as error:
                self._drop()
                unconfirmed = str(error)
                continue
            _log.warning("stopped by %s: %s", self._software.stop_path, reply)
            return
        _log.error("the program could not be stopped by %s: it %s", self._software.stop_path, unconfirmed)

    def _keep_open(self) -> None:
        now = time.monotonic()
        if self._connection is None and now >= self._try_open_at:
            self._try_open_at = now + _REOPEN_S
            try:
                self._connection = self._software.open_stop(_OPEN_TIMEOUT_S)
            except OSError:
                self._connection = None

    def _read_unasked(self) -> None:
        """Reads what the controller sends unasked, or notices its end of the connection."""
        if self._connection is None:
            return
        try:
            self._connection.read_unasked()
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None


def _readable(descriptors: Iterable[int], within_s: float) -> set[int]:
    """Returns which descriptors are readable or have failed, by `poll`: `select` takes none from 1024 on."""
    waiting = select.poll()
    for one in descriptors:
        waiting.register(one, select.POLLIN)
    return {one for one, _ in waiting.poll(1000 * within_s)}
