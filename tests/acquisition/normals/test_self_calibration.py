"""Self-calibration of lamp intensities and positions: evidence, normal equations, recovered offsets and their σ."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from acquisition import normals, photometry
from acquisition.models.light_plan import Light
from acquisition.models.result import SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals import alternation, self_calibration
from acquisition.normals.pixels import image_terms, pixel_solve
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms, TermValues
from acquisition.normals.pixels.pixel_solve import Estimate
from acquisition.normals.self_calibration import Equations, Priors, SharedParameters
from tests.acquisition import scenes
from tests.acquisition.normals.shared_scene import measured

STATED = 0.01
TURNED = np.linalg.qr(np.random.default_rng(0).normal(size=(8, 8)))[0]


def normal_equations(estimates: list[float], precision: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Of eight log intensities, and of a shift (m) that the images do not determine; `estimates` along rotated axes."""
    matrix = np.zeros((9, 9))
    matrix[:8, :8] = TURNED @ np.diag(precision) @ TURNED.T
    return matrix, matrix @ np.append(TURNED @ estimates, 0.0)


def test_evidence_undetermined_directions_are_ignored() -> None:
    """Five of eight combinations are off by 3 %; three are not determined by the images."""
    matrix, right = normal_equations([0.03, -0.03, 0.03, 0.03, -0.03, 0, 0, 0], [500.0**2] * 5 + [0.0] * 3)
    assert self_calibration.evidence_maximised_sigma(matrix, right, np.array([[33.0**2]]), STATED) == pytest.approx(
        0.03, rel=0.25
    )


@pytest.mark.parametrize("size", [0.0, 0.004, 0.01, 0.014])
def test_evidence_below_bayes_factor_keeps_stated_sigma(size: float) -> None:
    matrix, right = normal_equations([size] * 8, [500.0**2] * 8)
    assert self_calibration.evidence_maximised_sigma(matrix, right, np.array([[33.0**2]]), STATED) == STATED


def test_evidence_residuals_explained_by_shift_keep_stated_sigma() -> None:
    """The same residuals, which a shift of 10 mm also causes, are explained by the shift."""
    matrix, _ = normal_equations([0.0] * 8, [500.0**2] * 8)
    slope = TURNED[:, 0] * 4.0
    matrix[:8, 8] = matrix[8, :8] = matrix[:8, :8] @ slope
    matrix[8, 8] = slope @ matrix[:8, :8] @ slope
    assert (
        self_calibration.evidence_maximised_sigma(matrix, matrix[:, 8] * 0.01, np.array([[33.0**2]]), STATED) == STATED
    )


def test_step_flat_glossy_surface_recovers_intensities() -> None:
    """Tilt, highlight and intensities would drift together if the highlight were held fixed."""
    made = measured(largest_slant=0.15)
    rng = np.random.default_rng(5)
    wrong = rng.normal(0, 0.03, 8)
    gloss = ImageTerms(gloss=0.25, strength=1.2)
    view = -made.ray_direction / np.linalg.norm(made.ray_direction, axis=0)
    everywhere = np.ones(made.values.shape, np.bool_)
    added = image_terms.evaluate(gloss, 0.6 * made.normals, made.light, everywhere, view.astype(np.float32))
    images = (made.values + added.value) * np.exp(wrong)[:, None]
    images = (images + rng.normal(0, 0.002, images.shape)).astype(np.float32)
    present = replace(SharedParameters.nominal(8), terms=gloss)
    priors = Priors(STATED, 0.0, 0.0, ImageTerms(gloss=1.0, strength=1.0))
    for _ in range(10):
        divided = alternation.divide_intensity(images, present.log_intensity)
        scene = replace(made.scene, terms=present.terms)
        solution = pixel_solve.solve(made.pixels, divided, made.depth_m, scene)
        change = pixel_solve.depth_derivative(solution.light, solution.point, made.ray_direction, made.lamp)
        step = self_calibration.gauss_newton_step(solution, change, divided, made.lamp, present, priors, 0.003)
        present = replace(
            present,
            log_intensity=present.log_intensity + step.log_intensity,
            terms=image_terms.stepped(present.terms, step.terms),
        )
    left = present.log_intensity - wrong
    assert np.std(left) < 0.3 * np.std(wrong)


