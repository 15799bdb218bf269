"""Exposures that a light may get: octaves of the automatic time, within the camera's range, however short."""

import numpy as np
import pytest

from acquisition.models.recipe import Exposure
from acquisition.plan import exposure_plan
from acquisition.plan.exposure_plan import CaptureTimes


@pytest.mark.parametrize("automatic_s", [3e-6, 1.5e-5, 0.02, 0.7])
def test_options_are_octaves_of_the_automatic_time(automatic_s: float) -> None:
    times = CaptureTimes(shortest_s=1e-7, longest_s=10.0, move_s=1.0, frame_s=0.1)
    found = exposure_plan.options(automatic_s, Exposure(), times)
    ratios = {one.exposure_s / found[0][0].exposure_s for exposures in found for one in exposures}
    assert len(ratios) > 1
    for ratio in ratios:
        octave = 2.0 ** round(float(np.log2(ratio)))
        assert ratio == pytest.approx(octave, rel=1e-4)
