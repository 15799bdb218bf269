"""Keys and tickets: authentication, roles, and key changes while the service runs."""

import stat
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from acquisition.models.errors import ErrorCode, RigError
from api import Client, ProblemError
from api.cli.commands import app
from api.rest import keys
from api.rest.app import description
from api.rest.authentication import MAX_FAILURES
from api.rest.keys import KeyRing, Role

SECRETS = dict[Role, str]


@pytest.fixture
def secrets(tmp_path: Path) -> SECRETS:
    return {role: keys.add(keys.path_in(tmp_path / "data"), f"the-{role}", role) for role in Role}


@pytest.fixture
def locked(secrets: SECRETS, start: Callable[..., AbstractContextManager[Any]]) -> Generator[Any]:
    """A service that asks for keys."""
    with start() as running:
        yield running


def as_(role: Role, secrets: SECRETS) -> dict[str, str]:
    return {"Authorization": f"Bearer {secrets[role]}"}


def test_request_without_key_gets_only_health_and_problem_pages(locked: Any) -> None:
    for path, methods in description()["paths"].items():
        for method in methods:
            address = path.replace("{code}", "rig.busy").replace("{session_id}", "x")
            address = address.replace("{number}", "0").replace("{shot_number}", "0").replace("{artefact}", "a")
            answer = locked.http.request(method.upper(), address)
            if path.startswith(("/health/", "/problems/")):
                assert answer.status_code in (200, 503), path
            else:
                assert answer.status_code in (401, 429), (method, path)
    for path in ("/", "/docs", "/docs/start.js", "/openapi.json"):  # the same for every cell
        assert locked.http.get(path).status_code == 200


def test_refusal_without_key_names_bearer_scheme(locked: Any) -> None:
    answer = locked.http.get("/v1/rig")
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.json()["code"] == "request.unauthenticated"


@pytest.mark.parametrize(
    ("method", "address", "headers", "said"),
    [
        ("GET", "/v1/rig", {}, "needs a key"),
        ("GET", "/v1/rig", {"Authorization": "Bearer lightpose_old"}, "wrong or revoked"),
        ("GET", "/v1/rig", {"Authorization": "Basic YTpi"}, "not a Bearer key"),
        ("GET", "/v1/rig?ticket=old", {}, "has expired"),
        ("POST", "/v1/rig/park?ticket=any", {}, "reading only"),
    ],
)
def test_refusal_says_what_is_wrong_with_the_key_sent(
    locked: Any, method: str, address: str, headers: dict[str, str], said: str
) -> None:
    refused = locked.http.request(method, address, headers=headers)

    assert refused.status_code == 401
    assert refused.json()["detail"].endswith(said)


def test_role_decides_which_requests_are_allowed(locked: Any, secrets: SECRETS) -> None:
    http: httpx.Client = locked.http
    viewer, operator, admin = (as_(role, secrets) for role in Role)
    assert http.get("/v1/rig", headers=viewer).status_code == 200
    refused = http.post("/v1/sessions", json={}, headers=viewer)
    assert (refused.status_code, refused.json()["code"]) == (403, "request.forbidden")
    assert refused.json()["needed"] == "operator"
    made = http.post("/v1/sessions", json={}, headers=operator)
    assert made.status_code == 201
    assert http.delete(made.headers["location"], headers=operator).status_code == 403
    assert http.delete(made.headers["location"], headers=admin).status_code == 204


def test_delete_without_keys_needs_an_admin(shared: Any) -> None:
    made = shared.http.post("/v1/sessions", json={}).headers["location"]
    refused = shared.http.delete(made)

    assert shared.http.get("/v1/caller").json() == {"name": "operator", "role": "operator"}
    assert (refused.status_code, refused.json()["code"]) == (403, "request.forbidden")
    assert (refused.json()["role"], refused.json()["needed"]) == ("operator", "admin")
    assert "lightpose keys add" in refused.json()["remedy"]
    assert shared.http.get(made).status_code == 200


def test_session_allowed_actions_depend_on_role(locked: Any, secrets: SECRETS) -> None:
    bearer = {role: {"Authorization": f"Bearer {secret}"} for role, secret in secrets.items()}
    made = locked.http.post("/v1/sessions", json={}, headers=bearer[Role.OPERATOR]).json()

    offered = {
        role: locked.http.get(made["links"]["self"], headers=bearer[role]).json()["allowed_actions"] for role in Role
    }

    assert made["allowed_actions"] == ["start", "stop"]
    assert offered == {Role.VIEWER: [], Role.OPERATOR: ["start", "stop"], Role.ADMIN: ["start", "stop"]}


