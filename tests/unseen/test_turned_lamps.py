"""Turned lamps of a machined part, which near light reveals, and mirrored lamps, which also score as turned.

The normals of a machined part have the same circulation under any turn.
"""

import pytest

from tests.unseen import with_fault


@pytest.mark.parametrize(
    ("family", "fault"),
    [
        ("machined", "turned:10"),
        pytest.param("machined", "turned:-45", marks=pytest.mark.long),
        pytest.param("turned", "mirrored-x", marks=pytest.mark.long),
    ],
)
def test_solve_under_turned_or_mirrored_lamps_is_as_under_stated_ones(family: str, fault: str) -> None:
    pair = with_fault.solved(family, 62, "lambert", fault)
    assert with_fault.kinds(pair.faulty) == [("axes of the lamps", True)]
    assert pair.error_ratio < 1.1
