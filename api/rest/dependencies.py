"""Dependencies that FastAPI injects into routes (service, caller, actor), and the types of path parameters."""

from typing import Annotated

from fastapi import Depends, Request
from fastapi import Path as InPath

from api.rest.keys import Caller
from api.rest.wiring import Service


async def _service(request: Request) -> Service:
    # A coroutine, because a plain function would be run in a thread, and stop must not wait for one.
    return request.app.state.service


async def _caller(request: Request) -> Caller:
    return request.state.caller


async def _actor(request: Request) -> str:
    return f"{request.state.caller.name}@{request.client.host if request.client else 'local'}"


ServiceOf = Annotated[Service, Depends(_service)]
Actor = Annotated[str, Depends(_actor)]
CallerOf = Annotated[Caller, Depends(_caller)]

SessionId = Annotated[str, InPath(max_length=80)]
Number = Annotated[int, InPath(ge=0, le=10_000)]
