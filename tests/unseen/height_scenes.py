"""Random height fields before tables, on black cloth and beside a grey tile, and depth of objects with steps.

Results are overlaps of masks (IoU), errors of lamps' intensities and errors of depth. Images are those of
`tests.acquisition.scenes`, whose ray marching and shadows share nothing with the solver.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acquisition import photometry
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.models.shot import FrameQuality, FrameRef, Observations, Shot, ShotKey
from acquisition.normals import pyramid
from acquisition.normals.images import grey_tile, silhouette
from acquisition.normals.images.grey_tile import GreyTile
from acquisition.normals.images.image_set import DistantLights, ImageSet
from acquisition.normals.images.normalised_images import ImageBlock, Images
from acquisition.normals.surface import integration
from hardware_sim import families, sensor
from tests.acquisition import scenes
from tests.acquisition.normals.distant.gloss_scenes import Rows
from tests.acquisition.scenes import TABLE_DEPTH, Height
from tests.unseen import scenes as unseen
from tests.unseen.fresh_process import Errors

PIXELS, CLOTH_PIXELS, TILE_PIXELS = 64, 96, 96
OVERLAP = "overlap of the mask (IoU)"
CLOTH = 0.003
"""Albedo of black cloth."""
NOISE_DEG = 2.0
TILE_IMAGES = 12
DRIFT = np.linspace(0.975, 1.025, TILE_IMAGES)
LAMP_POINTS = 9


def height(rng: np.random.Generator, pieces: int = 0) -> Height:
    """A heap of steep caps within 55 mm of the middle, with waves on it, and `pieces` small caps apart from it."""
    caps = [(*rng.uniform(-0.022, 0.022, 2), rng.uniform(0.015, 0.033), rng.uniform(0.01, 0.06)) for _ in range(4)]
    angles = rng.uniform(0, 2 * np.pi, pieces)
    caps += [(0.07 * np.cos(a), 0.07 * np.sin(a), rng.uniform(0.002, 0.012), rng.uniform(0.004, 0.012)) for a in angles]
    wave, length = rng.uniform(0, 0.002), rng.uniform(0.003, 0.01)

    def top(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        heights = [z * np.sqrt(np.maximum(1 - ((x - u) ** 2 + (y - v) ** 2) / r**2, 0)) for u, v, r, z in caps]
        highest = np.max(heights, axis=0)
        inside = highest > 0
        waves = wave * np.sin(x[inside] / length) * np.cos(y[inside] / length)
        highest[inside] = np.maximum(highest[inside] + waves, 0.001)
        return highest

    return top


def before_table(seed: int) -> Callable[[], Errors]:
    """An object on a grained table; for every fourth seed the region holds the object alone."""
    rng = np.random.default_rng([seed, 41])
    known = scenes.calibration(PIXELS)
    true = scenes.scene(height(rng), known, rng.uniform(0.3, 0.7), rng.uniform(0.08, 0.25))
    true.albedo[:] = true.albedo * np.exp(rng.uniform(0, 0.15) * rng.normal(size=true.mask.shape))
    lights = scenes.ring(int(rng.integers(4, 9)), rng.uniform(20, 50), rng.uniform(0, 1))
    values = np.array([scenes.lit(true, one) for one in lights]) * (1 + 0.01 * rng.normal(size=(len(lights), 1, 1)))
    values += 0.003 * rng.normal(size=values.shape)
    window, none = slice(0, PIXELS), np.zeros(len(lights))
    block = ImageBlock(values.astype(np.float32), values > np.inf)
    images = Images(block.rows, tuple(lights), window, window, none, none)
    ray = photometry.rays(known, window, window)
    masked = pyramid.MaskedImages(images, np.ones_like(true.mask), ray)
    depth = np.full(true.mask.shape, TABLE_DEPTH - 0.03, np.float32)
    bound = pyramid.albedo_bound(masked, depth, photometry.lamps(lights), known)
    region = true.mask if seed % 4 == 0 else np.ones_like(true.mask)
    return lambda: {OVERLAP: _overlap(silhouette.segment(bound, region), true.mask)}


def on_black(seed: int) -> Callable[[], Errors]:
    """Pieces and specks of dust on black cloth, under eight lights and a camera with some stray light."""
    rng = np.random.default_rng([seed, 43])
    known = scenes.calibration(CLOTH_PIXELS)
    true = scenes.scene(height(rng, int(rng.integers(0, 4))), known, rng.uniform(0.2, 0.8), CLOTH)
    v, u = np.mgrid[:CLOTH_PIXELS, :CLOTH_PIXELS]
    for _ in range(rng.poisson(5)):
        row, column, radius = *rng.uniform(0, CLOTH_PIXELS, 2), rng.uniform(0.6, 4)
        true.albedo[(np.hypot(v - row, u - column) < radius) & ~true.mask] = rng.uniform(0.1, 0.6)
    lights = scenes.ring(8, rng.uniform(20, 50), rng.uniform(0, 1))
    values = np.array([scenes.lit(true, one) for one in lights])
    values *= 0.9 / np.quantile(values, 0.998)
    values += 0.01 + 0.002 * rng.normal(size=values.shape)
    stored = np.clip(np.round(values * 65535), 0, 65535).astype(np.uint16)
    place = np.array([one.position for one in lights])
    images = ImageSet(
        names=tuple(f"{number}.png" for number in range(len(lights))), height=CLOTH_PIXELS, width=CLOTH_PIXELS,
        channels=1, rows=Rows(stored), full_scale=65535, saturated_from=0.999,
        lights=DistantLights(place / np.linalg.norm(place, axis=1, keepdims=True), np.ones(len(lights))),
        mask=np.ones_like(true.mask), mask_given=False,
    )  # fmt: skip
    return lambda: {OVERLAP: _overlap(silhouette.propose(images), true.mask)}


def beside_tile(seed: int) -> Callable[[], Errors]:
    """A tile with the object's soft shadow, cast by a wide lamp, and some indirect light."""
    rng = np.random.default_rng([seed, 47])
    known = scenes.calibration(TILE_PIXELS, intensity_sigma=0.01, lamp_position_sigma_m=0.001)
    side = int(rng.integers(5, 13))
    near, along = int(rng.integers(1, 10)), int(rng.integers(20, TILE_PIXELS - 20 - side))
    row, column = (near, along) if seed % 2 else (along, TILE_PIXELS - side - near)
    window = slice(row, row + side), slice(column, column + side)
    mask = np.zeros((TILE_PIXELS, TILE_PIXELS), np.bool_)
    mask[window] = True
    depth = np.full(mask.shape, TABLE_DEPTH, np.float32)
    tile = GreyTile(mask, depth, np.array([0.0, 0.0, 1.0]))
    points = photometry.points(photometry.rays(known, *window).reshape(2, -1), depth[window].ravel())
    flat = scenes.Scene(
        lambda x, y: np.zeros_like(x), known, points.reshape(3, side, side).astype(float),
        np.broadcast_to([0.0, 0.0, 1.0], (side, side, 3)), np.full((side, side), rng.uniform(0.1, 0.5)), mask[window],
    )  # fmt: skip
    beside = replace(flat, height=height(rng))
    lights = [*scenes.ring(4, 25.0), *scenes.ring(TILE_IMAGES - 4, rng.uniform(50, 70), 0.3)]
    brightness = DRIFT * np.exp(rng.normal(0, 0.01, TILE_IMAGES))
    width_m, indirect = rng.uniform(0.002, 0.02), rng.uniform(0, 0.6)
    signal = [
        factor * ((1 - indirect) * _wide(beside, one, width_m, rng) + indirect * scenes.lit(flat, one))
        for one, factor in zip(lights, brightness, strict=True)
    ]
    observations = _session(known, lights, np.array(signal), window, rng)
    truth = np.log(brightness)

    def measure() -> Errors:
        found = grey_tile.measure(observations, known, tile)
        apart = (0 if found is None else found.log_intensity) - truth
        return {"error of lamps' intensities, %": 100 * float(np.std(apart))}

    return measure


