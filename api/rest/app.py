"""The web application: routes, middleware, problem objects, and the lifespan of the service behind them.

`create_app` receives everything that it serves and keeps no state outside the app, so that tests can run several
services side by side in one process.
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
    middleware,
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
from api.rest.camera_preview import CameraPreview
from api.rest.drawings import KEPT_DRAWINGS
from api.rest.events import EventFeed
from api.rest.joint_readings import JointReadings
from api.rest.keys import KeyRing
from api.rest.open_streams import OpenStreams
from api.rest.scene import CellScene
from api.rest.settings import Settings
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
            if settings.archive is not None:
                app.state.archive.close()
            await anyio.to_thread.run_sync(service.close)

    app = _with_routes(lifespan)
    app.state.service = service
    app.state.feed = EventFeed(service.store.journal, JointReadings(service.rig.arm))
    app.state.camera_preview = CameraPreview(service)
    app.state.scene, app.state.drawings = CellScene(service), Memo[bytes](KEPT_DRAWINGS)
    app.state.keys, app.state.capacity = keys, capacity.present()
    app.state.streams = OpenStreams(keys, app.state.capacity)
    if settings.archive is not None:
        _add_archive(app, settings.archive, settings.archive_catalogue)
    middleware.add(app, settings, keys)
    return app


def _add_archive(app: FastAPI, address: str, catalogue: str | None) -> None:
    """Adds the archive's routes, which only its own server describes, because most services have no archive."""
    from api.rest.archive_page import routes  # noqa: PLC0415 - needs the extra `archive`
    from api.rest.archive_page.reading import ReadArchive  # noqa: PLC0415

    app.state.archive = ReadArchive(address, catalogue)
    for router in (routes.router, routes.pages):
        app.include_router(router, include_in_schema=False)


def description() -> dict[str, Any]:
    """Generates the OpenAPI description of all routes without a service. The caller may change the returned value."""
    return json.loads(_description())


@cache
def _description() -> str:
    """The description as JSON, cached because it takes half a second and depends only on the code."""
    return json.dumps(_with_routes(None).openapi())


def _with_routes(lifespan: Any) -> FastAPI:
    app = FastAPI(
        title="lightpose",
        version=version("lightpose"),
        description=openapi_document.DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,  # FastAPI's pages load scripts from other hosts (see `docs_page`)
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
