"""Warnings about a result with advice, as sentences for the report.

A pixel lit by fewer than three lights needs one from a side that the lights so far leave dark there. Candidate
directions are rated by the mean cosine at such pixels. A pixel in cast shadow under a light from nearly the same
direction does not count, because it would be in shadow again.
"""

import cv2
import numpy as np

from acquisition import geometry, photometry
from acquisition.formats.export import lights_used
from acquisition.formats.report import pictures
from acquisition.formats.report.context import ReportContext
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.listing import first_few
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, NormalMap
from acquisition.models.rounding import percent
from acquisition.normals.images import memory_mapped

MIN_REPORTED_SHARE = 0.01
"""Share of the object's pixels above which a fault is reported."""

SIDES = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")
SLANTS_DEG = (20.0, 45.0, 65.0)
"""Angles off the viewing axis of the candidate lights."""

MIN_COSINE = 0.15
"""Least n·l at which a candidate light counts as lighting a pixel."""

MIN_RELIT_SHARE = 1 / 3
"""Share of the underlit pixels that another light must light to be proposed."""

SAME_SIDE_COSINE = float(np.cos(np.radians(25)))
"""Cosine of the angle within which two lights cast nearly the same shadows."""

MAX_SAMPLES = 4000
"""Approximate number of underlit pixels at which candidate lights are rated."""

MAX_INTENSITY_DEVIATION = 0.03
"""Relative deviation of a lamp's intensity from the known one above which it is reported."""

MISPLACED_DEVIATION = 0.05
"""Relative deviation of most lamps' intensities from the stated ones from which object or lamps may be misplaced. On a
ball under 12 lamps 0.4 m away, a depth that is wrong by 100 mm changes each by 10 %, and turns normals by 6° at a mean
σ of 0.7°; 60 mm, by which it may be wrong, change none by 0.5 % (scratch script, December 2026)."""

MAX_INTENSITY_RATIO = 1.5
"""Largest ratio between intensity factors that one solve finds. Measured on a ball and a relief under 8 and 16 distant
lamps, five draws each (scratch script, December 2026): where lamps differ by 1.5 at most, errors are as of equal lamps;
by 2 to 5, up to 13° and 5 times the mean σ. A second solve from the first one's factors brings nine of ten such errors
near those of equal lamps."""

MIN_PROBABILITY = 0.01
"""Probability of an image's misfit in a sound capture below which the image is named."""

MAX_SIGMA_DEG = 5.0
"""σ above which a normal counts as uncertain."""


def quality_warnings(normal_map: NormalMap, context: ReportContext) -> list[str]:
    """Warnings about a result with advice, the most serious first; empty: there is nothing to warn of."""
    silhouette, used = normal_map.silhouette, lights_used(normal_map)
    underlit = silhouette & (used < photometry.PIXEL_UNKNOWNS)
    if np.all(silhouette):
        underlit &= used > 0  # no mask was given: what no light reaches is background
    warnings = _share_sentence("{} of the pixels were lit by fewer than three lights", underlit, silhouette)
    if warnings:
        side = missing_side(normal_map, underlit, context.directions)
        warnings[0] += ": no single light would help most of them." if side is None else f": add a light {side}."
    warnings += _image_warnings(normal_map, context)
    highlighted = np.zeros_like(silhouette)
    for flags in memory_mapped.iterate(normal_map.flags):  # all at once may not fit into memory twice
        highlighted |= (flags & HIGHLIGHT) > 0
    warnings += _share_sentence(
        "{} of the pixels show a highlight in some image: the surface is glossy there; more lights leave more images "
        "without it.",
        highlighted, silhouette, 5 * MIN_REPORTED_SHARE,
    )  # fmt: skip
    if normal_map.indirect is not None:
        warnings += _share_sentence(
            "{} of the pixels get over a fifth of their light from other surfaces: it is predicted and subtracted, but "
            "σ is larger there; if it comes from the table, a dark cloth helps.",
            normal_map.indirect > 0.2, normal_map.mask,
        )  # fmt: skip
    doubtful = "At {} of the pixels σ is unreliable (hatched in its map): do not rely on it."
    warnings += _share_sentence(doubtful, normal_map.doubtful, silhouette)
    return [*warnings, *_fit_warnings(normal_map, context), *context.warnings]


def missing_side(normal_map: NormalMap, underlit: BoolArray, directions: FloatArray) -> str | None:
    """Describes the direction that would light the `underlit` pixels (H, W) best; None: none lights a third of them."""
    normals, flags = _underlit_sample(normal_map, underlit)
    if not len(normals):
        return None
    slant_deg, side = (one.ravel() for one in np.meshgrid(SLANTS_DEG, np.arange(len(SIDES)), indexing="ij"))
    units = geometry.direction(np.radians(slant_deg), side * np.radians(45.0))
    cosine = units @ normals.T
    same_side = units @ directions.T > SAME_SIDE_COSINE
    lit = (cosine > MIN_COSINE) & (same_side.astype(int) @ ((flags & CAST) > 0) == 0)
    light = np.where(np.mean(lit, axis=1) > MIN_RELIT_SHARE, np.mean(np.where(lit, cosine, 0), axis=1), 0.0)
    best = int(np.argmax(light))
    return (
        f"from the {SIDES[side[best]]}, about {slant_deg[best]:.0f}° off the viewing axis" if light[best] > 0 else None
    )


