"""No tuned number of solver and planner stands outside of settings but those named, and each has unit and meaning."""

import json
from collections import Counter
from pathlib import Path

from tests import tuned_numbers

SENSITIVITY = Path(__file__).parents[1] / "docs" / "reference" / "sensitivity.json"

MOST = 60
"""Tuned numbers in settings: a new one takes the place of another."""


def test_constants_with_numbers_are_settings_or_named_with_a_reason() -> None:
    found = set(tuned_numbers.constants())
    named = tuned_numbers.allowed()
    assert sorted(found - named) == [], "move them into the module's SETTINGS, or say in tests/tuned_numbers.py why not"
    assert sorted(named - found) == [], "they are gone: take them out of tests/tuned_numbers.py"


def test_constants_are_named_once() -> None:
    names = [name for names in tuned_numbers.REASONS.values() for name in names.split()]
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_numbers_in_functions_are_no_more_than_named() -> None:
    assert tuned_numbers.inline() == tuned_numbers.INLINE


def test_tuned_numbers_have_unit_and_meaning_and_are_no_more() -> None:
    found = tuned_numbers.settings()
    assert [f"{one.module}.{one.name}" for one in found if not (one.unit and one.meaning)] == []
    assert len(found) == MOST


def test_plain_numbers_leave_out_tuned_ones() -> None:
    assert all(tuned_numbers.is_plain(value) for value in (0.0, 0.5, 7, "0.3", 1e-9))
    assert not any(tuned_numbers.is_plain(value) for value in (0.3, 1e-3, 2.5, 98.0))


def test_sensitivities_are_of_numbers_that_there_are() -> None:
    parts = json.loads(SENSITIVITY.read_text(encoding="utf-8"))
    stated = {name for part in parts.values() for name in part["numbers"]}
    assert sorted(stated - {number.key for number in tuned_numbers.settings()}) == []
