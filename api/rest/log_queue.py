"""The queue between those who log and where the log goes: whoever stops the arm may log, and waits for nobody's disk.

A terminal on Ctrl-S, a log collector that is stuck, a disk that hangs: a write to them lasts until somebody comes. So
an entry is formatted where it is made, with that thread's context, and written in a thread of its own; what would be
too much to keep is left out and counted.
"""

import logging
import queue
import threading
from collections.abc import Callable
from logging.handlers import QueueHandler

MOST_WAITING = 2000
"""Entries that wait to be written; some kB each at most."""

FLUSH_WITHIN_S = 5.0
"""How long the entries so far may take to be written when the log ends, s."""


class QueuedHandler(QueueHandler):
    """Hands entries to another handler, whose thread writes them; `logging` itself ends it with the process."""

    def __init__(self, target: logging.Handler, on_left_out: Callable[[logging.LogRecord], None]) -> None:
        # The one queue that may be used while a signal handler interrupts its use in the same thread.
        self._waiting: queue.SimpleQueue[logging.LogRecord | threading.Event | None] = queue.SimpleQueue()
        super().__init__(self._waiting)
        self.target = target
        self._on_left_out = on_left_out
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queues a formatted entry, or leaves it out and says so; never waits."""
        if self._waiting.qsize() >= MOST_WAITING:
            self._on_left_out(record)
        else:
            self._waiting.put(record)

    def flush(self) -> None:
        """Waits until the entries so far are written, at most FLUSH_WITHIN_S."""
        written = threading.Event()
        if self._thread.is_alive():
            self._waiting.put(written)
            written.wait(FLUSH_WITHIN_S)

    def close(self) -> None:
        """Writes the entries so far and ends the thread."""
        self.flush()
        self._waiting.put(None)
        self._thread.join(FLUSH_WITHIN_S)
        super().close()

    def _write(self) -> None:
        while (entry := self._waiting.get()) is not None:
            if isinstance(entry, threading.Event):
                entry.set()
            else:
                self.target.handle(entry)
