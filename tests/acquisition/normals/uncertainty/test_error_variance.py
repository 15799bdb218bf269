"""Variance components of σ: what raises it, and that it is pooled over known pixels only."""

import numpy as np
import pytest

from acquisition import photometry
from acquisition.normals.uncertainty import error_variance
from acquisition.normals.uncertainty.error_variance import STRIP_ROWS

SHAPE = (2 * STRIP_ROWS + 30, 20)
EVERYWHERE = np.ones(SHAPE, bool)
MISFIT = photometry.SETTINGS.misfit_factor


def bounded(variance_deg2: float) -> float:
    """σ of a variance by the images, deg², and of a random normal together."""
    return float(1 / np.sqrt(1 / variance_deg2 + 1 / photometry.RANDOM_NORMAL_SIGMA_DEG**2))


def own_misfit(chi_squared: float, freedom: int = 5) -> float:
    """A pixel's χ² over its degrees of freedom, shrunk towards 1 by one of them."""
    return (chi_squared * freedom + 1) / (freedom + 1)


def bent(angle_deg: float, row: int = STRIP_ROWS) -> np.ndarray:
    """Normals of two planes that meet between two rows, this angle apart."""
    angle = np.where(np.arange(SHAPE[0]) < row, 0.0, np.radians(angle_deg))
    normals = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    return np.repeat(normals[:, None], SHAPE[1], axis=1).astype(np.float32)


def sigma(
    posterior_deg: float = 1.0, residual: float = 0.0, lights: int = 8,
    *, stated_share: float = 1.0, capture_deg: float = 0.0,
) -> np.ndarray:  # fmt: skip
    def full(value: float) -> np.ndarray:
        return np.full(SHAPE, value, np.float32)

    return error_variance.evaluate(
        full(posterior_deg), full(residual), np.full(SHAPE, lights, np.uint8), full(stated_share), bent(0), EVERYWHERE,
        capture_deg=capture_deg,
    ).sigma_deg  # fmt: skip


def test_sigma_perfect_fit_is_the_posterior() -> None:
    assert sigma() == pytest.approx(bounded(1.0), rel=1e-5)


def test_sigma_of_model_that_holds_is_the_posterior() -> None:
    assert sigma(residual=float(np.sqrt(5 / 8))) == pytest.approx(bounded(1.0), rel=1e-5)


@pytest.mark.parametrize("lights", [6, 20])
def test_sigma_excess_over_stated_noise_does_not_fall_with_lights(lights: int) -> None:
    """χ² is twice the freedom, of which the stated noise explains half of one: 1.5 for each light, and as much by the
    other pixels."""
    freedom = lights - 3
    residual = float(np.sqrt(2 * freedom / lights))
    expected = bounded(1.0 + own_misfit(2, freedom) * MISFIT * lights * 2 * 1.5)
    assert sigma(residual=residual, lights=lights, stated_share=0.5) == pytest.approx(expected, rel=1e-5)


def test_sigma_of_pixel_that_images_do_not_tell_of_is_a_random_normals() -> None:
    """49°: the mean square of θ under sin 2θ, 0 to 90°."""
    angle = np.linspace(0, np.pi / 2, 10001)
    random = np.degrees(np.sqrt(np.trapezoid(angle**2 * np.sin(2 * angle), angle)))
    assert random == pytest.approx(photometry.RANDOM_NORMAL_SIGMA_DEG, rel=1e-6)
    assert sigma(1e4) == pytest.approx(random, rel=1e-3)


def test_typical_excess_weighs_pixels_by_degrees_of_freedom() -> None:
    residual, stated = np.array([1.0, 2.0, 9.0] * 8, np.float32), np.array([1.0, 0.5, 0.5] * 8, np.float32)
    residual[1], lights = 4.0, np.array([5, 8, 3] * 8, np.uint8)  # the one that fits worst does not count
    excess = 8 * (5 - 2 * 1.0) + 7 * (4 * 8 - 5 * 0.5)
    assert error_variance.typical_excess(residual, lights, stated) == pytest.approx(excess / (8 * 2 + 7 * 5))
    assert error_variance.typical_excess(residual, np.full(24, 3, np.uint8), stated) == 0.0
    assert error_variance.typical_excess(0 * residual, lights, stated) == 0.0
    most = error_variance.typical_excess(residual * 100, np.full(24, 6, np.uint8), np.ones(24, np.float32))
    assert most == pytest.approx(2 * photometry.SETTINGS.significant_deviations**2 - 1)


