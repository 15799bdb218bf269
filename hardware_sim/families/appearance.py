"""Material of a random object: its albedo texture and its reflectance, both simple functions of the seed.

A bench can therefore stratify by kind without making an object. Consecutive seeds step through `TEXTURE_KINDS` and
`REFLECTANCE_KINDS`: any ten in a row hold every reflectance in its share, the first six of a decade hold all of them,
and forty in a row hold every pair of texture and reflectance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.families.noise import Waves, waves
from hardware_sim.reflectance import Reflectance

Texture = Callable[[FloatArray], FloatArray]
"""Points (N, 3), m, object frame → albedo (N,), 0.05–0.9."""

TextureKind = Literal["uniform", "marble", "checker", "dark-and-bright"]
TEXTURE_KINDS: tuple[TextureKind, ...] = ("uniform", "marble", "checker", "dark-and-bright")

ReflectanceKind = Literal["lambert", "oren-nayar", "ggx", "metal", "scatter"]
REFLECTANCE_KINDS: tuple[ReflectanceKind, ...] = (
    "lambert",
    "oren-nayar",
    "ggx",
    "lambert",
    "metal",
    "scatter",
    "lambert",
    "oren-nayar",
    "ggx",
    "lambert",
)
"""Lambert 40 %, Oren–Nayar 20 %, GGX dielectric 20 %, GGX metal 10 %, Lambert with subsurface scatter 10 %."""

DARK, BRIGHT = 0.06, 0.8
"""Albedos of the two regions of `dark-and-bright`: soot and chalk."""

REFLECTANCE_STREAM, TEXTURE_STREAM = 101, 102
"""First words of the random streams, distinct from those of the families' shapes (0–7)."""


def reflectance_kind_of(seed: int) -> ReflectanceKind:
    """`REFLECTANCE_KINDS[seed mod 10]`."""
    return REFLECTANCE_KINDS[seed % len(REFLECTANCE_KINDS)]


def texture_kind_of(seed: int) -> TextureKind:
    """`TEXTURE_KINDS[(seed + ⌊seed / 20⌋) mod 4]`; the shift decouples it from the reflectance."""
    return TEXTURE_KINDS[(seed + seed // 20) % len(TEXTURE_KINDS)]


def reflectance_of(seed: int) -> Reflectance:
    """The reflectance of a seed, the same in every family."""
    random = np.random.default_rng([REFLECTANCE_STREAM, seed])
    kind = reflectance_kind_of(seed)
    if kind == "lambert":
        return Reflectance()
    if kind == "scatter":
        return Reflectance(scatter_m=random.uniform(0.3e-3, 1.5e-3))
    low, high = {"oren-nayar": (0.15, 0.6), "ggx": (0.1, 0.5), "metal": (0.15, 0.5)}[kind]
    return Reflectance(kind, random.uniform(low, high))


def texture_of(seed: int) -> Texture:
    """The texture of a seed, the same in every family."""
    random = np.random.default_rng([TEXTURE_STREAM, seed])
    kind = texture_kind_of(seed)
    if kind == "uniform":
        return Uniform(random.uniform(0.2, 0.85))
    low, high = random.uniform(0.1, 0.35), random.uniform(0.5, 0.85)
    if kind == "marble":
        veins, warp = waves(random, 0.015, 0.05, 6), waves(random, 0.008, 0.04)
        return Marble(low, high, veins, warp, random.uniform(0.5, 2.0))
    if kind == "checker":
        basis, _ = np.linalg.qr(random.normal(size=(3, 3)))
        return Checker(low, high, basis, random.uniform(0.008, 0.03))
    return TwoRegions(waves(random, 0.04, 0.15, 8), random.uniform(-0.3, 0.3))


@dataclass(frozen=True)
class Uniform:
    """One albedo everywhere."""

    albedo: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Albedo (N,) at points (N, 3), m."""
        return np.full(len(points), self.albedo)


@dataclass(frozen=True)
class Marble:
    """Veins: narrow dark lines where a random field, warped by a finer one, crosses zero."""

    low: float
    high: float
    veins: Waves
    warp: Waves
    strength: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Albedo (N,) at points (N, 3), m."""
        height = self.veins(points) + self.strength * self.warp(points)
        return self.low + (self.high - self.low) * np.minimum(np.abs(np.sin(2 * height)) * 1.3, 1.0)


@dataclass(frozen=True)
class Checker:
    """Cubes of two alternating albedos, oblique to the object."""

    low: float
    high: float
    basis: FloatArray  # (3, 3)
    edge_m: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Albedo (N,) at points (N, 3), m."""
        odd = np.floor(points @ self.basis / self.edge_m).sum(axis=1) % 2
        return np.where(odd > 0.5, self.low, self.high)


@dataclass(frozen=True)
class TwoRegions:
    """Soot and chalk, separated where a coarse random field crosses a threshold."""

    field: Waves
    threshold: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Albedo (N,) at points (N, 3), m."""
        return np.where(self.field(points) < self.threshold, DARK, BRIGHT)
