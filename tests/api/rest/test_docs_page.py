"""The page that tries the API, in Chromium: it runs under its policy, loads nothing from elsewhere, sends requests."""

from typing import Any

import pytest
from playwright.sync_api import expect, sync_playwright

from tests.api.page import chromium

pytestmark = pytest.mark.long


def test_docs_page_sends_a_request_and_shows_the_answer(shared: Any) -> None:
    if chromium.EXECUTABLE is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    console = chromium.Console()
    asked: list[str] = []
    with sync_playwright() as playwright:
        browser = chromium.launch(playwright)
        page = console.watch(browser.new_page())
        page.set_default_timeout(60_000)
        expect.set_options(timeout=60_000)
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"{shared.url}/docs")
        route = page.locator("#operations-health-live")
        route.locator(".opblock-summary").click()
        route.get_by_role("button", name="Try it out").click()
        route.get_by_role("button", name="Execute").click()
        expect(route.locator(".live-responses-table .response-col_status").last).to_contain_text("200")
        expect(route.locator(".live-responses-table")).to_contain_text('"status": "ok"')
        assert page.locator(".opblock").count() > 40
        browser.close()

    assert console.errors == []
    assert f"{shared.url}/health/live" in asked
    assert all(url.startswith((shared.url, "data:", "blob:")) for url in asked)
