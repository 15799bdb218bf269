"""The design problem that plans are made from: sample pixels, their information so far, and the candidate lights."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import criterion, expected_sigma, planned_noise, visibility
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.expected_sigma import ExpectedSigma
from acquisition.plan.exposure_options import CaptureTimes, Exposures
from acquisition.plan.planned_noise import Gloss
from acquisition.plan.visibility import Surface

SAMPLE_PIXELS = 900
"""Number of random sample pixels of the search; from 50 to 4,000 the errors of the plans differ by less than 5 %."""

MAX_CANDIDATES = 300
"""Maximum number of candidate positions; 300 and 800 give the same errors."""


@dataclass(frozen=True)
class PlanOptions:
    """What counts in a plan, which candidates there are, and optional reports."""

    region: BoolArray | None = None
    """(H, W) pixels whose normals count; none: the full object."""

    certify: bool = True
    """Whether the relaxation's lower bound is computed."""

    listed: bool = False
    """Whether the candidates are all the positions there are, such as the lamps of a dome: they need not surround the
    object, since the images so far may do so."""

    times: CaptureTimes | None = None
    """Limits and times of the capture, by which exposures are planned where the recipe asks for it; none: they are not,
    and each light has the automatic one."""

    forecast_counts: Sequence[int] = ()
    """Numbers of further lights for which the plan's `forecast` predicts σ; those above the candidates' are omitted."""


@dataclass(frozen=True)
class Problem:
    """Design problem: sample pixels of the search, held-out pixels of the prediction, and the candidate lights."""

    captured: FloatArray  # (T, 3) unit directions of the lights captured so far
    surface: Surface
    gloss: Gloss
    expected: ExpectedSigma
    calibration: Calibration
    recipe: Recipe
    reach: Reach
    search_sample: Samples
    holdout_sample: Samples
    positions: FloatArray  # (K, 3) m, view frame
    units: FloatArray  # (K, 3)

    def lights(self, positions: FloatArray) -> list[Light]:
        """Lights at positions (M, 3) with their axes towards the dome's centre."""
        center = self.reach.center
        return [lamp_pose.light_at(position, center) for position in positions]

    def holdout_candidates(self, positions: FloatArray, exposures: Sequence[Exposures] | None = None) -> Candidates:
        """Design rows of lights at positions (M, 3) at the held-out pixels."""
        return self.design_rows(self.holdout_sample, positions, exposures)

    def predicted_deg(self, positions: FloatArray) -> FloatArray:
        """σ (P,) in degrees expected of the held-out pixels after lights at positions (M, 3)."""
        none = criterion.joined(self.holdout_sample, [])
        return self.expected_deg(self.holdout_candidates(positions) if len(positions) else none)

    def expected_deg(self, lights: Candidates) -> FloatArray:
        """σ (P,) in degrees expected of the held-out pixels after lights with these rows at them."""
        return self.expected.sigma_deg(criterion.posterior(self.holdout_sample, lights))

    def without_each_deg(self, lights: Candidates, instead: Candidates | None = None) -> list[FloatArray]:
        """The same (P,) without each of the lights, or with the same one of `instead` in its place."""
        left = criterion.without_each(self.holdout_sample, lights, instead)
        return [self.expected.sigma_deg(posterior) for posterior in left]

    def gains(self, lights: Candidates, instead: Candidates | None = None) -> list[float]:
        """Leave-one-out gains: for each light the fraction by which the mean σ rises without it, or with `instead`."""
        with_all = np.mean(self.expected_deg(lights))
        return [float(np.mean(without) / with_all - 1) for without in self.without_each_deg(lights, instead)]

    def design_rows(
        self, sample: Samples, positions: FloatArray, exposures: Sequence[Exposures] | None = None
    ) -> Candidates:
        """Whitened design rows and visibilities of lights at positions (M, 3) at sample pixels; exposures as of
        `criterion.candidates`."""
        lights, known = self.lights(positions), (self.surface, self.calibration, self.recipe, self.gloss)
        return criterion.candidates(sample, lights, *known, exposures=exposures)

    def automatic_seconds(self, positions: FloatArray) -> FloatArray:
        """The automatic exposure time (M,), s, of lights at positions (M, 3), by the search pixels' expected level."""
        return criterion.automatic_seconds(
            self.search_sample, self.lights(positions), self.surface, self.calibration, self.recipe
        )


def build(
    normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
    options: PlanOptions, count: int,
) -> Problem:  # fmt: skip
    """The design problem of `count` further lights. Raises RigError plan.infeasible as `choose` does."""
    usable = criterion.usable_pixels(normal_map, calibration)
    region, where = options.region, ""
    if region is not None:
        if region.shape != normal_map.mask.shape:
            raise RigError(
                ErrorCode.PLAN_INFEASIBLE,
                f"the region of interest has {region.shape[1]} × {region.shape[0]} pixels, the images "
                f"{normal_map.mask.shape[1]} × {normal_map.mask.shape[0]}: draw it on an image of this camera",
            )
        information = normal_map.information
        usable = usable[region[information.rows[usable], information.columns[usable]]]
        where = " in the region of interest"
    if len(usable) < photometry.SETTINGS.min_sample:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"only {len(usable)} sample pixels of the normal map are usable{where}, {photometry.SETTINGS.min_sample} "
            "are needed: check the pilot's images and the region",
            pixels=len(usable),
        )

    order = np.random.default_rng(recipe.seed).permutation(usable)
    half = max(len(order) // 2, photometry.SETTINGS.min_sample // 2)
    search_pixels, holdout_pixels = (np.sort(numbers[:SAMPLE_PIXELS]) for numbers in (order[:half], order[half:]))
    search_sample = criterion.samples(
        normal_map, calibration, search_pixels, photometry.SETTINGS.integrated_depth_sigma_m
    )
    holdout_sample = criterion.samples(normal_map, calibration, holdout_pixels)
    positions, units = candidate_positions(reach, count, surround=not options.listed)
    captured = [shot.light for shot in observations.shots if shot.kind == "light" and shot.light is not None]
    return Problem(
        captured=directions(captured, reach),
        surface=visibility.surface(normal_map, calibration),
        gloss=planned_noise.gloss(normal_map),
        expected=expected_sigma.of(
            normal_map, lamp_pose.common_direction_sigma_rad(reach.candidates, reach.center, calibration)
        ),
        calibration=calibration,
        recipe=recipe,
        reach=reach,
        search_sample=criterion.reweight(search_sample, normal_map, observations, calibration),
        holdout_sample=criterion.reweight(holdout_sample, normal_map, observations, calibration),
        positions=positions,
        units=units,
    )


def candidate_positions(reach: Reach, count: int, *, surround: bool = True) -> tuple[FloatArray, FloatArray]:
    """Candidate positions (K, 3) and their unit directions (K, 3), evenly out of those within reach. Raises RigError
    plan.infeasible where they are fewer than `count` or, where they are to `surround` the object, on one side of it."""
    units = lamp_pose.directions(reach.candidates, reach.center, count, surround=surround)
    kept = np.linspace(0, len(units) - 1, min(len(units), MAX_CANDIDATES)).round().astype(int)
    return reach.candidates[kept], units[kept]


def directions(lights: Sequence[Light], reach: Reach) -> FloatArray:
    """Unit directions (T, 3) of lights from the dome's centre."""
    offsets = np.array([light.position for light in lights]).reshape(-1, 3) - reach.center
    return offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
