"""Compares a mosaic sensor with a monochrome one of the same noise, by paired solves of grey and coloured scenes.

    python -m tests.unseen mosaic --families all --seeds 0:2 --lights 10

Colours are linear sRGB reflectances. A channel's value is a weighted sum of the three bands, as for a camera under a
white LED (`hardware_sim.spectra`); the monochrome sensor sees the mean over a cell. Each band is path-traced with
interreflections, so that light between coloured surfaces has their colour. Exposures follow from each sensor's own
images; lamp errors are the same.
"""

import itertools
import math
import zlib
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from acquisition import mosaic
from acquisition.models.calibration import Calibration
from acquisition.models.colour import ColourCalibration
from hardware_sim import spectra
from hardware_sim.families.noise import waves
from tests.unseen import grading, patterns, run, scenes
from tests.unseen.captures import capture
from tests.unseen.run import Line
from tests.unseen.scenes import Scene

Kind = Literal["grey", "coloured"]
KINDS: tuple[Kind, ...] = ("grey", "coloured")
IDENTITY = ("family", "seed", "kind", "lights", "sensor")

SATURATION = 0.75
"""Greatest relative deviation of a coloured scene's bands from its grey albedo."""


@dataclass(frozen=True)
class Tinted:
    """One band of a coloured texture: the grey one times 1 ± SATURATION, varying softly or in patches."""

    texture: Callable[[np.ndarray], np.ndarray]
    hue: Callable[[np.ndarray], np.ndarray]
    band: int
    sharpness: float

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Reflectance (N,) at points (N, 3)."""
        angle = 2 * np.pi * self.band / 3 + np.pi * np.tanh(self.sharpness * self.hue(points))
        return np.clip(self.texture(points) * (1 + SATURATION * np.cos(angle)), 0.01, 0.95)


@dataclass(frozen=True, eq=False)
class ColourScene(Scene):
    """A scene whose sensor mixes images of three bands, by `sensor.mosaic`, or monochrome if that is None."""

    bands: tuple[Scene, ...] = ()

    @property
    def _mixing(self) -> np.ndarray:
        """Response (4, 3) of red, green and blue sites and of a monochrome sensor to the three bands."""
        rows = spectra.band_response()
        return np.concatenate([rows, [spectra.CELL_SHARES @ rows]])

    @property
    def calibration(self) -> Calibration:
        """The solver's calibration, with that of colours."""
        known = super().calibration
        rows = self._mixing[:3]
        white = rows.sum(axis=1)
        matrix = np.linalg.inv(rows / white[:, None])
        colour = ColourCalibration(
            white=tuple(white.tolist()), matrix=tuple(tuple(row) for row in matrix.tolist()), delta_e_mean=0.0,
            delta_e_max=0.0, chart="exact",
        )  # fmt: skip
        return known.model_copy(update={"colour": colour})

    @cached_property
    def sites(self) -> np.ndarray:
        """Row of the mixing matrix of each pixel (H, W)."""
        everything = slice(0, self.pixels)
        if self.sensor.mosaic is None:
            return np.full((self.pixels, self.pixels), 3)
        return mosaic.sites(self.sensor.mosaic, everything, everything)

    def images(self, positions: np.ndarray) -> np.ndarray:
        """Noise-free values y (F, H, W) of the sensor's pixels."""
        mixing = self._mixing[self.sites].astype(np.float32)  # (H, W, 3)
        if len(self.bands) == 1:
            return self.bands[0].images(positions) * mixing.sum(axis=-1)
        return sum(mixing[..., band] * one.images(positions) for band, one in enumerate(self.bands))


def scene(family: str, seed: int, kind: Kind, pattern: str | None, reflectance: str) -> ColourScene:
    """The scene of a family and a seed, with its texture grey or tinted, and a mosaic sensor or a monochrome one."""
    grey = scenes.scene(family, seed, reflectance)
    bands: tuple[Scene, ...] = (grey,)
    if kind == "coloured":
        rng = np.random.default_rng([zlib.crc32(family.encode()), seed, 31])
        hue, sharpness = waves(rng, 0.02, 0.08, 6), float(rng.choice([0.7, 8.0]))
        shift = np.array([0.0, 0.0, grey.center[2]])
        bands = tuple(
            replace(grey, texture=Tinted(grey.texture, lambda points: hue(points - shift), band, sharpness))
            for band in range(3)
        )
    values = {name: getattr(grey, name) for name in Scene.__dataclass_fields__}
    values["sensor"] = grey.sensor.model_copy(update={"mosaic": pattern})
    return ColourScene(**values, bands=bands)


def solved(one: ColourScene, count: int) -> Line:
    """Grades of one solve by two rings of lamps."""
    positions = patterns.fixed("two-rings", one, count, 0, 1)
    captured = capture(one, positions)
    normal_map = run.solve(one, captured)
    return (
        grading.errors(normal_map.normals, normal_map.mask, one.truth)
        | grading.sigma(normal_map, one.truth)
        | {"findings": [[finding.kind, finding.corrected] for finding in normal_map.findings]}
    )


def run_scene(out: Path, lights: Sequence[int], reflectance: str, report: bool, family: str, seed: int) -> int:
    """Solves one scene's captures that are missing in the file; returns their number."""
    kept = run.done(run.read(out), IDENTITY)
    added = 0
    for kind, count, sensor in itertools.product(KINDS, lights, ("monochrome", "rggb")):
        line: Line = {"family": family, "seed": seed, "kind": kind, "lights": count, "sensor": sensor}
        if tuple(line[key] for key in IDENTITY) in kept:
            continue
        with scenes.report_seeds() if report else nullcontext():
            one = scene(family, seed, kind, None if sensor == "monochrome" else sensor, reflectance)
        run.append(out, line | solved(one, count))
        added += 1
    return added


def table(lines: Sequence[Line], gradings: Sequence[str] = ("one_surface", "within_78_deg", "object")) -> str:
    """Table of mean errors by kind of scene, and of the geometric mean ratio mosaic / monochrome with its error."""
    rows = [
        "scenes | grading | pairs | monochrome | mosaic | ratio | rms e/σ | P(e < σ)",
        "---|---|--:|--:|--:|--:|--:|--:",
    ]
    by = {tuple(line[key] for key in IDENTITY): line for line in lines}
    for kind, name in itertools.product((*KINDS, "all"), gradings):
        pairs = [
            (mono, by[(*key[:-1], "rggb")])
            for key, mono in by.items()
            if key[-1] == "monochrome" and kind in (key[2], "all") and (*key[:-1], "rggb") in by
        ]
        if not pairs:
            continue
        mean = np.array([[float(str(one[f"{name}.mean"])) for one in pair] for pair in pairs])
        logs = np.log(mean[:, 1] / mean[:, 0])
        error = float(np.std(logs, ddof=1) / math.sqrt(len(logs))) if len(logs) > 1 else math.nan
        ratio = math.exp(float(np.mean(logs)))
        sigma = {
            key: [float(np.mean([float(str(pair[which][key])) for pair in pairs])) for which in (0, 1)]
            for key in ("rms", "within_1")
        }
        rows.append(
            f"{kind} | {name} | {len(pairs)} | {mean[:, 0].mean():.3f}° | {mean[:, 1].mean():.3f}° | "
            f"{ratio:.3f} ± {ratio * error:.3f} | {sigma['rms'][0]:.2f} → {sigma['rms'][1]:.2f} | "
            f"{sigma['within_1'][0]:.2f} → {sigma['within_1'][1]:.2f}"
        )
    return "\n".join(rows)
