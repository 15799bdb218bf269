"""SIGTERM as an end that cleans up, for commands that write temporary files."""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def cleaned_up_at_sigterm() -> Generator[None]:
    """Makes SIGTERM end the block as Ctrl+C does, with exit status 143, so that its temporary files are removed.

    By default the process would end at once, and leave unpacked images of any size in hidden folders. Does nothing
    outside the main thread, where signals cannot be handled.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
