"""Dependencies that FastAPI injects into routes (service, caller, actor), and types of parameters."""

from typing import Annotated, Any

from fastapi import Depends, Request
from fastapi import Path as InPath
from fastapi.routing import APIRoute
from pydantic import AwareDatetime, BeforeValidator

from acquisition.models.errors import ErrorCode, RigError
from api.rest.keys import Caller
from api.rest.wiring import Service


async def _service(request: Request) -> Service:
    # A coroutine, because FastAPI runs a plain function in a thread, and stop must not wait for one.
    return request.app.state.service


async def _caller(request: Request) -> Caller:
    return request.state.caller


async def _actor(request: Request) -> str:
    return f"{request.state.caller.name}@{request.client.host if request.client else 'local'}"


async def refuse_unknown_query(request: Request) -> None:
    """Refuses query parameters that the route does not have: a filter with a typing error would list everything.

    Raises RigError request.invalid naming each.
    """
    route: APIRoute = request.scope["route"]
    known = [parameter.alias for parameter in route.dependant.query_params]
    unknown = sorted(set(request.query_params) - {*known, "ticket"})
    if unknown:
        errors = [{"field": name[:100], "message": "There is no such query parameter"} for name in unknown[:20]]
        names = ", ".join(name[:100] for name in unknown[:20])
        raise RigError(
            ErrorCode.REQUEST_INVALID, f"Unknown query parameter {names}; known are {', '.join(known)}", errors=errors
        )


ServiceOf = Annotated[Service, Depends(_service)]
Actor = Annotated[str, Depends(_actor)]
CallerOf = Annotated[Caller, Depends(_caller)]

IDEMPOTENCY_KEY = (
    "Any text that the caller chooses; a request with the same text is the same one and makes nothing twice"
)
"""Description of the header Idempotency-Key."""


def _refuse_number(value: Any) -> Any:
    if isinstance(value, str) and value.replace(".", "").replace("-", "").isdigit():
        raise ValueError("Give a time as ISO 8601 with its zone, such as 2026-11-23T12:00:00Z")
    return value


Time = Annotated[AwareDatetime, BeforeValidator(_refuse_number)]
"""A time with its zone. A plain number is refused, although pydantic would accept it as seconds since 1970."""

SessionId = Annotated[str, InPath(max_length=80, description="Identifier of the session, its `id`")]
Number = Annotated[int, InPath(ge=0, le=10_000, description="Number within the session or the pass, from 0")]
