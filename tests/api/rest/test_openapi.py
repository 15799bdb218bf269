"""The committed OpenAPI description is current and declares the problems of every route."""

import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import httpx
import jsonschema_rs
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.problem_table import PROBLEMS
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


def undescribed() -> Iterator[str]:
    """Every schema, field, parameter, body, answer and tag that says nothing about itself."""
    document = description()
    tags = {tag["name"]: tag["description"] for tag in document["tags"]}
    for name, schema in document["components"]["schemas"].items():
        if not schema.get("description"):
            yield name
        yield from (
            f"{name}.{field}" for field, value in schema.get("properties", {}).items() if not value.get("description")
        )
    for path, methods in document["paths"].items():
        for method, route in methods.items():
            where = f"{method} {path}"
            if not route.get("tags") or not all(tags.get(tag) for tag in route["tags"]):
                yield f"{where}: tag"
            yield from (
                f"{where}: {item['name']}" for item in route.get("parameters", []) if not item.get("description")
            )
            if "requestBody" in route and not route["requestBody"].get("description"):
                yield f"{where}: body"
            for status, answer in route["responses"].items():
                if not answer["description"] or answer["description"] == "Successful Response":
                    yield f"{where}: {status}"


def test_openapi_everything_is_described() -> None:
    assert list(undescribed()) == []


UNIT_OF_NAME = re.compile(r"(^|[._])(s|m|mm|rad|rad_s2|deg|px|dn|e|days|seconds|per_s|per_dn|misfits?)$")
UNIT_OF_TEXT = re.compile(
    r"\b(rad(/s)?|m|mm|s|degrees?|px|pixels?|DN|electrons|seconds since 1970|no unit|unit vector|fraction|share|gap|"
    r"factors?|scale|exponent|efficiency|probability|score|0 to 1|first is 1|times as much|OpenCV)\b",
    re.IGNORECASE,
)
"""Units, and the words and names of what has none."""


def numeric(schema: dict[str, object]) -> bool:
    """Whether a schema is of a number, or of lists of numbers."""
    parts = [*schema.get("anyOf", []), *schema.get("prefixItems", [])]  # type: ignore[misc]
    items = schema.get("items")
    return schema.get("type") == "number" or any(map(numeric, [*parts, *([items] if isinstance(items, dict) else [])]))


def test_openapi_numbers_state_their_unit_by_name_or_in_words() -> None:
    schemas = description()["components"]["schemas"]
    found = {
        f"{name}.{field}": value["description"]
        for name, schema in schemas.items()
        for field, value in schema.get("properties", {}).items()
        if numeric(value)
    }

    assert len(found) > 120
    unknown = {name for name, said in found.items() if not UNIT_OF_NAME.search(name) and not UNIT_OF_TEXT.search(said)}
    assert unknown == set()
    assert "rad, −2π to 2π" in found["ReadingResource.joints"]
    assert "s, ≥ 0" in found["ReadingResource.age_s"]


@pytest.mark.parametrize(
    "field",
    [
        "ActionRequest.action", "SessionResource.state", "SessionResource.allowed_actions", "Problem.code",
        "JogRequest.axis", "QueueActionRequest.action", "ResultResource.origin", "Recipe.method", "CallerResource.role",
    ],
)  # fmt: skip
def test_openapi_closed_sets_are_enumerations(field: str) -> None:
    schemas = description()["components"]["schemas"]
    name, _, key = field.partition(".")

    def values(schema: dict[str, object]) -> list[object]:
        if "$ref" in schema:
            return values(schemas[str(schema["$ref"]).rpartition("/")[2]])
        parts = [*schema.get("anyOf", []), *([schema["items"]] if "items" in schema else [])]  # type: ignore[misc]
        return [*schema.get("enum", []), *(value for part in parts for value in values(part))]  # type: ignore[misc]

    assert len(values(schemas[name]["properties"][key])) >= 2


def test_openapi_each_answer_has_a_type() -> None:
    """Bytes as such, text as text, JSON by its schema; the data of events is linked."""
    for path, methods in description()["paths"].items():
        for method, route in methods.items():
            for status, answer in route["responses"].items():
                for media_type, content in answer.get("content", {}).items():
                    schema = content["schema"]
                    if media_type.startswith(("image/", "model/", "multipart/", "application/zip", "application/oct")):
                        assert (schema["type"], schema["format"]) == ("string", "binary"), (method, path, status)
                        assert schema["contentMediaType"] == media_type
                    elif media_type.startswith("text/"):
                        assert schema["type"] == "string"
                    else:
                        assert schema, (method, path, status)
    (stream,) = description()["paths"]["/v1/events"]["get"]["responses"]["200"]["content"].values()
    assert stream["schema"]["contentSchema"] == {"$ref": "#/components/schemas/EventResource"}


