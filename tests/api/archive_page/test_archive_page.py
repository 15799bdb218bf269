"""The archive's page in headless Chromium: found, opened, lit from elsewhere, taken away; accessible, narrow."""

import os
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

from api.rest import keys
from api.rest.keys import Role
from tests.api.page import chromium
from tests.api.page.chromium import Console
from tests.api.page.pictures import contrast

WITHIN_S = 240.0
TIMEOUT_MS = 60_000

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for the module."""
    if chromium.EXECUTABLE is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as playwright:
        running = chromium.launch(playwright)
        yield running
        running.close()


@pytest.fixture(scope="module")
def served(browser: Browser, address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """Address of `lightpose archive serve` as a process of its own, and a viewer's key."""
    data = tmp_path_factory.mktemp("keys")
    secret = keys.add(keys.path_in(data), "reader", Role.VIEWER)
    command = [sys.executable, "-m", "api.cli", "archive", "serve", address, "--data", str(data), "--port", "0"]
    log = data / "log"
    with log.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file, env=os.environ)
    deadline = time.monotonic() + WITHIN_S
    while not (found := re.search(r"ready (\S+)", log.read_text())):
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.1)
    yield found[1], secret
    process.terminate()
    process.wait(60)


@pytest.fixture
def signed_in(browser: Browser, served: tuple[str, str]) -> Iterator[Page]:
    """The page, signed in; its complaints fail the test."""
    url, secret = served
    console = Console()
    context = browser.new_context(viewport={"width": 1280, "height": 860}, locale="en-GB")
    context.set_default_timeout(TIMEOUT_MS)
    page = console.watch(context.new_page())
    page.goto(f"{url}/archive")
    page.get_by_label("Key", exact=True).fill(secret)
    page.get_by_role("button", name="Sign in").click()
    page.locator("tbody tr").first.wait_for()
    yield page
    context.close()
    assert console.errors == []


def test_archive_page_finds_opens_lights_and_downloads(signed_in: Page, tmp_path: Path) -> None:
    page = signed_in
    expect(page.locator("tbody tr")).to_have_count(2)
    page.locator("tbody img").first.wait_for()
    page.get_by_label("Condition").fill("object =")
    page.get_by_role("button", name="Find").click()
    expect(page.get_by_role("alert")).to_contain_text("cannot be read")
    page.get_by_label("Condition").fill("")
    page.get_by_label("Object, number or notes").fill("vase")
    expect(page.locator("tbody tr")).to_have_count(1)
    page.get_by_role("link", name="Vase, Seite A").click()
    expect(page.locator("input[name=shown]")).to_have_count(2)
    page.locator("[aria-busy=false] #map").wait_for()
    assert contrast(page.locator("#map")) > 5
    page.locator("[data-map=relit]").click()
    page.locator("[aria-busy=false] #relit").wait_for()
    page.locator("#relit").press("ArrowRight")
    assert contrast(page.locator("#relit")) > 5
    with page.expect_download(timeout=300_000) as begun:
        page.locator("[data-form=bagit]").click()
    begun.value.save_as(tmp_path / "bag.zip")
    with zipfile.ZipFile(tmp_path / "bag.zip") as packed:
        assert any(name.endswith("/bagit.txt") for name in packed.namelist())


@pytest.mark.long
def test_archive_page_has_no_finding_of_axe_and_fits_into_360_px(signed_in: Page) -> None:
    page = signed_in
    for place in ("list", "details"):
        if place == "details":
            page.get_by_role("link", name="Vase, Seite A").press("Enter")
            page.locator("[aria-busy=false] #map").wait_for()
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            for name in ("Deutsch", "English"):
                page.get_by_role("button", name=name).press("Enter")
                page.wait_for_timeout(300)  # colours change slowly
                found = Axe().run(page)
                assert found.violations_count == 0, (place, scheme, name, found.generate_report())
        page.set_viewport_size({"width": 360, "height": 740})
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, place
        page.set_viewport_size({"width": 1280, "height": 860})
