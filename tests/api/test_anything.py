"""Whatever is sent to whatever route, the answer is declared, of the declared kind, and never a fault."""

import json
from typing import Any
from urllib.parse import quote

import httpx
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from api.app import description

PATHS = description()["paths"]
ROUTES = [
    (method, path)
    for path, methods in PATHS.items()
    for method in methods
    if path not in ("/v1/events", "/v1/rig/reach")
]
# Anything but what would begin a walk over the folders: clients resolve dots before they send.
NAMES = (
    st.text(min_size=1, max_size=30).filter(lambda name: name.strip(".") != "").map(lambda name: quote(name, safe=""))
)
NUMBERS = st.integers().map(str)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=8,
)
FIELDS = st.dictionaries(
    st.sampled_from(["kind", "method", "pilot_lights", "planned_lights", "user_lights", "seed", "exposure", "action"]),
    JSON,
    max_size=4,
)


@settings(
    max_examples=250, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_every_answer_is_declared(shared: Any, data: st.DataObject) -> None:
    method, path = data.draw(st.sampled_from(ROUTES))
    address = path
    for item in PATHS[path][method].get("parameters", []):
        if item["in"] == "path":
            name = item["name"]
            address = address.replace(f"{{{name}}}", data.draw(NUMBERS | NAMES))
        elif item["in"] == "query" and data.draw(st.booleans()):
            address += f"{'&' if '?' in address else '?'}{item['name']}={data.draw(NUMBERS | NAMES)}"
    arguments: dict[str, Any] = {}
    if method == "post" and data.draw(st.booleans()):
        arguments = {"content": json.dumps(data.draw(FIELDS | JSON)), "headers": {"Content-Type": "application/json"}}

    answer: httpx.Response = shared.http.request(method.upper(), address, **arguments)

    assert answer.status_code < 500 or answer.status_code == 503, (address, answer.text)
    declared = PATHS[path][method]["responses"]
    if answer.is_error:
        assert answer.headers["content-type"] == "application/problem+json"
        assert {"type", "title", "status", "detail", "code", "remedy"} <= set(answer.json())
    else:
        assert str(answer.status_code) in declared