def test_step_eliminated_pixels_equals_dense_solution() -> None:
    """The step with each pixel's unknowns eliminated equals the dense solution of the full system."""
    made, rng, offset_sigma, shift_sigma = measured(size=9), np.random.default_rng(2), 0.003, 0.03
    values = (made.values * (1 + rng.normal(0, 0.001, made.values.shape))).astype(np.float32)
    solution = pixel_solve.solve(made.pixels, values, made.depth_m, made.scene)
    change = pixel_solve.depth_derivative(solution.light, solution.point, made.ray_direction, made.lamp)
    start, aside, shift = rng.normal(0, 0.001, 8), rng.normal(0, 0.001, (8, 3)), 0.002
    present = SharedParameters(start, aside, shift, np.zeros((32, 32)))
    step = self_calibration.gauss_newton_step(
        solution, change, values, made.lamp, present, Priors(STATED, 0.001, shift_sigma), offset_sigma
    )
    count = values.shape[1]
    s, d, g = (one.astype(float) for one in (solution.light, change, solution.g))
    slope = np.einsum("fck,ck->fk", d, g)
    predicted = np.einsum("fck,ck->fk", s, g)
    by_position = self_calibration.position_derivative(solution, made.lamp)
    root = np.sqrt(solution.weights)
    rows = np.zeros((8, count, 33 + 4 * count))
    for pixel in range(count):
        rows[:, pixel, :8] = np.diag(predicted[:, pixel])
        for axis in range(3):
            rows[:, pixel, 8 + 8 * axis : 16 + 8 * axis] = np.diag(by_position[:, axis, pixel])
        own = slice(33 + 4 * pixel, 37 + 4 * pixel)
        rows[:, pixel, 32] = slope[:, pixel]
        rows[:, pixel, own] = np.concatenate([s[:, :, pixel], slope[:, None, pixel]], axis=1)
    rows = (rows * root[:, :, None]).reshape(8 * count, -1)
    shared = [np.full(8, STATED**-2), np.full(24, 0.001**-2), [shift_sigma**-2]]
    prior = np.concatenate([*shared, np.tile([1e-6] * 3 + [offset_sigma**-2], count)])
    held = np.concatenate([start, aside.T.ravel(), [shift], np.zeros(4 * count)])
    # Evidence of pixels counts a twentieth, with their own priors, against the priors of what they share.
    prior[33:] /= self_calibration.SETTINGS.effective_sample_divisor
    matrix = rows.T @ rows / self_calibration.SETTINGS.effective_sample_divisor + np.diag(prior)
    right = (
        rows.T @ (root * (values - predicted)).ravel() / self_calibration.SETTINGS.effective_sample_divisor
        - prior * held
    )
    dense = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(step.log_intensity, dense[:8], rtol=1e-4, atol=1e-8)
    np.testing.assert_allclose(step.lamp_offset_m, dense[8:32].reshape(3, 8).T, rtol=1e-4, atol=1e-8)
    assert step.shift_m == pytest.approx(dense[32], rel=1e-4)


