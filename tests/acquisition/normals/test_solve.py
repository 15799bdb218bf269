"""The solver on scenes of known truth: perspective, near light, shadows, sensor noise, unknown intensities."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import normals
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.result import ATTACHED, CAST, LIT, SATURATED, NormalMap, SolveSettings
from acquisition.models.shot import Observations, Shot
from acquisition.normals.images.image_set import direction_spread
from acquisition.plan import baselines
from tests.acquisition import scenes

SIZE = 112
ROUGH_DEPTH_M = scenes.TABLE_DEPTH - 0.045


@pytest.fixture(scope="module")
def ball() -> scenes.Scene:
    return scenes.scene(scenes.sphere, scenes.calibration(SIZE))


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(SIZE))


def two_rings(count: int, turn: float = 0.2) -> list[Light]:
    center = scenes.Dome(refused=0).center
    lights = []
    for unit in baselines.two_rings(count, turn):
        lights.append(Light(position=tuple((center + 0.45 * unit).tolist()), axis=tuple((-unit).tolist())))
    return lights


def solved(
    observations: Observations, known: Calibration, settings: SolveSettings | None = None, **options: object
) -> NormalMap:
    return normals.solve(
        observations, known, settings or SolveSettings(), normals.ObjectPlace(ROUGH_DEPTH_M, **options)
    )


@pytest.fixture(scope="module")
def clean(cushion: scenes.Scene) -> NormalMap:
    observations = scenes.capture(cushion, two_rings(12), intensity_sigma=0, position_sigma_m=0, noisy=False)
    return solved(observations, cushion.calibration)


def test_solve_noise_free_cushion_recovers_normals(clean: NormalMap, cushion: scenes.Scene) -> None:
    error = cushion.error_deg(clean.normals)
    assert np.mean(error) < 0.5
    assert np.median(error) < 0.25
    assert np.mean(clean.mask[cushion.graded]) > 0.995


def test_solve_noise_free_sphere_recovers_normals(ball: scenes.Scene) -> None:
    observations = scenes.capture(ball, two_rings(12), intensity_sigma=0, position_sigma_m=0, noisy=False)
    error = ball.error_deg(solved(observations, ball.calibration).normals)
    assert np.mean(error) < 0.5


def test_solve_albedo_is_absolute_and_normals_are_unit(clean: NormalMap, cushion: scenes.Scene) -> None:
    assert np.median(clean.albedo[cushion.graded]) == pytest.approx(0.5, rel=0.08)
    np.testing.assert_allclose(np.linalg.norm(clean.normals[clean.mask], axis=-1), 1, atol=1e-5)
    assert np.all(clean.normals[~clean.mask] == 0)
    assert np.all(np.isnan(clean.sigma_deg[~clean.mask]))


def test_solve_noise_free_cushion_recovers_depth(clean: NormalMap, cushion: scenes.Scene) -> None:
    where = cushion.graded & clean.mask
    difference = clean.depth[where] - cushion.depth[where]
    assert np.std(difference) < 0.0012


def test_solve_shadowed_measurements_are_flagged(clean: NormalMap, cushion: scenes.Scene) -> None:
    dark, lit = [], []
    for number, light in enumerate(two_rings(12)):
        value = scenes.lit(cushion, light)[cushion.graded]
        flags = clean.flags[number][cushion.graded]
        dark.append(((flags & (ATTACHED | CAST)) > 0)[value == 0])
        lit.append(((flags & LIT) > 0)[value > 0.15 * cushion.albedo[cushion.graded]])
    assert np.concatenate(dark).size > 200
    assert np.mean(np.concatenate(dark)) > 0.95
    assert np.mean(np.concatenate(lit)) > 0.98


def test_solve_flags_distinguish_cast_and_attached_shadows(clean: NormalMap, cushion: scenes.Scene) -> None:
    right = total = 0
    for number, light in enumerate(two_rings(12)):
        toward = np.array(light.position)[:, None, None] - cushion.points
        cosine = np.einsum("hwc,chw->hw", cushion.normals, toward) / np.linalg.norm(toward, axis=0)
        dark = cushion.graded & (scenes.lit(cushion, light) == 0)
        for kind, where in ((ATTACHED, dark & (cosine < -0.05)), (CAST, dark & (cosine > 0.25))):
            right += int(np.count_nonzero(clean.flags[number][where] & kind))
            total += int(np.count_nonzero(where))
    assert total > 150
    assert right > 0.85 * total


def test_solve_noisy_images_error_below_nine_tenths_degree(cushion: scenes.Scene) -> None:
    result = solved(scenes.capture(cushion, two_rings(12), seed=1), cushion.calibration)
    assert np.mean(cushion.error_deg(result.normals)) < 0.9


@pytest.mark.long
@pytest.mark.parametrize("shape", ["ball", "cushion"])
def test_solve_several_draws_sigma_is_calibrated(shape: str, request: pytest.FixtureRequest) -> None:
    """P(e < σ) is 0.632 and P(e < 2σ) 0.982 for a Rayleigh error; errors of one draw go together, so four are taken."""
    true: scenes.Scene = request.getfixturevalue(shape)
    within, within_two = [], []
    for seed in range(4):
        result = solved(scenes.capture(true, two_rings(8, turn=0.13 * seed), seed=seed), true.calibration)
        sigma = result.sigma_deg[true.graded]
        error = true.error_deg(result.normals)
        known = np.isfinite(sigma)
        within.append(np.mean(error[known] < sigma[known]))
        within_two.append(np.mean(error[known] < 2 * sigma[known]))
    assert 0.5 < np.mean(within) < 0.85
    assert np.mean(within_two) > 0.93


def test_solve_pixels_with_two_lights_have_large_sigma(cushion: scenes.Scene) -> None:
    result = solved(scenes.capture(cushion, scenes.ring(4, 60.0, turn=0.3), seed=2), cushion.calibration)
    lights = np.count_nonzero(result.flags & LIT, axis=0)
    two = result.mask & (lights == 2) & cushion.graded
    all_four = result.mask & (lights == 4) & cushion.graded
    assert np.count_nonzero(two) > 30
    assert np.median(result.sigma_deg[two]) > 4 * np.median(result.sigma_deg[all_four])
    assert np.median(result.sigma_deg[two]) > 4.0
    assert np.all(result.doubtful[two])


def test_solve_pixels_with_one_light_are_unsolved(cushion: scenes.Scene) -> None:
    result = solved(scenes.capture(cushion, scenes.ring(3, 78.0), seed=2), cushion.calibration)
    lights = np.count_nonzero(result.flags & LIT, axis=0)
    one = (lights < 2) & cushion.graded
    assert np.count_nonzero(one) > 30
    assert not np.any(result.mask & one)
    assert np.all(np.isnan(result.sigma_deg[one]))
    assert np.all(result.normals[one] == 0)


def test_solve_saturated_measurements_are_flagged_and_unused(cushion: scenes.Scene) -> None:
    """Three of ten images are exposed twice too long."""
    lights = two_rings(10)
    usual = scenes.capture(cushion, lights, seed=3)
    seconds = 2.0 * max(shot.exposure_s for shot in usual.shots)
    longer = scenes.capture(cushion, lights[:3], seed=3, exposure_s=seconds)
    frames = scenes.Frames()
    frames.stored = usual.frames.stored | {f"longer/{name}": frame for name, frame in longer.frames.stored.items()}

    def moved(shot: Shot) -> Shot:
        return shot.model_copy(update={"frame": shot.frame.model_copy(update={"path": f"longer/{shot.frame.path}"})})

    observations = Observations(
        shots=[*(moved(shot) for shot in longer.shots), *usual.shots[3:]],
        darks=usual.darks | {seconds: moved(longer.darks[seconds])},
        frames=frames,
    )
    result = solved(observations, cushion.calibration)
    clipped = 0
    for number, light in enumerate(lights[:3]):
        level = scenes.lit(cushion, light) * cushion.calibration.lamp_intensity * seconds
        over, under = cushion.graded & (level > 1.1), cushion.graded & (level < 0.85)
        clipped += np.count_nonzero(over)
        assert np.all(result.flags[number][over] & SATURATED)
        assert not np.any(result.flags[number][over] & LIT)
        assert not np.any(result.flags[number][under] & SATURATED)
    assert clipped > 500
    assert np.mean(cushion.error_deg(result.normals)) < 1.5


def test_solve_one_bright_lamp_recovers_intensity_factor(cushion: scenes.Scene) -> None:
    """One lamp image of 3 % too much light is brought to within 1 %; factors are free in their mean."""
    lights = two_rings(10)
    observations = scenes.capture(cushion, lights, seed=4, intensity_sigma=0.0, position_sigma_m=0.0)
    stored = observations.frames.stored
    name = observations.shots[6].frame.path
    black = cushion.calibration.sensor.black_level_dn
    stored[name] = np.round(black + 1.03 * (stored[name] - black)).astype(np.uint16)
    factors = solved(observations, cushion.calibration).intensity_factors
    others = np.delete(factors, 6)
    assert factors[6] / np.exp(np.mean(np.log(others))) == pytest.approx(1.03, abs=0.01)
    assert np.all(np.abs(others / np.exp(np.mean(np.log(others))) - 1) < 0.01)


def test_solve_initial_depth_off_by_15_mm_recovers_normals(cushion: scenes.Scene) -> None:
    observations = scenes.capture(cushion, two_rings(10), intensity_sigma=0, position_sigma_m=0, noisy=False)
    errors = [
        np.mean(
            cushion.error_deg(
                normals.solve(
                    observations, cushion.calibration, SolveSettings(), normals.ObjectPlace(ROUGH_DEPTH_M + off)
                ).normals
            )
        )
        for off in (-0.015, 0.015)
    ]
    assert max(errors) < 0.7


def test_solve_region_leaves_normals_inside_unchanged(cushion: scenes.Scene) -> None:
    """Only the region's rows and columns are read; what is solved there does not depend on it."""
    observations = scenes.capture(cushion, two_rings(8), seed=5)
    rows, columns = np.nonzero(cushion.mask)
    region = np.zeros_like(cushion.mask)
    region[rows.min() - 5 : rows.max() + 6, columns.min() - 4 : columns.max() + 7] = True
    full, part = solved(observations, cushion.calibration), solved(observations, cushion.calibration, region=region)
    assert not np.any(part.mask & ~region)
    both = full.mask & part.mask & cushion.graded
    assert np.count_nonzero(both) > 0.99 * np.count_nonzero(cushion.graded)
    cosine = np.sum(full.normals[both] * part.normals[both], axis=-1)
    assert np.percentile(np.degrees(np.arccos(np.clip(cosine, -1, 1))), 95) < 0.3


