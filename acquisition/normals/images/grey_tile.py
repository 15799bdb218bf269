"""Each image's lamp intensity from a grey tile in the picture, relative to the other images.

A tile that lies flat beside the object shows in every image how bright the lamp was. The intensity is the ratio of its
values to those that the light model gives for an even white surface there, relative to the median of all images. The
images are divided by it, and the tile's σ replaces the calibration's 1 σ of each image's intensity, which a lamp that
warms up or ages during a session exceeds. The scale common to all images remains that of the calibration, because the
tile's reflectance is unknown. If the tile is saturated or in a shadow, the intensity is interpolated from neighbouring
images.
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.result import ModelFinding
from acquisition.models.shot import Observations, Shot
from acquisition.models.tuned import tuned
from acquisition.normals.images import session_images


@dataclass(frozen=True)
class GreyTileSettings:
    """Tuned number of the intensities from a grey tile."""

    min_evenness: float = tuned(0.9, "1")
    """Least ratio of the 10th to the 90th percentile of the tile's pixels, each relative to its median over all images.
    Below it a shadow lies on part of the tile. Noise of a tile of 25 pixels at a tenth of full scale leaves 0.97."""


SETTINGS = GreyTileSettings()


@dataclass(frozen=True)
class GreyTile:
    """Tile's pixels `mask` (H, W), depth (H, W) of its face along OpenCV's z, m, and unit normal (3,), view frame."""

    mask: BoolArray
    depth_m: Float32Array
    normal: FloatArray


@dataclass(frozen=True)
class TileIntensities:
    """Log intensity (F,) of each image relative to the calibration's, the rms of their 1 σ, and a finding if the tile
    is saturated or in a shadow in some images."""

    log_intensity: FloatArray
    sigma: float
    finding: ModelFinding | None

    @property
    def figures(self) -> dict[str, float]:
        """Figures for the result's record: 1 σ and range of the intensities, as fractions."""
        return {"tile_sigma": self.sigma, "tile_range": float(np.expm1(np.ptp(self.log_intensity)))}


def measure(observations: Observations, calibration: Calibration, tile: GreyTile) -> TileIntensities | None:
    """Measures the images' relative intensities on a tile; none if less than half of the images show it lit, because
    their median is then not typical. Raises RigError normals.infeasible as `session_images.read` does."""
    shots, lights = zip(*session_images.lit_shots(observations), strict=True)
    rows, columns = photometry.bounding_box(tile.mask)
    inside = tile.mask[rows, columns]
    point = photometry.points(photometry.rays(calibration, rows, columns), tile.depth_m[rows, columns])[:, inside]
    lamps = photometry.lamps(lights)
    shading = np.einsum("c,fcn->fn", tile.normal, photometry.light_vectors(point, lamps, calibration))
    images = session_images.read(observations, calibration, rows, columns)
    values, clipped, _ = images.whole
    ratio = values[:, inside] / np.maximum(shading, 1e-6)
    brightness = np.median(ratio, axis=1).astype(np.float64)
    pattern = np.median(ratio / np.maximum(ratio.mean(axis=1, keepdims=True), 1e-6), axis=0)
    relative = np.where(clipped[:, inside], np.inf, ratio / np.maximum(pattern, 1e-6))
    dark, bright = np.percentile(relative, (10, 90), axis=1, method="higher")
    saturated = np.isinf(bright)
    lit = ~saturated & (shading.min(axis=1) > 0) & (dark > SETTINGS.min_evenness * bright)
    typical = float(np.median(brightness[lit])) if np.any(lit) else 1.0
    usable = lit & (brightness >= photometry.SETTINGS.grazing_cosine * typical)
    if 2 * np.count_nonzero(usable) < len(usable):
        return None
    log = np.log(np.where(usable, brightness, typical) / np.median(brightness[usable]))
    level = np.mean(values[:, inside], axis=1)
    level = np.maximum(level, 1e-6).astype(np.float64)
    noise = np.pi / 2 * (images.shot * level + images.floor) / (np.count_nonzero(inside) * level**2)  # of a median
    position = calibration.lamp_position_sigma_m * _log_gradient(tile, point, lamps)
    # The tile sees the lamp about 10° from the object's direction, and receives some light from the object.
    sigma = np.sqrt(noise + position**2 + photometry.SETTINGS.flat_field_sigma**2)
    log[~usable] = np.interp(_times(shots)[~usable], _times(shots)[usable], log[usable])
    sigma[~usable] = np.maximum(sigma[~usable], calibration.intensity_sigma)
    finding = None if np.all(usable) else _finding(saturated, ~saturated & ~usable)
    return TileIntensities(log, float(np.sqrt(np.mean(sigma**2))), finding)


def unusable() -> ModelFinding:
    """Returns the finding for a tile that cannot be used."""
    return ModelFinding(
        kind=photometry.GREY_TILE,
        message="the grey tile is saturated or in a shadow in most images, so it was not used: lay it where the "
        "object's shadow does not fall, choose a darker one, and check that `grey_tile.outline_px` is its outline",
        corrected=False,
    )


def _log_gradient(tile: GreyTile, point: Float32Array, lamps: Float32Array) -> FloatArray:
    """Returns the gradient (F,), per m, of the log of the tile's light by the lamp's place; lamps keep their aim."""
    away = lamps[:, :3].astype(np.float64) - point.mean(axis=1)
    square = np.sum(away**2, axis=1, keepdims=True)
    facing = np.maximum(away @ tile.normal, 1e-3)[:, None]
    return np.asarray(np.linalg.norm(tile.normal / facing - 3 * away / square, axis=1), np.float64)


def _times(shots: tuple[Shot, ...]) -> FloatArray:
    """Returns when each image was taken, s, or the order of the images if times are not on record."""
    times = np.array([shot.taken_at for shot in shots], dtype=np.float64)
    return times if np.all(np.diff(np.sort(times)) > 0) else np.arange(len(shots), dtype=np.float64)


def _finding(saturated: BoolArray, shadowed: BoolArray) -> ModelFinding:
    """Builds the finding that names the images in which the tile is `saturated` or `shadowed`, (F,) each."""
    said = [
        f"{why} in image {', '.join(map(str, np.flatnonzero(which)[:10]))}"
        for which, why in ((saturated, "is saturated"), (shadowed, "lies in a shadow"))
        if np.any(which)
    ]
    message = f"the grey tile {' and '.join(said)}: their intensities are interpolated from the images before and after"
    value = float(np.count_nonzero(saturated | shadowed))
    return ModelFinding(kind=photometry.GREY_TILE, message=message, corrected=True, value=value)