@pytest.mark.parametrize(
    ("change", "added_deg"),
    [
        ({"lights": 3}, photometry.SETTINGS.unchecked_sigma_deg),
        ({"capture_deg": 7.0}, 7.0),
    ],
)
def test_sigma_component_adds_in_quadrature(change: dict[str, float], added_deg: float) -> None:
    assert sigma(**change) == pytest.approx(bounded(1.0 + added_deg**2), rel=1e-5)


def test_sigma_residual_pools_known_neighbours_across_strips() -> None:
    """One badly fitting pixel at the last row of a strip raises its known neighbours alike; unknown ones stay NaN."""
    residual = np.zeros(SHAPE, np.float32)
    residual[STRIP_ROWS - 1, 10] = 5.0
    posterior = np.ones(SHAPE, np.float32)
    posterior[STRIP_ROWS, 9:12] = np.nan
    ones, lights = np.ones(SHAPE, np.float32), np.full(SHAPE, 8, np.uint8)
    result = error_variance.evaluate(
        posterior, residual, lights, ones, bent(0), EVERYWHERE, capture_deg=0.0
    ).sigma_deg  # fmt: skip
    assert np.all(np.isnan(result[STRIP_ROWS, 9:12]))
    misfit = MISFIT * 8 * ((25 * 8) / (22 * 5) - 1)
    assert result[STRIP_ROWS - 1, 10] == pytest.approx(bounded(1.0 + own_misfit(40) * misfit), rel=1e-4)
    assert result[STRIP_ROWS - 2, 10] == pytest.approx(bounded(1.0 + own_misfit(0) * misfit), rel=1e-4)
    assert result[STRIP_ROWS - 4, 10] == pytest.approx(bounded(1.0), rel=1e-5)
    assert np.count_nonzero(result > 1.01 * bounded(1.0)) == 22


def test_misfit_of_facing_pixels_raises_all_others() -> None:
    """χ² is 3 or 9 in some rows and 1 in others; only those that face the camera say so, but the worst 8 % of them."""
    residual = np.full(SHAPE, np.sqrt(5 / 8), np.float32)
    residual[:400] *= np.sqrt(3)
    residual[50:60] *= np.sqrt(3)
    ones, lights = np.ones(SHAPE, np.float32), np.full(SHAPE, 8, np.uint8)
    facing = EVERYWHERE.copy()
    facing[:50] = False
    found = error_variance.evaluate(ones, residual, lights, ones, bent(0), facing, capture_deg=0.0)
    rows = SHAPE[0] - 50
    # More than 8 % of the rows have a χ² of 3, so that it is theirs, not 1, up to which pixels count.
    typical = 340 * 2 / (rows - 10)
    assert found.sigma_deg[-1] == pytest.approx(bounded(1 + MISFIT * 8 * typical), rel=1e-5)
    assert found.sigma_deg[0] == pytest.approx(bounded(1 + own_misfit(3) * MISFIT * 8 * (2 + typical)), rel=1e-5)
    rim = error_variance.evaluate(ones, residual, lights, ones, bent(0), ~EVERYWHERE, capture_deg=0.0)
    typical = 390 * 2 / (SHAPE[0] - 10)
    assert rim.sigma_deg[-1] == pytest.approx(bounded(1 + MISFIT * 8 * typical), rel=1e-5)


