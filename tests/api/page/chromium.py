"""Debian's Chromium, driven by playwright: its flags, and a page that keeps what the console says."""

import shutil
import time
from dataclasses import dataclass, field

from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, Playwright

EXECUTABLE = shutil.which("chromium")
"""None where Debian's package `chromium` is not installed."""

FLAGS = (
    "--no-sandbox",  # tests run as root in containers
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
)

NETWORK = "Failed to load resource"
"""How Chromium's console reports an answer with a status of 400 or more, and a connection that was refused: no fault of
the page, which tells the person what it means."""


@dataclass
class Console:
    """Errors of all pages of a browser: exceptions, console errors, violations of the content security policy."""

    errors: list[str] = field(default_factory=list[str])

    def watch(self, page: Page) -> Page:
        """Keeps the errors of a page from now on."""
        page.on("console", self._say)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        return page

    def _say(self, message: ConsoleMessage) -> None:
        if message.type == "error" and not message.text.startswith(NETWORK):
            self.errors.append(message.text)


def launch(playwright: Playwright) -> Browser:
    """A headless Chromium with WebGL in software."""
    return playwright.chromium.launch(executable_path=EXECUTABLE, args=list(FLAGS))


def open_page(context: BrowserContext, console: Console, address: str, key: str | None = None) -> Page:
    """A new page at an address of the service; with a key, signed in."""
    page = console.watch(context.new_page())
    page.goto(address)
    if key is not None:
        page.get_by_label("Key", exact=True).fill(key)
        page.get_by_role("button", name="Sign in").click()
        page.locator("sign-in").wait_for(state="detached")
    page.locator("#connection[data-stale=false]").wait_for()
    return page


def until(page: Page, condition: str, within_s: float = 1_200.0) -> None:
    """Waits until an expression is true in a page: its policy forbids playwright's own way, which needs `eval`.

    Where it is about the arm, the first lights may have to be computed on a busy machine before.
    """
    deadline = time.monotonic() + within_s
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, condition
        page.wait_for_timeout(50)
