"""Two solves of one small scene, as it is and with a fault of the capture, and how much the fault costs.

Lights are two rings, so that no pilot and no plan is needed, and both solves are graded on the pixels that both have.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.result import NormalMap
from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture

PIXELS = 48


@dataclass(frozen=True)
class Pair:
    """Normal maps of a capture without and with a fault, and their mean errors."""

    sound: NormalMap
    faulty: NormalMap
    sound_deg: float
    faulty_deg: float

    @property
    def error_ratio(self) -> float:
        """Mean error with the fault over that without."""
        return self.faulty_deg / self.sound_deg


def solved(family: str, seed: int, reflectance: str, fault: str, lights: int = 10, *, pixels: int = PIXELS) -> Pair:
    """Solves a scene's capture without and with a fault, in images of so many pixels across."""
    scene = scenes.scene(family, seed, reflectance, pixels)
    positions = patterns.fixed("two-rings", scene, lights, 0, 1)
    sound, faulty = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", fault))
    graded = scene.truth.within_78_deg & sound.mask & faulty.mask
    return Pair(sound, faulty, *(float(np.mean(scene.truth.error_deg(one.normals)[graded])) for one in (sound, faulty)))


def kinds(normal_map: NormalMap) -> list[tuple[str, bool]]:
    """Kind of each finding, and whether it is corrected."""
    return [(finding.kind, finding.corrected) for finding in normal_map.findings]
