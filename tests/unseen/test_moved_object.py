"""A move of object or camera that leaves a sound fit."""

from tests.unseen import with_fault


def test_solve_cluster_moved_by_two_pixels_is_registered() -> None:
    """Its fit is sound, and its normals are three times as far off without registration."""
    pair = with_fault.solved("cluster", 64, "lambert", "moved:2")
    assert with_fault.kinds(pair.faulty) == [("moved object", True)]
    assert pair.error_ratio < 1.7
