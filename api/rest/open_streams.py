"""The open streams (events, live images): how many each caller may have, and whether a caller may continue.

A request is checked once, but a stream lasts for days. Each stream therefore checks here once a second whether the key
that opened it is still valid, or the ticket still within its lifetime, and ends if not. The counts limit what one key
can take from the others; a browser's tab needs one or two streams.
"""

import time
from collections import Counter
from collections.abc import AsyncIterable, Generator
from contextlib import contextmanager
from typing import Any

from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from acquisition.models.errors import ErrorCode, RigError
from api.rest.capacity import Capacity
from api.rest.keys import Caller, KeyRing

CHECK_S = 1.0
"""Time between two checks of a stream's caller, s."""

RETRY_AFTER_S = 5
"""Time after which a caller with too many streams may try again, s."""


class OpenStreams:
    """Counts the streams of all callers; lives on the event loop."""

    def __init__(self, keys: KeyRing, capacity: Capacity) -> None:
        self._keys = keys
        self._capacity = capacity
        self._of_caller: Counter[str] = Counter()

    def is_valid(self, caller: Caller) -> bool:
        """Returns whether the caller's key or ticket, or its absence, would still be accepted."""
        return self._keys.is_valid(caller, time.monotonic())

    def response(
        self, caller: Caller, content: AsyncIterable[Any], media_type: str, headers: dict[str, str]
    ) -> StreamingResponse:
        """Responds with a stream that counts as the caller's while it is sent.

        Raises RigError request.too_many_streams when the caller has the maximum number of streams, service.overloaded
        when all callers together have theirs.
        """
        most = self._capacity
        if self._of_caller[caller.name] >= most.streams_per_caller:
            raise RigError(
                ErrorCode.REQUEST_TOO_MANY_STREAMS,
                f"{caller.name} already has {most.streams_per_caller} open streams, the maximum of a caller",
                limit=most.streams_per_caller,
                retry_after_s=RETRY_AFTER_S,
            )
        if self._of_caller.total() >= most.streams:
            raise RigError(
                ErrorCode.SERVICE_OVERLOADED,
                f"The service already has {most.streams} open streams, the maximum",
                limit=most.streams,
                retry_after_s=RETRY_AFTER_S,
            )
        return _CountedResponse(self, caller, content, media_type, headers)

    @contextmanager
    def counted(self, caller: Caller) -> Generator[None]:
        """Counts one stream of a caller."""
        self._of_caller[caller.name] += 1
        try:
            yield
        finally:
            self._of_caller[caller.name] -= 1
            if not self._of_caller[caller.name]:
                del self._of_caller[caller.name]


class _CountedResponse(StreamingResponse):
    def __init__(
        self,
        streams: OpenStreams,
        caller: Caller,
        content: AsyncIterable[Any],
        media_type: str,
        headers: dict[str, str],
    ) -> None:
        super().__init__(content, media_type=media_type, headers=headers)
        self._streams, self._caller = streams, caller

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        # Counted here and not in the generator, because a generator that has not begun never reaches its end.
        with self._streams.counted(self._caller):
            await super().__call__(scope, receive, send)
