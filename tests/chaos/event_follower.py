"""A listener that follows the events of a service across its restarts and keeps their ids."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress

import httpx

from api import Client, ProblemError


class EventFollower:
    """A thread that hears every event from the first one on, as a page does that is left open."""

    def __init__(self, url: Callable[[], str | None]) -> None:
        """`url` is the address of the service that runs at present; None while there is none."""
        self._url = url
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.ids: list[int] = []

    def __enter__(self) -> "EventFollower":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()

    def has_heard(self, last: int, within_s: float = 60.0) -> bool:
        """Whether every event up to `last` was heard, each once and in order; waits for the last one."""
        deadline = time.monotonic() + within_s
        while (not self.ids or self.ids[-1] < last) and time.monotonic() < deadline:
            time.sleep(0.05)
        return self.ids[:last] == list(range(1, last + 1))

    def _run(self) -> None:
        while not self._ending.is_set():
            url = self._url()
            if url is not None:
                with suppress(httpx.HTTPError, ProblemError), Client(url) as client:
                    for event in client.events(after=self.ids[-1] if self.ids else 0, reconnect_timeout_s=0.5):
                        self.ids.append(event.id)
                        if self._ending.is_set():
                            return
            time.sleep(0.2)
