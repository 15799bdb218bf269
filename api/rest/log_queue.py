"""The queue between threads that log and the log's destination: a thread that stops the arm must not wait for a disk.

A write to a terminal on Ctrl-S, a stuck log collector or a hanging disk lasts until a person intervenes. An entry is
therefore formatted where it is made, with that thread's context, and written in a separate thread. Entries beyond the
queue's limit are left out and counted.
"""

import logging
import queue
import threading
from collections.abc import Callable
from logging.handlers import QueueHandler

MOST_WAITING = 2000
"""Maximum number of entries that wait to be written; each has a few kB at most."""

FLUSH_WITHIN_S = 5.0
"""Time limit for writing the waiting entries when the log ends, s."""


class QueuedHandler(QueueHandler):
    """Hands entries to another handler, whose thread writes them; `logging` itself closes it when the process ends."""

    def __init__(self, target: logging.Handler, on_left_out: Callable[[logging.LogRecord], None]) -> None:
        # The only queue that a signal handler may use while it interrupts a use of it in the same thread.
        self._waiting: queue.SimpleQueue[logging.LogRecord | threading.Event | None] = queue.SimpleQueue()
        super().__init__(self._waiting)
        self.target = target
        self._on_left_out = on_left_out
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queues a formatted entry, or leaves it out and reports that. Never waits."""
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
