"""The operator's page from sign-in to a stop in mid-move, in headless Chromium against the real service."""

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from hardware_sim.controller.control import ControlClient
from tests.api.page.conftest import COMPUTED_WITHIN_MS, Lab
from tests.api.page.pictures import contrast
from tests.end_to_end.processes import rests_after, wait_until_moving

pytestmark = pytest.mark.timeout(600)


def test_page_stop_by_mouse_in_mid_move_halts_arm(opened: Callable[..., Page], lab: Lab) -> None:
    page = opened(place="#/start")
    page.get_by_label("Label").fill("stopped by mouse")
    page.get_by_role("button", name="Start", exact=True).click()
    page.locator("#session-state[data-state=running]").wait_for()
    page.get_by_role("link", name="Cell").click()
    page.locator("#cell[data-frames]").wait_for()
    assert contrast(page.locator("#cell canvas")) > 5
    with ControlClient(lab.cell.address) as control:
        wait_until_moving(control, COMPUTED_WITHIN_MS / 1e3)
        box = page.locator("#stop").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 20, box["y"] + 20)
        page.mouse.down()  # and not up: it acts on the press
        rests_after(control)
    expect(page.locator("#stop-told")).to_have_text(re.compile(r"^Stop heard after"))
    page.mouse.up()
    session = next(iter(lab.client.sessions()))
    assert lab.client.wait(session.id).state == "stopped"
    expect(page.get_by_role("region", name="stop")).to_contain_text("The cell was stopped by the software's stop")
    lab.client.acknowledge()
