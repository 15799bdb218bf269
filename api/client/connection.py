# Generated from async_connection.py by `python -m api.client.generate`: change that one.
"""Connection: the connection to one service, its typed requests and its downloads, beneath `Client`."""

import hashlib
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from acquisition.models.errors import ErrorCode
from api.client.responses import ModelT, ProblemError, parsed, raise_problem
from api.client.transport import CLOSED_MEANWHILE, TIMEOUT_S, authorization_headers, connection, may_repeat
from api.rest.schemas import Page, Problem


class Connection:
    """Connection to one service; use it as a context manager or `close` it.

    `key` is the caller's API key; its default is the environment variable LIGHTPOSE_KEY, or none.
    """

    def __init__(self, url: str, key: str | None = None) -> None:
        self._http = httpx.Client(base_url=url, headers=authorization_headers(key), **connection())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def _get(self, address: str, model: type[ModelT]) -> ModelT:
        return parsed(self._send("GET", address), model)

    def _all(self, address: str, model: type[ModelT]) -> list[ModelT]:
        """Returns all items of a paged list."""
        items: list[ModelT] = []
        next_address: str | None = address
        while next_address is not None:
            page = self._get(next_address, Page[model])
            items += page.items
            next_address = page.next
        return items

    def _fetch(
        self, address: str, path: Path, sha256: str | None, timeout: httpx.Timeout | float = TIMEOUT_S
    ) -> Path:  # fmt: skip
        """Downloads to a hidden file beside `path`, and renames it once its digest is checked."""
        partial = path.with_name(f".{path.name}.part")
        digest = hashlib.sha256()
        try:
            with self._http.stream("GET", address, timeout=timeout) as response:
                if response.is_error:
                    response.read()
                    raise_problem(response)
                with partial.open("wb") as file:
                    for block in response.iter_bytes():
                        digest.update(block)
                        file.write(block)
            if sha256 is not None and digest.hexdigest() != sha256:
                raise ProblemError(Problem.of(ErrorCode.STORE_CORRUPT, f"{address} differs from the manifest's digest"))
            partial.rename(path)
        finally:
            partial.unlink(missing_ok=True)
        return path

    def _send(self, method: str, address: str, **arguments: Any) -> httpx.Response:
        try:
            response = self._http.request(method, address, **arguments)
        except CLOSED_MEANWHILE:
            if not may_repeat(method, address):
                raise
            response = self._http.request(method, address, **arguments)
        if response.is_error:
            raise_problem(response)
        return response