def test_solve_same_images_twice_is_deterministic(cushion: scenes.Scene) -> None:
    observations = scenes.capture(cushion, two_rings(6), seed=6)
    first, second = (solved(observations, cushion.calibration) for _ in range(2))
    np.testing.assert_array_equal(first.normals, second.normals)
    np.testing.assert_array_equal(first.information.matrices, second.information.matrices)


def test_fisher_information_is_symmetric_positive_at_solved_pixels(clean: NormalMap) -> None:
    matrices = clean.information.matrices
    np.testing.assert_allclose(matrices, matrices.transpose(0, 2, 1), rtol=1e-9, atol=1e-6)
    assert np.all(np.linalg.eigvalsh(matrices)[:, 0] > -1e-6 * np.linalg.eigvalsh(matrices)[:, -1])
    assert np.all(clean.mask[clean.information.rows, clean.information.columns])


# --------------------------------------------------------------------------------------------------------- bad input


def refused(observations: Observations, known: Calibration, **options: object) -> RigError:
    with pytest.raises(RigError) as caught:
        solved(observations, known, **options)
    assert caught.value.code == ErrorCode.NORMALS_INFEASIBLE
    return caught.value


@pytest.fixture(scope="module")
def observations(cushion: scenes.Scene) -> Observations:
    return scenes.capture(cushion, two_rings(5), seed=7)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_solve_fewer_than_three_lights_is_refused(
    count: int, observations: Observations, cushion: scenes.Scene
) -> None:
    error = refused(replace(observations, shots=observations.shots[:count]), cushion.calibration)
    assert "at least three" in error.detail
    assert error.context["lights"] == count


