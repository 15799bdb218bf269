"""The OpenAPI description: FastAPI's, derived from the routes, completed for people and for code generators.

FastAPI knows the types and docstrings of the code. This module adds what no route states by itself: the meaning of the
tags, the service's address, who may call, the types sent outside of JSON answers (events, problems), examples, and a
description of each answer and body without one, taken from its schema.
"""

from collections.abc import Iterator
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from api.rest import openapi_examples, openapi_links
from api.rest.authentication import PUBLIC_PATHS, needed_role
from api.rest.joint_readings import JointReadingResource
from api.rest.request_checks import VALID_UNTIL
from api.rest.schemas import EventResource, Problem
from api.rest.stored_files import NOT_MODIFIED

DESCRIPTION = (
    "Photometric stereo with planned lights: a robot arm carries a lamp round an object while a fixed camera captures "
    "images, which are solved to normals with an uncertainty (σ) for each pixel. Create a session, start it, follow "
    "its events, download its answer. Lengths are in m, angles in rad, times in s unless a name or a description says "
    "otherwise; errors are problem objects (RFC 9457) whose `code` is stable; fields may be added at any time."
)

TAGS = {
    "health": "Whether the service and its devices answer (no key needed); figures for a monitoring system.",
    "rig": "The cell: status, stop, safety, moving the arm by hand, the camera's present image, its geometry.",
    "sessions": "Capture sessions: recipe, actions, passes, images, results. This is where to begin.",
    "queue": "Sessions one after another, each of a named object.",
    "events": "What happens, as a stream (server-sent events).",
    "problems": "The pages that the `type` of a problem object leads to. No key needed.",
}

SERVERS = [{"url": "/", "description": "The service that this description comes from; by default 127.0.0.1:8000"}]

_HEADERS = {
    "ETag": ("string", "Names this content; sent back in `If-None-Match` it is answered 304 while it is still valid"),
    "Location": ("string", "Address of what was made or is being made"),
    "Retry-After": ("integer", "Time after which the request may be sent again, s"),
}
_WITH_LOCATION = frozenset({"create", "enqueue", "resolve"})
_MOVING = frozenset({"act", "park", "jog", "act_on_queue"})
"""Requests after which the arm moves. Every other POST accepts the header too, but it matters to none of them."""
_VALID_UNTIL = {
    "name": VALID_UNTIL,
    "in": "header",
    "required": False,
    "description": "Until when the request may be carried out, s since 1970 by the service's clock (`at` of the event "
    "`arm.joints` tells it); one that arrives later is refused (`request.expired`) and nothing moves",
    "schema": {"type": "number", "minimum": 0},
}
_ENDLESS = ("text/event-stream", "multipart/")
_NEVER_KEPT = frozenset({"preview_picture", "preview_figures_of", "preview_clipping", "preview_target", "archive"})

_SCHEMAS_OUTSIDE_ROUTES = {
    "Problem": Problem,
    "EventResource": EventResource,
    "JointReadingResource": JointReadingResource,
}
_PAGE = "One page of a list, and the address of the next"  # a generic class with its type filled in has no description
_UNDESCRIBED = "Successful Response"  # FastAPI's default


def of(app: FastAPI) -> dict[str, Any]:
    """Returns the description of an application's routes, which is made once."""
    if app.openapi_schema is None:
        app.openapi_schema = _made(app)
    return app.openapi_schema


def _made(app: FastAPI) -> dict[str, Any]:
    schema = get_openapi(
        title=app.title,
        version=app.version,
        description=DESCRIPTION,
        routes=app.routes,
        tags=[{"name": name, "description": text} for name, text in TAGS.items()],
        servers=SERVERS,
        license_info={"name": "Apache 2.0", "identifier": "Apache-2.0"},
    )
    components = schema["components"]["schemas"]
    for name, model in _SCHEMAS_OUTSIDE_ROUTES.items():
        own = model.model_json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
        components.update(own.pop("$defs", {}))
        components[name] = own
    openapi_examples.add_to(components)
    schema["components"]["securitySchemes"] = {
        "key": {"type": "http", "scheme": "bearer", "description": "Created by `lightpose keys add`"},
        "ticket": {
            "type": "apiKey",
            "in": "query",
            "name": "ticket",
            "description": "Issued by POST /v1/tickets; GET only",
        },
    }
    schema["security"] = [{"key": []}, {"ticket": []}, {}]  # none: on a machine without keys
    for name in [name for name in components if name.startswith("Page_")]:
        components[name]["description"] = _PAGE
    for method, path, operation in operations(schema):
        if path.startswith(PUBLIC_PATHS):
            operation["security"] = []
        else:
            operation["x-role"] = str(needed_role(method.upper(), path))
        if method == "get":
            _add_conditional(operation)
        if operation["operationId"] in _MOVING:
            operation.setdefault("parameters", []).append(_VALID_UNTIL)
        _describe(operation, components)
        _add_headers(operation)
    openapi_links.add_to(schema)
    return schema


def operations(schema: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yields method, path and operation of each route."""
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            yield method, path, operation


def _add_conditional(operation: dict[str, Any]) -> None:
    """Adds the answer 304 and the header ETag unless the answer is a stream or may not be kept."""
    good = operation["responses"]["200"]
    endless = any(media_type.startswith(_ENDLESS) for media_type in good.get("content", {}))
    if endless or operation["operationId"] in _NEVER_KEPT:
        return
    good.setdefault("headers", {})["ETag"] = _header("ETag")
    operation["responses"].setdefault("304", NOT_MODIFIED[304])


def _add_headers(operation: dict[str, Any]) -> None:
    for status, answer in operation["responses"].items():
        headers = answer.setdefault("headers", {})
        if status in ("429", "503"):
            headers["Retry-After"] = {**_header("Retry-After"), "required": True}
        if status in ("200", "201", "202") and operation["operationId"] in _WITH_LOCATION:
            headers["Location"] = _header("Location")
        if not headers:
            del answer["headers"]


def _header(name: str) -> dict[str, Any]:
    kind, text = _HEADERS[name]
    return {"description": text, "schema": {"type": kind}}


def _describe(operation: dict[str, Any], components: dict[str, Any]) -> None:
    """Gives an operation's body and answers the descriptions of their schemas where they have none."""
    body = operation.get("requestBody")
    if body is not None and "description" not in body:
        body["description"] = _description_of(body["content"], components)
    for status, answer in operation["responses"].items():
        if answer["description"] == _UNDESCRIBED:
            answer["description"] = (
                "Done; the answer has no content" if status == "204" else _description_of(answer["content"], components)
            )


def _description_of(content: dict[str, Any], components: dict[str, Any]) -> str:
    """Returns the first line of the description of the first schema that has one."""
    for media in content.values():
        schema = media.get("schema", {})
        named = components.get(schema.get("$ref", "").rpartition("/")[2], {})
        text = schema.get("description") or named.get("description", "")
        if text:
            return text.split("\n")[0]
    return ""
