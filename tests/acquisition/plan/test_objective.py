"""Scaling of the loss by the two-ring posterior: the cap of the variance."""

import numpy as np
import pytest

from acquisition.plan import objective
from acquisition.plan.criterion import Posterior


def of_sigmas(*sigma_deg: float) -> Posterior:
    """A two-ring posterior of pixels with these σ in all three scenarios."""
    variance = np.tile(np.radians(sigma_deg) ** 2, (3, 1))
    return Posterior(np.zeros((3, 10, len(sigma_deg)), np.float32), variance, np.full(variance.shape, 4.0))


@pytest.mark.parametrize(
    ("sigma_deg", "cap_deg"),
    [((0.1, 0.3), 3.0), ((0.7, 0.7), 3.0), ((1.0, 1.0), 4.0), ((1.0, 3.0), 8.0)],  # four times the mean, or 3°
)
def test_loss_uncertain_two_rings_raises_cap(sigma_deg: tuple[float, float], cap_deg: float) -> None:
    loss = objective.capped(of_sigmas(*sigma_deg))
    assert loss.inverse_cap == pytest.approx(np.radians(cap_deg) ** -2)
