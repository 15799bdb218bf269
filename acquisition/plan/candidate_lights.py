"""Candidate lights without an arm: a free dome round the object, or a list of the lamps that there are.

Both implement `models.route.Reach`, so that the planner is the same for a dome of lamps, a ring or another robot as for
the arm. On a free dome a light may stand anywhere between two slants; of a list it is one of its positions, which
`PlanOptions.listed` tells the planner.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import MAX_SLANT_DEG, MIN_SLANT_DEG
from acquisition.models.light_plan import Light
from acquisition.models.route import Refusal

DOME_CANDIDATES = 300
"""Candidates of a free dome; with 800 the errors are the same."""

SAME_POSITION_M = 1e-9
"""Distance within which two positions are the same one."""


@dataclass(frozen=True)
class FreeDome:
    """All positions on a sphere of `radius_m` about `center` (3,), m, view frame, between two slants."""

    center: FloatArray
    radius_m: float
    max_slant_rad: float = math.radians(MAX_SLANT_DEG)

    @property
    def candidates(self) -> FloatArray:
        """Fibonacci lattice (K, 3) on the dome, m, view frame: equal areas, none above another."""
        cosine = np.linspace(np.cos(np.radians(MIN_SLANT_DEG)), np.cos(self.max_slant_rad), DOME_CANDIDATES)
        azimuth = np.arange(DOME_CANDIDATES) * np.pi * (3 - np.sqrt(5))
        return self.center + self.radius_m * geometry.direction(np.arccos(cosine), azimuth)

    def allows(self, position: FloatArray) -> Refusal | None:
        """None between the dome's two slants, else the refusal."""
        slant_deg = float(np.degrees(geometry.slant_azimuth(position - self.center)[0]))
        limit_deg = float(np.degrees(self.max_slant_rad))
        if slant_deg > limit_deg:
            return Refusal(reason="too-far", detail=f"slant {slant_deg:.1f}° is more than {limit_deg:g}°")
        if slant_deg < MIN_SLANT_DEG:
            return Refusal(reason="blocks-view", detail=f"slant {slant_deg:.1f}° is less than {MIN_SLANT_DEG:g}°")
        return None


@dataclass(frozen=True)
class ListedLights:
    """Positions (K, 3) of lamps that stand where they stand, about `center` (3,); m, view frame."""

    candidates: FloatArray
    center: FloatArray

    @property
    def radius_m(self) -> float:
        """The lamps' mean distance from the centre."""
        return float(np.mean(np.linalg.norm(self.candidates - self.center, axis=1)))

    def allows(self, position: FloatArray) -> Refusal | None:
        """None at one of the positions, else the refusal."""
        if np.min(np.linalg.norm(self.candidates - position, axis=1)) <= SAME_POSITION_M:
            return None
        return Refusal(reason="too-far", detail="no lamp stands there")

    def numbers(self, lights: Sequence[Light]) -> list[int]:
        """The number in the list of each light, each number once."""
        places = np.array([light.position for light in lights])
        return linear_sum_assignment(cdist(places, self.candidates))[1].tolist()
