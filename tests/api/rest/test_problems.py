"""Every invalid request is answered by a problem object with a remedy, and starts no motion."""

import http.client
import json
import time
from typing import Any

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.problem_table import PROBLEMS
from acquisition.session_state import Trigger

JSON = {"Content-Type": "application/json"}


def problem(answer: httpx.Response, code: ErrorCode) -> dict[str, Any]:
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["code"] == code
    assert answer.status_code == body["status"] == PROBLEMS[code].status
    assert body["title"] == PROBLEMS[code].title
    assert body["remedy"]
    assert body["detail"]
    assert body["type"] == f"/problems/{code}"
    return body


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ('{"planned_lights": -3}', "planned_lights"),
        ('{"planned_lights": 10000}', "planned_lights"),
        ('{"planned_lights": 4.5}', "planned_lights"),
        ('{"planned_lights": "4"}', "planned_lights"),
        ('{"planned_lights": null}', "planned_lights"),
        ('{"planned_lights": 1e400}', "planned_lights"),
        ('{"planned_lights": NaN}', "body"),
        ('{"slant_deg": Infinity}', "body"),
        ('{"slant_deg": -Infinity}', "body"),
        ('{"slant_deg": 1e400}', "slant_deg"),
        ('{"seed": %s}' % ("9" * 30), "seed"),
        ('{"seed": %s}' % ("9" * 5000), "body"),
        ('{"method": "best"}', "method"),
        ('{"colour": "red"}', "colour"),
        ('{"exposure": {"target": 7}}', "exposure.target"),
        ('{"exposure": {"time": 7}}', "exposure.time"),
        ('{"method": "user"}', "body"),
        ('{"user_lights": [[0, 0, 1], [0, 1, 1], [1, 1]]}', "user_lights.2"),
        ('{"label": "%s"}' % ("x" * 300), "label"),
        ('{"planned_lights": 4', "body"),
        ("{planned_lights: 4}", "body"),
        ("[]", "body"),
        ("null", "body"),
        ("4", "body"),
        ("[" * 100_000, "body"),
    ],
)
def test_problem_invalid_recipe_names_its_field(shared: Any, body: str, field: str) -> None:
    answer = shared.http.post("/v1/sessions", content=body.encode(), headers=JSON)

    refusal = problem(answer, ErrorCode.REQUEST_INVALID)

    assert any(item["field"].startswith(field) and item["message"] for item in refusal["errors"]), refusal
    assert shared.service.store.journal.sessions(10) == []


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('{"planned_light": 4}', "planned_light: There is no such field"),
        ('{"user_lights": [[0, 0, -1]]}', "user_lights are for method `user` only"),
    ],
)
def test_problem_invalid_recipe_is_told_in_words_of_ours(shared: Any, body: str, said: str) -> None:
    refusal = problem(shared.http.post("/v1/sessions", content=body.encode(), headers=JSON), ErrorCode.REQUEST_INVALID)

    assert said in refusal["detail"]
    assert "Value error" not in refusal["detail"]


def test_problem_body_of_invalid_utf8_is_refused(shared: Any) -> None:
    answer = shared.http.post("/v1/sessions", content=b'{"label": "\xff\xfe"}', headers=JSON)

    problem(answer, ErrorCode.REQUEST_INVALID)


@pytest.mark.parametrize("media_type", ["text/plain", "application/x-www-form-urlencoded", ""])
def test_problem_body_of_other_media_type_is_refused(shared: Any, media_type: str) -> None:
    answer = shared.http.post("/v1/sessions", content=b"{}", headers={"Content-Type": media_type})

    problem(answer, ErrorCode.REQUEST_MEDIA_TYPE)


def test_problem_too_large_body_is_refused(shared: Any) -> None:
    answer = shared.http.post("/v1/sessions", content=b" " * 300_000, headers=JSON)

    assert problem(answer, ErrorCode.REQUEST_TOO_LARGE)["limit"] == 262_144