def test_stop_with_any_key_is_allowed_and_recorded(locked: Any, secrets: SECRETS) -> None:
    made = locked.http.post("/v1/sessions", json={}, headers=as_(Role.OPERATOR, secrets)).headers["location"]
    assert locked.http.post("/v1/rig/stop", headers=as_(Role.VIEWER, secrets)).status_code == 202
    answer = locked.http.post(f"{made}/actions", json={"action": "stop"}, headers=as_(Role.OPERATOR, secrets))
    assert answer.status_code == 202
    history = locked.http.get(f"{made}/actions", headers=as_(Role.VIEWER, secrets)).json()["items"]
    assert history[-1]["actor"].startswith("the-operator@")


def test_ticket_allows_reading_only(locked: Any, secrets: SECRETS) -> None:
    ticket = locked.http.post("/v1/tickets", headers=as_(Role.ADMIN, secrets)).json()["ticket"]
    assert locked.http.get("/v1/rig", params={"ticket": ticket}).status_code == 200
    events = locked.http.get("/v1/events", params={"ticket": ticket, "after": 0, "follow": False})
    assert events.status_code == 200
    assert locked.http.post("/v1/sessions", json={}, params={"ticket": ticket}).status_code == 401
    assert locked.http.post("/v1/rig/stop", params={"ticket": ticket}).status_code == 401
    assert locked.http.get("/v1/rig", params={"ticket": "x" + ticket[1:]}).status_code == 401


def test_keys_many_failures_are_throttled_valid_keys_pass(locked: Any, secrets: SECRETS) -> None:
    for _ in range(MAX_FAILURES):
        assert locked.http.get("/v1/rig", headers={"Authorization": "Bearer wrong"}).status_code == 401
    answer = locked.http.get("/v1/rig", headers={"Authorization": "Bearer wrong"})
    assert answer.status_code == 429
    assert 0 < int(answer.headers["retry-after"]) <= 60
    assert locked.http.post("/v1/rig/stop", headers=as_(Role.VIEWER, secrets)).status_code == 202


def test_keys_odd_headers_are_refused(locked: Any) -> None:
    for header in ("", "Bearer", "Basic b3BlcmF0b3I6eA==", "Bearer \x80\xff", "x" * 5000):
        answer = locked.http.get("/v1/rig", headers={"Authorization": header.encode("latin-1")})
        assert answer.status_code == 401


