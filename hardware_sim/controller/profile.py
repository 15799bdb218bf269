"""Velocity profiles: the trapezoidal profile of a programmed move, and the linear decay of a stop."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Trapezoid:
    """Trapezoidal velocity profile from rest to rest; triangular if the length is short."""

    length: float
    speed: float
    acceleration: float

    @classmethod
    def planned(
        cls, length: float, speed: float, acceleration: float, seconds: float, fastest: float, hardest: float
    ) -> "Trapezoid":
        """Plans a move of `length` that lasts `seconds`, or if that is zero, has this speed and acceleration. The time
        is lengthened if the limits `fastest` and `hardest` would be exceeded.
        """
        if length <= 0.0:
            return cls(0.0, speed, acceleration)
        if seconds > 0.0:
            shortest = max(length / (0.75 * fastest), math.sqrt(length / (0.75 * 0.25 * hardest)))
            seconds = max(seconds, shortest)  # a quarter of it accelerating and a quarter braking
            return cls(length, length / (0.75 * seconds), length / (0.75 * 0.25 * seconds**2))
        hardest = min(acceleration, hardest)
        return cls(length, min(speed, fastest, math.sqrt(length * hardest)), hardest)

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self.length / self.speed + self.speed / self.acceleration if self.length > 0.0 else 0.0

    @property
    def ramp(self) -> float:
        """Seconds of acceleration, which equal those of braking."""
        return self.speed / self.acceleration if self.length > 0.0 else 0.0

    def position(self, t: float) -> float:
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
        duration = self.duration
        if t <= 0.0 or t >= duration:
            return 0.0
        return min(self.speed, self.acceleration * t, self.acceleration * (duration - t))


class LinearDecay:
    """A speed of any kind that falls linearly to zero within `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._time = 0.0

    @property
    def finished(self) -> bool:
        """Whether the speed is zero."""
        return self._time >= self._seconds

    def advance(self, dt: float) -> tuple[float, float]:
        """Advances by `dt` seconds. Returns the distance covered since the start, in seconds at the first speed, and
        the remaining share of that speed.
        """
        self._time = min(self._time + dt, self._seconds)
        if self._seconds <= 0.0:
            return 0.0, 0.0
        return self._time - 0.5 * self._time**2 / self._seconds, 1.0 - self._time / self._seconds
