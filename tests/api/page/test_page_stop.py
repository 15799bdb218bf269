"""STOP at life speed, by mouse and by key, in mid-move: the arm rests half a second after the press."""

from collections.abc import Callable, Generator

import pytest
from playwright.sync_api import Browser, Page

from acquisition.models.recipe import Recipe
from api.rest.keys import Role
from hardware_sim.controller.control import ControlClient
from tests.api.page.conftest import HANGING_S, Lab, make_lab
from tests.end_to_end.processes import fastest_joint, rests_after

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
WITHIN_S = 0.5
MOVING_RAD_S = 0.1


@pytest.fixture(scope="module")
def lab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    """A cell at life speed."""
    yield from make_lab(tmp_path_factory.mktemp("lab"), speed=1.0)


def by_mouse(page: Page) -> None:
    box = page.locator("#stop").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()


def by_escape_while_typing(page: Page) -> None:
    page.keyboard.press("Escape")


def by_enter_on_button(page: Page) -> None:
    page.locator("#stop").focus()
    page.keyboard.down("Enter")


@pytest.mark.parametrize("press", [by_mouse, by_escape_while_typing, by_enter_on_button])
@pytest.mark.parametrize("role", [Role.OPERATOR, Role.VIEWER])
def test_page_stop_brings_arm_to_rest(
    opened: Callable[..., Page], lab: Lab, press: Callable[[Page], None], role: Role
) -> None:
    page = opened(role, "#/start")
    field = page.get_by_label("Label")
    field.click()
    session_id = lab.start(Recipe(pilot_lights=3, planned_lights=0, label="stopped"))
    with ControlClient(lab.cell.address) as control:
        while fastest_joint(control) < MOVING_RAD_S:
            lab.resume_if_interrupted(session_id)
        press(page)
        took_s = rests_after(control)
    page.locator("#stop-told.heard").wait_for()
    assert took_s <= WITHIN_S
    assert lab.client.wait(session_id).state == "stopped"
