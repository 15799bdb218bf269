"""Log entries for lines that C libraries, child processes and the interpreter write to standard error.

libpng, OpenCV and ur-rtde print where Python code cannot intercept it, so that a log of JSON objects would contain
other lines. Here descriptor 2 becomes the writing end of a pipe, and a thread logs each line that comes out; the log
itself goes to the original standard error. The pipe never blocks a writer. What does not fit is lost, because a flood
of warnings must delay neither the service nor the driver of the arm. The traceback of a crash bypasses the pipe, whose
reader would be dead by then.
"""

import faulthandler
import logging
import os
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager

from api.rest.log_queue import QueuedHandler

MAX_LINE_BYTES = 2000
"""Maximum number of bytes of one line that are logged."""

LINES_OF_BLOCK = 100
"""Maximum number of lines logged from one block (64 kB); longer output usually repeats itself."""

JOIN_S = 2.0
"""Time limit for reading the rest at the end, s; a child that lives on keeps the pipe open."""

_log = logging.getLogger("stderr")


@contextmanager
def as_entries() -> Generator[None]:
    """Logs each line that this process and its children write to standard error in this context, as a warning."""
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    sys.stderr.flush()
    before = os.dup(2)
    stream = os.fdopen(os.dup(before), "w", buffering=1, encoding="utf-8", errors="backslashreplace")
    queued = [handler for handler in logging.getLogger().handlers if isinstance(handler, QueuedHandler)]
    moved = [
        handler.target
        for handler in queued
        if isinstance(handler.target, logging.StreamHandler) and handler.target.stream is sys.stderr
    ]
    for handler in moved:
        handler.setStream(stream)
    crash_to = faulthandler.is_enabled()
    faulthandler.enable(stream)
    os.dup2(write_end, 2)
    os.close(write_end)
    reader = threading.Thread(target=_read, args=(read_end,), name="stderr", daemon=True)
    reader.start()
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(before, 2)
        os.close(before)
        reader.join(JOIN_S)
        faulthandler.disable()
        if crash_to:
            faulthandler.enable()
        for handler in queued:
            handler.flush()
        for handler in moved:
            handler.setStream(sys.stderr)
        if not reader.is_alive():
            stream.close()


def _read(read_end: int) -> None:
    rest = b""
    with os.fdopen(read_end, "rb", buffering=0) as pipe:
        while block := pipe.read(1 << 16):
            *lines, rest = (rest + block).split(b"\n")
            for line in lines[:LINES_OF_BLOCK]:
                _enter(line)
            if len(lines) > LINES_OF_BLOCK:
                _log.warning("%d further lines", len(lines) - LINES_OF_BLOCK)
            if len(rest) > MAX_LINE_BYTES:
                _enter(rest)
                rest = b""
    _enter(rest)


def _enter(line: bytes) -> None:
    text = line[:MAX_LINE_BYTES].decode("utf-8", "backslashreplace").strip()
    if text:
        _log.warning("%s", text)
