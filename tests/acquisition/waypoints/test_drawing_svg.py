"""SVG views of cell and route: well-formed, to scale, every light at its position."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from acquisition import geometry, lamp_pose
from acquisition.models.route import Route
from acquisition.waypoints import drawing
from acquisition.waypoints.reach import refusals
from acquisition.waypoints.roadmap import dome_lights
from acquisition.waypoints.routing import route
from tests.acquisition.waypoints.cells import simulated_cell

CELL, CALIBRATION = simulated_cell()


@pytest.fixture(scope="module")
def routes() -> list[Route]:
    lights = dome_lights(CELL, CALIBRATION, 12)
    good = [light for light, no in zip(lights, refusals(lights, CELL, CALIBRATION), strict=True) if no is None]
    return [route(some, CELL.arm.home, CELL, CALIBRATION) for some in (good[:3], good[3:5])]


def dots(svg: str) -> dict[str, np.ndarray]:
    """The positions (2,) in pixels of the numbered lights."""
    circles = re.findall(r'<circle cx="([-\d.]+)" cy="([-\d.]+)"[^>]*/><text[^>]*>(\d+)</text>', svg)
    return {word: np.array([float(x), float(y)]) for x, y, word in circles}


def test_svg_views_all_passes_are_to_scale_and_numbered(routes: list[Route]) -> None:
    base_from_view = lamp_pose.base_from_view(CALIBRATION)
    places = {
        str(first + number): geometry.transform(base_from_view, np.array(waypoint.light.position))
        for first, planned in zip((0, 3), routes, strict=True)
        for number, waypoint in zip(planned.light_numbers, planned.waypoints, strict=True)
    }
    for (_, svg), (right, up) in zip(drawing.svg_views(routes, CELL, CALIBRATION), ((0, 1), (0, 2)), strict=True):
        drawn = dots(svg)
        assert sorted(drawn) == sorted(places) == ["0", "1", "2", "3", "4"]
        steps = [(drawn[a] - drawn["0"], places[a] - places["0"]) for a in ("1", "2", "3", "4")]
        pixels = np.concatenate([step for step, _ in steps])
        metres = np.concatenate([(displacement[right], -displacement[up]) for _, displacement in steps])
        scale = pixels @ metres / (metres @ metres)
        assert scale > 100
        assert pixels == pytest.approx(scale * metres, abs=0.2)


def test_svg_views_are_well_formed_named_and_inside(routes: list[Route]) -> None:
    named = CELL.model_copy(update={"table": CELL.table.model_copy(update={"name": "<table> & more"})})
    for what, svg in drawing.svg_views(routes, named, CALIBRATION):
        assert what
        root = ElementTree.fromstring(svg)  # noqa: S314 - our own text
        titles = {title.text for title in root.iter("title")}
        assert {"<table> & more", "arm at home", "lamp's path", "lights", "the object's keep-out"} <= titles
        _, _, width, height = map(float, root.attrib["viewBox"].split())
        numbers = [float(value) for path in root.iter("path") for value in re.findall(r"[\d.-]+", path.attrib["d"])]
        assert len(numbers) > 200
        places = np.array(numbers).reshape(-1, 2)
        assert (places >= 0).all()
        assert (places <= (width, height)).all()


def test_svg_views_no_routes_draws_cell_alone() -> None:
    assert all("lights" not in svg for _, svg in drawing.svg_views([], CELL, CALIBRATION))