def test_problem_too_large_chunked_body_is_refused(shared: Any) -> None:
    def blocks() -> Any:
        for _ in range(40):
            yield b" " * 10_000

    # The service need not read on once it has refused, so the client may see the connection end instead.
    try:
        answer = shared.http.post("/v1/sessions", content=blocks(), headers=JSON)
    except httpx.TransportError:
        return
    problem(answer, ErrorCode.REQUEST_TOO_LARGE)


def test_problem_unknown_address_is_404(shared: Any) -> None:
    body = problem(shared.http.get("/v1/nothing"), ErrorCode.REQUEST_NOT_FOUND)

    assert body["instance"] == "/v1/nothing"


def test_problem_wrong_method_is_405(shared: Any) -> None:
    answer = shared.http.put("/v1/rig/stop")

    problem(answer, ErrorCode.REQUEST_METHOD_NOT_ALLOWED)
    assert answer.headers["allow"] == "POST, OPTIONS"


@pytest.mark.parametrize(
    ("address", "field"),
    [
        ("/v1/sessions?limit=0", "limit"),
        ("/v1/sessions?limit=many", "limit"),
        ("/v1/sessions?after=-1", "after"),
        ("/v1/events?after=x", "after"),
        ("/v1/sessions/s/passes/-1", "number"),
        ("/v1/sessions/s/results/latest", "number"),
        (f"/v1/sessions?after={2**70}", "after"),
    ],
)
def test_problem_invalid_parameter_is_named(shared: Any, address: str, field: str) -> None:
    body = problem(shared.http.get(f"{address}"), ErrorCode.REQUEST_INVALID)

    assert body["errors"][0]["field"] == field


def test_problem_time_without_zone_says_how_to_write_it(shared: Any) -> None:
    body = problem(shared.http.get("/v1/sessions?since=2026-11-30"), ErrorCode.REQUEST_INVALID)

    assert body["detail"].startswith("since: Give a time")


@pytest.mark.parametrize(
    "path",
    [
        "",
        "/actions",
        "/passes",
        "/passes/0",
        "/passes/0/shots/0/image",
        "/results",
        "/results/0",
        "/results/0/mask.png",
    ],
)
def test_problem_unknown_session_is_404(shared: Any, path: str) -> None:
    problem(shared.http.get(f"/v1/sessions/nope{path}"), ErrorCode.SESSION_NOT_FOUND)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "10.0.0.1", "evil.example:8000", ""])
def test_request_foreign_host_is_refused(shared: Any, host: str) -> None:
    answer = shared.http.post("/v1/sessions", headers={"Host": host, **JSON}, content=b"{}")

    problem(answer, ErrorCode.REQUEST_FOREIGN)


@pytest.mark.parametrize("host", ["localhost", "localhost:8000", "127.0.0.1", "[::1]:80", "LOCALHOST"])
def test_request_loopback_names_are_accepted(shared: Any, host: str) -> None:
    assert shared.http.get("/health/live", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.4.2", "http://127.0.4.2:1"])
def test_request_foreign_origin_is_refused_even_for_stop(shared: Any, origin: str) -> None:
    for path in ("/v1/sessions", "/v1/rig/stop"):
        problem(shared.http.post(f"{path}", headers={"Origin": origin}), ErrorCode.REQUEST_FOREIGN)


def test_request_own_origin_is_accepted(shared: Any) -> None:
    answer = shared.http.get("/v1/rig", headers={"Origin": shared.url})

    assert answer.status_code == 200


def test_request_allowed_origin_may_call_and_read(start: Any) -> None:
    with start(allowed_origins="http://lab.example:3000, http://other.example/") as service:
        answer = service.http.get("/v1/rig", headers={"Origin": "http://lab.example:3000"})
        asked = service.http.options(
            "/v1/sessions",
            headers={"Origin": "http://other.example", "Access-Control-Request-Method": "POST"},
        )
        refused = service.http.get("/v1/rig", headers={"Origin": "http://third.example"})

    assert answer.headers["access-control-allow-origin"] == "http://lab.example:3000"
    assert asked.status_code == 200
    assert asked.headers["access-control-allow-origin"] == "http://other.example"
    problem(refused, ErrorCode.REQUEST_FOREIGN)


def test_request_without_host_is_refused(shared: Any) -> None:
    host, port = shared.url.removeprefix("http://").split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=60)
    connection.putrequest("GET", "/v1/rig", skip_host=True)
    connection.endheaders()

    assert connection.getresponse().status in (400, 403)
    connection.close()