def test_misfit_of_a_capture_raises_the_mean_sigma_of_pixels_that_face_the_camera_alike() -> None:
    residual = np.full(SHAPE, np.sqrt(5 / 8), np.float32)
    residual[:400] *= np.sqrt(3)
    ones, lights = np.ones(SHAPE, np.float32), np.full(SHAPE, 8, np.uint8)
    facing = EVERYWHERE.copy()
    facing[:100] = facing[390:410] = False  # where pooling mixes both
    found = error_variance.evaluate(ones, residual, lights, ones, bent(0), facing, capture_deg=0.0)
    rows = SHAPE[0] - 120
    typical = 2 * 290 / rows
    raised = np.sqrt([1 + MISFIT * 8 * own_misfit(3) * (2 + typical), 1 + MISFIT * 8 * typical])
    mean = (raised[0] * 290 + raised[1] * (rows - 290)) / rows
    assert np.sqrt(1 + MISFIT * 8 * (found.misfit - 1)) == pytest.approx(mean, rel=1e-5)


@pytest.mark.parametrize(("rows", "told"), [(20, False), (60, True)])
def test_misfit_of_few_pixels_is_not_that_of_the_object(rows: int, told: bool) -> None:
    """Of 542 rows 43 are 8 %."""
    residual = np.full(SHAPE, np.sqrt(5 / 8), np.float32)
    residual[:rows] *= 2.0
    ones, lights = np.ones(SHAPE, np.float32), np.full(SHAPE, 8, np.uint8)
    found = error_variance.evaluate(ones, residual, lights, ones, bent(0), EVERYWHERE, capture_deg=0.0)
    assert (found.sigma_deg[-1, 0] > 1.01 * bounded(1.0)) == told


@pytest.mark.parametrize("row", [STRIP_ROWS - 1, STRIP_ROWS, STRIP_ROWS + 1])
def test_sigma_crease_raises_pixels_on_both_sides_in_any_strip(row: int) -> None:
    result = error_variance.evaluate(*_plain_maps(), bent(90, row), EVERYWHERE, capture_deg=0.0).sigma_deg
    crease = np.degrees(2 * np.sin(np.radians(45)) / 2)
    tuned = error_variance.SETTINGS
    # A normal and the mean of four neighbours, one of which is 90° away, lie atan(1/3) apart.
    detail = np.degrees(np.arctan(1 / 3)) / 2
    raised = bounded(
        1.0 + tuned.structure_share**2 * (crease**2 - tuned.min_crease_deg**2 + detail**2 - error_variance.NOISE_DETAIL)
    )
    assert result[row - 1 : row + 1, 1:-1] == pytest.approx(raised, rel=1e-4)
    assert np.delete(result, [row - 1, row], axis=0) == pytest.approx(bounded(1.0), rel=1e-5)


@pytest.mark.parametrize("chi_squared", [0.0, 9.0])
def test_sigma_crease_counts_as_far_as_the_pixels_own_images_fit_badly(chi_squared: float) -> None:
    """Only one pixel fits better or worse, so that the misfit of the others stays nearly the same."""
    posterior, residual, lights, share = _plain_maps()
    results: list[np.ndarray] = []
    for angle_deg in (0.0, 90.0):
        residual[STRIP_ROWS, 10] = np.sqrt(chi_squared * 5 / 8)
        found = error_variance.evaluate(
            posterior, residual, lights, share, bent(angle_deg), EVERYWHERE, capture_deg=0.0
        )  # fmt: skip
        variance = found.sigma_deg[STRIP_ROWS, [10, 5]].astype(float) ** -2 - photometry.RANDOM_NORMAL_SIGMA_DEG**-2
        results.append(1 / variance)
    own, other = results[1] - results[0]
    assert own == pytest.approx(own_misfit(chi_squared) * other, rel=1e-3)


