"""Generated requests, valid and invalid: every response conforms to the OpenAPI description.

Requests are made by schemathesis from the description, half of them for things that exist: a session with results and
images whose recipe, files and entries are there. Of the answers 503 (a device is absent, as here) and 507 are the only
ones above 499, and each only where the route declares it.
"""

import os
import time
from typing import Any

import numpy as np
import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from schemathesis.checks import CHECKS, load_all_checks
from schemathesis.generation import GenerationMode

from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import ResultSummary
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.store.folder import write_frame, write_manifest, write_value
from api.rest.app import description
from tests.contract.steering import CONFORMANCE, EVENTS, Steering, ending

CASES = int(os.environ.get("LIGHTPOSE_CASES", "200"))
"""Requests for each operation and kind in the long run."""

DESCRIBED = description()
OPERATIONS = [
    (method, path, mode)
    for path, methods in DESCRIBED["paths"].items()
    for method, operation in methods.items()
    for mode in GenerationMode
    if mode is GenerationMode.POSITIVE or "requestBody" in operation or "parameters" in operation
]
"""Requests as described, and, where there is anything to send, requests that are not."""

RECKONING = ("/v1/rig/reach", "/v1/dry-runs")
"""Routes that first reckon what the arm can reach: for the long run."""
ALLOWED_FAULTS = frozenset({503, 507})


def furnished(service: Any) -> str:
    """A session that has a plan, an image and a result, entered in the journal."""
    session_id: str = service.client.create(Recipe()).id
    store = service.service.store
    folder = store.folder(session_id)
    light = Light(position=(0.1, 0.1, -0.4), axis=(0.0, 0.0, -1.0))
    plan = LightPlan(lights=[light], method="optimal", reasons=["first"])
    digest = write_value(folder / "passes/0/plan.json", plan)
    body = {"lights": 1, "method": "optimal", "predicted_sigma_deg": None}
    store.journal.add_artifact(session_id, "plan", 0, "passes/0/plan.json", digest, body, "plan.ready")
    frame = write_frame(folder, "passes/0/shots/0.tiff", np.full((16, 16), 900, np.uint16))
    quality = FrameQuality(saturated=0.0, bright_level=0.5, accepted=True)
    shot = Shot(
        key=ShotKey(pass_number=0, number=0), kind="light", frame=frame, exposure_s=0.1, light_number=0, light=light,
        taken_at=time.time(), quality=quality,
    )  # fmt: skip
    store.journal.add_shot(session_id, shot)
    summary = ResultSummary(
        images=1, object_pixels=10, solved_pixels=10, mean_sigma_deg=1.0, median_sigma_deg=1.0,
        predicted_sigma_deg=None, predicted_median_deg=None, fewer_than_three_lights=0.0, intensity_factors=[1.0],
        noise={},
    )  # fmt: skip
    (folder / "results/0").mkdir(parents=True)
    digest = write_manifest(folder / "results/0", {"number": 0})
    more = {**summary.model_dump(mode="json"), "origin": "session", "seconds": 1.0}
    store.journal.add_artifact(session_id, "result", 0, "results/0/manifest.json", digest, more, "normals.ready")
    return session_id


@pytest.fixture(scope="module")
def known(shared: Any) -> dict[str, Any]:
    """Path parameters that exist."""
    return {"session_id": furnished(shared), "number": 0, "shot_number": 0, "light": 0, "artefact": "manifest.json"}


@pytest.fixture(scope="module")
def contracts(known: dict[str, Any]) -> dict[GenerationMode, Any]:
    """The description for each kind of request; it takes a while to read."""
    return {mode: contract(known, mode) for mode in GenerationMode}


def contract(known: dict[str, Any], mode: GenerationMode) -> Any:
    """The description; what is sent by it as described leads somewhere half of the time."""
    schema = schemathesis.openapi.from_dict(DESCRIBED)
    if mode is GenerationMode.POSITIVE:
        steering = Steering(known)

        @schema.hook
        def map_path_parameters(context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
            return steering.path_parameters(context, path_parameters)

    @schema.hook
    def map_query(context: Any, query: dict[str, Any] | None) -> dict[str, Any] | None:
        return ending(context.operation.path, context.operation.method, query)

    return schema


def keeps_its_word(
    contracts: dict[GenerationMode, Any], service: Any, method: str, path: str, mode: GenerationMode, cases: int
) -> None:
    """Sends generated requests of one kind to one route and checks the responses."""
    load_all_checks()
    # Of the events' parameters null and lists are sent as words, which are valid again.
    checks = [CHECKS.get_one(name) for name in CONFORMANCE if (name, path) != ("negative_data_rejection", EVENTS)]
    operation = contracts[mode][path][method]

    @settings(max_examples=cases, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
    @given(case=operation.as_strategy(generation_mode=mode))
    def send(case: Any) -> None:
        answer = case.call(base_url=service.url, timeout=120)  # a map of the reach is made once
        if answer.status_code >= 500:
            assert answer.status_code in ALLOWED_FAULTS, answer.text
            assert str(answer.status_code) in operation.definition.raw["responses"], (answer.status_code, answer.text)
        case.validate_response(answer, checks=checks)

    send()


@pytest.mark.parametrize(
    ("method", "path", "mode"), [item for item in OPERATIONS if not item[1].startswith(RECKONING)], ids=str
)
def test_contract_few_generated_requests_conform(
    contracts: Any, shared: Any, method: str, path: str, mode: GenerationMode
) -> None:
    keeps_its_word(contracts, shared, method, path, mode, 1)


@pytest.mark.long
@pytest.mark.parametrize(("method", "path", "mode"), OPERATIONS, ids=str)
def test_contract_many_generated_requests_conform(
    contracts: Any, shared: Any, method: str, path: str, mode: GenerationMode
) -> None:
    keeps_its_word(contracts, shared, method, path, mode, CASES)
