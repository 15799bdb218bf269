"""The σ that a plan expects: what misfit, few lights and findings add to the posterior."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import photometry, pilot
from acquisition.models.recipe import Recipe
from acquisition.models.result import ModelFinding
from acquisition.plan.criterion import Posterior
from acquisition.plan.expected_sigma import ExpectedSigma
from tests.acquisition import scenes
from tests.acquisition.plan import cases


def posterior(sigma_deg: float, lit: float = 6.0) -> Posterior:
    return Posterior(
        np.zeros((4, 4, 5)),
        np.full(5, np.radians(sigma_deg) ** 2),
        np.full(5, lit),
    )


def bounded(variance_deg2: float) -> float:
    """σ of a variance by the images, deg², and of a random normal together."""
    return float(1 / np.sqrt(1 / variance_deg2 + 1 / photometry.RANDOM_NORMAL_SIGMA_DEG**2))


def test_sigma_misfit_part_does_not_fall_with_lights() -> None:
    """Posterior variances fall as the lights' number rises; what images share does not."""
    few, many = (ExpectedSigma(1e6).sigma_deg(posterior(1.0 / np.sqrt(lit), lit)) for lit in (5.0, 500.0))
    assert few == pytest.approx(many, rel=1e-3)


def test_sigma_of_unlit_pixel_is_a_random_normals() -> None:
    assert ExpectedSigma().sigma_deg(posterior(1e4)) == pytest.approx(photometry.RANDOM_NORMAL_SIGMA_DEG, rel=1e-3)


def test_sigma_rises_with_misfit_of_images_so_far() -> None:
    tuned = photometry.SETTINGS
    factor = 1 + tuned.misfit_factor * 6 * (3 - 1)
    variance = factor * 2.0**2
    assert ExpectedSigma(3.0).sigma_deg(posterior(2.0)) == pytest.approx(bounded(variance))


@pytest.mark.parametrize(
    ("expected", "lit", "added_deg"),
    [
        (ExpectedSigma(), 3.0, photometry.SETTINGS.unchecked_sigma_deg),
        (ExpectedSigma(capture_deg=7.0), 4.0, 7.0),
    ],
)
def test_sigma_component_adds_in_quadrature(expected: ExpectedSigma, lit: float, added_deg: float) -> None:
    plain = 1
    assert expected.sigma_deg(posterior(1.0, lit)) == pytest.approx(bounded(plain + added_deg**2))


def test_sigma_of_structure_adds_to_the_mean() -> None:
    """A few pixels on creases have it, and the others nothing of it."""
    assert ExpectedSigma(structure_deg=3.0).sigma_deg(posterior(1.0)) == pytest.approx(bounded(1.0) + 3.0)


def test_of_normal_map_reads_misfit_and_findings() -> None:
    true = scenes.scene(scenes.sphere, scenes.calibration(48))
    known = cases.known_map(true, pilot.pattern(Recipe(), scenes.Dome(refused=0)))
    more = replace(known, flags=np.concatenate([known.flags, known.flags[:1]]))
    for images, counted in ((known, [1.0, 2.0, 9.0]), (more, [1.0, 4.0, 81.0])):
        stated = [ExpectedSigma.of(replace(images, noise={"misfit": misfit})).misfit for misfit in (0.2, 4.0, 81.0)]
        assert stated == counted
    assert ExpectedSigma.of(known) == ExpectedSigma()
    for images, freedom in ((known, 1), (more, 2)):
        stated = ExpectedSigma.of(replace(images, noise={"structure_deg": 1.5})).structure_deg
        assert stated == pytest.approx(1.5 * np.sqrt((freedom + 1) / freedom))
    corrected, left = (ModelFinding(kind="lamps", message="-", corrected=one) for one in (True, False))
    metal = ModelFinding(kind=photometry.METAL, message="-", corrected=True)
    settings = photometry.SETTINGS
    half = settings.unchecked_sigma_deg / 2
    for findings, of_pilot, of_more in (
        ((corrected,), 0.0, 0.0),
        ((corrected, metal), half, half),
        ((left,), 0.0, settings.unchecked_sigma_deg),
        ((metal, left), half, settings.unchecked_sigma_deg),
    ):
        assert ExpectedSigma.of(replace(known, findings=findings)).capture_deg == of_pilot
        assert ExpectedSigma.of(replace(more, findings=findings)).capture_deg == of_more