@pytest.mark.parametrize("sharpened", [False, True])
def test_sigma_follows_detail_where_there_is_no_crease(*, sharpened: bool) -> None:
    """A bend of 20° is less of a crease than what counts as one. All detail of sharpened images is extrapolated."""
    result = error_variance.evaluate(
        *_plain_maps(), bent(20), EVERYWHERE, capture_deg=0.0, sharpened=sharpened
    ).sigma_deg
    detail = np.degrees(np.arctan2(np.sin(np.radians(20)), 3 + np.cos(np.radians(20)))) / 2
    share = 1.0 if sharpened else error_variance.SETTINGS.structure_share
    raised = bounded(1.0 + share**2 * (detail**2 - error_variance.NOISE_DETAIL))
    assert result[STRIP_ROWS - 1 : STRIP_ROWS + 1, 1:-1] == pytest.approx(raised, rel=1e-4)
    assert raised > 1.05 * bounded(1.0)


@pytest.mark.parametrize("step_deg", [1.0, 10.0, 40.0])
def test_crease_of_constant_curvature_is_none(step_deg: float) -> None:
    angle = np.radians(step_deg) * np.arange(SHAPE[0])
    normals = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    normals = np.repeat(normals[:, None], SHAPE[1], axis=1).astype(np.float32)
    assert error_variance.crease_deg2(normals, np.ones(SHAPE, bool))[2:-2] == pytest.approx(0, abs=1e-3)


def test_crease_of_rows_and_columns_is_the_same() -> None:
    known = np.ones((20, 20), bool)
    normals = bent(70, 10)[:20, :20]
    turned = np.swapaxes(error_variance.crease_deg2(np.swapaxes(normals, 0, 1), known), 0, 1)
    assert turned == pytest.approx(error_variance.crease_deg2(normals, known))


def test_crease_beside_unknown_pixels_is_none() -> None:
    known = np.ones(SHAPE, bool)
    known[STRIP_ROWS:] = False
    assert error_variance.crease_deg2(bent(90), known) == pytest.approx(0)


def _plain_maps() -> tuple[np.ndarray, ...]:
    """Posterior, residuals with a χ² of 1, lights and stated share."""
    ones = np.ones(SHAPE, np.float32)
    return ones, np.full(SHAPE, np.sqrt(5 / 8), np.float32), np.full(SHAPE, 8, np.uint8), ones


def test_detail_of_one_tilted_normal_is_half_its_angle_and_a_part_of_it_beside() -> None:
    normals = bent(0)
    angle = np.radians(8.0)
    normals[20, 10] = 0, np.sin(angle), np.cos(angle)
    detail = error_variance.detail_deg2(normals, np.ones(SHAPE, bool))
    assert np.sqrt(detail[20, 10]) == pytest.approx(4.0, rel=1e-3)
    beside = np.degrees(np.arctan2(np.sin(angle), 3 + np.cos(angle))) / 2
    assert np.sqrt(detail[[19, 21, 20, 20], [10, 10, 9, 11]]) == pytest.approx(beside, rel=1e-3)
    assert np.count_nonzero(detail > 0.01) == 5


def test_detail_beside_unknown_pixels_is_that_of_the_known() -> None:
    known = np.ones(SHAPE, bool)
    known[STRIP_ROWS:] = False
    assert error_variance.detail_deg2(bent(90), known) == pytest.approx(0, abs=1e-3)


def tilted_rows(rows: slice, angle_deg: float) -> np.ndarray:
    """A plane's normals, those of some rows turned by an angle, as of a wall along them."""
    normals, angle = bent(0), np.radians(angle_deg)
    normals[rows] = 0, np.sin(angle), np.cos(angle)
    return normals


@pytest.mark.parametrize("wide", [1, 2])
@pytest.mark.parametrize("row", [20, STRIP_ROWS - 1, STRIP_ROWS])
def test_sigma_of_a_wall_narrower_than_pixels_is_that_of_any_inclination(row: int, wide: int) -> None:
    """A deviation of 15° may be half of a pixel at 30° or a fifth at 75°: ω (90° − ω)/2."""
    result = error_variance.evaluate(
        *_plain_maps(), tilted_rows(slice(row, row + wide), 15.0), EVERYWHERE, capture_deg=0.0
    ).sigma_deg
    chance = photometry.SETTINGS.outlying_deviations**2 * error_variance.NOISE_LINE
    line = np.sqrt(np.degrees(2 * np.sin(np.radians(7.5))) ** 2 - chance)
    assert result[row : row + wide] == pytest.approx(bounded(1.0 + line * (90 - line) / 2), rel=0.02)
    assert np.max(result[[row - 1, row + wide]]) < 1.5 * bounded(1.0)
    assert np.delete(result, np.arange(row - 1, row + wide + 1), axis=0) == pytest.approx(bounded(1.0), rel=1e-5)


