"""PNG and HTML drawings of reach and route: correct content, and no network access."""

import re

import cv2
import numpy as np
import pytest

from acquisition import geometry, lamp_pose
from acquisition.models.route import Route
from acquisition.waypoints import drawing
from acquisition.waypoints.reach import ReachMap, reach
from acquisition.waypoints.routing import route
from tests.acquisition.waypoints.cells import random_cell


@pytest.fixture(scope="module")
def reach_map() -> ReachMap:
    return reach(*random_cell(3))


@pytest.fixture(scope="module")
def planned(reach_map: ReachMap) -> Route:
    lights = [lamp_pose.light_at(position, reach_map.center) for position in reach_map.candidates[:3]]
    return route(lights, reach_map.home, reach_map.cell, reach_map.calibration)


def test_reach_marks_each_position_is_drawn_once_with_reason(reach_map: ReachMap) -> None:
    marks = {mark.name: mark for mark in drawing.reach_marks(reach_map)}
    assert sum(len(mark.points) for mark in marks.values()) == len(reach_map.points)
    assert len(marks["reachable"].points) == len(reach_map.candidates)
    assert set(marks) - {"reachable"} == {refusal.reason for refusal in reach_map.refusals if refusal is not None}
    refused = marks["too-far"]
    assert len(refused.labels) == len(refused.points) > 0


def test_route_marks_lamp_path_passes_all_lights(reach_map: ReachMap, planned: Route) -> None:
    marks = {mark.name: mark for mark in drawing.route_marks(planned, reach_map.cell, reach_map.calibration)}
    path = marks["lamp's path"].points
    base_from_view = lamp_pose.base_from_view(reach_map.calibration)
    for waypoint in planned.waypoints:
        place = geometry.transform(base_from_view, waypoint.light.position)
        assert np.linalg.norm(path - place, axis=1).min() < 1e-6
    assert np.allclose(
        marks["lights"].points[0], geometry.transform(base_from_view, planned.waypoints[0].light.position)
    )
    assert f"arm at light {planned.light_numbers[2]}" in marks


def test_cell_marks_all_bodies_are_at_their_poses(reach_map: ReachMap) -> None:
    cell = reach_map.cell
    marks = {mark.name: mark for mark in drawing.cell_marks(cell, reach_map.calibration)}
    assert {item.name for item in (cell.table, *cell.camera_body, *cell.obstacles)} < set(marks)
    keep = cell.object.keep_out
    height = np.nanmax(marks["the object's keep-out"].points[:, 2]) - keep.base_from_object.position_m[2]
    assert height == pytest.approx(keep.height_m)


@pytest.mark.long
def test_png_reach_and_route_are_not_blank(reach_map: ReachMap, planned: Route) -> None:
    for content in (
        drawing.reach_png(reach_map),
        drawing.route_png(planned, reach_map.cell, reach_map.calibration),
    ):
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert min(image.shape[:2]) > 500
        colored = np.ptp(image.astype(int), axis=2) > 60
        assert colored.sum() > 200


def test_html_pages_load_nothing_remote(reach_map: ReachMap, planned: Route) -> None:
    for page in (drawing.reach_html(reach_map), drawing.route_html(planned, reach_map.cell, reach_map.calibration)):
        assert "Plotly.newPlot" in page
        assert re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=", page) == []
