"""The server process: one worker, and a signal that halts the arm before anything else happens.

uvicorn installs its own signal handlers and ends the application only after the open connections are served, which an
event stream delays by seconds. So the halt hangs on the handler itself and the streams are told to end at shutdown.
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
from api.rest.camera_view import View
from api.rest.connection import Connection
from api.rest.events import EventFeed
from api.rest.keys import KeyRing
from api.rest.settings import Settings
from api.rest.wiring import Service

GRACE_S = 5
"""How long requests in progress may take after a signal; the arm does not wait for them."""

_log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """A uvicorn server that halts the arm from the signal handler and tells where it listens."""

    def __init__(
        self,
        config: uvicorn.Config,
        service: Service,
        feed: EventFeed,
        view: View,
        say: Callable[[str], None] | None,
    ) -> None:
        """`say` is called with the service's address once it listens."""
        super().__init__(config)
        self.service = service
        self._feed = feed
        self._view = view
        self._say = say

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Halts the arm, then lets the server end; the session is interrupted, for the next service to resume."""
        self.service.rig.halt()  # takes no lock, so it may interrupt anything
        # The rest takes locks that the interrupted code may hold, so it must not wait for them in here.
        threading.Thread(target=self.service.runner.begin_shutdown, name="shut").start()
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Listens, and says where."""
        await super().startup(sockets)
        if self.started and self._say is not None:
            host, port = self.servers[0].sockets[0].getsockname()[:2]
            self._say(f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}")

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Ends the streams, then as ever."""
        self._feed.end()
        self._view.end()
        await super().shutdown(sockets)


def make(settings: Settings, say: Callable[[str], None] | None = None) -> Server:
    """The server of these settings, not yet running.

    Raises RigError config.invalid for a host that is not this machine alone while there are no keys, for a bad cell
    file, calibration or key file; store.locked, store.corrupt.
    """
    ring = KeyRing(keys.path_in(settings.data))
    settings_.refuse_open_bind(settings.host, ring.required)
    return around(wiring.build(settings), settings, ring, say)


def around(service: Service, settings: Settings, ring: KeyRing, say: Callable[[str], None] | None = None) -> Server:
    """The server of a service, not yet running; `ring` holds the keys of those who may call."""
    app: FastAPI = create_app(service, settings, ring)
    config = uvicorn.Config(
        app,
        http=Connection,
        ws="none",
        host=settings.host,
        port=settings.port,
        workers=1,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=GRACE_S,
    )
    return Server(config, service, app.state.feed, app.state.view, say)


def announce(address: str) -> None:
    """Prints where the service listens, for people and for programs that started it."""
    print(f"ready {address}", flush=True)


def serve(settings: Settings, say: Callable[[str], None] = announce) -> None:
    """Serves until SIGTERM or SIGINT; `say` is called with the address once it listens.

    Raises RigError as `make` does, and config.invalid when the port cannot be had.
    """
    logs.configure(settings.log)
    process_priority.set_niceness(process_priority.SERVICE)
    server = make(settings, say)
    try:
        server.run()
    except KeyboardInterrupt:  # uvicorn raises the signal again after it has ended in good order
        _log.info("ended by the keyboard")
    except SystemExit as error:  # its way to say that it did not start
        raise RigError(
            ErrorCode.CONFIG_INVALID,
            f"{settings.host}:{settings.port} cannot be listened on; the log says why",
        ) from error
