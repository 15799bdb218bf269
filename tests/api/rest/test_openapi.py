"""The committed OpenAPI description is current and declares the problems of every route."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import jsonschema_rs
import pytest

from acquisition.models.errors import PROBLEMS, ErrorCode
from api.rest.app import description
from api.rest.openapi import text

COMMITTED = Path(__file__).parents[3] / "api" / "openapi.json"


def test_openapi_committed_description_is_up_to_date() -> None:
    assert COMMITTED.read_text(encoding="utf-8") == text(), "run: python -m api.rest.openapi > api/openapi.json"


def test_openapi_each_route_has_problems_and_description() -> None:
    for path, methods in description()["paths"].items():
        for method, route in methods.items():
            assert route["description"], (method, path)
            assert "application/problem+json" in route["responses"]["default"]["content"], (method, path)
            for status, answer in route["responses"].items():
                if status != "default" and int(status) >= 400:
                    assert list(answer["content"]) == ["application/problem+json"], (method, path, status)


def test_openapi_references_resolve() -> None:
    schema = description()
    names = set(schema["components"]["schemas"])
    wanted = {part.split('"')[0] for part in text().split("#/components/schemas/")[1:]}

    assert wanted <= names
    assert "HTTPValidationError" not in names  # no error has that shape


def bodies() -> Iterator[tuple[str, str]]:
    """Every JSON body of a request or a good answer: where it stands, and its schema's name."""
    for path, methods in description()["paths"].items():
        for method, route in methods.items():
            contents = [answer.get("content", {}) for status, answer in route["responses"].items() if status < "300"]
            for content in [*contents, route.get("requestBody", {}).get("content", {})]:
                reference = content.get("application/json", {}).get("schema", {}).get("$ref")
                if reference is not None:
                    yield f"{method} {path}", reference.rpartition("/")[2]


def test_openapi_each_body_has_an_example() -> None:
    schemas = description()["components"]["schemas"]

    without = {(where, name) for where, name in bodies() if not schemas[name].get("examples")}

    assert without == set()
    assert schemas["Problem"]["examples"]
    assert schemas["EventResource"]["examples"]


def test_openapi_examples_are_valid() -> None:
    """Against the schemas as they stand in the description, by a validator that is not the models' own."""
    document = description()
    for name, schema in document["components"]["schemas"].items():
        check = jsonschema_rs.validator_for(
            {"$ref": f"#/components/schemas/{name}", "components": document["components"]}, validate_formats=True
        )
        for example in schema.get("examples", []):
            assert not [error.message for error in check.iter_errors(example)], name


def test_openapi_is_served_with_an_offline_page(shared: object) -> None:
    http: httpx.Client = shared.http  # type: ignore[attr-defined]

    assert http.get("/openapi.json").json() == description()
    page = http.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    assert "/v1/rig/stop" in page.text
    assert "http://" not in page.text
    assert "https://" not in page.text


@pytest.mark.parametrize("code", list(ErrorCode))
def test_error_codes_each_have_a_remedy(code: ErrorCode) -> None:
    assert PROBLEMS[code].remedy.endswith(".")
    assert 400 <= PROBLEMS[code].status < 600
