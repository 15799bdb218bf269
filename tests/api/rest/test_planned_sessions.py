"""Sessions in the simulated cell that plan: an ordered accuracy for a region of interest, and every method's lights.

On a machine that is busy with other things the controller's watchdog stops the arm now and then: a quarter of a second
without a sign of life is what it waits for. Then a person resumes, and so do these tests.
"""

from collections.abc import Generator
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from acquisition.models.recipe import Method, Recipe
from acquisition.plan import stopping_rule
from acquisition.session_state import State
from api import Client
from api.rest import settings
from api.rest.schemas import SessionResource
from hardware_sim.cell import Cell, CellOptions
from tests.api.rest.test_region import png, square

CELL = "127.0.48.10"
PIXELS = 128

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]
TARGET_DEG = 0.5
"""Below what the pilot reaches, 0.59° in the region."""

ORDERED = Recipe(target_sigma_deg=TARGET_DEG, max_lights=12)
MOST_STOPS = 8
PROGRAM_ENDED = ("arm.not_ready", "lamp.not_confirmed")
"""What is said when the control program ends: between moves, and while the lamp is on."""

USER_LIGHTS = [(0.0, 0.15, -0.45), (0.2, -0.1, -0.5), (-0.2, -0.1, -0.5)]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Generator[Cell]:
    folder = tmp_path_factory.mktemp("cell")
    with Cell(CellOptions(CELL, "bumps", 1, "direct", 20, pixels=PIXELS), folder) as made:
        yield made


def stopped_by_watchdog(client: Client, session_id: str) -> bool:
    """Whether the session is interrupted because the control program ended."""
    resource = client.session(session_id)
    return resource.state is State.INTERRUPTED and resource.reason is not None and resource.reason.code in PROGRAM_ENDED


def followed(client: Client, session_id: str) -> SessionResource:
    """The session once it has ended, resumed where the watchdog stopped the arm."""
    for _ in range(MOST_STOPS):
        resource = client.wait(session_id)
        if not stopped_by_watchdog(client, session_id):
            return resource
        client.resume(session_id)
    return client.wait(session_id)


def test_session_ordered_accuracy_in_region_survives_restart(cell: Cell, tmp_path: Path, serving: Any) -> None:
    chosen = settings.read(cell=cell.cell_file, data=tmp_path / "data", host="127.0.48.2", port=0)
    mask = tmp_path / "mask.png"
    mask.write_bytes(png(square(PIXELS, half=14)))
    with serving(chosen) as service:
        service.client.wait_ready()
        session = service.client.create(ORDERED)
        service.client.draw_region(session.id, mask)
        service.client.start(session.id)
        for event in service.client.events(session.id, after=0):
            assert event.body.get("state") not in (State.FAILED, State.COMPLETED), event
            if event.body.get("state") == State.INTERRUPTED:
                assert stopped_by_watchdog(service.client, session.id), event
                service.client.resume(session.id)
            if event.type == "shot.captured" and event.body["pass"] == 1:
                break
    with serving(chosen) as service:
        assert service.client.session(session.id).state is State.INTERRUPTED
        service.client.resume(session.id)
        ended = followed(service.client, session.id)

        assert ended.state is State.COMPLETED
        assert ended.conclusion is not None
        assert ended.conclusion.startswith("target met with")
        assert ended.answer is not None
        summary = ended.answer.summary
        assert summary.region_sigma_deg is not None
        assert summary.region_sigma_deg <= TARGET_DEG * (1 + stopping_rule.SETTINGS.tolerance)
        assert f"with {summary.images} images" in ended.conclusion
        before = service.client.results(session.id)[-2].summary
        assert before.region_sigma_deg is not None
        assert before.region_sigma_deg > TARGET_DEG  # the last lights were needed
        keys = [shot.key for shot in service.service.store.journal.shots(session.id)]
        assert len(keys) == len(set(keys))

        planned = service.client.one_pass(session.id, 1)
        assert planned.plan.forecast
        assert all(one.sigma_deg >= other.sigma_deg * 0.98 for one, other in zip(
            planned.plan.forecast, planned.plan.forecast[1:], strict=False
        ))  # fmt: skip
        assert len(planned.gain_pictures) == len(planned.plan.lights) == len(planned.plan.gains)
        picture = service.http.get(planned.gain_pictures[0])
        image = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_COLOR)
        assert picture.headers["content-type"] == "image/png"
        assert image is not None
        assert np.ptp(image) > 100
        last = service.client.passes(session.id)[-1]
        assert last.lights == 0
        assert service.client.one_pass(session.id, 0).gain_pictures == []
        refused = service.http.get(planned.gain_pictures[0].replace("/lights/0/", "/lights/64/"))
        assert refused.status_code == 404


def test_session_each_method_captures_its_lights(cell: Cell, tmp_path: Path, serving: Any) -> None:
    with serving(settings.read(cell=cell.cell_file, data=tmp_path / "data", host="127.0.48.2", port=0)) as service:
        service.client.wait_ready()
        for method in get_args(Method):
            lights = USER_LIGHTS if method == "user" else []
            recipe = Recipe(method=method, pilot_lights=4, planned_lights=1, user_lights=lights, slant_deg=35)
            created = service.client.create(recipe)
            service.client.start(created.id)
            session = followed(service.client, created.id)
            assert session.state is State.COMPLETED
            assert session.answer is not None
            assert session.answer.summary.images == recipe.lights_total, method
            plans = [service.client.one_pass(session.id, item.number).plan for item in
                     service.client.passes(session.id)]  # fmt: skip
            assert [plan.method for plan in plans] == (["pilot", "optimal"] if method == "optimal" else [method])
            assert sum(len(plan.lights) for plan in plans) == recipe.lights_total
            assert session.conclusion is None
