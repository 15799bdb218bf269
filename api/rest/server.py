"""The server process: one worker, and a signal handler that halts the arm before anything else.

uvicorn's own signal handlers end the application only after the open connections are served, which an event stream
delays by seconds. Here the signal handler itself halts the arm, and the streams are ended at shutdown.
"""

import asyncio
import logging
import ssl
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext
from functools import partial
from socket import socket
from types import FrameType

import uvicorn
from fastapi import FastAPI
from uvicorn.config import STARTUP_FAILURE

from acquisition import process_priority
from acquisition.models.errors import ErrorCode, RigError
from api.rest import capacity, http_protocol, keys, logs, standard_error, tls, wiring
from api.rest import settings as settings_
from api.rest.app import create_app
from api.rest.camera_preview import CameraPreview
from api.rest.capacity import Capacity
from api.rest.events import EventFeed
from api.rest.http_protocol import TimeLimitedH11Protocol
from api.rest.keys import KeyRing
from api.rest.listener import Listener, bound_sockets
from api.rest.settings import Settings
from api.rest.stop_request import StopRequests
from api.rest.tls import TlsProtocol, TlsSession
from api.rest.wiring import Service

SWITCH_INTERVAL_S = 0.001
"""Time for which a thread may keep others from running Python code, s (default 0.005). Beside a busy event loop the
listener waits this long, about ten times per stop."""

SHUTDOWN_GRACE_S = 5
"""Time limit for requests in progress after a signal, s. The halt of the arm does not wait for them."""

_log = logging.getLogger(__name__)


class Server(uvicorn.Server):
    """A uvicorn server that halts the arm from the signal handler and reports its address."""

    def __init__(
        self,
        config: uvicorn.Config,
        service: Service,
        app: FastAPI,
        tls_context: ssl.SSLContext | None,
        on_ready: Callable[[str], None] | None,
    ) -> None:
        """`on_ready` is called with the service's address once it listens."""
        super().__init__(config)
        self.service = service
        self._tls, self._scheme = tls_context, "http" if tls_context is None else "https"
        self._stops = StopRequests(
            service,
            app.state.pages,
            app.state.authentication,
            app.state.proxies,
            app.state.security_headers,
            self._scheme,
        )
        self._capacity: Capacity = app.state.capacity
        self._security_headers: dict[str, str] = app.state.security_headers
        self._listener: Listener | None = None
        self._adopting: set[asyncio.Task[None]] = set()
        self._feed: EventFeed = app.state.feed
        self._preview: CameraPreview = app.state.camera_preview
        self._on_ready = on_ready

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Halts the arm, then lets the server end. The session is interrupted; the next service can resume it."""
        # Neither takes a lock, so they may interrupt anything. Unannounced, the halt would seem a fault of the arm.
        self.service.runner.closing.announced = True
        self.service.rig.halt()
        # The rest takes locks that the interrupted code may hold, so it must not wait for them in here.
        threading.Thread(target=self.service.runner.begin_shutdown, name="shut").start()
        super().handle_exit(sig, frame)

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """As uvicorn's, which ends the process by the signal once more: no entry of the log is lost with it."""
        with super().capture_signals():
            yield
            for handler in logging.getLogger().handlers:
                handler.flush()

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Binds the sockets, starts the service, starts the listener and reports the address.

        In place of uvicorn's own, which has the event loop accept connections. The sockets come first: a service that
        cannot listen, because another one does, must not touch the arm that the other one moves.
        """
        try:
            bound = sockets or bound_sockets(self.config.host, self.config.port)
        except OSError as error:
            self.service.store.close()
            raise RigError(
                ErrorCode.CONFIG_INVALID,
                f"{self.config.host}:{self.config.port} cannot be bound ({error.strerror}): is the port free? --port "
                "chooses another",
            ) from error
        await self.lifespan.startup()
        if self.lifespan.should_exit:
            for each in bound:
                each.close()
            sys.exit(STARTUP_FAILURE)
        self.servers, self.loop = [], asyncio.get_running_loop()
        self._listener = Listener(
            bound, self._capacity, lambda: http_protocol.HEAD_TIMEOUT_S, self._security_headers, self._tls
        )
        host, port = bound[0].getsockname()[:2]
        self._listener.start(self._stops.answer, partial(self._hand_over, self.loop))
        self.started = True
        if self._on_ready is not None:
            self._on_ready(f"{self._scheme}://[{host}]:{port}" if ":" in host else f"{self._scheme}://{host}:{port}")

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Ends the streams, then shuts down as uvicorn does."""
        if self._listener is not None:
            self._listener.close()
        self._feed.end()
        self._preview.end()
        await super().shutdown(sockets)

    def _hand_over(
        self, loop: asyncio.AbstractEventLoop, held: socket, received: bytes, peer: str, session: TlsSession | None
    ) -> None:
        """Gives a connection to the event loop. Called in the listener's thread."""

        def adopt() -> None:
            task = loop.create_task(self._adopt(held, received, peer, session))
            self._adopting.add(task)
            task.add_done_callback(self._adopting.discard)

        loop.call_soon_threadsafe(adopt)

    async def _adopt(self, held: socket, received: bytes, peer: str, session: TlsSession | None) -> None:
        listener = self._listener
        assert listener is not None  # noqa: S101 - the caller is its thread

        def protocol() -> asyncio.Protocol:
            made = TimeLimitedH11Protocol(
                config=self.config,
                server_state=self.server_state,
                app_state=self.lifespan.state,
                received=received,
                security_headers=self._security_headers,
                on_lost=partial(listener.release, peer),
            )
            return made if session is None else TlsProtocol(session, made)

        try:
            await asyncio.get_running_loop().connect_accepted_socket(protocol, held)
        except OSError:  # the peer has gone already
            listener.release(peer)
            held.close()


def create(settings: Settings, on_ready: Callable[[str], None] | None = None) -> Server:
    """Creates the server of these settings, not yet running.

    Raises RigError config.invalid for a host other than this machine without keys, and for a bad cell file, calibration
    or key file; folder.invalid for a data folder within another or a session's; store.locked, store.corrupt.
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
    return Server(config, service, app, tls.context(settings.tls_cert, settings.tls_key), on_ready)


def announce(address: str) -> None:
    """Prints the service's address, for people and for programs that started it.

    It is one write. `print` makes two where standard output has no buffer (PYTHONUNBUFFERED, as in containers), and the
    log's first line, in the same file, may come between the port and the end of its line.
    """
    sys.stdout.write(f"ready {address}\n")
    sys.stdout.flush()


def serve(settings: Settings, on_ready: Callable[[str], None] = announce) -> None:
    """Serves until SIGTERM or SIGINT. `on_ready` is called with the address once the service listens.

    Raises RigError as `create` does, and config.invalid when the port cannot be bound or the service cannot be opened.
    """
    logs.configure(settings.log, settings.log_file)
    process_priority.set_niceness(process_priority.SERVICE)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    _log.info("this process may open %d descriptors", capacity.raise_descriptor_limit())
    try:
        with standard_error.as_entries() if settings.log == "json" else nullcontext():
            _run(settings, on_ready)
    finally:
        logs.flush()


def _run(settings: Settings, on_ready: Callable[[str], None]) -> None:
    server = create(settings, on_ready)
    try:
        server.run()
    except KeyboardInterrupt:  # uvicorn raises the signal again after an orderly shutdown
        _log.info("ended by an interrupt from the keyboard")
    except SystemExit as error:  # uvicorn's report that it did not start
        raise RigError(ErrorCode.CONFIG_INVALID, "the service cannot be opened; the log says why") from error