def test_solve_parallel_lights_is_refused(cushion: scenes.Scene) -> None:
    one = two_rings(3)[0]
    assert "parallel" in refused(scenes.capture(cushion, [one, one, one]), cushion.calibration).detail


def test_solve_coplanar_lights_is_refused(cushion: scenes.Scene) -> None:
    line = [scenes.ring(1, slant)[0] for slant in (10.0, 30.0, 50.0)]
    assert "one plane" in refused(scenes.capture(cushion, line), cushion.calibration).detail


def test_solve_lights_close_together_has_a_sigma_that_says_so(cushion: scenes.Scene) -> None:
    """Within 3° of one direction: what differs between the images is of the size of the intensities' errors."""
    lights = scenes.ring(8, 2.6)
    assert 0.02 < direction_spread(np.array([light.axis for light in lights])) < 0.05
    result = solved(scenes.capture(cushion, lights, seed=7), cushion.calibration)
    shown = result.mask & cushion.graded
    error, sigma = cushion.error_deg(result.normals)[shown[cushion.graded]], result.sigma_deg[shown]
    assert np.median(sigma) > 5
    assert 0.5 < np.sqrt(np.mean((error / sigma) ** 2)) < 2  # the errors of few lights are common to all pixels


def test_solve_empty_region_is_refused(observations: Observations, cushion: scenes.Scene) -> None:
    refused(observations, cushion.calibration, region=np.zeros_like(cushion.mask))


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (1, 40), (40, 1)])
def test_solve_object_of_hardly_a_pixel_is_refused(
    shape: tuple[int, int], observations: Observations, cushion: scenes.Scene
) -> None:
    """Too few pixels, or a single row or column of them, of which nothing can be integrated."""
    silhouette = np.zeros_like(cushion.mask)
    silhouette[20 : 20 + shape[0], 20 : 20 + shape[1]] = True
    assert "no object" in refused(observations, cushion.calibration, silhouette=silhouette).detail


