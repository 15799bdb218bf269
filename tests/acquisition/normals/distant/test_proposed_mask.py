"""Masks proposed from images alone: the object on black, on dark grey, and filling the frame."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.normals import distant
from acquisition.normals.images import silhouette
from acquisition.normals.images.image_set import ImageSet
from tests.acquisition.normals.distant import few_light_scenes
from tests.acquisition.normals.distant.few_light_scenes import Scene
from tests.acquisition.normals.distant.gloss_scenes import Rows


@pytest.fixture(scope="module")
def rabbit() -> Scene:
    return few_light_scenes.scene("rabbit", "matt", 8, 0, size=96, indirect=False)


def unmasked(scene: Scene) -> ImageSet:
    return replace(scene.image_set(masked=False), mask_given=False)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.count_nonzero(one & other) / np.count_nonzero(one | other))


@pytest.mark.parametrize("bits", [8, 16])
def test_propose_object_on_black_recovers_its_mask(rabbit: Scene, bits: int) -> None:
    images = unmasked(rabbit)
    if bits == 8:
        stored = (images.rows.stored // 257).astype(np.uint8)
        images = replace(images, rows=Rows(stored), full_scale=255)
    assert overlap(silhouette.propose(images), rabbit.mask) > 0.97


def test_propose_background_above_black_is_left_out(rabbit: Scene) -> None:
    rng = np.random.default_rng(1)
    images = unmasked(rabbit)
    raised = images.rows.stored + 600 + rng.normal(0, 60, images.rows.stored.shape)
    raised = replace(images, rows=Rows(np.clip(raised, 0, 65535).astype(np.uint16)))
    assert overlap(silhouette.propose(raised), rabbit.mask) > 0.95


def test_propose_object_that_fills_the_frame_keeps_all_pixels(rabbit: Scene) -> None:
    rng = np.random.default_rng(2)
    stored = rng.normal(20_000, 200, (8, 40, 50)) * rng.uniform(0.5, 1.5, (40, 50))
    images = replace(
        unmasked(rabbit), height=40, width=50, mask=np.ones((40, 50), np.bool_), rows=Rows(stored.astype(np.uint16))
    )
    assert np.all(silhouette.propose(images))


def test_background_noise_cut_at_black_is_estimated(rabbit: Scene) -> None:
    _, noise = silhouette.background(unmasked(rabbit), 3)
    level = 0.9 / np.quantile(rabbit.images[:, rabbit.mask], 0.999)
    true = level * 0.005 * np.mean(rabbit.images[:, rabbit.mask])
    assert 0.4 * true < noise < 1.5 * true


def test_solve_without_mask_leaves_black_unsolved(rabbit: Scene) -> None:
    result = distant.solve(unmasked(rabbit))
    assert result.notes["mask"] == "proposed"
    assert np.count_nonzero(result.mask & ~rabbit.mask) < 0.01 * np.count_nonzero(rabbit.mask)
    assert overlap(result.silhouette, rabbit.mask) > 0.97


def test_solve_with_mask_keeps_it(rabbit: Scene) -> None:
    result = distant.solve(rabbit.image_set())
    assert "mask" not in result.notes
    assert np.array_equal(result.silhouette, rabbit.mask)
