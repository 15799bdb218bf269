"""Registration of images that moved once."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from acquisition.normals.alternatives import registration


@given(
    st.integers(1, 11), st.tuples(st.floats(0.5, 3), st.floats(0.5, 3)), st.integers(0, 1000)
)  # fmt: skip
def test_single_move_of_noisy_translations_recovers_split_and_move(
    split: int, move: tuple[float, float], seed: int
) -> None:
    """Twelve images, each known to 0.05 pixels, moved by half a pixel and more between two of them."""
    truth = np.zeros((12, 2))
    truth[split:] = move
    noisy = truth + np.random.default_rng(seed).normal(0, 0.05, truth.shape)
    result = registration.single_move(noisy)
    assert np.all(result[:split] == 0)
    assert np.allclose(result[split:], move, atol=0.3)


def test_single_move_ignores_an_outlier() -> None:
    translations = np.zeros((10, 2))
    translations[6:] = 1.0
    translations[2] = 5.0
    result = registration.single_move(translations)
    assert np.all(result[:6] == 0)
    assert np.all(result[6:] == 1)
