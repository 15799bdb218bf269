"""What both contract runs, in this process and by schemathesis' command line, do to the requests that they generate.

Requests made from the description alone name sessions that are not there and listen to events for ever; half of them
are led to things that exist, and events are read until now.
"""

import threading
from collections.abc import Mapping
from itertools import count
from typing import Any

CONFORMANCE = (
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
)
"""Names of schemathesis' checks of an answer against its description."""

EVENTS = "/v1/events"


class Steering:
    """Leads every other request to things that exist."""

    def __init__(self, known: Mapping[str, Any]) -> None:
        """`known` are path parameters that exist."""
        self._known = known
        self._turn = count()
        self._counting = threading.Lock()

    def path_parameters(self, context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
        """The path parameters of things that exist, in every other request; never of one that deletes."""
        with self._counting:
            turn = next(self._turn)
        if path_parameters is None or turn % 2 or context.operation.method.upper() == "DELETE":
            return path_parameters
        return {name: self._known.get(name, value) for name, value in path_parameters.items()}


def ending(path: str, method: str, query: dict[str, Any] | None) -> dict[str, Any] | None:
    """The query with which the answer ends: events are read until now, else they would be listened to for ever."""
    return {**(query or {}), "follow": "false"} if (path, method.upper()) == (EVENTS, "GET") else query
