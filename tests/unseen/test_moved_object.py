"""A move of object or camera that leaves a sound fit."""

from tests.unseen import with_fault


def test_solve_cluster_moved_by_two_pixels_is_registered() -> None:
    """Its fit is sound, and its normals are three times as far off without registration."""
    pair = with_fault.solved("cluster", 64, "lambert", "moved:2")
    assert with_fault.kinds(pair.faulty) == [("moved object", True)]
    assert pair.error_ratio < 1.7


def test_solve_move_that_the_surface_has_made_up_for_is_told_by_the_loss() -> None:
    """The misfit, a median, hardly falls with registered images, the loss to 0.7; unregistered, errors are 2.7 times
    those without a move."""
    pair = with_fault.solved("sheet", 469, "lambert", "moved:2", 8, pixels=96)
    assert with_fault.kinds(pair.faulty) == [("moved object", True)]
    assert pair.error_ratio < 1.3
