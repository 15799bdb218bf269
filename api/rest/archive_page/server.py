"""A server of the archive's page alone, where there is no cell: `lightpose archive serve`.

It has the same checks, keys and problem objects as a cell's service. There is no arm to stop, so uvicorn itself accepts
the connections.
"""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import version
from socket import socket

import anyio.to_thread
import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import RedirectResponse
from pydantic import Field

from acquisition.archive.archive import refuse_missing_folder
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import PROBLEMS
from api.rest import capacity, keys, logs, middleware, problems, settings, tickets, tls
from api.rest.archive_page import routes
from api.rest.archive_page.reading import ReadArchive
from api.rest.archive_page.routes import ArchiveOf
from api.rest.keys import KeyRing
from api.rest.rig_schemas import Health
from api.rest.settings import ServerSettings

SHUTDOWN_GRACE_S = 5
"""Time limit for requests in progress after a signal, s."""
IDLE_S = 30
"""Time for which a connection is kept without a request, s."""


class ArchivePageSettings(ServerSettings):
    """Settings of this server, from `LIGHTPOSE_…` too."""

    port: int = Field(8010, ge=0, le=65535, description="0: any free port")
    archive: str = Field(min_length=1, description="A folder, or an address such as s3://bucket/archive")
    archive_catalogue: str | None = Field(None, min_length=1, description="Its catalogue; none: SQLite in the folder")


def create_app(wanted: ArchivePageSettings, ring: KeyRing) -> FastAPI:
    """Creates the application that shows an archive to the holders of keys. It opens the archive on first use."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None, None]:
        ring.open()
        try:
            yield
        finally:
            await anyio.to_thread.run_sync(ring.close)
            app.state.archive.close()

    app = FastAPI(
        title="lightpose archive", version=version("lightpose"), lifespan=lifespan, docs_url=None, redoc_url=None,
        redirect_slashes=False, responses=problems.default_response(),
        generate_unique_id_function=lambda route: route.name,
    )  # fmt: skip
    problems.install(app)
    app.state.archive = ReadArchive(wanted.archive, wanted.archive_catalogue)
    app.state.keys, app.state.capacity = ring, capacity.present()
    for router in (routes.router, routes.pages, tickets.router, problems.router):
        app.include_router(router)

    @app.get("/", include_in_schema=False)
    async def start() -> RedirectResponse:
        return RedirectResponse("/archive")

    @app.get("/health/live", tags=["health"])
    async def live() -> Health:
        return Health()

    @app.get("/health/ready", tags=["health"], responses=problems.responses_of(ErrorCode.ARCHIVE_UNREACHABLE))
    async def ready(archive: ArchiveOf, request: Request) -> Health:
        try:
            await archive.read(archive.probe)
        except RigError as error:
            if not request.app.state.keys.required:
                raise
            raise RigError(error.code, PROBLEMS[error.code].title) from error  # without addresses: anybody may ask
        return Health()

    _ = start, live, ready  # registered
    middleware.add(app, wanted, ring)
    return app


class Server(uvicorn.Server):
    """A uvicorn server that reports its address."""

    def __init__(self, config: uvicorn.Config, on_ready: Callable[[str], None]) -> None:
        super().__init__(config)
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Starts the server, then reports the address."""
        await super().startup(sockets)
        if not self.should_exit:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            scheme = "https" if self.config.is_ssl else "http"
            self._on_ready(f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}")


def serve(wanted: ArchivePageSettings, on_ready: Callable[[str], None]) -> None:
    """Serves until SIGTERM or SIGINT. `on_ready` is called with the address once the server listens.

    Raises RigError archive.address_invalid for a folder that is missing or no archive's, and config.invalid for a host
    other than this machine without keys, a bad key file or certificate, and a port that cannot be bound.
    """
    refuse_missing_folder(wanted.archive)
    logs.configure(wanted.log, wanted.log_file)
    ring = KeyRing(keys.path_in(wanted.data))
    settings.refuse_open_bind(wanted.host, ring.required, "read the archive", "viewer")
    tls.context(wanted.tls_cert, wanted.tls_key)  # says what is wrong with them; uvicorn would not
    capacity.raise_descriptor_limit()
    config = uvicorn.Config(
        create_app(wanted, ring), host=wanted.host, port=wanted.port, ws="none", http="h11", log_config=None,
        access_log=False, server_header=False, proxy_headers=False, timeout_keep_alive=IDLE_S,
        timeout_graceful_shutdown=SHUTDOWN_GRACE_S, ssl_certfile=wanted.tls_cert, ssl_keyfile=wanted.tls_key,
        limit_concurrency=capacity.present().connections,
    )  # fmt: skip
    try:
        Server(config, on_ready).run()
    except KeyboardInterrupt:  # uvicorn raises the signal again after an orderly shutdown
        return
    except SystemExit as error:  # uvicorn's report that it did not start
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"{wanted.host}:{wanted.port} cannot be bound (see the log): is the port free? --port chooses another",
        ) from error
    finally:
        logs.flush()
