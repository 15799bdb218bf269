"""Choice of a session's answer among its results, and paged lists."""

from typing import Any

import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.models.result import ResultSummary
from acquisition.store.folder import write_manifest
from api import ProblemError

SUMMARY = ResultSummary(
    images=4, object_pixels=10, solved_pixels=10, mean_sigma_deg=1.0, median_sigma_deg=1.0, predicted_sigma_deg=None,
    predicted_median_deg=None, fewer_than_three_lights=0.0, intensity_factors=[1.0], noise={},
)  # fmt: skip


def with_results(service: Any, *origins: str) -> str:
    """A session of which the journal has results, oldest first."""
    session_id = service.client.create(Recipe()).id
    for number, origin in enumerate(origins):
        name = f"results/{number}"
        folder = service.service.store.folder(session_id) / name
        folder.mkdir(parents=True)
        digest = write_manifest(folder, {"number": number})
        body = {**SUMMARY.model_dump(mode="json"), "origin": origin, "seconds": 1.0}
        service.service.store.journal.add_artifact(
            session_id, "result", number, f"{name}/manifest.json", digest, body, "normals.ready"
        )
    return session_id


def test_choose_answer_replaces_default_answer(own: Any) -> None:
    session_id = with_results(own, "session", "session", "resolve")
    assert own.client.session(session_id).answer.number == 1  # the newest that the session itself made

    assert own.client.choose_answer(session_id, 2).number == 2

    assert own.client.session(session_id).answer.number == 2
    assert own.client.choose_answer(session_id, 0).number == 0
    assert own.client.session(session_id).answer.number == 0
    events = own.client.past_events(session_id)
    assert [event.body["number"] for event in events if event.type == "answer.chosen"] == [2, 0]
    with pytest.raises(ProblemError) as missing:
        own.client.choose_answer(session_id, 7)
    assert missing.value.code is ErrorCode.REQUEST_NOT_FOUND
    assert own.http.patch(f"/v1/sessions/{session_id}", json={"answer": 1, "state": "stopped"}).status_code == 422


def test_results_and_actions_are_paged(own: Any) -> None:
    session_id = with_results(own, *["session"] * 5)
    for number in range(5):
        own.client.choose_answer(session_id, number)
    for what in ("results", "actions"):
        address, items = f"/v1/sessions/{session_id}/{what}?limit=2", []
        while address is not None:
            part = own.http.get(address).json()
            assert len(part["items"]) <= 2
            items += part["items"]
            address = part["next"]
        assert len(items) == 5
    assert [item.number for item in own.client.results(session_id)] == list(range(5))
    assert own.http.get(f"/v1/sessions/{session_id}/passes?limit=0").status_code == 422