def _underlit_sample(normal_map: NormalMap, underlit: BoolArray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (K, 3) and flags (F, K) of a sample of pixels; unsolved pixels have the nearest solved normal."""
    if not np.any(normal_map.mask):
        return np.zeros((0, 3)), np.zeros((len(normal_map.flags), 0), np.uint8)
    rows, columns = np.nonzero(underlit)
    step = max(1, len(rows) // MAX_SAMPLES)
    rows, columns = rows[::step], columns[::step]
    _, label = cv2.distanceTransformWithLabels(
        (~normal_map.mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = np.asarray(label, np.intp)
    nearest = np.zeros(int(label.max()) + 1, np.int64)
    nearest[label[normal_map.mask]] = np.flatnonzero(normal_map.mask)
    normals = normal_map.normals.reshape(-1, 3)[nearest[label[rows, columns]]]
    return normals.astype(np.float64), normal_map.flags[:, rows, columns]


def _image_warnings(normal_map: NormalMap, context: ReportContext) -> list[str]:
    warnings: list[str] = []
    left_out, shares = images_left_out(normal_map), pictures.shares(normal_map)
    usual = float(np.median([lit for lit, _, _ in shares]))
    for number, (name, share) in enumerate(zip(context.names, shares, strict=True)):
        if number in left_out:  # none of its pixels is used, whatever its exposure
            continue
        lit, clipped, shadow = share
        if clipped > 5 * MIN_REPORTED_SHARE:
            warnings.append(f"{name}: {_percent(clipped)} of the pixels are clipped: shorten its exposure.")
        elif lit < 0.1 and (shadow < 0.8 or (usual > 0.5 and _faced(normal_map, number) > 0.5)):
            warnings.append(f"{name} lights only {_percent(lit)} of the pixels: check its lamp and exposure.")
    for name, factor in zip(context.names, normal_map.intensity_factors, strict=True):
        if abs(factor - 1) > MAX_INTENSITY_DEVIATION:
            than = "brighter" if factor > 1 else "dimmer"
            warnings.append(
                f"{name}: its light was {_percent(abs(factor - 1))} {than} than {context.intensities}; this is "
                "corrected."
            )
    placed = context.intensities == "stated" and "depth_unit" not in normal_map.notes  # distant lights have no place
    if placed and np.mean(np.abs(normal_map.intensity_factors - 1) > MISPLACED_DEVIATION) > 0.5:
        warnings.append(
            "Most lamps' intensities differ from the stated ones: if these are right, the object's rough depth or the "
            "lamps' positions are wrong, and so are the normals."
        )
    factors = [one for number, one in enumerate(normal_map.intensity_factors.tolist()) if number not in left_out]
    if context.intensities != "calibrated" and max(factors) > MAX_INTENSITY_RATIO * min(factors):
        warnings.append(
            f"Beside the {context.intensities} intensities, lamps differ by up to a factor of "
            f"{max(factors) / min(factors):.1f}. One solve may find this in part only, and errors may exceed σ: "
            "multiply the intensities by intensity_factors (as in the exported folder `diligent`) and solve again."
        )
    return warnings


def _faced(normal_map: NormalMap, number: int) -> float:
    """Returns the share of the object's pixels that face the lamp of an image. If nearly all of them are dark, the lamp
    was rather off than hidden."""
    return 1 - float(np.mean(normal_map.flags[number][normal_map.silhouette] & ATTACHED > 0))


def images_left_out(normal_map: NormalMap) -> set[int]:
    """Numbers of the images that the solver left out."""
    found = (finding for finding in normal_map.findings if finding.kind == "bad image" and finding.corrected)
    return {int(finding.value) for finding in found if finding.value is not None}


def _fit_warnings(normal_map: NormalMap, context: ReportContext) -> list[str]:
    if not np.any(normal_map.mask):
        return ["No pixel could be solved: check lamps, exposure and mask."]
    warnings = [f"{finding.message[0].upper()}{finding.message[1:]}." for finding in normal_map.findings]
    probabilities = [] if normal_map.fit is None else normal_map.fit.image_probabilities
    named = zip(context.names, probabilities, strict=False)
    poor = [name for name, probability in named if probability is not None and probability < MIN_PROBABILITY]
    if poor and len(poor) <= len(probabilities) / 2:  # most images fit better
        warnings.append(f"{first_few(poor)}: poor fit to the other images; check image and lamp.")
    known = normal_map.mask & np.isfinite(normal_map.sigma_deg)
    inside = known & photometry.inside(normal_map.silhouette)  # nearly the facing pixels, which would need rays
    structure = normal_map.noise.get("structure_deg", 0.0) * np.count_nonzero(inside)  # a mean over facing pixels
    remedy = "add lights"
    if structure > np.sqrt(0.5) * np.sum(normal_map.sigma_deg, where=inside):  # more than half of σ²
        remedy = "the surface changes from pixel to pixel; larger images help, more lights do not"
    uncertain = f"{{}} of the normals are uncertain by more than {MAX_SIGMA_DEG:.0f}°: {remedy}."
    return warnings + _share_sentence(uncertain, normal_map.sigma_deg > MAX_SIGMA_DEG, known, 5 * MIN_REPORTED_SHARE)


def _share_sentence(sentence: str, where: BoolArray, area: BoolArray, least: float = MIN_REPORTED_SHARE) -> list[str]:
    """The sentence with the share of `area` (H, W) that is in `where`, if it is above `least`; else nothing."""
    share = np.count_nonzero(where & area) / max(1, np.count_nonzero(area))
    return [sentence.format(_percent(share))] if share > least else []


def _percent(share: float) -> str:
    return percent(share, 0 if share >= 0.095 else 1)
