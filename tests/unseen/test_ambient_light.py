"""Ambient light on a path-traced object whose images turned lamps fit better than the plain model does."""

from tests.unseen import with_fault


def test_solve_ambient_light_is_not_taken_for_turned_lamps() -> None:
    pair = with_fault.solved("turned", 63, "lambert", "ambient:0.1")
    assert with_fault.kinds(pair.faulty) == [("ambient light", True)]
    assert pair.error_ratio < 1.3
