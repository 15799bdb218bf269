"""Forecasts for lights that a person drags, in the compute process, which keeps what does not depend on the lights.

A review requests a forecast several times a second, each time with one light moved. So the last review's basis stays in
memory, and with it the arm's verdict on each position so far. All of it can be computed again: if the compute process
is ended in between, only the next answer is late.
"""

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from acquisition import lamp_pose
from acquisition.capture import region
from acquisition.formats import export
from acquisition.models.base import FloatArray, Vector3
from acquisition.models.light_forecast import ForecastInput, LightForecast, PlacedLight
from acquisition.models.route import Refusal
from acquisition.plan.design_problem import DesignProblem
from acquisition.plan.explain import Basis
from acquisition.waypoints.reach import ReachMap, refusals

MAX_POSITIONS = 500
"""Number of positions whose verdicts are kept, enough for minutes of dragging."""

NEAREST_M, FARTHEST_M = 0.02, 10.0
"""Range of distances, m, of a light from the dome's centre; outside it a light is refused without checking the arm."""


@dataclass
class _Review:
    """What is kept of one review."""

    key: str
    basis: Basis | None
    verdicts: OrderedDict[Vector3, Refusal | None] = field(default_factory=OrderedDict[Vector3, Refusal | None])


_kept: list[_Review] = []  # only the last review: there is one at a time


def forecast(
    key: str, given: ForecastInput, reach: ReachMap, positions: list[Vector3]
) -> tuple[LightForecast, bytes | None]:
    """Forecasts σ with lights at `positions` (m, view frame), with a picture (PNG); `key` names the review.

    Raises RigError plan.infeasible when the last result is no basis for a plan.
    """
    if not _kept or _kept[0].key != key:
        _kept[:] = [_Review(key, _basis(given, reach))]
    review, center = _kept[0], reach.center
    verdicts = [_verdict(review, position, center, given) for position in positions]
    if review.basis is None:
        lights = [
            PlacedLight(position=position, refusal=verdict, gain=None)
            for position, verdict in zip(positions, verdicts, strict=True)
        ]
        return LightForecast(
            lights=lights, sigma_before_deg=None, sigma_deg=None, median_deg=None, brightest_sigma_deg=None
        ), None
    served = [position for position, verdict in zip(positions, verdicts, strict=True) if verdict is None]
    basis, places = review.basis, np.array(served).reshape(-1, 3)
    predicted = basis.problem.predict(places)
    gains = iter(predicted.gains)
    return LightForecast(
        lights=[
            PlacedLight(position=position, refusal=verdict, gain=next(gains) if verdict is None else None)
            for position, verdict in zip(positions, verdicts, strict=True)
        ],
        sigma_before_deg=basis.problem.before.mean_deg,
        sigma_deg=predicted.mean_deg,
        median_deg=predicted.median_error_deg,
        brightest_sigma_deg=basis.brightest_deg,
    ), basis.sigma_picture(places)


def _basis(given: ForecastInput, reach: ReachMap) -> Basis | None:
    if given.result is None:
        return None
    normal_map, observations, calibration = export.read(given.result), given.observations, given.calibration
    mask = None if given.region_file is None else region.decode_mask(given.region_file.read_bytes(), calibration)
    problem = DesignProblem.of(normal_map, observations, given.recipe, reach, calibration, region=mask)
    return Basis.of(problem, normal_map, observations, calibration)


def _verdict(review: _Review, position: Vector3, center: FloatArray, given: ForecastInput) -> Refusal | None:
    if position not in review.verdicts:
        place = np.array(position)
        distance = float(np.linalg.norm(place - center))
        if distance < NEAREST_M:
            verdict: Refusal | None = Refusal(
                reason="hits-object", detail=f"the light stands {1e3 * distance:.0f} mm from the dome's centre"
            )
        elif not distance < FARTHEST_M:
            verdict = Refusal(reason="too-far", detail=f"the light stands more than {FARTHEST_M:g} m from the object")
        else:
            verdict = refusals([lamp_pose.light_at(place, center)], given.cell, given.calibration)[0]
        review.verdicts[position] = verdict
        while len(review.verdicts) > MAX_POSITIONS:
            review.verdicts.popitem(last=False)
    return review.verdicts[position]
