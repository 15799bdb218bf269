"""The middleware of every server: what each request passes on its way to a route, and each answer on its way back.

The order is the reverse of that of adding: the middleware added last sees a request first.
"""

from fastapi import FastAPI

from api.rest.answer_headers import (
    EXPOSED,
    AllowedMethods,
    AnswerHeaders,
    HeadAsGet,
    Preflights,
    RefusedRanges,
    security_headers,
)
from api.rest.authentication import Authentication
from api.rest.compression import Compressed
from api.rest.conditional import ConditionalGet
from api.rest.keys import KeyRing
from api.rest.logs import RequestLogMiddleware
from api.rest.request_checks import KnownPages, RequestChecks
from api.rest.settings import ServerSettings
from api.rest.trusted_proxies import ForwardedCaller, TrustedProxies


def add(app: FastAPI, settings: ServerSettings, keys: KeyRing) -> None:
    """Adds the middleware to an application whose state holds its `capacity`, and stores its parts in that state."""
    app.state.proxies = TrustedProxies(settings.trusted_proxies)
    app.state.security_headers = security_headers(foreign_pages=bool(settings.allowed_origins))
    app.add_middleware(RefusedRanges)
    app.add_middleware(ConditionalGet)
    app.add_middleware(Compressed)
    app.add_middleware(HeadAsGet)
    app.add_middleware(AllowedMethods, routes=app.routes)
    app.state.pages, app.state.authentication = KnownPages(settings), Authentication(keys)
    app.add_middleware(
        RequestChecks,
        pages=app.state.pages,
        authentication=app.state.authentication,
        most_requests=app.state.capacity.requests,
    )
    app.add_middleware(RequestLogMiddleware)
    # Outside the request checks, so that an allowed page can read a refusal, and its preflight needs no key.
    if settings.allowed_origins:
        app.add_middleware(
            Preflights,
            allow_origins=list(settings.allowed_origins),
            allow_methods=["*"],
            allow_headers=["*"],
            expose_headers=EXPOSED,
        )
    app.add_middleware(ForwardedCaller, proxies=app.state.proxies)
    app.add_middleware(AnswerHeaders, defaults=app.state.security_headers)
