"""What a route is given: the service, and who asks."""

from typing import Annotated

from fastapi import Depends, Request

from api.wiring import Service


async def _service(request: Request) -> Service:
    # A coroutine, because a plain function would be run in a thread, and stop must not wait for one.
    return request.app.state.service


async def _actor(request: Request) -> str:
    # There are no keys yet: whoever is on this machine is an operator.
    return f"operator@{request.client.host if request.client else 'local'}"


ServiceOf = Annotated[Service, Depends(_service)]
Actor = Annotated[str, Depends(_actor)]
