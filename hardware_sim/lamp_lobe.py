"""Lobe of a real LED behind a lens: its radiant intensity off the axis, with the unevenness of real LEDs.

No LED follows cosᵘ exactly. A lens leaves a shoulder and a ring, a reflector a brighter or darker middle, and a die
beside the lens's axis lights one side more than the other. `led` draws such lobes from a seed; the calibration under
test fits its own knots and does not know this family.
"""

from dataclasses import dataclass, field

import numpy as np

from acquisition.models.base import Float32Array, FloatArray

SAMPLES = 1025
"""Number of samples of a profile over the cosine: linear interpolation between them is accurate to 1e-6."""


def _flat() -> Float32Array:
    return np.ones(2, dtype=np.float32)


@dataclass(frozen=True)
class LampLobe:
    """Intensity relative to the axis: cos^`exponent` · profile(cos) · (1 + tilt · d), where d is the direction's x and
    y in the lamp's frame. `profile` (K,) is sampled at cosines equally spaced from 0 to 1."""

    exponent: float = 0.0
    profile: Float32Array = field(default_factory=_flat)
    tilt: tuple[float, float] = (0.0, 0.0)

    def relative(self, directions: FloatArray) -> FloatArray:
        """Intensity (N,) towards unit vectors (N, 3) in the lamp's frame, z along its axis; 0 behind it."""
        cosine = np.clip(directions[:, 2], 0.0, 1.0)
        table = np.interp(cosine, np.linspace(0, 1, len(self.profile)), self.profile)
        side = 1 + directions[:, :2] @ np.array(self.tilt)
        return np.where(directions[:, 2] > 0, cosine**self.exponent * table * side, 0.0)


def led(random: np.random.Generator) -> LampLobe:
    """Draws an LED with a secondary lens: a flat top, a shoulder, a faint ring, and one side brighter than the other.

    Half-value angles are 56–66°, rings 2–4 % at 22–34°, and the tilt is 2–4 %: about what makers' diagrams of wide
    lenses show.
    """
    angle = np.arccos(np.linspace(0, 1, SAMPLES))
    half, order, share = np.radians(random.uniform(56, 66)), random.uniform(2.2, 3.0), random.uniform(0.2, 0.4)
    ring, width = np.radians(random.uniform(22, 34)), np.radians(random.uniform(6, 9))
    height = random.uniform(0.02, 0.04) * random.choice([-1.0, 1.0])
    profile = (1 - share) * np.exp(-np.log(2) * (angle / half) ** order) + share * np.cos(angle)
    profile = profile * (1 + height * np.exp(-(((angle - ring) / width) ** 2)))
    side, strength = random.uniform(0, 2 * np.pi), random.uniform(0.02, 0.04)
    return LampLobe(
        0.0,
        (profile / profile[-1]).astype(np.float32),
        (float(strength * np.cos(side)), float(strength * np.sin(side))),
    )
