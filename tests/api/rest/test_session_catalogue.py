"""Sessions found by state, label and date, and label and notes that a person edits."""

import json
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import ProblemError
from api.rest import sessions
from api.rest.keys import Caller, Role


def ids(service: Any, **wanted: Any) -> list[str]:
    return [item.id for item in service.client.sessions(**wanted)]


def test_sessions_are_found_by_label_and_state(own: Any) -> None:
    coin, vase, other = (own.client.create(Recipe(label=label)) for label in ("Münze, Avers", "vase", "MÜNZE 2"))
    own.client.stop(other.id)

    assert ids(own, label="münze") == [other.id, coin.id]
    assert ids(own, label="ASE") == [vase.id]
    assert ids(own, label="%") == []
    assert ids(own, state="created") == [vase.id, coin.id]
    assert ids(own, state=["created", "stopped"]) == [other.id, vase.id, coin.id]
    assert ids(own, state="stopped", label="münze") == [other.id]
    assert own.http.get("/v1/sessions?state=asleep").status_code == 422


def test_sessions_are_found_by_date(own: Any) -> None:
    made = own.client.create()
    now = datetime.now(UTC)
    hour = timedelta(hours=1)

    assert ids(own, since=now - hour, until=now + hour) == [made.id]
    assert ids(own, since=now + hour) == []
    assert ids(own, until=made.created) == []  # until is exclusive, since is not
    assert ids(own, since=made.created) == [made.id]
    assert own.http.get("/v1/sessions?since=2026-11-01T00:00:00").status_code == 422  # of which time zone?


def test_sessions_filtered_list_keeps_filter_over_pages(own: Any) -> None:
    made = [own.client.create(Recipe(label=f"A&B ü {number % 2}")) for number in range(9)]
    first = own.http.get("/v1/sessions", params={"label": "a&b Ü 1", "limit": 3, "state": "created"}).json()
    second = own.http.get(first["next"]).json()

    found = [item["id"] for page in (first, second) for item in page["items"]]
    assert found == [item.id for item in reversed(made[1::2])]
    assert second["next"] is None


def test_sessions_one_deleted_while_they_are_listed_is_left_out(administered: Any) -> None:
    made = administered.client.create()
    row, caller = administered.service.store.journal.session(made.id), Caller("an-admin", Role.ADMIN, "")
    assert sessions._listed(administered.service, row, caller) is not None
    administered.client.delete(made.id)

    assert sessions._listed(administered.service, row, caller) is None


def test_sessions_unknown_parameter_is_refused_by_name(own: Any) -> None:
    answer = own.http.get("/v1/sessions?stat=running&lable=x")

    assert answer.status_code == 422
    assert answer.json()["code"] == ErrorCode.REQUEST_INVALID
    assert {item["field"] for item in answer.json()["errors"]} == {"stat", "lable"}
    assert "state" in answer.json()["detail"]
    assert own.http.get("/v1/sessions?ticket=any").status_code == 200


def test_unknown_parameter_of_events_and_images_is_refused_by_name(own: Any) -> None:
    made = own.client.create()
    shot = f"/v1/sessions/{made.id}/passes/0/shots/0"
    for path in ("/v1/events?sesion_id=x", f"{shot}/image?fromat=tiff", f"{shot}/thumbnail.jpg?widht=20"):
        answer = own.http.get(path)
        assert answer.status_code == 422, path
        assert [item["field"] for item in answer.json()["errors"]] == [path.partition("?")[2].partition("=")[0]]
    assert own.http.get("/v1/events?follow=false&after=0&ticket=any").status_code == 200


def test_log_of_session_cannot_be_forged(own: Any) -> None:
    forged = "coin\n2026-11-29T00:00:00  action  action=stop by=root\0 Münze"
    made = own.client.create(Recipe(label="coin"))
    before = own.http.get(f"/v1/sessions/{made.id}/log").text
    own.client.edit(made.id, label=forged)

    lines = own.http.get(f"/v1/sessions/{made.id}/log").text.splitlines()
    assert len(lines) == len(before.splitlines()) + 2
    assert all(char.isprintable() for line in lines for char in line)
    (described,) = [line for line in lines if " session.described " in line]
    assert 'label="coin\\n2026' in described
    assert "Münze" in described


def test_edit_changes_label_and_notes_and_keeps_recipe(own: Any) -> None:
    made = own.client.create(Recipe(label="coin", notes="obverse"))
    own.client.stop(made.id)

    edited = own.client.edit(made.id, label="denarius")
    emptied = own.client.edit(made.id, notes="")

    assert (made.label, made.notes) == ("coin", "obverse")
    assert (edited.label, edited.notes) == ("denarius", "obverse")
    assert (emptied.label, emptied.notes, emptied.state) == ("denarius", "", State.STOPPED)
    assert emptied.recipe == made.recipe
    assert ids(own, label="denarius") == [made.id]
    assert ids(own, label="coin") == []
    stored = json.loads((own.service.store.folder(made.id) / "recipe.json").read_bytes())
    assert stored["label"] == "coin"  # the folder's manifest holds its hash
    events = [event.body for event in own.client.past_events(made.id) if event.type == "session.described"]
    assert [{key: value for key, value in body.items() if key != "by"} for body in events] == [
        {"label": "denarius"},
        {"notes": ""},
    ]


def test_edit_survives_restart(start: Any) -> None:
    with start() as service:
        made = service.client.create(Recipe(label="coin"))
        service.client.edit(made.id, label="denarius", notes="worn")
    with start() as service:
        again = service.client.session(made.id)

    assert (again.label, again.notes, again.recipe.label) == ("denarius", "worn", "coin")


def test_edit_invalid_change_is_refused_and_changes_nothing(own: Any) -> None:
    made = own.client.create(Recipe(label="coin"))
    path = f"/v1/sessions/{made.id}"

    for body in ({}, {"label": "x" * 201}, {"label": 3}, {"label": "x", "state": "stopped"}, {"recipe": {}}):
        assert own.http.patch(path, json=body).status_code == 422
    refused = own.http.patch(path, json={"label": "denarius", "answer": 7})

    assert refused.status_code in (404, 409)
    assert own.client.session(made.id).label == "coin"
    with pytest.raises(ProblemError) as missing:
        own.client.edit("nobody", label="x")
    assert missing.value.code is ErrorCode.SESSION_NOT_FOUND
