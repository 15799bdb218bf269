"""Percentages for people: a small share is not told as 0, whether it is a finding's, a report's or a command's."""

import re
from pathlib import Path

import pytest

from acquisition.models.rounding import figure, percent
from acquisition.normals.alternatives.alternative import Alternative, Limits
from acquisition.normals.alternatives.model_trial import Hypothesis
from acquisition.normals.pixels.image_terms import ImageTerms

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("share", "decimals", "text"),
    [
        (0.1234, 1, "12.3"),
        (0.1234, 0, "12"),
        (1.0, 0, "100"),
        (0.0, 1, "0"),
        (0.00062, 1, "0.1"),
        (0.00031, 1, "0.03"),
        (0.00096, 0, "0.1"),
        (0.004, 0, "0.4"),
        (0.000012, 2, "0.001"),
        (3e-9, 1, "under 0.001"),
        (-0.0004, 1, "-0.04"),
        (float("nan"), 1, "nan"),
    ],
)
def test_percent_small_share_is_not_zero(share: float, decimals: int, text: str) -> None:
    assert percent(share, decimals) == f"{text} %"


@pytest.mark.parametrize(
    ("share", "text"), [(0.031, "+3.1"), (-0.031, "-3.1"), (4e-4, "+0.04"), (-4e-8, "under ±0.001")]
)
def test_percent_signed_share_has_its_sign(share: float, text: str) -> None:
    assert percent(share, signed=True) == f"{text} %"


def test_figure_of_small_value_in_any_unit_is_not_zero() -> None:
    assert [figure(value, 2) for value in (1.5, 0.004, 0.0, 2e-4)] == ["1.50", "0.004", "0", "under 0.001"]


@pytest.mark.parametrize("term", ["ambient", "offset"])
def test_finding_of_little_ambient_light_states_how_much(term: str) -> None:
    alternative = Alternative(term, "there is light", Hypothesis.__new__(Hypothesis), (Limits(1.0),), term=term)
    assert alternative.finding(ImageTerms(**{term: 0.0003})).message == "there is light (0.03 % of white)"


def test_messages_state_shares_by_one_function() -> None:
    """`{share:.1%}` would tell a small share as 0.0%, and without the space; so would a sign written by hand."""
    files = [file for part in ("acquisition", "api", "hardware_sim") for file in (ROOT / part).rglob("*.py")]
    sign = re.compile(r":[+]?\.\d%\}|[})]%(?! \()|\{[^{}]*percent\([^{}]*\)\} ?%")
    assert [str(file.relative_to(ROOT)) for file in files if sign.search(file.read_text())] == []
