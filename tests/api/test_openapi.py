"""The committed description is the service's own, and says of every route what may go wrong."""

from pathlib import Path

import httpx
import pytest

from acquisition.errors import PROBLEMS, ErrorCode
from api.app import description
from api.openapi import text

COMMITTED = Path(__file__).parents[2] / "api" / "openapi.json"


def test_the_committed_description_is_up_to_date() -> None:
    assert COMMITTED.read_text(encoding="utf-8") == text(), "run: python -m api.openapi > api/openapi.json"


def test_every_route_declares_problems_and_says_what_it_is_for() -> None:
    for path, methods in description()["paths"].items():
        for method, route in methods.items():
            assert route["description"], (method, path)
            assert "application/problem+json" in route["responses"]["default"]["content"], (method, path)
            for status, answer in route["responses"].items():
                if status != "default" and int(status) >= 400:
                    assert list(answer["content"]) == ["application/problem+json"], (method, path, status)


def test_every_reference_leads_somewhere() -> None:
    schema = description()
    names = set(schema["components"]["schemas"])
    wanted = {part.split('"')[0] for part in text().split("#/components/schemas/")[1:]}

    assert wanted <= names
    assert "HTTPValidationError" not in names  # no error has that shape


def test_it_is_served_with_a_page_that_needs_no_network(shared: object) -> None:
    http: httpx.Client = shared.http  # type: ignore[attr-defined]

    assert http.get("/openapi.json").json() == description()
    page = http.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    assert "/v1/rig/stop" in page.text
    assert "http://" not in page.text
    assert "https://" not in page.text


@pytest.mark.parametrize("code", list(ErrorCode))
def test_each_code_says_what_to_do(code: ErrorCode) -> None:
    assert PROBLEMS[code].remedy.endswith(".")
    assert 400 <= PROBLEMS[code].status < 600
