"""The event that the service ends."""

import threading


class Closing(threading.Event):
    """Set when the service ends. A signal handler, which may take no lock, announces that instead."""

    def __init__(self) -> None:
        super().__init__()
        self.announced = False

    def is_set(self) -> bool:
        """Whether the service ends, or will as soon as the thread runs that a signal handler has started."""
        return self.announced or super().is_set()
