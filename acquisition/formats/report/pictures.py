"""Reduction of a result's maps to small pictures of the object, averaged over the pixels of the mask.

A report is viewed on a screen, so maps of any size are reduced before all other steps.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from acquisition import photometry
from acquisition.formats.export import lights_used
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.result import ATTACHED, CAST, LIT, SATURATED, NormalMap
from acquisition.normals.images import memory_mapped

MAX_SIDE_PX = 460
"""Longer side of a picture, px."""

MARGIN_SHARE = 0.03
"""Margin around the object, as a share of its longer side."""

BACKGROUND_RGB = (238, 238, 236)
"""Grey around the object, R G B."""


@dataclass(frozen=True)
class ReducedMaps:
    """A result reduced to the size of a report; maps (h, w), normals (h, w, 3)."""

    normals: Float32Array
    albedo: Float32Array  # (h, w) or (h, w, 3)
    sigma_deg: Float32Array
    residual: Float32Array
    lights: Float32Array
    indirect: Float32Array | None
    doubtful: Float32Array
    mask: BoolArray
    solved: BoolArray


def reduced(normal_map: NormalMap) -> ReducedMaps:
    """The object's window of a result, at most `MAX_SIDE_PX` pixels along a side."""
    shown = normal_map.silhouette | normal_map.mask
    rows, columns = _window(shown)
    inside = shown[rows, columns]
    solved = normal_map.mask[rows, columns]
    height, width = inside.shape
    scale = min(1.0, MAX_SIDE_PX / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))

    def small(values: np.ndarray, where: BoolArray) -> Float32Array:
        if values.ndim == 3:
            return np.stack([small(values[..., channel], where) for channel in range(values.shape[2])], axis=-1)
        kept = np.where(where, values, 0).astype(np.float32, copy=False)
        np.nan_to_num(kept, copy=False)
        if scale == 1.0:
            return kept
        share = np.asarray(cv2.resize(where.astype(np.float32), size, interpolation=cv2.INTER_AREA))
        mean = np.asarray(cv2.resize(kept, size, interpolation=cv2.INTER_AREA))
        return np.asarray(mean / np.maximum(share, 1e-6), np.float32)

    normals = small(normal_map.normals[rows, columns], solved)
    everywhere = np.ones_like(inside)
    return ReducedMaps(
        normals=np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6), np.float32),
        albedo=small(
            (normal_map.albedo if normal_map.albedo_rgb is None else normal_map.albedo_rgb)[rows, columns], solved
        ),
        sigma_deg=small(normal_map.sigma_deg[rows, columns], solved),
        residual=small(normal_map.residual[rows, columns], solved),
        lights=small(lights_used(normal_map)[rows, columns], inside),
        indirect=None if normal_map.indirect is None else small(normal_map.indirect[rows, columns], solved),
        doubtful=small(normal_map.doubtful[rows, columns], inside),
        mask=small(inside, everywhere) > 0.5,
        solved=small(solved, everywhere) > 0.5,
    )


def normals(small: ReducedMaps) -> np.ndarray:
    """Normals as colours (n + 1)/2, OpenGL green, 8 bits (h, w, 3) RGB."""
    return _on_background(np.round((small.normals + 1) * 127.5), small.solved)


def gamma_encoded(values: Float32Array, mask: BoolArray, top: float) -> np.ndarray:
    """Gamma-encoded picture (h, w, 3), exponent 1/2.2, of linear grey (h, w) or colour (h, w, 3); `top` is white."""
    shown = np.round(np.clip(values / max(top, 1e-9), 0, 1) ** (1 / 2.2) * 255)
    return _on_background(shown if shown.ndim == 3 else np.repeat(shown[..., None], 3, axis=-1), mask)


def coloured(values: Float32Array, mask: BoolArray, top: float) -> np.ndarray:
    """Values from 0 to `top` in the colours of `scale_colours`; (h, w, 3) RGB."""
    level = np.clip(values / max(top, 1e-9), 0, 1)
    bgr = np.asarray(cv2.applyColorMap(np.round(level * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS))
    return _on_background(bgr[..., ::-1], mask)


def scale_colours() -> list[str]:
    """The colours of `coloured` from 0 to the top, as CSS."""
    bar = np.linspace(0, 255, 16).astype(np.uint8)[None]
    return [f"rgb({r},{g},{b})" for b, g, r in np.asarray(cv2.applyColorMap(bar, cv2.COLORMAP_VIRIDIS))[0].tolist()]


def scale_top(values: Float32Array, mask: BoolArray, least: float) -> float:
    """A round upper end for a map's scale: its 98th percentile, rounded up to a half of its first digit's unit."""
    high = max(float(np.quantile(values[mask], 0.98)) if np.any(mask) else 0.0, least)
    step = 10.0 ** np.floor(np.log10(high)) / 2
    return float(np.ceil(high / step) * step)


def shares(normal_map: NormalMap) -> list[list[float]]:
    """For each image the shares of the object's pixels that were used, that were clipped, and that were in shadow."""
    count = max(1, np.count_nonzero(normal_map.silhouette))
    inside = (flags[normal_map.silhouette] for flags in memory_mapped.iterate(normal_map.flags))
    return [[np.count_nonzero(one & bits) / count for bits in (LIT, SATURATED, CAST | ATTACHED)] for one in inside]


def _window(mask: BoolArray) -> tuple[slice, slice]:
    if not np.any(mask):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    rows, columns = photometry.bounding_box(mask)
    more = 1 + round(MARGIN_SHARE * (max(rows.stop - rows.start, columns.stop - columns.start) - 1))
    return (
        slice(max(0, rows.start - more), min(mask.shape[0], rows.stop + more)),
        slice(max(0, columns.start - more), min(mask.shape[1], columns.stop + more)),
    )


def _on_background(colours: np.ndarray, mask: BoolArray) -> np.ndarray:
    return np.where(mask[..., None], colours, BACKGROUND_RGB).astype(np.uint8)
