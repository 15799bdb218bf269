"""The trapezoid: from rest to rest over a length, under a greatest speed and an acceleration."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Trapezoid:
    """Speed over time rises at `acceleration`, stays at `speed`, falls again; a triangle where the length is short."""

    length: float
    speed: float
    acceleration: float

    @classmethod
    def under(cls, length: float, speed: float, acceleration: float) -> "Trapezoid":
        """The fastest profile under the limits; `speed` is the one reached."""
        return cls(length, min(speed, math.sqrt(length * acceleration)), acceleration)

    @classmethod
    def lasting(cls, length: float, seconds: float) -> "Trapezoid":
        """The profile that takes a given time, a quarter of it accelerating and a quarter braking."""
        speed = length / (0.75 * seconds)
        return cls(length, speed, speed / (0.25 * seconds))

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self.length / self.speed + self.speed / self.acceleration if self.length > 0.0 else 0.0

    def position(self, t: float) -> float:
        """Length covered at time t."""
        ramp, duration = self.ramp, self.duration
        if t <= 0.0:
            return 0.0
        if t >= duration:
            return self.length
        if t < ramp:
            return 0.5 * self.acceleration * t * t
        if t <= duration - ramp:
            return self.speed * (t - 0.5 * ramp)
        return self.length - 0.5 * self.acceleration * (duration - t) ** 2

    def speed_at(self, t: float) -> float:
        """Speed at time t."""
        duration = self.duration
        if t <= 0.0 or t >= duration:
            return 0.0
        return min(self.speed, self.acceleration * t, self.acceleration * (duration - t))

    @property
    def ramp(self) -> float:
        """Seconds of the acceleration, and of the braking."""
        return self.speed / self.acceleration
