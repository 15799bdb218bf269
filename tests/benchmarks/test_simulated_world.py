"""Times of the simulated world at full size: one core, 1024 × 1024 pixels. Goals: a shot ≤ 2 s, preparation ≤ 10 s."""

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition.models import cell_config
from hardware_sim import nominal
from hardware_sim.world import ExposureInterval, World

LIT = (-2.6641, -0.9534, 1.6785, 2.607, 1.8307, 2.423)
"""The lamp on the dome at 45° from the view axis."""


def world(name: str) -> World:
    return World(cell_config.load(nominal.default_cell_file()), nominal.calibration(1024), name, 1, "realistic")


@pytest.mark.parametrize("name", ["relief", "figure"])
def test_world_preparation_time(benchmark: BenchmarkFixture, name: str) -> None:
    made = benchmark.pedantic(world, args=(name,), rounds=1)
    assert made.lens.width == 1024


@pytest.mark.parametrize("level", [1.0, 0.0], ids=["lit", "dark"])
def test_world_shot_time(benchmark: BenchmarkFixture, level: float) -> None:
    scene = world("figure")
    frame = benchmark.pedantic(scene.frame, args=([ExposureInterval(1.0, LIT, level)], 0.06, 0), rounds=3)
    assert frame.shape == (1024, 1024)
