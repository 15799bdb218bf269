"""Coded values of a path-traced object, which a wrong position of the object explains nearly as well."""

import pytest

from tests.unseen import with_fault


@pytest.mark.long
def test_solve_coded_values_of_machined_part_are_linearised() -> None:
    pair = with_fault.solved("machined", 62, "lambert", "gamma", 12)
    assert with_fault.kinds(pair.faulty) == [("coded values", True)]
    assert pair.error_ratio < 1.35
    assert pair.faulty_deg < 2.6
