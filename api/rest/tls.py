"""TLS of the service itself: its certificate, and encrypted connections that the listener's thread can begin.

asyncio encrypts a connection only from its first byte on, but here the listener's thread reads the first request, since
it answers the stop. So a connection's TLS state lives in memory (`TlsSession`, over OpenSSL's memory buffers), belongs
to the listener until the connection is handed over, and then to a protocol on the event loop that decrypts what arrives
and hands a transport that encrypts to the HTTP protocol. The context is uvicorn's own.
"""

import asyncio
import ssl
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

from uvicorn.config import create_ssl_context

from acquisition.models.errors import ErrorCode, RigError

OF_EVERYBODY = 0o007
"""Permissions of a file that concern everybody; a group such as Debian's `ssl-cert` may read a key."""

_READ_BYTES = 1 << 16
_NO_PASSWORD = "none"  # noqa: S105 - of a key that needs one, so that OpenSSL refuses it instead of asking at the terminal


def context(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """The server's TLS context; None without certificate and key.

    Raises RigError config.invalid naming what is missing, cannot be read, is open to everybody, or does not fit.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        raise _invalid("TLS needs both a certificate (--tls-cert) and its key (--tls-key)")
    for name, path in (("certificate", certificate), ("key", key)):
        try:
            path.read_bytes()
        except OSError as error:
            raise _invalid(f"The TLS {name} {path} cannot be read: {error.strerror}") from error
    mode = stat.S_IMODE(key.stat().st_mode)
    if mode & OF_EVERYBODY:
        raise _invalid(f"The TLS key {key} may be read or written by everybody (mode {mode:04o}): run chmod 640 {key}")
    try:
        made = create_ssl_context(
            certificate, key, _NO_PASSWORD, ssl.PROTOCOL_TLS_SERVER, ssl.CERT_NONE, ca_certs=None, ciphers=None
        )
    except (ssl.SSLError, OSError, ValueError) as error:
        raise _invalid(f"{certificate} and {key} are no certificate and key, in PEM, of each other: {error}") from error
    made.minimum_version = ssl.TLSVersion.TLSv1_2
    return made


def _invalid(detail: str) -> RigError:
    return RigError(ErrorCode.CONFIG_INVALID, detail)


class TlsSession:
    """The server's side of one encrypted connection, without a socket; one thread at a time uses it."""

    def __init__(self, server: ssl.SSLContext) -> None:
        self.context = server
        self.ended = False  # the peer has said that it sends no more
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._object = server.wrap_bio(self._incoming, self._outgoing, server_side=True)
        self._established = False

    def receive(self, block: bytes) -> bytes:
        """Decrypts what has arrived, empty during the handshake; `to_send` may hold an answer to it.

        Raises ssl.SSLError for what is no TLS.
        """
        self._incoming.write(block)
        plain = bytearray()
        try:
            if not self._established:
                self._object.do_handshake()
                self._established = True
            while not self.ended:
                part = self._object.read(_READ_BYTES)
                plain += part
                self.ended = not part
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLZeroReturnError:
            self.ended = True
        return bytes(plain)

    def send(self, plain: bytes) -> bytes:
        """Encrypts; with it goes what else is to be sent."""
        rest = memoryview(plain)
        while rest:
            rest = rest[self._object.write(rest) :]
        return self.to_send()

    def close(self) -> bytes:
        """The end of what is sent."""
        with suppress(ssl.SSLError):  # it waits for the peer's, which nobody needs; or there was no complete handshake
            self._object.unwrap()
        return self.to_send()

    def to_send(self) -> bytes:
        """Bytes for the peer."""
        return self._outgoing.read()


class TlsProtocol(asyncio.Protocol):
    """Protocol of an encrypted connection whose session has begun elsewhere; drives an inner protocol in clear."""

    def __init__(self, session: TlsSession, inner: asyncio.Protocol) -> None:
        self._session = session
        self._inner = inner
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begins the inner connection."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - a socket's is
        self._transport = transport
        self._inner.connection_made(TlsTransport(self._session, transport))

    def data_received(self, data: bytes) -> None:
        """Decrypts for the inner protocol."""
        assert self._transport is not None  # noqa: S101 - made before
        try:
            plain = self._session.receive(data)
        except ssl.SSLError:
            self._transport.abort()
            return
        answer = self._session.to_send()
        if answer:
            self._transport.write(answer)
        if plain:
            self._inner.data_received(plain)
        if self._session.ended:
            self._inner.eof_received()
            self._transport.close()

    def eof_received(self) -> bool | None:
        """Passes it on."""
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        """Passes it on."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Passes it on."""
        self._inner.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Passes it on."""
        self._inner.connection_lost(exc)


class TlsTransport(asyncio.Transport):
    """Transport that encrypts for a TLS session; all else is the underlying transport's."""

    def __init__(self, session: TlsSession, under: asyncio.Transport) -> None:
        super().__init__()
        self._session = session
        self._under = under

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """As the underlying transport's; with the TLS context, by which the server knows the scheme."""
        return self._session.context if name == "sslcontext" else self._under.get_extra_info(name, default)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Encrypts and sends."""
        if data and not self._under.is_closing():
            self._under.write(self._session.send(bytes(data)))

    def close(self) -> None:
        """Sends what is buffered and the end of it, then closes."""
        if not self._under.is_closing():
            self._under.write(self._session.close())
            self._under.close()

    def abort(self) -> None:
        """Closes at once."""
        self._under.abort()

    def is_closing(self) -> bool:
        """Whether it closes."""
        return self._under.is_closing()

    def pause_reading(self) -> None:
        """Reads no more for now."""
        self._under.pause_reading()

    def resume_reading(self) -> None:
        """Reads again."""
        self._under.resume_reading()

    def is_reading(self) -> bool:
        """Whether it reads."""
        return self._under.is_reading()

    def get_write_buffer_size(self) -> int:
        """Encrypted bytes that are to be sent."""
        return self._under.get_write_buffer_size()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Limits of that buffer."""
        self._under.set_write_buffer_limits(high, low)

    def can_write_eof(self) -> bool:
        """TLS has no half-closed connections here."""
        return False
