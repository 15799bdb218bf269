"""The region of interest over HTTP: accepted and refused masks, and in which states."""

from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import Trigger
from api import ProblemError

SIZE = 1024  # of the simulated cell's calibration


def png(mask: np.ndarray) -> bytes:
    written, content = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    assert written
    return content.tobytes()


def square(size: int = SIZE, half: int = 60) -> np.ndarray:
    mask = np.zeros((size, size), bool)
    mask[size // 2 - half : size // 2 + half, size // 2 - half : size // 2 + half] = True
    return mask


def put(http: httpx.Client, session_id: str, content: bytes, media_type: str = "image/png") -> httpx.Response:
    return http.put(f"/v1/sessions/{session_id}/region.png", content=content, headers={"Content-Type": media_type})


def test_region_newest_mask_is_returned_unchanged(own: Any, tmp_path: Path) -> None:
    session = own.client.create(Recipe())
    assert own.http.get(f"/v1/sessions/{session.id}/region.png").status_code == 404

    assert put(own.http, session.id, png(square(half=20))).json()["pixels"] == 1600
    drawn = tmp_path / "mask.png"
    drawn.write_bytes(png(square()))
    assert own.client.draw_region(session.id, drawn) == 14400

    answer = own.http.get(f"/v1/sessions/{session.id}/region.png")
    kept = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert answer.headers["content-type"] == "image/png"
    assert np.array_equal(kept > 0, square())
    events = [event for event in own.client.past_events(session.id) if event.type == "region.drawn"]
    assert [event.body["path"] for event in events] == ["region.png", "region_2.png"]
    assert "draw-region" in {item["action"] for item in own.http.get(session.links["actions"]).json()["items"]}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (png(square(size=100, half=10)), "100 × 100"),
        (png(np.zeros((SIZE, SIZE), bool)), "all black"),
        (png(np.eye(SIZE, dtype=bool) & (np.arange(SIZE) < 20)), "outside"),
        (b"GIF89a, not a picture of ours", "not a PNG"),
        (png(square())[:60], "damaged"),
        (b"", "required"),
    ],
    ids=["of another size", "empty", "beside the object", "no PNG", "cut short", "no body"],
)
def test_region_unusable_mask_is_refused_with_remedy(shared: Any, content: bytes, said: str) -> None:
    session = shared.client.create(Recipe())

    answer = put(shared.http, session.id, content)

    assert answer.status_code == 422
    assert answer.json()["code"] == ErrorCode.REQUEST_INVALID
    assert said in answer.json()["detail"]
    assert shared.http.get(f"/v1/sessions/{session.id}/region.png").status_code == 404


def test_region_accepts_only_png_and_only_before_planning(own: Any) -> None:
    session = own.client.create(Recipe())
    for media_type in ("application/octet-stream", "application/json"):
        refused = put(own.http, session.id, b"{}", media_type)
        assert refused.status_code == 415
        assert "takes image/png" in refused.json()["detail"]
    assert put(own.http, "no-such", png(square())).status_code == 404

    own.service.store.journal.trigger(session.id, Trigger.STOP, "test")

    with pytest.raises(ProblemError) as late:
        own.client.draw_region(session.id, _written(own))
    assert late.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED
    assert not (own.service.store.folder(session.id) / "region.png").exists()


def _written(own: Any) -> Path:
    path = own.settings.data / "mask.png"
    path.write_bytes(png(square()))
    return path
