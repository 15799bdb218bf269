"""Maps under the right names, and comparisons of what is chosen, with results that the test makes up."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from acquisition.models.recipe import Recipe
from api.rest.keys import Role
from tests.api.page.conftest import HANGING_S, Lab
from tests.api.page.pictures import contrast

pytestmark = [pytest.mark.long, pytest.mark.timeout(HANGING_S)]
PIXELS = 64
SIGMAS_DEG = (0.4, 4.0, 2.0)
"""Largest σ of results 0, 1 and 2; result 2 has images of another size."""


def result(session_id: str, number: int) -> dict[str, Any]:
    """A result as the service describes it."""
    summary = {
        "images": 4 + number, "object_pixels": 9, "solved_pixels": 9, "mean_sigma_deg": SIGMAS_DEG[number],
        "median_sigma_deg": 1.0, "predicted_sigma_deg": None, "predicted_median_deg": None,
        "fewer_than_three_lights": 0.0, "intensity_factors": [1.0], "noise": {},
    }  # fmt: skip
    return {
        "number": number, "passes": [0], "origin": "session", "created": "2026-01-01T00:00:00Z", "seconds": 1.0,
        "summary": summary, "artefacts": [], "exports": {},
        "links": {"self": f"/v1/sessions/{session_id}/results/{number}"},
    }  # fmt: skip


def file_of(number: int, name: str) -> bytes:
    """A file of a result: a ramp of values, normals that lean a little more with each result."""
    side = PIXELS * (2 if number == 2 else 1)
    ramp = np.tile(np.linspace(0.1, 1, side, dtype=np.float32), (side, 1))
    lean = 0.1 * (number + 1) * ramp
    towards = np.stack([lean, np.zeros_like(ramp), np.sqrt(1 - lean**2)], axis=-1)  # x, y, z
    pictures: dict[str, Any] = {
        "mask.png": np.full((side, side), 255, np.uint8),
        "normals.png": np.round((towards[..., ::-1] + 1) * 127.5).astype(np.uint8),
        "normals.tiff": towards[..., ::-1],
        "sigma_deg.tiff": ramp * SIGMAS_DEG[number],
        "depth.tiff": 0.5 + 0.01 * ramp,
    }
    picture = pictures.get(name, ramp)
    ending, options = (".png", []) if name.endswith("png") else (".tiff", [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    return cv2.imencode(ending, np.ascontiguousarray(picture), options)[1].tobytes()


@pytest.fixture
def page(opened: Callable[..., Page], lab: Lab) -> Page:
    """The results of a session that has three."""
    session = lab.client.create(Recipe(label="made up"))
    page = opened(Role.OPERATOR)

    def answer(route: Route) -> None:
        _, _, rest = route.request.url.partition("/results")
        if not rest:
            route.fulfill(json={"items": [result(session.id, number) for number in range(3)], "next": None})
        else:
            number, name = rest.strip("/").split("/")
            route.fulfill(body=file_of(int(number), name))

    page.route(f"**/v1/sessions/{session.id}/results**", answer)
    page.route(f"**/v1/sessions/{session.id}/results/**", answer)
    page.goto(f"{lab.url}/#/sessions/{session.id}/result")
    page.get_by_role("button", name="Result 1").click()
    return page


def taken(page: Page, held: list[Route]) -> Route:
    """The request that is held up, once there is one."""
    while not held:
        page.wait_for_timeout(20)
    return held.pop()


def test_page_map_is_never_shown_under_another_name(page: Page) -> None:
    figure, scale = page.locator("map-viewer figure"), page.locator("map-viewer .scale")
    page.locator("[data-map=sigma_deg]").click()
    expect(scale).to_contain_text("≥ 4.00°")
    expect(figure).to_have_attribute("aria-busy", "false")
    assert contrast(page.locator("#map")) > 5
    held: list[Route] = []

    def hold(route: Route) -> None:  # a bound method of a list is none that playwright takes
        held.append(route)

    page.route("**/depth.tiff", hold)
    page.locator("[data-map=depth]").click()
    expect(figure).to_contain_text("Loading …")
    expect(scale).to_have_count(0)
    assert page.evaluate("document.querySelector('#map').getContext('2d').getImageData(9, 9, 1, 1).data[3]") == 0
    page.locator("#map").hover()  # there is nothing to be read yet
    expect(page.locator("map-viewer")).not_to_contain_text("Pixel ")
    taken(page, held).fallback()
    expect(scale).to_contain_text(" mm")
    page.locator("#map").hover(position={"x": 30, "y": 30})
    expect(page.locator("map-viewer")).to_contain_text("Pixel ")
    page.get_by_role("button", name="Pilot only").click()
    expect(figure).to_contain_text("Loading …")
    expect(scale).to_have_count(0)
    taken(page, held).abort()
    expect(page.locator("map-viewer [role=alert]")).to_contain_text("could not be read")


def test_page_comparison_follows_the_result_that_is_chosen(page: Page) -> None:
    comparison = page.locator("result-comparison")
    page.locator("#compare-with").select_option(label="Result 0")
    expect(comparison.locator(".scale")).to_have_count(3)
    expect(comparison.locator("figcaption").nth(0)).to_contain_text("Result 1: Mean σ 4.00°")
    expect(comparison.locator("figcaption").nth(1)).to_contain_text("Result 0: Mean σ 0.40°")
    expect(comparison.locator(".scale").nth(1)).to_contain_text("≥ 4.00°")  # one scale for both
    expect(comparison.locator(".scale").nth(2)).to_contain_text("≥ 5.7")  # of asin 0.2 − asin 0.1, 98 %
    assert contrast(comparison.locator("canvas[data-side='2']")) > 2
    page.get_by_role("button", name="Result 2").click()
    expect(page.locator("#compare-with option:checked")).to_have_text("Result 0")
    expect(comparison.locator("[role=alert]")).to_contain_text("differ in size (128 × 128 and 64 × 64 pixels)")
    expect(comparison.locator(".scale")).to_have_count(0)
    blank = "document.querySelector('canvas[data-side=\"0\"]').getContext('2d').getImageData(9, 9, 1, 1).data[3]"
    assert page.evaluate(blank) == 0
    page.get_by_role("button", name="Pilot only").click()  # not compared with itself
    expect(page.locator("#compare-with option:checked")).to_have_text("nothing")
    expect(comparison.locator("canvas")).to_have_count(0)


def test_page_fit_that_is_unknown_is_not_praised(page: Page) -> None:
    notice = page.locator("result-view section", has_text="Do the images fit the model?")
    expect(notice).to_contain_text("Not evaluated for this result.")
    expect(notice).to_have_class("notice ")