def test_line_of_rows_and_columns_is_the_same() -> None:
    known, normals = np.ones((20, 20), bool), tilted_rows(slice(10, 12), 25.0)[:20, :20]
    found = error_variance.line_deg(normals, known, np.ones((20, 20), np.float32))
    turned = error_variance.line_deg(np.swapaxes(normals, 0, 1).copy(), known, np.ones((20, 20), np.float32))
    assert np.swapaxes(turned, 0, 1) == pytest.approx(found)
    assert np.all(found[10:12] > 20)


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (3, 2), (5, 1)])
def test_line_of_an_object_too_narrow_for_sides_is_none(shape: tuple[int, int]) -> None:
    normals = np.zeros((*shape, 3), np.float32)
    normals[..., 2] = 1
    assert not np.any(error_variance.line_deg(normals, np.ones(shape, bool), np.zeros(shape, np.float32)))


@pytest.mark.parametrize("of", ["bend", "wide step", "curvature", "noise", "edge of the object"])
def test_line_of_what_is_no_line_is_none(of: str) -> None:
    known, variance = np.ones(SHAPE, bool), np.zeros(SHAPE, np.float32)
    normals = {"bend": bent(40), "wide step": tilted_rows(slice(20, 23), 30.0)}.get(of, bent(0))
    if of == "curvature":
        angle = np.radians(10.0) * np.arange(SHAPE[0])
        normals = np.repeat(np.stack([0 * angle, np.sin(angle), np.cos(angle)], -1)[:, None], SHAPE[1], axis=1)
    if of == "noise":  # of 2° over both directions, of which a hundredth looks like lines of some degrees
        normals = normals + np.random.default_rng(0).normal(0, np.radians(2.0) / np.sqrt(2), (*SHAPE, 3)) * [1, 1, 0]
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        variance += 4.0
    if of == "edge of the object":
        normals = tilted_rows(slice(20, 21), 30.0)
        known[21:] = False
    found = error_variance.line_deg(normals.astype(np.float32), known, variance)
    assert np.mean(found > 0.1) <= (0.02 if of == "noise" else 0.0)


def test_structure_of_one_crease_is_its_share_of_the_pixels_and_noise_makes_none() -> None:
    flat, crease = (
        error_variance.evaluate(*_plain_maps(), normals, EVERYWHERE, capture_deg=0.0).structure_deg
        for normals in (bent(0), bent(90))
    )
    assert flat == 0.0
    tuned, detail = error_variance.SETTINGS, np.degrees(np.arctan(1 / 3)) / 2
    turn = np.degrees(np.sin(np.radians(45))) ** 2 - tuned.min_crease_deg**2
    each = tuned.structure_share * np.sqrt(turn + detail**2 - error_variance.NOISE_DETAIL)
    assert crease == pytest.approx(2 / SHAPE[0] * each, rel=0.01)
    noisy = bent(0) + np.random.default_rng(0).normal(0, np.radians(2.0) / np.sqrt(2), (*SHAPE, 3)) * [1, 1, 0]
    noisy = (noisy / np.linalg.norm(noisy, axis=-1, keepdims=True)).astype(np.float32)
    residual, lights, share = _plain_maps()[1:]
    sigma_deg = np.full(SHAPE, 2.0, np.float32)
    found = error_variance.evaluate(sigma_deg, residual, lights, share, noisy, EVERYWHERE, capture_deg=0.0)
    assert found.structure_deg < 0.4 * tuned.structure_share * 2.0
