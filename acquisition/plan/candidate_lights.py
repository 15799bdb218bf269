"""Candidate lights: the reach of an arm, a free dome round the object, or a list of existing lamps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import MAX_SLANT_DEG, MIN_SLANT_DEG
from acquisition.models.light_plan import Light

DOME_CANDIDATES = 300
"""Number of candidates of a free dome. With 800 the errors are the same."""


@dataclass(frozen=True)
class CandidateLights:
    """Positions (K, 3) about `center` (3,), m, view frame; a `models.route.Reach`."""

    candidates: FloatArray
    center: FloatArray

    @classmethod
    def dome(
        cls, center: FloatArray, radius_m: float, max_slant_rad: float = math.radians(MAX_SLANT_DEG)
    ) -> "CandidateLights":
        """A free dome: a Fibonacci lattice of equal areas, no two at one azimuth, from the least slant to
        `max_slant_rad`."""
        cosine = np.linspace(np.cos(np.radians(MIN_SLANT_DEG)), np.cos(max_slant_rad), DOME_CANDIDATES)
        azimuth = np.arange(DOME_CANDIDATES) * np.pi * (3 - np.sqrt(5))
        return cls(center + radius_m * geometry.direction(np.arccos(cosine), azimuth), center)

    @cached_property
    def units(self) -> FloatArray:
        """Unit directions (K, 3) of the candidates from the centre."""
        return self.directions(self.candidates)

    def directions(self, positions: FloatArray) -> FloatArray:
        """Unit directions (M, 3) of positions (M, 3) from the centre."""
        offsets = positions - self.center
        return offsets / np.linalg.norm(offsets, axis=1, keepdims=True)

    def numbers(self, lights: Sequence[Light]) -> list[int]:
        """Assigns a candidate of its own to each light by least total distance, and returns the candidates' numbers."""
        places = np.array([light.position for light in lights])
        return linear_sum_assignment(cdist(places, self.candidates))[1].tolist()
