"""Segmentation of object and table by brightness."""

import numpy as np
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals.images import silhouette
from tests.acquisition import scenes


def stack(true: scenes.Scene, lights: int = 6, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = np.stack([scenes.lit(true, light) for light in scenes.ring(lights, 45.0, turn=0.3)])
    return (values * (1 + 0.01 * rng.normal(size=values.shape)) + 0.002 * rng.normal(size=values.shape)).astype(
        np.float32
    )


def find(values: np.ndarray, region: np.ndarray, clipped: np.ndarray | None = None) -> np.ndarray:
    return silhouette.segment(
        np.max(values if clipped is None else np.where(clipped, np.float32(np.inf), values), axis=0), region
    )


@pytest.mark.parametrize("shape", [scenes.sphere, scenes.bumps, scenes.relief])
@pytest.mark.parametrize("albedo", [0.3, 0.7])
def test_segment_bright_object_on_dark_table(shape: scenes.Height, albedo: float) -> None:
    true = scenes.scene(shape, scenes.calibration(112), albedo=albedo, table=0.08)
    values = stack(true)
    segmented = find(values, np.ones(true.mask.shape, np.bool_))
    assert np.mean(segmented[true.mask]) > 0.96
    assert np.mean(segmented[~true.mask]) < 0.02


def test_segment_region_excludes_pixels_outside() -> None:
    true = scenes.scene(scenes.relief, scenes.calibration(96))
    values = stack(true)
    region = np.zeros(true.mask.shape, np.bool_)
    region[20:60, 20:80] = True
    segmented = find(values, region)
    assert not np.any(segmented & ~region)
    assert np.mean(segmented[true.mask & region]) > 0.95


def test_segment_clipped_pixels_are_object() -> None:
    true = scenes.scene(scenes.relief, scenes.calibration(96))
    values = stack(true)
    clipped = np.zeros(values.shape, np.bool_)
    clipped[:, 40:56, 40:56] = True
    values[clipped] = 0.0
    segmented = find(values, np.ones(true.mask.shape, np.bool_), clipped)
    assert np.all(segmented[40:56, 40:56])


def test_segment_nothing_lit_is_refused() -> None:
    dark = np.zeros((4, 40, 40), np.float32)
    with pytest.raises(RigError, match="nothing in the region is lit") as caught:
        find(dark, np.ones((40, 40), np.bool_))
    assert caught.value.code == ErrorCode.NORMALS_INFEASIBLE


def test_largest_component_fills_holes() -> None:
    mask = np.zeros((30, 30), np.bool_)
    mask[2:6, 2:6] = True
    mask[10:25, 10:25] = True
    mask[15:18, 15:18] = False
    part = silhouette.largest_component(mask)
    expected = np.zeros_like(mask)
    expected[10:25, 10:25] = True
    np.testing.assert_array_equal(part, expected)


def test_largest_component_empty_mask_is_empty() -> None:
    assert not np.any(silhouette.largest_component(np.zeros((5, 5), np.bool_)))
