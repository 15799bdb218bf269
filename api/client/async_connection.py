"""AsyncConnection: the connection to one service, its typed requests and its downloads, beneath `AsyncClient`."""

import asyncio
import hashlib
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from acquisition.models.errors import ErrorCode
from api.client.responses import ModelT, ProblemError, parsed, raise_problem
from api.client.transport import CLOSED_MEANWHILE, TIMEOUT_S, authorization_headers, connection, may_repeat
from api.rest.schemas import Page, Problem


class AsyncConnection:
    """Connection to one service; use it as an async context manager or `close` it.

    `key` is the caller's API key; its default is the environment variable LIGHTPOSE_KEY, or none.
    """

    def __init__(self, url: str, key: str | None = None) -> None:
        self._http = httpx.AsyncClient(base_url=url, headers=authorization_headers(key), **connection())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def _get(self, address: str, model: type[ModelT]) -> ModelT:
        return parsed(await self._send("GET", address), model)

    async def _all(self, address: str, model: type[ModelT]) -> list[ModelT]:
        """Returns all items of a paged list."""
        items: list[ModelT] = []
        next_address: str | None = address
        while next_address is not None:
            page = await self._get(next_address, Page[model])
            items += page.items
            next_address = page.next
        return items

    async def _fetch(
        self, address: str, path: Path, sha256: str | None, timeout: httpx.Timeout | float = TIMEOUT_S
    ) -> Path:  # fmt: skip
        """Downloads to a hidden file beside `path`, and renames it once its digest is checked."""
        partial = path.with_name(f".{path.name}.part")
        digest = hashlib.sha256()
        try:
            async with self._http.stream("GET", address, timeout=timeout) as response:
                if response.is_error:
                    await response.aread()
                    raise_problem(response)
                with await asyncio.to_thread(partial.open, "wb") as file:
                    async for block in response.aiter_bytes():
                        digest.update(block)
                        await asyncio.to_thread(file.write, block)
            if sha256 is not None and digest.hexdigest() != sha256:
                raise ProblemError(Problem.of(ErrorCode.STORE_CORRUPT, f"{address} differs from the manifest's digest"))
            await asyncio.to_thread(partial.rename, path)
        finally:
            await asyncio.to_thread(partial.unlink, missing_ok=True)
        return path

    async def _send(self, method: str, address: str, **arguments: Any) -> httpx.Response:
        try:
            response = await self._http.request(method, address, **arguments)
        except CLOSED_MEANWHILE:
            if not may_repeat(method, address):
                raise
            response = await self._http.request(method, address, **arguments)
        if response.is_error:
            raise_problem(response)
        return response