def test_openapi_says_where_the_service_is_and_who_may_call() -> None:
    document = description()
    assert [server["url"] for server in document["servers"]] == ["/"]
    assert document["paths"]["/v1/sessions"]["post"]["x-role"] == "operator"
    assert document["paths"]["/v1/sessions/{session_id}"]["delete"]["x-role"] == "admin"
    assert document["paths"]["/v1/rig/stop"]["post"]["x-role"] == "viewer"
    assert document["paths"]["/health/live"]["get"]["security"] == []


def test_openapi_deprecated_fields_are_those_of_the_policy() -> None:
    page = (COMMITTED.parents[1] / "docs" / "reference" / "rest.md").read_text(encoding="utf-8")
    marked = {
        f"{name}.{field}"
        for name, schema in description()["components"]["schemas"].items()
        for field, value in schema.get("properties", {}).items()
        if value.get("deprecated")
    }
    assert marked == set(re.findall(r"^\| `([\w.]+)` \| [\d.]+ \|", page, re.MULTILINE))
    assert not [path for path, ways in description()["paths"].items() for way in ways.values() if way.get("deprecated")]


def links_of(operation_id: str, status: str) -> dict[str, dict[str, object]]:
    """The links of an operation's answer."""
    for ways in description()["paths"].values():
        for route in ways.values():
            if route["operationId"] == operation_id:
                return route["responses"][status].get("links", {})
    raise KeyError(operation_id)


def test_openapi_links_lead_to_operations_by_their_own_parameters() -> None:
    operations = {route["operationId"]: route for ways in description()["paths"].values() for route in ways.values()}
    checked = 0
    for route in operations.values():
        for answer in route["responses"].values():
            for name, link in answer.get("links", {}).items():
                target = operations[link["operationId"]]
                known = {f"{item['in']}.{item['name']}" for item in target.get("parameters", [])}
                needed = {f"path.{item['name']}" for item in target.get("parameters", []) if item["in"] == "path"}
                given = set(link.get("parameters", {}))
                assert given <= known, name
                assert link["description"], name
                assert bool(given & needed) or not needed or link["operationId"] in ("image", "thumbnail", "artefact")
                checked += 1
    assert checked > 80
    of_session = links_of("create", "201")
    assert {"read", "start", "passes", "results", "events", "archive", "delete"} <= set(of_session)
    assert of_session["start"]["requestBody"] == {"action": "start"}


def test_openapi_states_headers_that_answers_have() -> None:
    for path, methods in description()["paths"].items():
        for method, route in methods.items():
            for status in {"429", "503"} & set(route["responses"]):
                assert route["responses"][status]["headers"]["Retry-After"]["required"], (method, path)
    sessions = description()["paths"]["/v1/sessions"]
    assert "Location" in sessions["post"]["responses"]["201"]["headers"]
    assert "ETag" in sessions["get"]["responses"]["200"]["headers"]
    assert "304" in sessions["get"]["responses"]
    for part in (".jpg", "/figures", "/clipping.png", "/target"):
        good = description()["paths"][f"/v1/rig/preview{part}"]["get"]["responses"]
        assert "304" not in good, part  # the present image is never kept
        assert "ETag" not in good["200"].get("headers", {}), part


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


def test_docs_page_is_served_offline_under_a_strict_policy(shared: object) -> None:
    http: httpx.Client = shared.http  # type: ignore[attr-defined]

    assert http.get("/openapi.json").json() == description()
    page = http.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    assert "unsafe" not in page.headers["content-security-policy"]
    assert not re.search(r"<script(?![^>]* src=)|<style|\son\w+=|https?://", page.text)
    wanted = re.findall(r'(?:src|href)="(/docs/[^"]*)"', page.text)
    assert len(wanted) == 4
    for address in wanted:
        answer = http.get(address)
        assert answer.status_code == 200, address
        assert answer.headers["content-encoding"] == "gzip"
    assert not re.search(r"https?://", http.get("/docs/start.js").text)
    assert "Apache" in (resources.files("api.rest") / "swagger_ui" / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.parametrize("code", list(ErrorCode))
def test_error_codes_each_have_a_remedy(code: ErrorCode) -> None:
    assert PROBLEMS[code].remedy.endswith(".")
    assert 400 <= PROBLEMS[code].status < 600
