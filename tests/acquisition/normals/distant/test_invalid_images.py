"""Image sets that the distant-light solvers refuse, with what the refusal names: degenerate lights, no mask."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals import distant
from acquisition.normals.images.image_set import DistantLights, ImageSet, direction_spread
from tests.acquisition.normals.distant.ball_scenes import SIZE, ball, errors, few_lights, image_set, lambert


def refused(images: ImageSet, solver: distant.Solver = "auto") -> RigError:
    with pytest.raises(RigError) as caught:
        distant.solve(images, solver)
    assert caught.value.code == ErrorCode.NORMALS_INFEASIBLE
    return caught.value


def good(count: int = 8) -> ImageSet:
    normals, mask = ball()
    return image_set(lambert(normals, few_lights(count)), few_lights(count), mask)


def with_lights(images: ImageSet, directions: np.ndarray) -> ImageSet:
    return replace(images, lights=DistantLights(directions, np.ones((len(directions), 1))))


def test_solve_two_images_is_refused() -> None:
    assert "002.png" in refused(good(2)).detail


def test_solve_least_squares_accepts_distant_lights_that_are_close_together() -> None:
    """Stated directions hold at all pixels: lights too close for near light, 2.4° off one axis, give normals here."""
    angle, slant = 2 * np.pi * np.arange(8) / 8, np.radians(2.4)
    close = np.stack([np.sin(slant) * np.cos(angle), np.sin(slant) * np.sin(angle), np.full(8, np.cos(slant))], axis=-1)
    assert 0.02 < direction_spread(close) < 0.05
    normals, mask = ball()
    result = distant.solve(image_set(lambert(normals, close), close, mask), "ls")
    assert np.median(errors(result.normals, normals, mask)) < 0.5


def test_solve_parallel_lights_is_refused() -> None:
    assert "parallel" in refused(with_lights(good(), np.tile([0.1, 0.2, 1.0], (8, 1)))).detail


def test_solve_coplanar_lights_is_refused() -> None:
    flat = few_lights().copy()
    flat[:, 1] = 0
    assert "one plane" in refused(with_lights(good(), flat)).detail


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_solve_invalid_light_direction_is_named(bad: float) -> None:
    directions = few_lights().copy()
    directions[4] = bad
    assert refused(with_lights(good(), directions)).context["file"] == "005.png"


def test_solve_zero_intensity_is_named() -> None:
    strength = np.ones((8, 1))
    strength[2] = 0
    assert refused(replace(good(), lights=DistantLights(few_lights(), strength))).context["file"] == "003.png"


def test_solve_light_count_mismatch_is_refused() -> None:
    assert "one row for each" in refused(with_lights(good(), few_lights(6))).detail


def test_solve_empty_mask_is_refused() -> None:
    assert "mask" in refused(replace(good(), mask=np.zeros((SIZE, SIZE), np.bool_))).detail


def test_solve_findings_about_directions_name_no_lengths() -> None:
    """Directions off by about 11°. Nobody stated distance or size of the object, so no lengths are told."""
    normals, mask = ball()
    rng, directions = np.random.default_rng(1), few_lights()
    stated = directions + 0.2 * rng.standard_normal(directions.shape)
    noise = 0.001 * rng.standard_normal((8, SIZE, SIZE))
    result = distant.solve(image_set(lambert(normals, directions) + noise, stated, mask))
    told = {one.kind: one.message for one in result.findings}
    assert "directions or intensities of the lamps differ from the stated values" in told["lamps"]
    assert " pixels below the surface" in told["translucent surface"]
    assert not [message for message in told.values() if " mm" in message or "distance" in message]


def test_solve_directions_that_light_nothing_are_refused_without_positions() -> None:
    """All values are black or clipped."""
    images = good()
    normals, mask = ball()
    bright = np.where(lambert(normals, few_lights()) > 0.3, 1.0, 0.0)
    told = refused(replace(image_set(bright, few_lights(), mask), names=images.names)).detail
    assert "with the stated directions" in told
    assert "depth" not in told
