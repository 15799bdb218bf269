"""What a person should know of a result, in words, and what to do about it.

A pixel lit by fewer than three lights wants one from a side that the lights so far leave dark there. Candidate
directions are weighed by how many such pixels they would face; a pixel that stood in another part's shadow under a
light from much the same direction would do so again, and does not count.
"""

import cv2
import numpy as np

from acquisition.formats.export import lights_used
from acquisition.formats.report.context import Facts
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED, NormalMap
from acquisition.normals import memory_mapped

ENOUGH_LIGHTS = 3
SPEAKS_FROM = 0.01
"""Share of the object's pixels from which a fault is worth a sentence."""

SIDES = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")
SLANTS_DEG = (20.0, 45.0, 65.0)
LEAST_COSINE = 0.15
LEAST_SHARE = 1 / 3
"""Of the pixels that lack light, which one more light has to reach to be worth naming."""

SAME_SIDE_COSINE = float(np.cos(np.radians(25)))
MOST_SAMPLES = 4000
LARGE_FACTOR = 0.03
LARGE_RESIDUAL = 2.5
LARGE_SIGMA_DEG = 5.0


def sentences(found: NormalMap, facts: Facts) -> list[str]:
    """Warnings with advice, the gravest first; none when there is nothing to say."""
    said: list[str] = []
    object_pixels = max(1, np.count_nonzero(found.silhouette))
    used = lights_used(found)
    few = found.silhouette & (used < ENOUGH_LIGHTS)
    if np.all(found.silhouette):
        few &= used > 0  # no mask was given: what no light reaches is background
    if np.count_nonzero(few) > SPEAKS_FROM * object_pixels:
        share = np.count_nonzero(few) / object_pixels
        side = missing_side(found, few, facts.directions)
        advice = "no single light would help most of them" if side is None else f"add a light {side}"
        said.append(f"{_percent(share)} of the pixels were lit by fewer than three lights: {advice}.")
    said += _of_images(found, facts)
    shining = np.zeros_like(found.silhouette)
    for flags in memory_mapped.iterate(found.flags):  # image by image: all flags at once may not fit into memory twice
        shining |= (flags & HIGHLIGHT) > 0
    highlights = np.count_nonzero(shining & found.silhouette) / object_pixels
    if highlights > 5 * SPEAKS_FROM:
        said.append(
            f"{_percent(highlights)} of the pixels show a highlight in some image: the surface is glossy there; "
            "solver `glossy` fits the gloss, and more lights leave more images without it."
        )
    if found.indirect is not None:
        strong = float(np.mean(found.indirect[found.mask] > 0.2)) if np.any(found.mask) else 0.0
        if strong > SPEAKS_FROM:
            said.append(
                f"{_percent(strong)} of the pixels get over a fifth of their light from other surfaces: it is "
                "predicted and taken out, but σ is larger there; where it is the table's, a dark cloth helps."
            )
    if found.doubtful is not None and np.any(found.doubtful):
        share = np.count_nonzero(found.doubtful & found.silhouette) / object_pixels
        if share > SPEAKS_FROM:
            said.append(f"At {_percent(share)} of the pixels σ means nothing (hatched in its map): do not rely on it.")
    said += _of_fit(found)
    return said + list(facts.warnings)


def missing_side(found: NormalMap, few: BoolArray, directions: FloatArray) -> str | None:
    """From which side most of the pixels `few` (H, W) would be lit, in words; none when none lights a third of them."""
    normals, flags = _starved(found, few)
    if not len(normals):
        return None
    best, most = None, 0.0
    for slant in SLANTS_DEG:
        for number, side in enumerate(SIDES):
            azimuth = np.radians(45.0 * number)
            unit = np.array([np.cos(azimuth), np.sin(azimuth), 0]) * np.sin(np.radians(slant))
            unit[2] = np.cos(np.radians(slant))
            cosine = normals @ unit
            alike = directions @ unit > SAME_SIDE_COSINE
            again = np.any(flags[alike] & CAST, axis=0) if np.any(alike) else np.zeros(len(normals), bool)
            lit = (cosine > LEAST_COSINE) & ~again
            light = float(np.mean(np.where(lit, cosine, 0)))
            if light > most and np.mean(lit) > LEAST_SHARE:
                best, most = f"from the {side}, about {slant:.0f}° off the viewing axis", light
    return best


def _starved(found: NormalMap, few: BoolArray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (K, 3) and flags (F, K) of a sample of pixels; unsolved ones borrow from the nearest solved one."""
    if not np.any(found.mask):
        return np.zeros((0, 3)), np.zeros((len(found.flags), 0), np.uint8)
    rows, columns = np.nonzero(few)
    step = max(1, len(rows) // MOST_SAMPLES)
    rows, columns = rows[::step], columns[::step]
    _, label = cv2.distanceTransformWithLabels(
        (~found.mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = np.asarray(label, np.intp)
    nearest = np.zeros(int(label.max()) + 1, np.int64)
    nearest[label[found.mask]] = np.flatnonzero(found.mask)
    normals = found.normals.reshape(-1, 3)[nearest[label[rows, columns]]]
    return normals.astype(np.float64), found.flags[:, rows, columns]


def _of_images(found: NormalMap, facts: Facts) -> list[str]:
    said: list[str] = []
    for name, flags in zip(facts.names, memory_mapped.iterate(found.flags), strict=True):
        inside = flags[found.silhouette]
        clipped = float(np.mean((inside & SATURATED) > 0)) if inside.size else 0.0
        lit = float(np.mean((inside & LIT) > 0)) if inside.size else 0.0
        shadow = float(np.mean((inside & (CAST | ATTACHED)) > 0)) if inside.size else 0.0
        if clipped > 5 * SPEAKS_FROM:
            said.append(f"{name}: {_percent(clipped)} of the pixels are clipped: expose it shorter.")
        elif lit < 0.1 and shadow < 0.8:
            said.append(f"{name} lights only {_percent(lit)} of the pixels: check its lamp and exposure.")
    for name, factor in zip(facts.names, found.intensity_factors, strict=True):
        if abs(factor - 1) > LARGE_FACTOR:
            than = "brighter" if factor > 1 else "dimmer"
            said.append(
                f"{name}: its light was {_percent(abs(factor - 1))} {than} than the calibration says; corrected."
            )
    return said


def _of_fit(found: NormalMap) -> list[str]:
    if not np.any(found.mask):
        return ["No pixel could be solved: check lamps, exposure and mask."]
    said: list[str] = []
    residual = float(np.median(found.residual[found.mask]))
    if residual > LARGE_RESIDUAL:
        said.append(
            f"The images fit the model badly (residuals {residual:.1f} times what is expected): check that nothing "
            "moved, that the light's positions and intensities belong to these images, and that they are linear."
        )
    sigma = found.sigma_deg[found.mask]
    uncertain = float(np.mean(sigma[np.isfinite(sigma)] > LARGE_SIGMA_DEG)) if np.any(np.isfinite(sigma)) else 0.0
    if uncertain > 5 * SPEAKS_FROM:
        said.append(
            f"{_percent(uncertain)} of the normals are uncertain by more than {LARGE_SIGMA_DEG:.0f}°: add lights."
        )
    return said


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.095 else f"{100 * share:.1f} %"