def with_steps(seed: int) -> Callable[[], Errors]:
    """Depth integrated from noisy true normals of an object with steps."""
    scene = unseen.scene(families.NAMES[seed % len(families.NAMES)], 40 + seed // len(families.NAMES))
    rng, truth = np.random.default_rng([seed, 53]), scene.truth
    noisy = truth.normals + np.radians(NOISE_DEG) / np.sqrt(2) * rng.normal(size=truth.normals.shape)
    normals = (noisy / np.linalg.norm(noisy, axis=-1, keepdims=True)).transpose(2, 0, 1).astype(np.float32)
    rays = photometry.rays(scene.calibration, slice(0, scene.pixels), slice(0, scene.pixels))
    inside = truth.object
    start = np.full(inside.shape, np.exp(np.mean(np.log(truth.depth_m[inside]))), np.float32)

    def measure() -> Errors:
        ones = np.ones(inside.shape, np.float32)
        apart = (integration.depth(normals, inside, rays, ones, start, keep_steps=True) - truth.depth_m)[inside]
        return {"error of depth, mm": 1e3 * float(np.mean(np.abs(apart - np.median(apart))))}

    return measure


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.count_nonzero(one & other) / np.count_nonzero(one | other))


def _wide(true: scenes.Scene, light: Light, radius_m: float, rng: np.random.Generator) -> np.ndarray:
    """Values under a wide lamp: the mean over its points, which are drawn at random."""
    away = rng.normal(size=(LAMP_POINTS, 3))
    away -= away.mean(axis=0)
    away *= radius_m / np.sqrt(np.mean(np.sum(away**2, axis=1)))
    places = np.array(light.position) + rng.normal(0, 0.001 / np.sqrt(3), 3) + away
    return np.mean([scenes.lit(true, Light(position=tuple(one), axis=light.axis)) for one in places], axis=0)


def _session(
    known: Calibration, lights: list[Light], signal: np.ndarray, window: tuple[slice, slice],
    rng: np.random.Generator,
) -> Observations:  # fmt: skip
    """Images of one exposure, with values (F, h, w) at the tile and no light elsewhere, and a lamp-off frame."""
    level = float(rng.uniform(0.2, 0.7))
    seconds = level / (known.lamp_intensity * float(signal.max()))
    frames = scenes.Frames()

    def shot(number: int, light: Light | None) -> Shot:
        values = np.zeros((known.height, known.width), np.float32)
        if light is not None:
            values[window] = signal[number] * (level / signal.max())
        frames.stored[f"{number}.tiff"] = sensor.expose(values, known.sensor, rng)
        return Shot(
            key=ShotKey(pass_number=0, number=number), kind="dark" if light is None else "light",
            frame=FrameRef(path=f"{number}.tiff", width=known.width, height=known.height, sha256=""),
            exposure_s=seconds, light=light, taken_at=float(number),
            quality=FrameQuality(saturated=0.0, bright_level=0.8, accepted=True),
        )  # fmt: skip

    shots = [shot(number, light) for number, light in enumerate(lights)]
    return Observations(shots=shots, darks={seconds: shot(len(lights), None)}, frames=frames)
