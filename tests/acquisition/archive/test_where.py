"""Conditions: each form as SQL with bound values, versions as versions, and nothing else gets through."""

import contextlib

import pytest
import sqlalchemy as sa
from hypothesis import given
from hypothesis import strategies as st
from packaging.version import Version

from acquisition.archive import where
from acquisition.archive.entries import version_order
from acquisition.models.errors import ErrorCode, RigError

NUMBERS = st.lists(st.integers(0, 300), min_size=1, max_size=4).map(lambda parts: ".".join(map(str, parts)))
SUFFIXES = st.sampled_from(["", "rc1", "rc2", "a1", "b3", ".dev4", ".post1"])
VERSIONS = st.builds(lambda numbers, suffix: numbers + suffix, NUMBERS, SUFFIXES)


@given(VERSIONS, VERSIONS)
def test_version_order_sorts_as_packaging_does(one: str, two: str):
    assert (version_order(one) < version_order(two)) == (Version(one) < Version(two))


@pytest.mark.parametrize(
    ("condition", "complaint"),
    [
        ("", "cannot be read at its end"),
        ("object = 'a", "cannot be read at position 10"),
        ("colour = 'red'", "colour is unknown"),
        ("sigma > 'x'", "compared with a number"),
        ("object = 3", "compared with a text"),
        ("solver < 2", "compared with a version"),
        ("solver < 'new'", "is not a version"),
        ("captured > 'yesterday'", "is not a date"),
        ("lights ~ '3'", "~ needs a text column and a text in quotes, not lights ~ '3'"),
        ("sigma > 1; drop table session", "cannot be read at position 10"),
    ],
)
def test_parse_bad_condition_says_what_is_wrong(condition: str, complaint: str):
    with pytest.raises(RigError, match=complaint) as refused:
        where.parse(condition)
    assert refused.value.code is ErrorCode.ARCHIVE_QUERY_INVALID


def test_parse_precedence_is_not_and_or():
    text = str(where.parse("not object = 'a' and lights = 1 or lights = 2"))
    assert text == "session.object != :object_1 AND session.lights = :lights_1 OR session.lights = :lights_2"


@given(st.text(st.characters(exclude_characters="'"), max_size=40))
def test_parse_text_is_a_bound_value_only(text: str):
    compiled = where.parse(f"object = '{text}'").compile()
    assert compiled.params == {"object_1": text}
    assert str(compiled) == "session.object = :object_1"


@given(st.text("andorti (<>=~)'\"solver12.", max_size=40))
def test_parse_garbage_is_refused_by_its_code(text: str):
    with contextlib.suppress(RigError):  # anything but this error fails, and so does SQL that is no condition
        assert isinstance(where.parse(text), sa.ColumnElement)


@pytest.mark.parametrize("name", sorted(where.COLUMNS))
def test_parse_reads_every_name_whole(name: str):
    """Names may begin as words of the grammar do: notes, object, kind."""
    assert where.parse(f"{name} is unknown").compare(where.COLUMNS[name].is_(None))
    assert where.parse(f"NOT {name} is unknown or not({name} IS unknown)").compare(
        sa.or_(where.COLUMNS[name].is_not(None), where.COLUMNS[name].is_not(None))
    )
