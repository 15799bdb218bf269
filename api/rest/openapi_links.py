"""Links between operations in the OpenAPI description: which value of an answer is which parameter of the next request.

HTTP answers carry `links` for clients that follow them at run time; the description states the same relations here. A
reader sees what can be done with a newly created session, a code generator can offer it, and a test with generated
requests goes from answer to request as a client does. The links are one table, because a route does not know which
other routes build on it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

OPERATION_METHODS = ("get", "put", "post", "delete", "patch")

_OF_PATH = "$request.path."
_IN_BODY = "$response.body#/"


@dataclass(frozen=True)
class Link:
    """A step from the answer of one operation to the request of others. Its parameters are runtime expressions."""

    source: str  # operationId
    statuses: tuple[str, ...]
    targets: tuple[str, ...]  # operationIds
    parameters: dict[str, str] = field(default_factory=dict[str, str])
    body: dict[str, Any] | None = None
    description: str = ""


_SESSION = (
    "read", "edit", "act", "actions", "passes", "results", "draw_region", "region", "events", "archive", "log",
    "resolve", "delete",
)  # fmt: skip
_RESULT = ("result", "artefact", "cancel_resolve")
_PASS = ("one_pass", "route_picture", "forecast_plan", "replace_plan", "image", "thumbnail", "gain")


def _of_session(**more: str) -> dict[str, str]:
    """Returns the session parameter of the request itself and the further parameters of the next one."""
    return {"session_id": f"{_OF_PATH}session_id", **more}


LINKS = (
    Link(
        "create", ("200", "201"), _SESSION, {"session_id": f"{_IN_BODY}id"},
        description="The session that was created",
    ),
    Link(
        "create", ("200", "201"), ("act",), {"session_id": f"{_IN_BODY}id"}, {"action": "start"},
        description="Starts the session that was created",
    ),
    Link(
        "sessions", ("200",), _SESSION, {"session_id": f"{_IN_BODY}items/0/id"},
        description="The newest session of the page",
    ),
    Link(
        "act", ("202",), ("read", "actions", "passes", "results", "events", "act"), _of_session(),
        description="The session of the action",
    ),
    Link(
        "read", ("200",), ("result", "artefact"), _of_session(number=f"{_IN_BODY}answer/number"),
        description="The session's answer, once there is one",
    ),
    Link(
        "edit", ("200",), ("read",), _of_session(), description="The session that was edited",
    ),
    Link(
        "delete", ("204",), ("read",), _of_session(), description="The deleted session: 404",
    ),
    Link(
        "draw_region", ("200",), ("region",), _of_session(), description="The region that was set",
    ),
    Link(
        "passes", ("200",), _PASS, _of_session(number=f"{_IN_BODY}items/0/number"),
        description="The first pass of the page",
    ),
    Link(
        "one_pass", ("200",), ("image", "thumbnail"),
        _of_session(number=f"{_OF_PATH}number", shot_number=f"{_IN_BODY}shots/0/shot/key/number"),
        description="The pass's first image",
    ),
    Link(
        "replace_plan", ("200",), ("one_pass", "forecast_plan"), _of_session(number=f"{_OF_PATH}number"),
        description="The pass whose lights were replaced",
    ),
    Link(
        "results", ("200",), _RESULT, _of_session(number=f"{_IN_BODY}items/0/number"),
        description="The first result of the page",
    ),
    Link(
        "result", ("200",), ("artefact",),
        _of_session(number=f"{_OF_PATH}number", artefact=f"{_IN_BODY}artefacts/0/name"),
        description="The result's first file",
    ),
    Link(
        "resolve", ("200", "202"), _RESULT, _of_session(number=f"{_IN_BODY}number"),
        description="The result that was asked for",
    ),
    Link(
        "cancel_resolve", ("202",), ("result",), _of_session(number=f"{_OF_PATH}number"),
        description="The result whose solve was cancelled",
    ),
    Link(
        "enqueue", ("200", "201"), ("queue_entry", "remove_queue_entry"), {"entry_id": f"{_IN_BODY}id"},
        description="The entry that was added",
    ),
    Link(
        "queue", ("200",), ("queue_entry", "remove_queue_entry"), {"entry_id": f"{_IN_BODY}entries/0/id"},
        description="The first entry",
    ),
    Link(
        "queue_entry", ("200",), ("read", "events"), {"session_id": f"{_IN_BODY}session_id"},
        description="The entry's session, once there is one",
    ),
    Link(
        "remove_queue_entry", ("204",), ("queue_entry",), {"entry_id": f"{_OF_PATH}entry_id"},
        description="The removed entry: 404",
    ),
    Link(
        "ticket", ("201",), ("events", "preview_stream", "preview_picture", "image", "thumbnail", "artefact"),
        description="What a page loads without a header: `?ticket=` with the answer's `ticket`",
    ),
    Link(
        "stop", ("202",), ("safety", "acknowledge", "rig"),
        description="What a stop leaves: a latched fault, until a person acknowledges",
    ),
    Link("jog", ("202",), ("release_jog",), description="Ends the motion of this press"),
)  # fmt: skip
"""All links. Each is named after the operation that it leads to, or, with a body, after the action in the body."""


def add_to(schema: dict[str, Any]) -> None:
    """Adds the links to the answers of a description. Raises KeyError for an unknown operation or answer."""
    by_id = {operation["operationId"]: operation for operation in _operations(schema)}
    for link in LINKS:
        for status in link.statuses:
            of_answer = by_id[link.source]["responses"][status].setdefault("links", {})
            for target in link.targets:
                of_answer[_name(link, target)] = _entry(link, by_id[target])


def _operations(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for methods in schema["paths"].values():
        yield from (operation for method, operation in methods.items() if method in OPERATION_METHODS)


def _name(link: Link, target: str) -> str:
    return target if link.body is None else str(link.body["action"])


def _entry(link: Link, target: dict[str, Any]) -> dict[str, Any]:
    taken = {item["name"]: item["in"] for item in target.get("parameters", [])}
    parameters = {f"{taken[name]}.{name}": value for name, value in link.parameters.items()}
    entry: dict[str, Any] = {"operationId": target["operationId"], "description": link.description}
    if parameters:
        entry["parameters"] = parameters
    if link.body is not None:
        entry["requestBody"] = link.body
    return entry
