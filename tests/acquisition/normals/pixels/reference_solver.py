"""Reference of the solve of one pixel: the energy of docs/explanation/solver.md, minimised slowly in plain NumPy.

    E(g) = Σ_i c² ln(1 + r_i²/(c² v_i)) + |g − ρ̄ n̄|²/(ρ̄/2)²,   r_i = y_i − g·s_i

Descents start from the solution of every three measurements, so that the lowest of Cauchy's minima is found. Each is
Gauss–Newton with reweighting (Holland and Welsch 1977) until the state stays. One pixel at a time, images by rows.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

STEPS = 60
"""Steps of one descent at most."""


@dataclass(frozen=True)
class Pixel:
    """What one pixel measured: values y (F,), light vectors s (F, 3), and the unit direction to the camera (3,)."""

    values: np.ndarray
    light: np.ndarray
    view: np.ndarray


@dataclass(frozen=True)
class NoiseModel:
    """v = shot·y + floor + (c y)² + (σ_d ρ|s|)², the scale of Cauchy's loss in σ, the share of the largest y/|s| below
    which a measurement is shadow, and the median of the largest y/|s| over the object's pixels."""

    shot: np.ndarray
    floor: np.ndarray
    intensity: float
    direction: float
    cauchy_scale: float
    shadow_threshold: float
    median_albedo: float


class PixelEnergy:
    """The energy of one pixel; states are g (3,)."""

    def __init__(self, pixel: Pixel, noise: NoiseModel) -> None:
        strength = np.linalg.norm(pixel.light, axis=1)
        ratio = pixel.values / strength
        lit = (ratio >= noise.shadow_threshold * ratio.max()) & (ratio > 0)
        self.pixel, self.noise, self.strength = pixel, noise, strength
        self.lit = np.flatnonzero(lit)
        self.albedo = max(ratio.max(), 0.2 * noise.median_albedo)  # ρ̄
        self.prior_mean = self.albedo * pixel.view
        self.prior_precision = np.full(3, (2 / self.albedo) ** 2)

    def residual(self, state: np.ndarray) -> np.ndarray:
        """Residuals (L,) of the lit measurements."""
        return (self.pixel.values - self.pixel.light @ state)[self.lit]

    def variance(self, albedo: float) -> np.ndarray:
        """Variance (L,) of the lit measurements of a surface of an albedo."""
        y, noise = self.pixel.values, self.noise
        v = noise.shot * y + noise.floor + (noise.intensity * y) ** 2 + (noise.direction * albedo * self.strength) ** 2
        return v[self.lit]

    def value(self, state: np.ndarray, albedo: float) -> float:
        """The energy, with the variance that an albedo gives."""
        c2 = self.noise.cauchy_scale**2
        loss = c2 * np.log1p(self.residual(state) ** 2 / (c2 * self.variance(albedo)))
        return float(np.sum(loss) + np.sum(self.prior_precision * (state - self.prior_mean) ** 2))

    def step(self, state: np.ndarray) -> np.ndarray:
        """The state after one Gauss–Newton step with the weights of the present residuals."""
        rows = self.pixel.light[self.lit]
        variance = self.variance(float(np.linalg.norm(state)))
        weight = 1 / (variance + self.residual(state) ** 2 / self.noise.cauchy_scale**2)
        matrix = (rows.T * weight) @ rows + np.diag(self.prior_precision)
        downhill = rows.T @ (weight * self.residual(state)) + self.prior_precision * (self.prior_mean - state)
        return state + np.linalg.solve(matrix, downhill)

    def descend(self, start: np.ndarray) -> np.ndarray:
        """The minimum that descent from a state ends in."""
        state = start
        for _ in range(STEPS):
            before, state = state, self.step(state)
            if np.all(np.abs(state - before) < 1e-7):
                break
        return state

    def minimum(self) -> np.ndarray:
        """The lowest minimum over descents from every three measurements, and from the prior."""
        starts = [self.prior_mean]
        for three in combinations(self.lit, 3):
            rows = self.pixel.light[list(three)]
            if abs(np.linalg.det(rows)) > 1e-3 * np.prod(self.strength[list(three)]):
                starts.append(np.linalg.solve(rows, self.pixel.values[list(three)]))
        ends = [self.descend(start) for start in starts]
        return min(ends, key=lambda state: self.value(state, float(np.linalg.norm(state))))
