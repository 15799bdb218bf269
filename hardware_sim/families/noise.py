"""Random fields: band-limited sums of waves in space, and spectral noise in a plane."""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray


@dataclass(frozen=True)
class Waves:
    """A band-limited random field in space, the sum of K plane waves, with mean 0 and variance 1."""

    vectors: FloatArray  # (K, 3) rad per unit
    phases: FloatArray  # (K,)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Values (...) at points (..., 3)."""
        total = np.zeros(points.shape[:-1])
        for vector, phase in zip(self.vectors, self.phases, strict=True):
            total += np.cos(points @ vector + phase)
        return total * np.sqrt(2 / len(self.phases))


def waves(random: np.random.Generator, shortest: float, longest: float, count: int = 24) -> Waves:
    """Waves of random directions, with log-uniform wavelengths between two bounds."""
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = np.exp(random.uniform(np.log(shortest), np.log(longest), count))
    return Waves(direction * (2 * np.pi / length)[:, None], random.uniform(0, 2 * np.pi, count))


def spectral(random: np.random.Generator, size: int, shortest: float, longest: float, slope: float) -> FloatArray:
    """Noise (size, size) with an amplitude spectrum ~ 1 / frequency^slope between two wavelengths.

    Wavelengths are in parts of the side; mean 0, greatest magnitude 1.
    """
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]) * size
    band = (frequency >= 1 / longest) & (frequency <= 1 / shortest)
    amplitude = np.where(band, np.maximum(frequency, 1e-9) ** -slope, 0.0)
    phase = random.uniform(0, 2 * np.pi, amplitude.shape)
    field = np.fft.irfft2(amplitude * np.exp(1j * phase) * random.rayleigh(size=amplitude.shape), (size, size))
    field -= field.mean()
    return field / np.abs(field).max()
