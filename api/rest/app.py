"""The web application: routes, middleware, problem objects, and the lifespan of the service behind them.

`create_app` is given all that it serves and keeps no state outside the app, so that tests can run several services side
by side in one process.
"""

import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from functools import cache
from importlib.metadata import version
from typing import Any

import anyio.to_thread
from fastapi import FastAPI

from acquisition.runner.memo import Memo
from api.rest import (
    archive,
    calibration,
    calibration_sessions,
    camera_preview,
    capacity,
    docs_page,
    drawings,
    events,
    images,
    jog,
    metrics,
    openapi_document,
    outbox,
    page,
    plans,
    problems,
    queue,
    region,
    results,
    rig,
    scene,
    sessions,
    target_views,
    tickets,
)
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
from api.rest.camera_preview import CameraPreview
from api.rest.compression import Compressed
from api.rest.conditional import ConditionalGet
from api.rest.drawings import KEPT_DRAWINGS
from api.rest.events import EventFeed
from api.rest.joint_readings import JointReadings
from api.rest.keys import KeyRing
from api.rest.logs import RequestLogMiddleware
from api.rest.open_streams import OpenStreams
from api.rest.request_checks import KnownPages, RequestChecks
from api.rest.scene import CellScene
from api.rest.settings import Settings
from api.rest.trusted_proxies import ForwardedCaller, TrustedProxies
from api.rest.wiring import Service


def create_app(service: Service, settings: Settings, keys: KeyRing) -> FastAPI:
    """Creates the application that serves `service` to the holders of `keys`.

    It opens the service at start-up and closes it at shutdown.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None, None]:
        feed: EventFeed = app.state.feed
        await anyio.to_thread.run_sync(service.open)
        keys.open()
        feed.start()
        try:
            yield
        finally:
            await anyio.to_thread.run_sync(feed.close)
            await anyio.to_thread.run_sync(keys.close)
            await anyio.to_thread.run_sync(service.close)

    app = _with_routes(lifespan)
    app.state.service = service
    app.state.feed = EventFeed(service.store.journal, JointReadings(service.rig.arm))
    app.state.camera_preview = CameraPreview(service)
    app.state.scene, app.state.drawings = CellScene(service), Memo[bytes](KEPT_DRAWINGS)
    app.state.keys = keys
    app.state.capacity, app.state.proxies = capacity.present(), TrustedProxies(settings.trusted_proxies)
    app.state.security_headers = security_headers(foreign_pages=bool(settings.allowed_origins))
    app.state.streams = OpenStreams(keys, app.state.capacity)
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
    return app


def description() -> dict[str, Any]:
    """Generates the OpenAPI description of all routes, a value of the caller's own; needs no service."""
    return json.loads(_description())


@cache
def _description() -> str:
    """The same as JSON: it takes half a second, and depends on the code alone."""
    return json.dumps(_with_routes(None).openapi())


def _with_routes(lifespan: Any) -> FastAPI:
    app = FastAPI(
        title="lightpose",
        version=version("lightpose"),
        description=openapi_document.DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,  # the usual pages load scripts from elsewhere (`docs_page`)
        redoc_url=None,
        redirect_slashes=False,  # one address for each thing
        responses=problems.default_response(),
        generate_unique_id_function=lambda route: route.name,
    )
    problems.install(app)
    for module in (
        rig,
        jog,
        scene,
        calibration,
        calibration_sessions,
        camera_preview,
        target_views,
        sessions,
        images,
        results,
        region,
        plans,
        drawings,
        archive,
        outbox,
        queue,
        events,
        tickets,
        metrics,
        problems,
        page,
        docs_page,
    ):
        app.include_router(module.router)
    app.openapi = lambda: openapi_document.of(app)
    return app
