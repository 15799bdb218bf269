"""Checks that the servers that a command names answer, before anything is imported that takes long.

Dask, SQLAlchemy and the clients of object stores take seconds to import, and each waits in its own way for a server
that accepts a connection and stays silent. The three kinds of server answer within one exchange of bytes, which the
standard library can read. So a wrong address is reported first and in one way, and the clients keep time-outs that suit
busy servers. The clients find whatever else is wrong (rights, versions, a server of another kind).
"""

import os
import socket
import ssl
import struct
from urllib.parse import SplitResult, urlsplit

from acquisition.models.errors import ErrorCode, RigError

ANSWER_S = 4.0
"""Time limit, s, for a server's answer; with the start of the program (0.5 s) a failure shows within five seconds.

An idle server in the same building needs a hundredth of it. A scheduler to which workers and a graph of tasks have just
returned needs more than 2.5 s on a machine of two cores that they share.
"""
DASK_PROTOCOLS = ("tcp", "tls", "ws", "wss")
_POSTGRES_SSL_REQUEST = struct.pack("!ii", 8, 80877103)
"""PostgreSQL, Frontend/Backend Protocol, “SSLRequest”: answered with one byte, whether the server accepts it or not."""


def require_store(address: str) -> None:
    """Raises RigError archive.unreachable unless the object store of `s3://…` at AWS_ENDPOINT_URL answers.

    Other addresses are not checked: folders need no server, and the client finds Amazon's own stores.
    """
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL")
    if not address.startswith(("s3://", "s3a://")) or not endpoint:
        return
    url = urlsplit(endpoint)
    request = f"HEAD / HTTP/1.1\r\nHost: {url.hostname}\r\nConnection: close\r\n\r\n".encode()
    try:
        _exchange(url, 443 if url.scheme == "https" else 80, request)
    except OSError as error:
        raise _unreachable(f"{address}: {endpoint}", error) from error


def require_catalogue(address: str | None) -> None:
    """Raises RigError archive.unreachable unless the server of `postgresql://HOST…` answers."""
    if address is None or not address.startswith("postgresql"):
        return
    url = urlsplit(address)
    if url.hostname is None or "," in url.netloc:
        return  # a socket of this machine, or several hosts of which libpq takes the one that answers
    try:
        _exchange(url, 5432, _POSTGRES_SSL_REQUEST)
    except OSError as error:
        raise _unreachable(url._replace(netloc=url.netloc.rpartition("@")[2]).geturl(), error) from error


def require_scheduler(address: str | None) -> None:
    """Raises RigError archive.no_scheduler unless a Dask scheduler answers; it is the one that speaks first."""
    if address is None:
        return
    url = urlsplit(address)
    try:
        if url.scheme not in DASK_PROTOCOLS:
            raise OSError(f"the address must begin with one of {', '.join(f'{name}://' for name in DASK_PROTOCOLS)}")
        _exchange(url, 8786, b"GET / HTTP/1.1\r\n\r\n" if url.scheme == "ws" else b"")
    except OSError as error:
        raise RigError(
            ErrorCode.ARCHIVE_NO_SCHEDULER, f"no Dask scheduler answers at {address}: {_why(error)}", address=address
        ) from error


def _exchange(url: SplitResult, port: int, question: bytes) -> None:
    """Sends the question and waits for the first byte; on an encrypted connection, waits only for the handshake."""
    try:
        address = (url.hostname or "", url.port or port)
    except ValueError as error:
        raise OSError(str(error)) from error
    with socket.create_connection(address, ANSWER_S) as connection:
        if url.scheme in ("https", "tls", "wss"):
            # The client will check who the server is; here it only has to answer.
            context = ssl.create_default_context()
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            try:
                context.wrap_socket(connection).close()
            except ssl.SSLError:
                return  # it answered, and the client will report what is wrong
            return
        connection.sendall(question)
        if not connection.recv(1):
            raise OSError("it closed the connection without an answer")


def _unreachable(what: str, error: OSError) -> RigError:
    return RigError(ErrorCode.ARCHIVE_UNREACHABLE, f"{what}: {_why(error)}", address=what)


def _why(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return f"no answer within {ANSWER_S:g} s"
    return error.strerror or str(error)
