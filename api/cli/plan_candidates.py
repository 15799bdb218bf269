"""Candidates of `lightpose plan`: from a file, from a folder's other images, or on a free dome."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from acquisition import geometry
from acquisition.models.base import FloatArray
from acquisition.models.cell_config import MAX_SLANT_DEG
from acquisition.models.errors import RigError
from acquisition.normals.equivalent_session import EquivalentSession
from acquisition.plan.candidate_lights import CandidateLights
from api.cli.plan_capture import Capture, PlanRequest, invalid

SAME_LIGHT_DEG = 0.5
"""Angle at the object below which a candidate of a file counts as a light of the pilot, which is captured already."""


SAME_PLACE = 1e-5
"""Distance of candidates below which they count as one, relative to their mean distance from the object."""

OTHER_UNIT = 10.0
"""Ratio of the candidates' distances to those of the pilot's lamps beyond which another unit is suspected."""


@dataclass(frozen=True)
class Offer:
    """Candidates of a list: their coordinates (K, 3) in the folder's frame, their numbers in the list, and its name."""

    own: FloatArray
    numbers: tuple[int, ...]
    what: str
    notes: tuple[str, ...] = ()
    advice: str = ""  # what to do where too few are left

    def only(self, kept: np.ndarray, note: str, advice: str) -> "Offer":
        """Returns the candidates of the boolean array `kept` (K,), with `note` and `advice` if some are missing."""
        if np.all(kept):
            return self
        numbers = tuple(number for number, keep in zip(self.numbers, kept, strict=True) if keep)
        return Offer(self.own[kept], numbers, self.what, (*self.notes, note), advice)

    def noted(self, note: str) -> "Offer":
        """Returns the same offer with a further note."""
        return replace(self, notes=(*self.notes, note))


def offered(request: PlanRequest, capture: Capture, pilot: Sequence[int]) -> Offer | None:
    """Returns the candidates of a file, or those of the images outside the pilot; None for a free dome."""
    if request.candidates is not None:
        own = read_candidates(request.candidates)
        return Offer(own, tuple(range(len(own))), f"{request.candidates}")
    rest = [number for number in range(len(capture.lights)) if number not in pilot]
    if not rest:
        if request.radius_mm is not None and capture.frame.word == "direction":
            raise invalid(f"--radius-mm: {request.folder} gives directions, which have no radius: leave the option out")
        return None
    if request.radius_mm is not None:
        raise invalid(
            f"--radius-mm is the radius of a free dome, but the {len(rest)} images of {request.folder} outside the "
            "pilot are the candidates: leave out the option, or these images"
        )
    return Offer(capture.lights[rest], tuple(rest), f"{request.folder}, whose other images are the candidates,")


