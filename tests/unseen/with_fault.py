"""Two solves of one small scene, without and with a fault of the capture, and the increase of the error by the fault.

Lights are two rings, so that no pilot and no plan is needed. Both solves are graded on the pixels solved in both.
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
        """Ratio of the mean error with the fault to that without."""
        return self.faulty_deg / self.sound_deg


def solved(family: str, seed: int, reflectance: str, fault: str, lights: int = 10, *, pixels: int = PIXELS) -> Pair:
    """Solves a scene's capture without and with a fault, in images of `pixels` × `pixels`."""
    scene = scenes.scene(family, seed, reflectance, pixels)
    positions = patterns.fixed("two-rings", scene, lights, 0, 1)
    sound, faulty = (run.solve(scene, capture(scene, positions, fault=faults.named(name))) for name in ("", fault))
    graded = scene.truth.within_78_deg & sound.mask & faulty.mask
    return Pair(sound, faulty, *(float(np.mean(scene.truth.error_deg(one.normals)[graded])) for one in (sound, faulty)))


def kinds(normal_map: NormalMap) -> list[tuple[str, bool]]:
    """The kind of each finding, and whether it is corrected."""
    return [(finding.kind, finding.corrected) for finding in normal_map.findings]