def test_client_sends_key_given_or_of_environment(
    locked: Any, secrets: SECRETS, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Client(locked.url, key=secrets[Role.OPERATOR]) as client:
        assert client.rig().cell
    monkeypatch.setenv("LIGHTPOSE_KEY", secrets[Role.VIEWER])
    with Client(locked.url) as client:
        assert client.rig().cell
        with pytest.raises(ProblemError) as refused:
            client.acknowledge()
    assert refused.value.code is ErrorCode.REQUEST_FORBIDDEN


def test_keys_changes_apply_to_running_service(
    tmp_path: Path, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    data = tmp_path / "data"

    def status(secret: str) -> int:
        return running.http.get("/v1/rig", headers={"Authorization": f"Bearer {secret}"}).status_code

    def becomes(expected: int, secret: str) -> bool:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if status(secret) == expected:
                return True
            time.sleep(0.1)
        return False

    with start() as running:
        assert running.http.get("/v1/rig").status_code == 200  # no keys: this machine is trusted
        one = keys.add(keys.path_in(data), "one", Role.VIEWER)
        assert becomes(401, "wrong")
        assert becomes(200, one)
        ticket = running.http.post("/v1/tickets", headers={"Authorization": f"Bearer {one}"}).json()["ticket"]
        keys.revoke(keys.path_in(data), "one")
        assert becomes(401, one) or status(one) == 429
        assert running.http.get("/v1/rig", params={"ticket": ticket}).status_code in (401, 429)
        two = keys.add(keys.path_in(data), "two", Role.VIEWER)
        assert becomes(200, two)
        keys.path_in(data).write_text("broken")
        assert becomes(429, two) or status(two) == 401
        keys.path_in(data).unlink()
        assert running.http.get("/v1/rig").status_code in (401, 429)


def test_key_file_holds_no_secret_and_is_private(tmp_path: Path) -> None:
    file = keys.path_in(tmp_path)
    secret = keys.add(file, "lab", Role.OPERATOR)
    assert secret not in file.read_text()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    ring = KeyRing(file)
    caller = ring.caller(secret)
    assert caller is not None
    assert (caller.name, caller.role) == ("lab", Role.OPERATOR)
    assert ring.caller(secret[:-1]) is None
    assert ring.caller("") is None


def test_tickets_expire_and_are_bounded(tmp_path: Path) -> None:
    secret = keys.add(keys.path_in(tmp_path), "lab", Role.VIEWER)
    ring = KeyRing(keys.path_in(tmp_path))
    caller = ring.caller(secret)
    assert caller is not None
    first = ring.issue_ticket(caller, 0.0)
    holder = ring.holder(first, keys.TICKET_LIFETIME_S - 1)
    assert holder is not None
    assert (holder.name, holder.role, holder.valid_until) == ("lab", Role.VIEWER, keys.TICKET_LIFETIME_S)
    assert ring.holder(first, keys.TICKET_LIFETIME_S + 1) is None
    for _ in range(keys.MAX_TICKETS + 5):
        last = ring.issue_ticket(caller, 1.0)
    assert ring.holder(first, 2.0) is None
    assert ring.holder(last, 2.0) is not None


@pytest.mark.parametrize("name", ["", "a b", "x" * 61, "../x", "ключ"])
def test_keys_bad_names_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(RigError, match=r"cannot name a key"):
        keys.add(keys.path_in(tmp_path), name, Role.VIEWER)
    assert not keys.path_in(tmp_path).exists()


def test_keys_command_adds_lists_and_revokes(tmp_path: Path) -> None:
    runner = CliRunner()
    data = ["--data", str(tmp_path)]
    made = runner.invoke(app, ["keys", "add", "lab", "--role", "viewer", *data])
    assert made.exit_code == 0
    assert made.stdout.strip().startswith(keys.PREFIX)
    assert runner.invoke(app, ["keys", "add", "lab", *data]).exit_code == 2
    assert runner.invoke(app, ["keys", "add", "other", "--role", "king", *data]).exit_code == 2
    assert "lab\tviewer" in runner.invoke(app, ["keys", "list", *data]).stdout
    assert runner.invoke(app, ["keys", "revoke", "lab", *data]).exit_code == 0
    assert runner.invoke(app, ["keys", "revoke", "lab", *data]).exit_code == 2


def test_key_file_that_others_may_read_is_refused_by_name(
    tmp_path: Path, secrets: SECRETS, start: Callable[..., AbstractContextManager[Any]]
) -> None:
    path = keys.path_in(tmp_path / "data")
    for mode in (0o644, 0o640, 0o620):
        path.chmod(mode)
        with pytest.raises(RigError, match=rf"keys\.json .*mode {mode:04o}.*chmod 600"), start():
            pass
    path.chmod(0o600)
    with start() as running:
        assert running.http.get("/v1/rig", headers=as_(Role.VIEWER, secrets)).status_code == 200


def test_data_folder_is_closed_to_others(tmp_path: Path, start: Callable[..., AbstractContextManager[Any]]) -> None:
    data = tmp_path / "data"
    with start():
        made = stat.S_IMODE(data.stat().st_mode)
    data.chmod(0o755)
    with start():
        by_hand = stat.S_IMODE(data.stat().st_mode)

    assert (made, by_hand) == (0o700, 0o750)


def test_ready_without_key_tells_no_address(locked: Any, secrets: SECRETS) -> None:
    open_to_all = locked.http.get("/health/ready")
    with_key = locked.http.get("/v1/rig", headers=as_(Role.VIEWER, secrets))

    assert open_to_all.status_code == 503
    assert "127.0" not in open_to_all.text
    assert open_to_all.json()["reasons"]
    assert "127.0" in with_key.text


def test_keys_are_listed_for_admins_without_secrets(locked: Any, secrets: SECRETS) -> None:
    for role in (Role.VIEWER, Role.OPERATOR):
        refused = locked.http.get("/v1/keys", headers=as_(role, secrets))
        assert (refused.status_code, refused.json()["needed"]) == (403, "admin")
    ticket = locked.http.post("/v1/tickets", headers=as_(Role.ADMIN, secrets)).json()["ticket"]
    assert locked.http.get("/v1/keys", params={"ticket": ticket}).status_code == 403
    assert locked.http.head("/v1/keys", headers=as_(Role.VIEWER, secrets)).status_code == 403

    answer = locked.http.get("/v1/keys", headers=as_(Role.ADMIN, secrets))

    listed = {item["name"]: item for item in answer.json()["items"]}
    assert {name: item["role"] for name, item in listed.items()} == {f"the-{role}": str(role) for role in Role}
    assert all(set(item) == {"name", "role", "created", "last_used"} for item in listed.values())
    assert all(item["last_used"] is not None for item in listed.values())
    stored = keys.read(keys.path_in(locked.settings.data))
    assert stored is not None
    for key in stored.keys:
        assert key.sha256 not in answer.text
    assert not any(secret in answer.text for secret in secrets.values())


def test_key_that_was_never_sent_has_no_last_use(tmp_path: Path) -> None:
    path = keys.path_in(tmp_path)
    used = keys.add(path, "used", Role.VIEWER)
    keys.add(path, "idle", Role.VIEWER)
    ring = KeyRing(path)
    before = time.time()
    assert ring.caller(used) is not None
    assert ring.caller("wrong") is None
    times = {key.name: at for key, at in ring.listed()}
    assert times["idle"] is None
    assert times["used"] is not None
    assert before <= times["used"] <= time.time()