def read_candidates(path: Path) -> FloatArray:
    """Reads the candidates (K, 3) of a file: three numbers on each line, separated by white space or commas.

    No line may be blank, so that the numbers of lines are numbers of lights. Raises RigError request.invalid naming the
    line, counted from 1.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise invalid(f"--candidates {path}: cannot be read: {error}", path) from error
    if not lines:
        raise invalid(f"--candidates {path}: is empty: write three numbers on a line for each light", path)
    rows: list[list[float]] = []
    for line, text in enumerate(lines, start=1):
        try:
            numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip())]
        except ValueError:
            numbers = []
        if len(numbers) != 3 or not np.all(np.isfinite(numbers)):
            raise invalid(f"--candidates {path}, line {line}: {text.strip()[:60]!r} is not three numbers", path)
        rows.append(numbers)
    return np.array(rows)


def reach(
    request: PlanRequest, capture: Capture, session: EquivalentSession, offer: Offer | None
) -> tuple[CandidateLights, Offer | None]:
    """Returns the candidates about the object, and the remaining offer."""
    center = session.center
    positions = [shot.light.position for shot in session.observations.shots if shot.light is not None]
    pilot = np.array(positions) - center
    if offer is None:
        radius_m = float(np.mean(np.linalg.norm(pilot, axis=1)))
        radius_m = radius_m if request.radius_mm is None else request.radius_mm / 1000
        slant_deg = MAX_SLANT_DEG if request.max_slant_deg is None else request.max_slant_deg
        return CandidateLights.dome(center, radius_m, float(np.radians(slant_deg))), None
    offsets = capture.frame.view(offer.own)
    if capture.frame.word == "position":
        offsets = offsets - center
    length = np.linalg.norm(offsets, axis=1)
    if np.min(length) <= 0:
        line = offer.numbers[int(np.argmin(length))]
        raise invalid(f"{offer.what} light {line}, counted from 0, has no direction: correct it")
    units = offsets / length[:, None]
    if capture.frame.word == "direction":
        offsets = units * np.mean(np.linalg.norm(pilot, axis=1))
    seen = pilot / np.linalg.norm(pilot, axis=1, keepdims=True)
    kept, left = np.ones(len(units), np.bool_), _checked(offer, capture, units, offsets, pilot)
    if request.candidates is not None:
        first = np.zeros(len(units), np.bool_)
        first[np.unique(np.round(offsets / np.mean(length) / SAME_PLACE) + 0.0, axis=0, return_index=True)[1]] = True
        note = f"{np.count_nonzero(~first)} candidates repeat another one of the list and were left out"
        left = left.only(first, note, "give each light once")
        new = np.max(units @ seen.T, axis=1) < np.cos(np.radians(SAME_LIGHT_DEG))
        note = f"{np.count_nonzero(first & ~new)} candidates are lights of the pilot and were left out"
        left = left.only(new[first], note, "give positions that are not the pilot's")
        kept = first & new
    if request.max_slant_deg is not None:
        within = np.degrees(geometry.slant_azimuth(units)[0]) <= request.max_slant_deg
        note = f"{np.count_nonzero(kept & ~within)} candidates are beyond slant {request.max_slant_deg:g}°"
        left = left.only(within[kept], note, f"raise --max-slant-deg {request.max_slant_deg:g}")
        kept = kept & within
    if len(left.numbers) < request.count:
        raise too_few(request, left)
    return CandidateLights(center + offsets[kept], center), left


def _checked(
    offer: Offer, capture: Capture, units: FloatArray, offsets: FloatArray, pilot: FloatArray
) -> Offer:  # fmt: skip
    """Notes candidates behind the object, or in another unit than the pilot's lamps.

    `units` and `offsets` (K, 3) are directions and offsets of candidates from the object, `pilot` (F, 3) the offsets of
    the pilot's lamps, view frame. Raises RigError request.invalid if all candidates are behind the object.
    """
    if capture.frame.word == "position":
        apart = np.linalg.norm(offsets, axis=1) / np.median(np.linalg.norm(pilot, axis=1))
        wide = np.linalg.norm(offer.own, axis=1) / max(float(np.max(np.linalg.norm(capture.lights, axis=1))), 1e-12)
        ratio = next((one for one in (apart, wide) if np.all(one > OTHER_UNIT) or np.all(one < 1 / OTHER_UNIT)), None)
        if ratio is not None:
            offer = offer.noted(
                f"all candidates are {np.median(ratio):.2g} times as far away as the pilot's lamps: are they in "
                f"{capture.frame.unit}, as the folder's are?"
            )
    behind = np.count_nonzero(units[:, 2] <= 0)
    if behind == len(units):
        raise invalid(
            f"{offer.what} has no candidate in front of the object, {behind} behind it: correct the axes "
            f"({capture.frame.axes}) or the unit{_notes_of(offer)}"
        )
    if behind:
        offer = offer.noted(f"{behind} candidates are behind the object, more than 90° off the view axis")
    return offer


def too_few(request: PlanRequest, offer: Offer) -> RigError:
    """Returns the refusal of a plan with more lights than candidates."""
    have = len(offer.numbers)
    if not have:
        return invalid(f"{offer.what} leaves no candidates: {offer.advice or 'give some'}{_notes_of(offer)}")
    more = (f", or {offer.advice}" if offer.advice else "") + _notes_of(offer)
    return invalid(f"--count {request.count}: {offer.what} leaves {have} candidates: plan at most {have}{more}")


def _notes_of(offer: Offer) -> str:
    """Formats the notes of an offer for the end of a refusal."""
    return f" ({'; '.join(offer.notes)})" if offer.notes else ""
