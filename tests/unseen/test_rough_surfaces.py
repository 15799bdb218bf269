"""Rough surfaces among what resembles them: coded values, stray light, and a poor fit that nothing explains."""

import numpy as np
import pytest

from acquisition.models.result import NormalMap
from tests.unseen import faults, patterns, run, scenes
from tests.unseen.captures import capture
from tests.unseen.scenes import Scene

PIXELS = 48


def solved(scene: Scene, lights: int, fault: str = "") -> NormalMap:
    positions = patterns.fixed("two-rings", scene, lights, 0, 1)
    return run.solve(scene, capture(scene, positions, fault=faults.named(fault)))


def kinds(normal_map: NormalMap) -> set[tuple[str, bool]]:
    return {(finding.kind, finding.corrected) for finding in normal_map.findings}


@pytest.mark.parametrize(("family", "seed", "lights"), [("turned", 3, 8), ("turned", 12, 8), ("sheet", 61, 10)])
def test_solve_rough_surface_is_found_and_nothing_else(family: str, seed: int, lights: int) -> None:
    """Turned profiles, which also seem coded, and a sheet, whose poor fit gives roughness a gain of four."""
    scene = scenes.scene(family, seed, "oren-nayar:0.5", PIXELS)
    assert kinds(solved(scene, lights)) == {("rough surface", True)}


@pytest.mark.parametrize("family", ["blob", "sheet"])
def test_solve_rough_surface_in_stray_light_is_as_without_it(family: str) -> None:
    scene = scenes.scene(family, 60, "oren-nayar:0.5", PIXELS)
    sound, stray = (solved(scene, 10, fault) for fault in ("", "offset:0.03"))
    assert {("rough surface", True), ("stray light", True)} <= kinds(stray)
    graded = scene.truth.within_78_deg & sound.mask & stray.mask
    errors = [np.mean(scene.truth.error_deg(one.normals)[graded]) for one in (sound, stray)]
    assert errors[1] < 1.2 * errors[0]
