"""Image sets of a ball under few distant lights, as a 16-bit camera stores them, and the error of its normals."""

import numpy as np

from acquisition.normals.images.image_set import DistantLights, ImageSet
from tests.acquisition.normals.distant.gloss_scenes import Rows

SIZE = 48
FULL = 65535


def ball(size: int = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Normals (H, W, 3) of a ball that fills the image, up to 75° from the viewing direction, and its mask (H, W)."""
    v, u = np.mgrid[:size, :size]
    x, y = (u - size / 2 + 0.5) / (size / 2), -(v - size / 2 + 0.5) / (size / 2)
    squared = x**2 + y**2
    mask = squared < np.sin(np.radians(75)) ** 2
    return np.stack([x, y, np.sqrt(np.maximum(1 - squared, 0))], axis=-1) * mask[..., None], mask


def few_lights(count: int = 8) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    slant = np.radians(np.where(np.arange(count) % 2, 25, 45))
    return np.stack([np.sin(slant) * np.cos(angle), np.sin(slant) * np.sin(angle), np.cos(slant)], axis=-1)


def image_set(
    brightness: np.ndarray, directions: np.ndarray, mask: np.ndarray, intensities: np.ndarray | None = None
) -> ImageSet:
    """Brightness (F, H, W[, 3]) per unit of light as stored images of a 16-bit camera."""
    channels = 3 if brightness.ndim == 4 else 1
    strength = np.ones((len(directions), channels)) if intensities is None else intensities
    shape = strength[:, None, None] if channels == 3 else strength[:, :1, None]
    stored = np.clip(np.round(brightness * shape * FULL), 0, FULL).astype(np.uint16)
    return ImageSet(
        names=tuple(f"{n:03d}.png" for n in range(1, len(directions) + 1)), height=mask.shape[0], width=mask.shape[1],
        channels=channels, rows=Rows(stored), full_scale=FULL, saturated_from=0.99,
        lights=DistantLights(directions, strength), mask=mask,
    )  # fmt: skip


def lambert(normals: np.ndarray, directions: np.ndarray, albedo: float = 0.6) -> np.ndarray:
    return albedo * np.maximum(np.einsum("hwc,fc->fhw", normals, directions), 0)


def errors(estimate: np.ndarray, normals: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.sum(estimate * normals, axis=-1)[mask], -1, 1)))