def test_problem_request_that_the_end_of_the_service_halts_says_so(own: Any) -> None:
    own.service.runner.begin_shutdown()

    answers = [own.http.post("/v1/dry-runs", json={}), own.http.get("/v1/rig/reach.png")]

    assert [answer.status_code for answer in answers] == [503, 503]
    assert {answer.json()["detail"] for answer in answers} == {"The service is ending"}


def test_problem_unexpected_exception_hides_its_message(own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ZeroDivisionError("secret")

    monkeypatch.setattr(own.service.runner, "status", broken)

    answer = own.http.get("/v1/rig")

    problem(answer, ErrorCode.SERVICE_FAULT)
    assert "secret" not in answer.text
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("code", list(ErrorCode))
def test_problem_page_exists_for_each_code(shared: Any, code: ErrorCode) -> None:
    plain = shared.http.get(f"/problems/{code}")
    page = shared.http.get(f"/problems/{code}", headers={"Accept": "text/html,*/*"})

    assert plain.json() == {
        "code": code,
        "status": PROBLEMS[code].status,
        "title": PROBLEMS[code].title,
        "remedy": PROBLEMS[code].remedy,
    }
    assert page.headers["content-type"].startswith("text/html")
    assert f"<code>{code}</code>" in page.text


@pytest.mark.parametrize(
    ("method", "address", "body"),
    [
        ("GET", "/v1/rig/reach", None),
        ("POST", "/v1/dry-runs", {}),
        ("POST", "/v1/dry-runs/views", {"kind": "camera"}),
    ],
)
def test_problem_busy_rig_names_its_holder(own: Any, method: str, address: str, body: dict[str, Any] | None) -> None:
    holding = own.client.create()
    own.service.store.journal.trigger(holding.id, Trigger.START, "test")

    refused = own.http.request(method, address, json=body)

    assert problem(refused, ErrorCode.RIG_BUSY)["holder"] == holding.id


def test_problem_page_unknown_code_is_404(shared: Any) -> None:
    body = problem(shared.http.get("/problems/no.such"), ErrorCode.REQUEST_NOT_FOUND)

    assert "rig.busy" in json.dumps(body["known"])


def test_problem_request_that_arrives_after_its_validity_does_nothing(shared: Any) -> None:
    """The network had it for longer than the person wanted it; without the header it is valid for ever."""
    known = {session.id for session in shared.client.sessions()}

    late = shared.http.post("/v1/sessions", json={}, headers={"Valid-Until": f"{time.time() - 0.5:.3f}"})
    parked = shared.http.post("/v1/rig/park", headers={"Valid-Until": "0"})
    stopped = shared.http.post("/v1/rig/stop", json={}, headers={"Valid-Until": "0"})
    in_time = shared.http.post("/v1/sessions", json={}, headers={"Valid-Until": f"{time.time() + 60:.3f}"})

    assert problem(late, ErrorCode.REQUEST_EXPIRED)["late_s"] == pytest.approx(0.5, abs=0.5)
    problem(parked, ErrorCode.REQUEST_EXPIRED)
    assert stopped.status_code == 202  # a stop is never too late
    assert in_time.status_code == 201
    assert {session.id for session in shared.client.sessions()} - known == {in_time.json()["id"]}


@pytest.mark.parametrize("stated", ["tomorrow", "nan", "inf", "-1", ""])
def test_problem_validity_that_is_no_time_is_refused(shared: Any, stated: str) -> None:
    answer = shared.http.post("/v1/rig/park", headers={"Valid-Until": stated})

    assert problem(answer, ErrorCode.REQUEST_INVALID)["errors"][0]["field"] == "Valid-Until"
