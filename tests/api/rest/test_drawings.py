"""Drawings over HTTP: reach, and the route of a pass."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquisition.models.recipe import Recipe
from acquisition.store.folder import write_value
from acquisition.waypoints.roadmap import dome_lights
from acquisition.waypoints.routing import route
from tests.api.conftest import running


@contextmanager
def forbidden(owner: object, name: str) -> Generator[None]:
    """A method that fails when it is called."""

    def fail(*_: object) -> None:
        raise AssertionError(name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, fail)
        yield


@pytest.mark.long
def test_drawings_reach_and_route_as_png_and_html(tmp_path: Path) -> None:
    with running(tmp_path) as service:
        still = service.http.get("/v1/rig/reach.png", timeout=120)
        assert still.status_code == 200
        assert still.headers["content-type"] == "image/png"
        assert still.content.startswith(b"\x89PNG")
        page = service.http.get("/v1/rig/reach.html", timeout=120)
        assert page.headers["content-type"].startswith("text/html")
        assert "reachable" in page.text
        assert page.headers["content-encoding"] == "gzip"
        tag = {"If-None-Match": page.headers["etag"]}
        with forbidden(service.service.runner, "render"):  # what is there is not drawn anew
            assert service.http.get("/v1/rig/reach.html", headers=tag).status_code == 304
            assert service.http.get("/v1/rig/reach.html").content == page.content
        assert service.http.get("/v1/rig/reach.pdf").status_code == 422

        session = service.client.create(Recipe(pilot_lights=3, planned_lights=0))
        missing = service.http.get(f"/v1/sessions/{session.id}/passes/0/route.png")
        assert missing.status_code == 404
        assert missing.json()["code"] == "request.not_found"
        cell = service.service.cell
        lights = dome_lights(cell, service.service.calibration, 30)[10:13]
        planned = route(lights, cell.arm.home, cell, service.service.calibration)
        store = service.service.store
        name = "passes/0/route.json"
        digest = write_value(store.folder(session.id) / name, planned)
        store.journal.add_artifact(session.id, "route", 0, name, digest, {}, "waypoints.ready")
        assert service.http.get(f"/v1/sessions/{session.id}/passes/0/route.png").content.startswith(b"\x89PNG")
        assert "lamp" in service.http.get(f"/v1/sessions/{session.id}/passes/0/route.html").text
