"""TLS of the service itself: its certificate, and encrypted connections that the listener's thread can begin.

asyncio encrypts a connection only from its first byte on. Here the listener's thread reads the first request, since it
answers the stop. A connection's TLS state therefore lives in memory (`TlsSession`, over OpenSSL's memory buffers). It
belongs to the listener until the connection is handed over. Then a protocol on the event loop owns it, which decrypts
what arrives and gives the HTTP protocol a transport that encrypts. The context is uvicorn's own.
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
"""Permission bits of a file for everybody. A group such as Debian's `ssl-cert` may read a key."""

_READ_BYTES = 1 << 16
_NO_PASSWORD = "none"  # noqa: S105 - makes OpenSSL refuse a key with a password instead of asking at the terminal


def context(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """Returns the server's TLS context, or None without certificate and key.

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
        raise _invalid(f"The TLS key {key} can be read or written by everybody (mode {mode:04o}): run chmod 640 {key}")
    try:
        made = create_ssl_context(
            certificate, key, _NO_PASSWORD, ssl.PROTOCOL_TLS_SERVER, ssl.CERT_NONE, ca_certs=None, ciphers=None
        )
    except (ssl.SSLError, OSError, ValueError) as error:
        raise _invalid(f"{certificate} and {key} are not a matching certificate and key in PEM: {error}") from error
    made.minimum_version = ssl.TLSVersion.TLSv1_2
    return made


def _invalid(detail: str) -> RigError:
    return RigError(ErrorCode.CONFIG_INVALID, detail)


class TlsSession:
    """The server's side of one encrypted connection, without a socket. Only one thread at a time may use it."""

    def __init__(self, server: ssl.SSLContext) -> None:
        self.context = server
        self.ended = False  # whether the peer has announced that it sends no more
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._object = server.wrap_bio(self._incoming, self._outgoing, server_side=True)
        self._established = False

    def receive(self, block: bytes) -> bytes:
        """Decrypts what has arrived; empty during the handshake. `to_send` may then hold TLS's own answer.

        Raises ssl.SSLError for data that is not TLS.
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
        """Encrypts data, and returns it with whatever else is to be sent."""
        rest = memoryview(plain)
        while rest:
            rest = rest[self._object.write(rest) :]
        return self.to_send()

    def close(self) -> bytes:
        """Returns the encrypted end of the connection."""
        with suppress(ssl.SSLError):  # raised for the missing end of the peer or an incomplete handshake
            self._object.unwrap()
        return self.to_send()

    def to_send(self) -> bytes:
        """Returns and removes the bytes that are ready for the peer."""
        return self._outgoing.read()


class TlsProtocol(asyncio.Protocol):
    """Protocol of an encrypted connection whose session began elsewhere. It drives an inner protocol in clear text."""

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
        """Passes the call on."""
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        """Passes the call on."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Passes the call on."""
        self._inner.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Passes the call on."""
        self._inner.connection_lost(exc)


class TlsTransport(asyncio.Transport):
    """Transport that encrypts for a TLS session and leaves everything else to the underlying transport."""

    def __init__(self, session: TlsSession, under: asyncio.Transport) -> None:
        super().__init__()
        self._session = session
        self._under = under

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Returns the underlying transport's information, and the TLS context, by which the server knows the scheme."""
        return self._session.context if name == "sslcontext" else self._under.get_extra_info(name, default)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Encrypts and sends."""
        if data and not self._under.is_closing():
            self._under.write(self._session.send(bytes(data)))

    def close(self) -> None:
        """Sends the buffered data and the end of the connection, then closes."""
        if not self._under.is_closing():
            self._under.write(self._session.close())
            self._under.close()

    def abort(self) -> None:
        """Closes at once."""
        self._under.abort()

    def is_closing(self) -> bool:
        """Returns whether the transport is closing."""
        return self._under.is_closing()

    def pause_reading(self) -> None:
        """Pauses reading."""
        self._under.pause_reading()

    def resume_reading(self) -> None:
        """Resumes reading."""
        self._under.resume_reading()

    def is_reading(self) -> bool:
        """Returns whether the transport is reading."""
        return self._under.is_reading()

    def get_write_buffer_size(self) -> int:
        """Returns the number of encrypted bytes that wait to be sent."""
        return self._under.get_write_buffer_size()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Sets the limits of that buffer."""
        self._under.set_write_buffer_limits(high, low)

    def can_write_eof(self) -> bool:
        """Returns False, because TLS has no half-closed connections here."""
        return False
