"""Open streams: they end with the key or ticket that opened them, and one key has only so many."""

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.rest import keys
from api.rest.keys import Role
from tests.model.quick_rig import quick_service

WITHIN_S = 30.0


def follow(url: str, path: str, headers: dict[str, str]) -> tuple[int, int]:
    """Reads a stream to its end; status and bytes."""
    with (
        httpx.Client(base_url=url, timeout=WITHIN_S, trust_env=False) as http,
        http.stream("GET", path, headers=headers) as answer,
    ):
        return answer.status_code, sum(len(block) for block in answer.iter_raw())


def test_streams_of_revoked_key_end_and_others_go_on(tmp_path: Path) -> None:
    with ThreadPoolExecutor(4) as pool, quick_service(tmp_path, "127.0.15.40") as (server, _, url, secrets):
        path = keys.path_in(server.service.store.data)
        viewer, operator = ({"Authorization": f"Bearer {secrets[role]}"} for role in (Role.VIEWER, Role.OPERATOR))
        ticket = httpx.post(f"{url}/v1/tickets", headers=viewer, trust_env=False).json()["ticket"]
        ending = [
            pool.submit(follow, url, "/v1/events?after=0&joints=true", viewer),
            pool.submit(follow, url, "/v1/rig/preview.mjpeg", viewer),
            pool.submit(follow, url, f"/v1/events?after=0&ticket={ticket}", {}),
        ]
        going_on = pool.submit(follow, url, "/v1/events?after=0", operator)
        while server._feed.listeners < 3 or server._preview.viewers < 1:
            time.sleep(0.01)
        name = next(key.name for key in keys.read(path).keys if key.role is Role.VIEWER)  # type: ignore[union-attr]
        keys.revoke(path, name)
        answers = [future.result(WITHIN_S) for future in ending]
        still = not going_on.done()

    assert [status for status, _ in answers] == [200] * 3
    assert still


def test_stream_of_ticket_ends_with_its_lifetime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keys, "TICKET_LIFETIME_S", 1.5)
    with quick_service(tmp_path, "127.0.15.41") as (_, _, url, secrets):
        viewer = {"Authorization": f"Bearer {secrets[Role.VIEWER]}"}
        for path in ("/v1/events?joints=true&", "/v1/rig/preview.mjpeg?"):
            ticket = httpx.post(f"{url}/v1/tickets", headers=viewer, trust_env=False).json()["ticket"]
            assert follow(url, f"{path}ticket={ticket}", {})[0] == 200
            assert httpx.get(f"{url}/v1/rig?ticket={ticket}", trust_env=False).status_code == 401


def test_stream_beyond_a_keys_share_is_refused_for_a_while(
    start: Callable[..., AbstractContextManager[Any]],
) -> None:
    with start() as running, ExitStack() as stack:
        streams = running.server.config.loaded_app.state.streams
        streams._capacity = dataclasses.replace(streams._capacity, streams_per_caller=3)
        http = running.http
        opened = [stack.enter_context(http.stream("GET", "/v1/events?after=0")) for _ in range(3)]
        texts = [answer.iter_text() for answer in opened]  # kept: an iterator that is dropped closes its connection
        for text in texts:
            next(text)
        refused = http.get("/v1/events?follow=false")
        opened[0].close()
        while streams._of_caller.total() == 3:
            time.sleep(0.01)
        again = http.get("/v1/events?follow=false")

    assert (refused.status_code, refused.json()["code"]) == (429, "request.too_many_streams")
    assert int(refused.headers["Retry-After"]) == refused.json()["retry_after_s"]
    assert again.status_code == 200
