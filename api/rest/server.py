"""The server process: one worker, and a signal handler that halts the arm before anything else.

uvicorn installs its own signal handlers and ends the application only after the open connections are served, which an
event stream delays by seconds. So the halt is in the handler itself, and the streams are ended at shutdown.
"""

import logging
import threading
from collections.abc import Callable
from socket import socket
from types import FrameType

import uvicorn
from fastapi import FastAPI

from acquisition.devices import process_priority
from acquisition.models.errors import ErrorCode, RigError
from api.rest import keys, logs, wiring
from api.rest import settings as settings_
from api.rest.app import create_app
from api.rest.camera_preview import CameraPreview
from api.rest.events import EventFeed
from api.rest.http_protocol import TimeLimitedH11Protocol
from api.rest.keys import KeyRing
from api.rest.settings import Settings
from api.rest.wiring import Service

SHUTDOWN_GRACE_S = 5
"""How long requests in progress may take after a signal, s; the halt of the arm does not wait for them."""

_log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """A uvicorn server that halts the arm from the signal handler and reports its address."""

    def __init__(
        self,
        config: uvicorn.Config,
        service: Service,
        feed: EventFeed,
        preview: CameraPreview,
        on_ready: Callable[[str], None] | None,
    ) -> None:
        """`on_ready` is called with the service's address once it listens."""
        super().__init__(config)
        self.service = service
        self._feed = feed
        self._preview = preview
        self._on_ready = on_ready

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Halts the arm, then lets the server end; the session is interrupted, for the next service to resume."""
        self.service.rig.halt()  # takes no lock, so it may interrupt anything
        # The rest takes locks that the interrupted code may hold, so it must not wait for them in here.
        threading.Thread(target=self.service.runner.begin_shutdown, name="shut").start()
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Binds the socket and reports its address."""
        await super().startup(sockets)
        if self.started and self._on_ready is not None:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            self._on_ready(f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}")

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Ends the streams, then shuts down as uvicorn does."""
        self._feed.end()
        self._preview.end()
        await super().shutdown(sockets)


def create(settings: Settings, on_ready: Callable[[str], None] | None = None) -> Server:
    """Creates the server of these settings, not yet running.

    Raises RigError config.invalid for a host that is not this machine alone while there are no keys, for a bad cell
    file, calibration or key file; store.locked, store.corrupt.
    """
    ring = KeyRing(keys.path_in(settings.data))
    settings_.refuse_open_bind(settings.host, ring.required)
    return create_for(wiring.build(settings), settings, ring, on_ready)


def create_for(
    service: Service, settings: Settings, ring: KeyRing, on_ready: Callable[[str], None] | None = None
) -> Server:
    """Creates the server of a service, not yet running; `ring` holds the keys of its callers."""
    app: FastAPI = create_app(service, settings, ring)
    config = uvicorn.Config(
        app,
        http=TimeLimitedH11Protocol,
        ws="none",
        host=settings.host,
        port=settings.port,
        workers=1,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=SHUTDOWN_GRACE_S,
    )
    return Server(config, service, app.state.feed, app.state.camera_preview, on_ready)


def announce(address: str) -> None:
    """Prints the service's address, for people and for programs that started it."""
    print(f"ready {address}", flush=True)


def serve(settings: Settings, on_ready: Callable[[str], None] = announce) -> None:
    """Serves until SIGTERM or SIGINT; `on_ready` is called with the address once it listens.

    Raises RigError as `create` does, and config.invalid when the port cannot be bound.
    """
    logs.configure(settings.log)
    process_priority.set_niceness(process_priority.SERVICE)
    server = create(settings, on_ready)
    try:
        server.run()
    except KeyboardInterrupt:  # uvicorn raises the signal again after an orderly shutdown
        _log.info("ended by an interrupt from the keyboard")
    except SystemExit as error:  # uvicorn's report that it did not start
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"{settings.host}:{settings.port} cannot be bound; the log says why",
        ) from error
