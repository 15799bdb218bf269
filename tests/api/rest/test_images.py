"""Images over HTTP: thumbnails, and caching that a pass taken anew does not fool."""

from typing import Any

import cv2
import numpy as np
import pytest

from acquisition.models.recipe import Recipe
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.store.folder import write_frame
from api.rest import image_encoding

WIDTH, HEIGHT = 400, 300


def enter(service: Any, session_id: str, level: int) -> Shot:
    """Enters shot 0 of pass 0, a frame of one grey, as the runner does."""
    pixels = np.full((HEIGHT, WIDTH), level, np.uint16)
    frame = write_frame(service.service.store.folder(session_id), "passes/0/shots/0.tiff", pixels)
    quality = FrameQuality(saturated=0.0, bright_level=0.5, accepted=True)
    shot = Shot(
        key=ShotKey(pass_number=0, number=0), kind="light", frame=frame, exposure_s=0.1, light_number=0, taken_at=1.0,
        quality=quality,
    )  # fmt: skip
    service.service.store.journal.add_shot(session_id, shot)
    return shot


def decoded(answer: Any) -> Any:
    return cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.fixture
def session_id(own: Any) -> str:
    return str(own.client.create(Recipe()).id)


def test_thumbnail_has_width_and_grey_of_frame(own: Any, session_id: str) -> None:
    sensor = own.service.calibration.sensor
    enter(own, session_id, round(sensor.black_level_dn + 0.25 * sensor.full_scale_dn))
    address = f"/v1/sessions/{session_id}/passes/0/shots/0/thumbnail.jpg"

    usual, small, large = (own.http.get(address + query) for query in ("", "?width=100", "?width=1024"))

    assert decoded(usual).shape == (180, 240)
    assert decoded(small).shape == (75, 100)
    assert decoded(large).shape == (HEIGHT, WIDTH)  # not enlarged
    assert decoded(small).mean() == pytest.approx(255 * 0.25 ** (1 / image_encoding.GAMMA), abs=2)
    assert len(small.content) < len(large.content)
    assert own.http.get(f"{address}?width=0").status_code == 422


def test_image_taken_anew_has_other_etag_and_is_not_immutable(own: Any, session_id: str) -> None:
    address = f"/v1/sessions/{session_id}/passes/0/shots/0/"
    journal = own.service.store.journal
    for name in ("image", "image?format=tiff", "thumbnail.jpg"):
        enter(own, session_id, 1000)
        first = own.http.get(address + name)
        tag = {"If-None-Match": first.headers["etag"]}
        unchanged = own.http.get(address + name, headers=tag)
        journal.discard_shots(session_id, 0, "the object was moved")
        enter(own, session_id, 3000)
        anew = own.http.get(address + name, headers=tag)
        journal.discard_shots(session_id, 0, "next name")

        assert "immutable" not in first.headers["cache-control"]
        assert (unchanged.status_code, unchanged.content) == (304, b"")
        assert anew.status_code == 200
        assert anew.headers["etag"] != first.headers["etag"]
        assert anew.content != first.content


def test_image_address_with_hash_is_immutable_and_ends_with_frame(own: Any, session_id: str) -> None:
    shot = enter(own, session_id, 1000)
    address = f"/v1/sessions/{session_id}/passes/0/shots/0/"
    addresses = [f"{address}{name}?frame={shot.frame.sha256[:16]}" for name in ("image", "thumbnail.jpg")]

    answers = [own.http.get(item) for item in addresses]
    own.service.store.journal.discard_shots(session_id, 0, "the object was moved")
    enter(own, session_id, 3000)
    gone = [own.http.get(item) for item in addresses]

    assert all("immutable" in answer.headers["cache-control"] for answer in answers)
    assert [answer.status_code for answer in gone] == [404, 404]
    assert "taken again" in gone[0].json()["detail"]
    assert own.http.get(f"{address}image?frame=xyz").status_code == 422