@pytest.mark.parametrize("glossy", [False, True])
@pytest.mark.parametrize("count", [5, 8, 21])
def test_step_random_pixels_equals_sum_of_dense_pixels(count: int, *, glossy: bool) -> None:
    """Random pixels lit by some of the lamps, with terms and without, against dense matrices of each pixel."""
    rng, pixels, offset_sigma = np.random.default_rng(count), 90, 0.003
    terms = ImageTerms(0.1, 0.05, 0.02, 0.3, 0.0, 0.8) if glossy else LAMBERTIAN

    def random(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    lamp = random(count, 6)
    weights = rng.uniform(0, 1e4, (count, pixels)) * (rng.random((count, pixels)) < 0.8)
    solution = Estimate(
        g=random(3, pixels), variance=random(pixels), residual=random(pixels),
        weights=weights.astype(np.float32), usable=weights > 0,
        light=random(count, 3, pixels), point=random(3, pixels) - np.array([[0], [0], [5]], np.float32),
    )  # fmt: skip
    change, values = random(count, 3, pixels), random(count, pixels)
    added, by_g = np.zeros((count, pixels)), np.zeros((count, 3, pixels))
    by_term, term_sigma = np.zeros((count, 0, pixels)), np.zeros(0)
    if glossy:
        added, by_g, term_sigma = random(count, pixels), random(count, 3, pixels), np.full(6, 0.5)
        ambient, offset = random(pixels), 0.3  # which no lamp's intensity multiplies
        value = added + ambient + np.float32(offset)
        values_of_terms = TermValues(value, added, ambient, added, offset, added, by_g)
        solution, added = replace(solution, terms=values_of_terms), values_of_terms.from_lamps
        view = -solution.point / np.linalg.norm(solution.point, axis=0)
        by_term = image_terms.by_parameter(terms, solution.g, solution.light, solution.usable, view)
    present = SharedParameters(
        random(count).astype(float), random(count, 3).astype(float), 0.7, np.zeros((0, 0)), terms
    )
    step = self_calibration.gauss_newton_step(
        solution, change, values, lamp, present, Priors(9.0, 5.0, 3.0, ImageTerms(*term_sigma)), offset_sigma
    )

    size = 4 * count + 1 + len(term_sigma)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    aside = self_calibration.position_derivative(solution, lamp).astype(float)
    pixel_prior = np.diag([1e-6] * 3 + [offset_sigma**-2])
    for p in np.flatnonzero(np.count_nonzero(weights, axis=0) >= 4):
        root = np.sqrt(solution.weights[:, p].astype(float))
        slope, predicted = (rows[:, :, p].astype(float) @ solution.g[:, p] for rows in (change, solution.light))
        own = np.column_stack([solution.light[:, :, p] + by_g[:, :, p], slope])
        each = [np.diag(predicted + added[:, p]), *(np.diag(along) for along in aside[:, :, p].T)]
        shared = np.column_stack([*each, slope, *by_term[:, :, p].T])
        term_value = 0 if solution.terms is None else solution.terms.value[:, p]
        left = root * (values[:, p] - term_value - predicted)
        own, shared = root[:, None] * own, root[:, None] * shared
        inner = np.linalg.inv(own.T @ own + pixel_prior)
        matrix += shared.T @ shared - shared.T @ own @ inner @ own.T @ shared
        right += shared.T @ left - shared.T @ own @ inner @ own.T @ left
    prior = np.array([9.0**-2] * count + [5.0**-2] * 3 * count + [3.0**-2, *term_sigma**-2])
    parameters = astuple(terms) if glossy else ()
    before = np.concatenate([present.log_intensity, present.lamp_offset_m.T.ravel(), [present.shift_m], parameters])
    divisor = self_calibration.SETTINGS.effective_sample_divisor
    covariance = np.linalg.inv(matrix / divisor + np.diag(prior))
    dense = covariance @ (right / divisor - prior * before)
    lamps = 4 * count + 1
    given = np.linalg.inv((matrix / divisor + np.diag(prior))[:lamps, :lamps])
    covariance[:lamps, :lamps] += given @ (np.diag(prior) + matrix / divisor**2)[:lamps, :lamps] @ given - given
    scale = np.sqrt(np.diag(covariance))[: 4 * count + 1]
    moved = np.concatenate([step.log_intensity, step.lamp_offset_m.T.ravel(), [step.shift_m]])
    np.testing.assert_allclose(moved / scale, dense[: 4 * count + 1] / scale, atol=1e-7)
    scales = np.sqrt(np.outer(*[np.diag(covariance)] * 2))
    np.testing.assert_allclose(step.covariance[:size, :size] / scales, covariance / scales, atol=1e-7)


def test_posterior_covariance_is_that_of_the_errors_of_independent_pixels() -> None:
    """Parameters drawn by the prior, and residuals by the images' information, which is weighed a twentieth."""
    rng, count, draws = np.random.default_rng(4), 5, 4000
    root = rng.normal(size=(count, count)) * np.geomspace(0.2, 20, count)
    information, precision = root @ root.T, np.diag(np.geomspace(0.5, 2, count))
    factor = np.linalg.cholesky(information)
    divisor = self_calibration.SETTINGS.effective_sample_divisor
    errors, said = np.empty((draws, count)), np.zeros((count, count))
    for error in errors:
        true = rng.normal(size=count) / np.sqrt(np.diag(precision))
        right = (information @ true + factor @ rng.normal(size=count)) / divisor
        nothing = np.zeros(count, bool)
        equations = Equations(information / divisor, right, precision, np.zeros(count), nothing, nothing)
        change, said = equations.posterior()
        error[:] = change - true
    whitened = np.linalg.solve(np.linalg.cholesky(said), errors.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(count), atol=0.1)


def test_posterior_of_terms_is_no_surer_than_images_are_weighed() -> None:
    """Terms approximate what surfaces do; given them, lamps are as sure as without any."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(4, 6))
    matrix, precision, nothing = root @ root.T, np.eye(4), np.zeros(4)
    terms = np.array([False, False, False, True])
    _, covariance = Equations(matrix, nothing, precision, nothing, terms & ~terms, terms).posterior()
    weighed = np.linalg.inv(matrix + precision)
    np.testing.assert_allclose(covariance[3], weighed[3], rtol=1e-9)
    lamps = slice(0, 3)
    _, given = Equations(
        matrix[lamps, lamps], nothing[lamps], precision[lamps, lamps], nothing[lamps], *[terms[lamps]] * 2
    ).posterior()
    by_term = np.outer(weighed[lamps, 3], weighed[3, lamps]) / weighed[3, 3]
    np.testing.assert_allclose(covariance[lamps, lamps], given + by_term, rtol=1e-9)


def test_position_derivative_equals_finite_difference() -> None:
    made, by = measured(size=9), 1e-4
    solution = pixel_solve.solve(made.pixels, made.values, made.depth_m, made.scene)
    derivative = self_calibration.position_derivative(solution, made.lamp)
    for axis in range(3):
        value = []
        for sign in (-1, 1):
            lamp = made.lamp.copy()
            lamp[:, axis] += sign * by
            light = photometry.light_vectors(solution.point, lamp, made.calibration)
            value.append(np.einsum("fck,ck->fk", light.astype(float), solution.g))
        np.testing.assert_allclose(derivative[:, axis], (value[1] - value[0]) / (2 * by), atol=0.02)


def test_step_displaced_lamps_recovers_offsets_with_true_sigma() -> None:
    """Directions that images do not determine, such as all lamps and the object moved together, keep their prior."""
    offsets_m, left, said = [], [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        made = measured(size=60)
        wrong = rng.normal(0, 0.001, (8, 3))
        lamp = made.lamp.copy()
        lamp[:, :3] -= wrong.astype(np.float32)
        images = (made.values + rng.normal(0, 0.002, made.values.shape)).astype(np.float32)
        present = SharedParameters.nominal(8)
        for _ in range(4):
            displaced = present.lamps(lamp)
            values = alternation.divide_intensity(images, present.log_intensity)
            solution = pixel_solve.solve(made.pixels, values, made.depth_m, replace(made.scene, lamps=displaced))
            change = pixel_solve.depth_derivative(solution.light, solution.point, made.ray_direction, displaced)
            step = self_calibration.gauss_newton_step(
                solution, change, values, displaced, present, Priors(STATED, 0.001, 0.0), 0.003
            )
            present = SharedParameters(
                present.log_intensity + step.log_intensity,
                present.lamp_offset_m + step.lamp_offset_m,
                0.0,
                step.covariance,
            )
        offsets_m.append(wrong)
        left.append(present.lamp_offset_m - wrong)
        said.append(np.sqrt(np.diag(present.covariance)[8:32]))
    assert np.std(left) < 0.85 * np.std(offsets_m)
    assert np.std(left) == pytest.approx(np.sqrt(np.mean(np.square(said))), rel=0.2)


def captured_with_offsets(
    true: scenes.Scene, nominal: list[Light], lamp_offset_m: np.ndarray, seed: int
) -> Observations:
    """Images of lamps displaced by `lamp_offset_m` (F, 3) from their recorded positions."""
    displaced = [
        Light(position=tuple((np.array(light.position) + by).tolist()), axis=light.axis)
        for light, by in zip(nominal, lamp_offset_m, strict=True)
    ]
    observations = scenes.capture(true, displaced, seed, intensity_sigma=0, position_sigma_m=0)
    shots = [shot.model_copy(update={"light": light}) for shot, light in zip(observations.shots, nominal, strict=True)]
    return replace(observations, shots=shots)


def test_solve_displaced_lamps_lowers_normal_error() -> None:
    """Against a calibration whose position σ is nearly zero, with images of exact intensities."""
    true = scenes.scene(scenes.sphere, scenes.calibration(96))
    nominal, offset_sigma_m = [*scenes.ring(6, 30.0), *scenes.ring(6, 55.0, 0.3)], 0.004
    offsets_m, estimated_offsets_m, error = [], [], {"sought": [], "held": []}
    for seed in range(3):
        offsets_m.append(np.random.default_rng(seed).normal(0, offset_sigma_m, (len(nominal), 3)))
        observations = captured_with_offsets(true, nominal, offsets_m[-1], seed)
        for name, sigma in (("sought", offset_sigma_m), ("held", 1e-6)):
            known = scenes.calibration(96, lamp_position_sigma_m=sigma)
            normal_map = normals.solve(
                observations, known, SolveSettings(), normals.ObjectPlace(0.87, region=true.mask)
            )
            error[name].append(np.mean(true.error_deg(normal_map.normals)))
            if name == "sought":
                estimated_offsets_m.append(normal_map.notes["lamps_aside_m"])
            else:
                assert np.max(np.abs(normal_map.notes["lamps_aside_m"])) < 1e-6
    assert np.corrcoef(np.ravel(estimated_offsets_m), np.ravel(offsets_m))[0, 1] > 0.7
    assert np.std(np.array(estimated_offsets_m) - offsets_m) < 0.75 * np.std(offsets_m)
    assert np.mean(error["sought"]) < 0.9 * np.mean(error["held"])


def test_shared_normal_variance_where_albedo_vanishes_is_that_of_random_normal() -> None:
    made, count = measured(size=9), 8
    solved = pixel_solve.solve(made.pixels, made.values, made.depth_m, made.scene)
    g = solved.g.copy()
    g[:, 0] *= 1e-7
    nominal = SharedParameters.nominal(count)
    shared = replace(nominal, covariance=1e-4 * np.eye(len(nominal.covariance)))
    indirect = np.full(made.values.shape, 0.01, np.float32)

    def variance(estimate: Estimate) -> np.ndarray:
        return alternation.shared_normal_variance(estimate, shared, made.ray_direction, made.lamp, indirect)

    found = variance(replace(solved, g=g))
    assert found[0] == np.float32(photometry.RANDOM_NORMAL_VARIANCE)
    np.testing.assert_array_equal(found[1:], variance(solved)[1:])
    assert np.all(found[1:] < 0.01)
