"""HEAD, OPTIONS, Allow, preflights, and the headers that tell a browser what it may do with an answer."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from api.rest.app import description

PAGE = "http://lab.example"


def concrete(path: str, session_id: str) -> str:
    for name, value in {"session_id": session_id, "code": "rig.busy", "number": "0", "shot_number": "0"}.items():
        path = path.replace("{" + name + "}", value)
    return path.replace("{artefact}", "a").replace("{entry_id}", "1")


def test_head_answers_as_get_without_a_body(shared: Any) -> None:
    made = shared.client.create()
    for path, methods in description()["paths"].items():
        if "get" not in methods or path in ("/v1/events", "/v1/rig/preview.mjpeg", "/v1/rig/reach"):
            continue
        address = concrete(path, made.id)
        got, head = shared.http.get(address), shared.http.head(address)
        assert head.status_code == got.status_code, path
        assert head.content == b""
        assert head.headers.get("content-type") == got.headers.get("content-type"), path
        assert head.headers.get("etag") == got.headers.get("etag"), path


def test_head_of_event_stream_ends(shared: Any) -> None:
    head = shared.http.head("/v1/events")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"].startswith("text/event-stream")


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/v1/sessions", {"GET", "POST", "HEAD", "OPTIONS"}),
        ("/v1/sessions/x", {"GET", "PATCH", "DELETE", "HEAD", "OPTIONS"}),
        ("/v1/rig/stop", {"POST", "OPTIONS"}),
    ],
)
def test_allow_names_every_method_of_an_address(shared: Any, path: str, methods: set[str]) -> None:
    refused = shared.http.put(path)
    options = shared.http.options(path)

    assert refused.status_code == 405
    assert refused.json()["code"] == "request.method_not_allowed"
    assert options.status_code == 204
    for answer in (refused, options):
        assert set(answer.headers["Allow"].split(", ")) == methods


def test_answers_have_headers_against_misuse(shared: Any) -> None:
    for path in ("/v1/rig", "/v1/sessions/none", "/health/live", "/v1/rig/stop"):
        answer = shared.http.get(path)
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert answer.headers["Content-Security-Policy"] == "default-src 'none'; frame-ancestors 'none'"
    html = shared.http.get("/problems/rig.busy", headers={"Accept": "text/html"})
    assert "sandbox allow-scripts" in html.headers["Content-Security-Policy"]
    assert "allow-same-origin" not in html.headers["Content-Security-Policy"]
    page = shared.http.get("/")
    assert "sandbox" not in page.headers["Content-Security-Policy"]


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_post_of_another_page_without_origin_is_refused(shared: Any, site: str) -> None:
    before = shared.service.runner.halts
    for path in ("/v1/rig/stop", "/v1/rig/park", "/v1/rig/safety/acknowledgement"):
        answer = shared.http.post(path, headers={"Sec-Fetch-Site": site})
        assert (answer.status_code, answer.json()["code"]) == (403, "request.foreign")
    assert shared.service.runner.halts == before
    own = shared.http.post("/v1/tickets", headers={"Sec-Fetch-Site": "same-origin"})
    assert own.status_code == 201


def test_preflights_allow_the_allowed_page_only(start: Callable[..., AbstractContextManager[Any]]) -> None:
    asked = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "authorization"}
    with start(allowed_origins=(PAGE,)) as service:
        allowed = service.http.options("/v1/sessions", headers={"Origin": PAGE, **asked})
        foreign = service.http.options("/v1/sessions", headers={"Origin": "http://evil.example", **asked})
        made = service.http.post("/v1/sessions", json={}, headers={"Origin": PAGE})

    assert allowed.status_code == 200
    assert allowed.headers["Access-Control-Allow-Origin"] == PAGE
    assert (foreign.status_code, foreign.json()["code"]) == (403, "request.foreign")
    exposed = {name.strip() for name in made.headers["Access-Control-Expose-Headers"].split(",")}
    assert {"Location", "ETag", "Retry-After"} <= exposed
    assert made.headers["Cross-Origin-Resource-Policy"] == "cross-origin"
