"""Uncertain normals on path-traced objects, taken from their neighbours: few lamps reach them, or they are a limb."""

import numpy as np
import pytest

from acquisition.normals.surface import markov_field
from tests.unseen import patterns, run, scenes
from tests.unseen.captures import capture


@pytest.mark.parametrize(
    ("family", "seed", "lights", "most", "most_deg"),
    [
        ("machined", 469, 8, 0.85, 2.5),
        ("knot", 473, 8, 0.85, 2.7),
        ("turned", 476, 4, 1.0, 2.0),
        ("blob", 476, 4, 1.0, 2.5),
    ],
)
def test_solve_uncertain_pixels_gain_by_their_neighbours(
    family: str, seed: int, lights: int, most: float, most_deg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four lights are a pilot's. Three of them reach most of a smooth object's limb, whose images determine it better
    than neighbours that face another way, or the viewing axis, with which the turned part's error is 2.4°."""
    scene = scenes.scene(family, seed, "lambert")
    pilot = lights == patterns.PILOT_LIGHTS
    positions = patterns.pilot_lights(scene, 0, 1) if pilot else patterns.fixed("two-rings", scene, lights, 0, 1)
    captured = capture(scene, positions)

    def error_deg() -> float:
        solved = run.solve(scene, captured)
        return float(np.mean(scene.truth.error_deg(solved.normals)[scene.truth.within_78_deg & solved.mask]))

    regularised = error_deg()
    monkeypatch.setattr(markov_field, "regularise", lambda *_: None)
    ratio = regularised / error_deg()
    print(f"\n{family} {seed}, {lights} lights: {regularised:.2f}°, {ratio:.3f} of that without")
    assert ratio < most
    assert regularised < most_deg
