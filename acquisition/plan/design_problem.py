"""The design problem that plans are made from: sample pixels, their information so far, and the candidate lights."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import FrameExposure, Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.models.route import Reach
from acquisition.models.shot import Observations
from acquisition.plan import sample_pixels, visibility
from acquisition.plan.candidate_lights import CandidateLights
from acquisition.plan.criterion import Candidates, Samples
from acquisition.plan.expected_sigma import ExpectedSigma, Prediction
from acquisition.plan.planned_images import PlannedImages

SAMPLE_PIXELS = 900
"""Number of random sample pixels of the search. From 50 to 4,000 the errors of the plans differ by less than 5 %."""

MAX_CANDIDATES = 300
"""Maximum number of candidate positions, picked evenly from those within reach. 300 and 800 give the same errors."""


@dataclass(frozen=True)
class DesignProblem:
    """Sample pixels of the search, held-out pixels of all predictions, and what the images of a light depend on.

    The variance of the pixels that the search has used is optimistic, so σ is predicted at other pixels.
    """

    recipe: Recipe
    reach: CandidateLights
    captured: FloatArray  # (T, 3) unit directions of the lights captured so far
    exposures: Sequence[Sequence[FrameExposure]]  # of the same
    images: PlannedImages
    expected: ExpectedSigma
    search_sample: Samples
    holdout_sample: Samples

    @classmethod
    def of(
        cls, normal_map: NormalMap, observations: Observations, recipe: Recipe, reach: Reach, calibration: Calibration,
        *, region: BoolArray | None = None, surround: bool = True,
    ) -> "DesignProblem":  # fmt: skip
        """Makes the design problem after a solve of the images so far.

        `region` (H, W) marks the pixels whose normals count; None: those of the whole object. Without `surround` the
        candidates need not surround the object, for example if they are all the lamps of a dome. Raises RigError
        plan.infeasible when the normal map has too few usable pixels, the region is of another size, or the candidates
        are too few or on one side.
        """
        order = np.random.default_rng(recipe.seed).permutation(_counted(normal_map, calibration, region))
        half = max(len(order) // 2, photometry.SETTINGS.min_sample // 2)
        sample = partial(sample_pixels.samples, normal_map, calibration, observations=observations)
        wide = photometry.SETTINGS.integrated_depth_sigma_m
        candidates = candidates_of(reach, surround=surround)
        return cls(
            recipe=recipe,
            reach=candidates,
            captured=candidates.directions(positions_of([light for _, light in observations.lit])),
            exposures=[sample_pixels.of_frames(observations.frames_of(shot)) for shot, _ in observations.lit],
            images=PlannedImages(visibility.surface(normal_map, calibration), calibration, recipe.exposure),
            expected=ExpectedSigma.of(
                normal_map, lamp_pose.common_direction_sigma_rad(reach.candidates, reach.center, calibration)
            ),
            search_sample=sample(np.sort(order[:half][:SAMPLE_PIXELS]), wide),
            holdout_sample=sample(np.sort(order[half:][:SAMPLE_PIXELS])),
        )

    @cached_property
    def options(self) -> Candidates:
        """Design rows of all candidates at the search pixels."""
        return self.rows(self.search_sample, self.reach.candidates)

    @cached_property
    def before(self) -> Prediction:
        """Prediction without further lights, at the held-out pixels."""
        return self.predict(np.empty((0, 3)))

    def lights(self, positions: FloatArray) -> list[Light]:
        """Returns lights at positions (M, 3) with their axes towards the dome's centre."""
        return [lamp_pose.light_at(position, self.reach.center) for position in positions]

    def rows(
        self, sample: Samples, positions: FloatArray, exposures: Sequence[Sequence[FrameExposure]] | None = None
    ) -> Candidates:
        """Design rows of lights at positions (M, 3), m, view frame; `exposures` as in `PlannedImages.candidates`."""
        return self.images.candidates(sample, self.lights(positions), exposures)

    def predict(
        self, positions: FloatArray, exposures: Sequence[Sequence[FrameExposure]] | None = None,
        sample: Samples | None = None,
    ) -> Prediction:  # fmt: skip
        """Predicts σ with lights at positions (M, 3), at the pixels of `sample`; None: at the held-out pixels."""
        return Prediction(self.rows(sample or self.holdout_sample, positions, exposures), self.expected)


def candidates_of(reach: Reach, *, surround: bool = True) -> CandidateLights:
    """Picks at most `MAX_CANDIDATES` candidates evenly from those in reach.

    Raises RigError plan.infeasible if there are none or, with `surround`, if all are on one side of the object.
    """
    count = len(lamp_pose.directions(reach.candidates, reach.center, 1, surround=surround))
    kept = np.linspace(0, count - 1, min(count, MAX_CANDIDATES)).round().astype(int)
    return CandidateLights(reach.candidates[kept], reach.center)


def positions_of(lights: Sequence[Light]) -> FloatArray:
    """Positions (M, 3) of lights, m, view frame."""
    return np.array([light.position for light in lights]).reshape(-1, 3)


def _counted(normal_map: NormalMap, calibration: Calibration, region: BoolArray | None) -> np.ndarray:
    """Numbers of the information's pixels that count. Raises RigError plan.infeasible as `DesignProblem.of` does."""
    usable, where = sample_pixels.usable(normal_map, calibration), ""
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
            "are needed: check the pilot's images, and the region or mask",
            pixels=len(usable),
        )
    return usable