def test_solve_region_of_other_size_is_refused(observations: Observations, cushion: scenes.Scene) -> None:
    refused(observations, cushion.calibration, region=np.ones((10, 10), np.bool_))


def test_solve_light_at_nan_is_refused(observations: Observations, cushion: scenes.Scene) -> None:
    shots = list(observations.shots)
    nowhere = Light.model_construct(position=(float("nan"), 0.0, 0.0), axis=(0.0, 0.0, -1.0))
    shots[2] = shots[2].model_copy(update={"light": nowhere})
    assert "is not finite" in refused(replace(observations, shots=shots), cushion.calibration).detail


def test_solve_missing_lamp_off_frame_is_named(observations: Observations, cushion: scenes.Scene) -> None:
    gone = observations.shots[3].exposure_s
    darks = {seconds: shot for seconds, shot in observations.darks.items() if seconds != gone}
    error = refused(replace(observations, darks=darks), cushion.calibration)
    assert "lamp-off" in error.detail
    assert error.context["file"] in {shot.frame.path for shot in observations.shots if shot.exposure_s == gone}


def test_solve_frame_of_other_size_is_named(observations: Observations) -> None:
    assert "pixels" in refused(observations, scenes.calibration(SIZE // 2)).detail


def test_solve_dark_images_is_refused(observations: Observations, cushion: scenes.Scene) -> None:
    frames = scenes.Frames()
    frames.stored = {name: np.full_like(frame, 64) for name, frame in observations.frames.stored.items()}
    refused(replace(observations, frames=frames), cushion.calibration)
