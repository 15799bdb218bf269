"""Moves of the object or the camera that leave a good fit."""

from tests.unseen import with_fault


def test_solve_cluster_moved_by_two_pixels_is_registered() -> None:
    """Its fit is good, but its error is three times as large without registration."""
    pair = with_fault.solved("cluster", 64, "lambert", "moved:2")
    assert with_fault.kinds(pair.faulty) == [("moved object", True)]
    assert pair.error_ratio < 1.7


def test_solve_move_that_the_surface_has_made_up_for_is_told_by_the_loss() -> None:
    """Registration hardly lowers the misfit, a median, but lowers the loss to 0.7. Without registration the error is
    2.7 times that without a move."""
    pair = with_fault.solved("sheet", 469, "lambert", "moved:2", 8, pixels=96)
    assert with_fault.kinds(pair.faulty) == [("moved object", True)]
    assert pair.error_ratio < 1.3
