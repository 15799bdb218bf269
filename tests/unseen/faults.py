"""Faults of a capture, by name: errors in users' data that residuals need not show.

A fault changes the light on the object, the exposed signal, the encoding of the file, or the stated lamps. Deviations
of the reflectance (Oren–Nayar, GGX, metal) belong to scenes: `scene(…, reflectance="oren-nayar:0.35")`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from tests.unseen.scenes import Scene

Change = Callable[[np.ndarray, "Scene", np.random.Generator], np.ndarray]
Lamps = Callable[[np.ndarray, "Scene", np.random.Generator], tuple[np.ndarray, np.ndarray]]


def _same(values: np.ndarray, scene: "Scene", rng: np.random.Generator) -> np.ndarray:
    return values


def _same_lamps(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return positions, np.ones(len(positions))


@dataclass(frozen=True)
class Fault:
    """A fault of a capture.

    `light` changes values y (F, H, W) before the exposure is set, `signal` shares of full scale (F, H, W) after it, and
    `encoding` stored values. `lamps` takes the nominal positions (F, 3) and returns the stated ones, with the factors
    (F,) by which intensities are overstated.
    """

    light: Change = _same
    signal: Change = _same
    encoding: Callable[[np.ndarray, int], np.ndarray] = lambda dn, full_scale: dn
    lamps: Lamps = _same_lamps


NONE = Fault()
GAMMA = 2.2
WRONG_M = 0.005
FLASH = 0.5
BLUR_PX = 2.5


def named(name: str | None) -> Fault:
    """The fault of a name, or no fault for None. Raises ValueError that lists the faults."""
    if not name:
        return NONE
    if name not in ALL:
        raise ValueError(f"there is no fault {name!r}: choose one of {', '.join(ALL)}")
    return ALL[name]


def _offset(level: float) -> Fault:
    """The same value everywhere, as a share of a white surface's: stray light in the lens, a remaining black level, or
    below zero, too much subtracted."""
    return Fault(light=lambda y, scene, rng: y + np.float32(level))


def _ambient(level: float) -> Fault:
    """Light from all round, as a share of the lamp's on a white surface; it depends on albedo and hollows."""
    return Fault(light=lambda y, scene, rng: y + np.float32(level) * scene.ambient())


def _gamma_coded(dn: np.ndarray, full_scale: int) -> np.ndarray:
    """8 bits of value^(1/2.2), stored over the sensor's range."""
    coded = np.round(255 * (dn / full_scale) ** (1 / GAMMA))
    return np.round(coded / 255 * full_scale).astype(np.uint16)


def _eight_bit(dn: np.ndarray, full_scale: int) -> np.ndarray:
    return np.round(np.round(255 * (dn / full_scale)) / 255 * full_scale).astype(np.uint16)


def _mirrored(axis: int) -> Fault:
    def lamps(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        sign = np.ones(3)
        sign[axis] = -1
        return positions * sign, np.ones(len(positions))

    return Fault(lamps=lamps)


def _turned(degrees: float) -> Fault:
    """Turns the lamps' frame about the camera's axis."""

    def lamps(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        return positions @ turn.T, np.ones(len(positions))

    return Fault(lamps=lamps)


def _swapped(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Exchanges two lamps at least 40° apart."""
    unit = (positions - scene.center) / np.linalg.norm(positions - scene.center, axis=1, keepdims=True)
    apart = np.argwhere(np.triu(unit @ unit.T < np.cos(np.radians(40))))
    one, other = apart[rng.integers(len(apart))]
    out = positions.copy()
    out[[one, other]] = positions[[other, one]]
    return out, np.ones(len(positions))


def _shifted(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    away = rng.normal(size=3)
    return positions + WRONG_M * away / np.linalg.norm(away), np.ones(len(positions))


def _scattered(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    away = rng.normal(size=positions.shape)
    return positions + WRONG_M * away / np.linalg.norm(away, axis=1, keepdims=True), np.ones(len(positions))


def _intensities(positions: np.ndarray, scene: "Scene", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return positions, np.exp(rng.normal(0, 0.1, len(positions)))


def _moved(pixels: float) -> Fault:
    """Shifts the object by this many pixels in the second half of the images."""

    def light(y: np.ndarray, scene: "Scene", rng: np.random.Generator) -> np.ndarray:
        angle = rng.uniform(0, 2 * np.pi)
        shift = np.array([[1, 0, pixels * np.cos(angle)], [0, 1, pixels * np.sin(angle)]])
        out = y.copy()
        for number in range(len(y) // 2, len(y)):
            out[number] = cv2.warpAffine(y[number].astype(np.float32), shift, y.shape[:0:-1], flags=cv2.INTER_LANCZOS4)
        return out

    return Fault(light=light)


def _one(change: Callable[[np.ndarray, "Scene"], np.ndarray], *, exposed: bool) -> Fault:
    """Changes one image, drawn at random."""

    def apply(values: np.ndarray, scene: "Scene", rng: np.random.Generator) -> np.ndarray:
        number, out = int(rng.integers(len(values))), values.copy()
        out[number] = change(values[number], scene)
        return out

    return Fault(signal=apply) if exposed else Fault(light=apply)


def _flash(y: np.ndarray, scene: "Scene") -> np.ndarray:
    """Adds the light of a lamp at the camera."""
    return y + FLASH * scene.images(np.array([[0.0, 0.0, 0.0]]))[0]


ALL: dict[str, Fault] = {
    "offset:-0.03": _offset(-0.03),
    "offset:0.01": _offset(0.01),
    "offset:0.03": _offset(0.03),
    "offset:0.1": _offset(0.1),
    "ambient:0.01": _ambient(0.01),
    "ambient:0.03": _ambient(0.03),
    "ambient:0.1": _ambient(0.1),
    "8-bit": Fault(encoding=_eight_bit),
    "gamma": Fault(encoding=_gamma_coded),
    "mirrored-x": _mirrored(0),
    "mirrored-y": _mirrored(1),
    "turned:10": _turned(10.0),
    "turned:-45": _turned(-45.0),
    "swapped": Fault(lamps=_swapped),
    "lamps-shifted": Fault(lamps=_shifted),
    "lamps-scattered": Fault(lamps=_scattered),
    "intensities": Fault(lamps=_intensities),
    "moved:1": _moved(1.0),
    "moved:2": _moved(2.0),
    "one-dark": _one(lambda signal, scene: 0.02 * signal, exposed=True),
    "one-exposure": _one(lambda signal, scene: 0.5 * signal, exposed=True),
    "one-blurred": _one(
        lambda signal, scene: cv2.GaussianBlur(signal.astype(np.float32), (0, 0), BLUR_PX), exposed=True
    ),
    "one-flash": _one(_flash, exposed=False),
}
"""Faults by name, as `--fault` reads them."""
