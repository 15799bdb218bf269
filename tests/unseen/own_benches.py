"""Sensitivity to tuned numbers that the bench's captures do not show: each such number has small scenes of its own.

Some numbers serve another task (masks, a grey tile, the sensor's noise, depth with steps, a target σ, many distant
lights, metal), and one is compiled into kernels. Errors are those that a user sees there, over many random scenes of
design seeds, so that a mean has a standard error. Figures are values, not ratios, because some errors are zero, and an
overlap or a number of images is no error. A bench whose scenes do not read the number is refused.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Protocol

import numpy as np

from tests.tuned_numbers import Number
from tests.unseen import fresh_process, height_scenes, reports, sensitivity, sensor_scenes, solved_scenes, stages
from tests.unseen.fresh_process import Errors
from tests.unseen.sensitivity import FACTORS
from tests.unseen.stages import Stage


class Bench(Protocol):
    """Scenes, and their errors with a number changed."""

    @property
    def scenes(self) -> str:
        """A description of the scenes."""
        ...

    def errors(self, number: Number, factor: float | None) -> Sequence[Errors]:
        """Each scene's errors by quantity, with the number times a factor; None leaves it unchanged."""
        ...


@dataclass(frozen=True)
class Drawn:
    """Scenes that are drawn once; each is a function that measures its errors with the present settings."""

    scenes: str
    draw: Callable[[int], Callable[[], Errors]]
    count: int
    _drawn: list[Callable[[], Errors]] = field(default_factory=list[Callable[[], Errors]])
    _usual: list[Errors] = field(default_factory=list[Errors])
    _read: set[str] = field(default_factory=set[str])

    def errors(self, number: Number, factor: float | None) -> list[Errors]:
        """Each scene's errors. Raises ValueError if no scene reads the number."""
        if not self._drawn:
            self._drawn.extend(self.draw(seed) for seed in range(self.count))
        if factor is None:
            return self._unchanged(number)
        with stages.off(Stage(number.key, "", (sensitivity.changed(number, factor),))):
            return [measure() for measure in self._drawn]

    def _unchanged(self, number: Number) -> list[Errors]:
        """The errors with all numbers unchanged, which are the same for all numbers with these scenes."""
        if not self._usual:
            with sensitivity.reading() as read:
                self._usual.extend(measure() for measure in self._drawn)
            self._read.update(read)
        if number.key not in self._read:
            raise ValueError(f"no scene reads {number.key}")
        return self._usual


@dataclass(frozen=True)
class Fresh:
    """Captures that are solved in a process that starts with the value, because kernels compile it in. This includes
    the present value, because kernels of two compilations differ in their last digits."""

    scenes: str
    captures: str
    pixels: int

    def errors(self, number: Number, factor: float | None) -> list[Errors]:
        """Each capture's errors."""
        value = sensitivity.value(number, 1.0 if factor is None else factor)
        return fresh_process.errors(number.name, value, self.captures, self.pixels)


SENSORS = Drawn(
    "sensors of gains 0.1–10 and read noise 0.5–20 steps, stated wrong by 30 %; an image and its repetition, of which "
    "every third is displaced by up to a pixel and every twelfth has detail as fine as pixels",
    sensor_scenes.sensor,
    240,
)
SESSIONS = Drawn(
    "sessions of random height fields, up to 20 images; the target is within 10 % of the σ of 6–13 lights by two rings",
    solved_scenes.session,
    12,
)

BENCHES: dict[str, Bench] = {
    "silhouette.min_contrast": Drawn(
        "random height fields, albedo 0.3–0.7, before tables of 0.08–0.25; every fourth in a region of it alone",
        height_scenes.before_table,
        60,
    ),
    "silhouette.min_component_share": Drawn(
        "random height fields of one to four pieces on black cloth with specks of dust, eight lights",
        height_scenes.on_black,
        60,
    ),
    "grey_tile.min_evenness": Drawn(
        "tiles of 25–144 pixels beside a random height field, twelve images by lamps 4–40 mm wide that drift by 5 %",
        height_scenes.beside_tile,
        80,
    ),
    "integration.bilateral_sharpness": Drawn(
        "objects of all families, design seeds 40–43, whose true normals have 2° of noise", height_scenes.with_steps, 32
    ),
    "photon_transfer.max_tail_share": SENSORS,
    "photon_transfer.rounding_sigma": SENSORS,
    "photon_transfer.pattern_sigma": SENSORS,
    "photon_transfer.max_relative_sigma": SENSORS,
    "reflectance_fit.dark_share": Drawn(
        "scenes of figure and vase in six glossy materials under 96 distant lights (`gloss_scenes`)",
        solved_scenes.glossy,
        12,
    ),
    "stopping_rule.tolerance": SESSIONS,
    "stopping_rule.first_slack": SESSIONS,
    "alternation.least_metal_albedo": Drawn(
        "captures of metal of roughness 0.3 at 96 pixels: turned, blob, knot and sheet 44, turned and blob 46",
        solved_scenes.metal,
        6,
    ),
    "photometry.min_view_cosine": Fresh(
        "captures of the solver's figures at 96 pixels, each value in a process of its own", sensitivity.CAPTURES, 96
    ),
}
"""The benches of the numbers that no capture of the main bench shows."""


def numbers() -> list[Number]:
    """The numbers with a bench of their own."""
    return sensitivity.named(",".join(BENCHES))


def measured(number: Number, bench: Bench) -> dict[str, Any]:
    """The page's figures of a number: each quantity's mean with the number unchanged; with it halved and doubled, the
    mean, the standard error of its difference over the scenes, and the number of scenes that change."""
    usual = bench.errors(number, None)
    shown: dict[str, Any] = {"bench": bench.scenes, "scenes": len(usual), "usual": _means(usual)}
    for change, factor in FACTORS.items():
        after = bench.errors(number, factor)
        shown[change] = {name: _compared(name, usual, after) for name in usual[0]}
    return shown


def _means(errors: Sequence[Errors]) -> Errors:
    return {name: round(float(np.mean([one[name] for one in errors])), 4) for name in errors[0]}


def _compared(name: str, usual: Sequence[Errors], after: Sequence[Errors]) -> list[float]:
    """Mean after a change, standard error of the mean difference, and the number of scenes that differ."""
    values = np.array([[one[name], other[name]] for one, other in zip(usual, after, strict=True)])
    apart = values[:, 1] - values[:, 0]
    error = float(np.std(apart, ddof=1)) / math.sqrt(len(apart)) if len(apart) > 1 else math.nan
    return [round(float(values[:, 1].mean()), 4), round(error, 4), int(np.count_nonzero(np.abs(apart) > 1e-9))]


def measure(chosen: Sequence[Number], write: bool) -> None:
    """Measures numbers one by one, prints their figures, and if `write` is set adds each to the page's figures."""
    commit = {"date": datetime.now(UTC).strftime("%Y-%m-%d"), "commit": reports.commit()}
    for number in chosen:
        figures = measured(number, BENCHES[number.key])
        print(number.key, json.dumps(figures, ensure_ascii=False), flush=True)
        if write:
            sensitivity.write(_page(number, commit | figures), "own")


def _page(number: Number, figures: dict[str, Any]) -> dict[str, Any]:
    """The section of all numbers with benches of their own, with one of them updated."""
    known = json.loads(sensitivity.PAGE.read_text(encoding="utf-8")).get("own", {}).get("numbers", {})
    known = {key: value for key, value in known.items() if key in BENCHES} | {number.key: figures}
    return {"numbers": {key: known[key] for key in sorted(known)}}
