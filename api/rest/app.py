"""The web application: routes, gate, problem objects, and the life of the service behind them.

`create_app` takes what it serves and keeps nothing outside the app, so that a test may run several side by side.
"""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from html import escape
from importlib.metadata import version
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, Request
from fastapi.middleware.cors import CORSMiddleware
from fastapi.openapi.utils import get_openapi
from fastapi.responses import HTMLResponse

from api.rest import (
    archive,
    camera_view,
    events,
    examples,
    metrics,
    pictures,
    planning,
    problems,
    proposals,
    results,
    rig,
    sessions,
    tickets,
)
from api.rest.authentication import Authentication
from api.rest.camera_view import View
from api.rest.events import EventFeed
from api.rest.gate import Gate
from api.rest.keys import KeyRing
from api.rest.logs import RequestLog
from api.rest.schemas import EventResource, Problem
from api.rest.settings import Settings
from api.rest.wiring import Service

DESCRIPTION = (
    "A robot arm carries a lamp round an object while a camera looks on; the lights are planned, the images solved to "
    "normals with an uncertainty for each pixel. Create a session, start it, follow its events, fetch its answer."
)
_SCHEMAS_OF_NO_ROUTE = {"Problem": Problem, "EventResource": EventResource}


def create_app(service: Service, settings: Settings, keys: KeyRing) -> FastAPI:
    """The application that serves `service` to the holders of `keys`; it opens the service on start-up and closes it in
    the end.
    """

    @asynccontextmanager
    async def life(app: FastAPI) -> AsyncGenerator[None, None]:
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

    app = _routed(life)
    app.state.service = service
    app.state.feed = EventFeed(service.store.journal)
    app.state.view = View(service)
    app.state.keys = keys
    app.add_middleware(Gate, settings=settings, authentication=Authentication(keys))
    app.add_middleware(RequestLog)
    # Outside the gate, so that a page that may call can read a refusal, and its preflight needs no key.
    if settings.allowed_origins:
        app.add_middleware(
            CORSMiddleware, allow_origins=list(settings.allowed_origins), allow_methods=["*"], allow_headers=["*"]
        )
    return app


def description() -> dict[str, Any]:
    """The OpenAPI description of all routes; no service is needed for it."""
    return _routed(None).openapi()


def _routed(life: Any) -> FastAPI:
    app = FastAPI(
        title="lightpose",
        version=version("lightpose"),
        description=DESCRIPTION,
        lifespan=life,
        docs_url=None,  # the usual pages load scripts from elsewhere; this service works without a network
        redoc_url=None,
        redirect_slashes=False,  # one address for each thing
        responses=problems.declared_for_all(),
        generate_unique_id_function=lambda route: route.name,
    )
    problems.install(app)
    for part in (
        rig,
        camera_view,
        sessions,
        results,
        planning,
        pictures,
        proposals,
        archive,
        events,
        tickets,
        metrics,
        problems,
    ):
        app.include_router(part.router)
    app.add_api_route("/docs", _docs, include_in_schema=False, response_class=HTMLResponse)
    app.openapi = lambda: _openapi(app)
    return app


def _openapi(app: FastAPI) -> dict[str, Any]:
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        components = schema["components"]["schemas"]
        for name, model in _SCHEMAS_OF_NO_ROUTE.items():
            own = model.model_json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
            components.update(own.pop("$defs", {}))
            components[name] = own
        examples.into(components)
        schema["components"]["securitySchemes"] = {
            "key": {"type": "http", "scheme": "bearer", "description": "Made by `lightpose keys add`"},
            "ticket": {
                "type": "apiKey",
                "in": "query",
                "name": "ticket",
                "description": "Of POST /v1/tickets; GET only",
            },
        }
        schema["security"] = [{"key": []}, {"ticket": []}, {}]  # none: on a machine without keys
        app.openapi_schema = schema
    return app.openapi_schema


async def _docs(request: Request) -> HTMLResponse:
    """The routes as a page for people."""
    schema = request.app.openapi()
    rows = "".join(
        f"<tr><td><code>{method.upper()}</code><td><code>{escape(path)}</code><td>{escape(route['description'])}"
        for path, methods in schema["paths"].items()
        for method, route in methods.items()
    )
    return HTMLResponse(
        "<!doctype html><html lang=en><meta charset=utf-8><title>lightpose</title>"
        "<body style='font:16px/1.5 sans-serif;max-width:70em;margin:3em auto'>"
        f"<h1>{escape(schema['info']['title'])} {escape(schema['info']['version'])}</h1>"
        f"<p>{escape(DESCRIPTION)}</p><p><a href=/openapi.json>openapi.json</a></p>"
        f"<table cellpadding=6>{rows}</table></body></html>"
    )
