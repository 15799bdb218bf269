"""HEAD, OPTIONS, Allow, preflights, and the headers that tell a browser what it may do with an answer."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from acquisition.store.folder import write_manifest
from api.rest.app import description

PAGE = "http://lab.example"


def concrete(path: str, session_id: str) -> str:
    for name, value in {"session_id": session_id, "code": "rig.busy", "number": "0", "shot_number": "0"}.items():
        path = path.replace("{" + name + "}", value)
    return path.replace("{artefact}", "a.png").replace("{entry_id}", "1")


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
        assert ("etag" in head.headers) == ("etag" in got.headers), path  # an age or a count may have changed


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


def test_answers_to_deletes_have_neither_body_nor_content_type(administered: Any) -> None:
    entry = administered.http.post("/v1/queue/entries", json={"object_name": "coin"}).headers["Location"]
    for address in (f"/v1/sessions/{administered.client.create().id}", entry):
        answer = administered.http.delete(address)

        assert (answer.status_code, answer.content) == (204, b"")
        assert "content-type" not in answer.headers, address
        assert "content-length" not in answer.headers, address


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


def test_text_is_compressed_for_who_accepts_it_and_revalidated(shared: Any) -> None:
    plain = shared.http.get("/v1/rig/scene", headers={"Accept-Encoding": "identity"})
    packed = shared.http.get("/v1/rig/scene", headers={"Accept-Encoding": "br, gzip;q=0.5"})
    refused = shared.http.get("/v1/rig/scene", headers={"Accept-Encoding": "gzip;q=0.0"})

    assert packed.headers["content-encoding"] == "gzip"
    assert int(packed.headers["content-length"]) < int(plain.headers["content-length"]) / 2
    assert packed.json() == plain.json()
    assert "content-encoding" not in plain.headers
    assert "content-encoding" not in refused.headers
    assert "Accept-Encoding" in plain.headers["vary"]
    assert packed.headers["etag"] == f"W/{plain.headers['etag']}"
    for tag in (plain.headers["etag"], packed.headers["etag"]):
        again = shared.http.get("/v1/rig/scene", headers={"If-None-Match": tag})
        assert (again.status_code, again.content) == (304, b"")


def test_resource_in_json_has_etag_until_it_changes(own: Any) -> None:
    made = own.client.create()
    address = f"/v1/sessions/{made.id}"
    first = own.http.get(address)
    same = own.http.get(address, headers={"If-None-Match": first.headers["etag"]})
    own.http.patch(address, json={"label": "other"})
    changed = own.http.get(address, headers={"If-None-Match": first.headers["etag"]})

    assert same.status_code == 304
    assert first.headers["cache-control"] == "private, no-cache"
    assert (changed.status_code, changed.json()["label"]) == (200, "other")


def test_range_that_cannot_be_served_is_a_problem_object(shared: Any) -> None:
    made = shared.client.create()
    file = shared.service.store.folder(made.id) / "results" / "0"
    file.mkdir(parents=True)
    digest = write_manifest(file, {"number": 0})
    body = {"origin": "session", "seconds": 1.0, "images": 1}
    shared.service.store.journal.add_artifact(made.id, "result", 0, "results/0/manifest.json", digest, body, "x.ready")

    answer = shared.http.get(f"/v1/sessions/{made.id}/results/0/manifest.json", headers={"Range": "bytes=9999999-"})

    assert answer.status_code == 416
    assert answer.headers["content-type"] == "application/problem+json"
    assert "*/" in answer.headers["content-range"]
    assert answer.json()["status"] == 416


def test_absent_devices_say_when_to_try_again(shared: Any) -> None:
    answer = shared.http.get("/health/ready")

    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0


def test_body_of_other_json_types_is_refused(own: Any) -> None:
    made = own.client.create()

    for body in ({"action": "start", "from_here": 0}, {"action": "start", "from_here": "false"}):
        answer = own.http.post(f"/v1/sessions/{made.id}/actions", json=body)
        assert answer.status_code == 422, body
        assert answer.json()["errors"][0]["field"] == "from_here"
    assert own.http.get("/v1/sessions?since=1795439184.5").status_code == 422
    assert own.http.get("/v1/sessions?since=2026-11-23T12:00:00Z").status_code == 200


def test_methods_of_an_address_are_its_own(shared: Any) -> None:
    address = "/v1/sessions/x/results/0/cancellation"

    assert shared.http.options(address).headers["allow"] == "POST, OPTIONS"
    assert shared.http.get(address).status_code == 405
    png = {"Content-Type": "image/png"}
    assert shared.http.request("TRACE", "/v1/sessions/x/region.png", content=b"x", headers=png).status_code == 405
