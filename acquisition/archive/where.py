"""Conditions on sessions (`--where`): a small grammar, parsed by lark into an SQLAlchemy condition.

No user's text reaches the database as SQL: names are looked up in a table here, values are bound parameters. Versions
compare as versions (0.9 < 0.10), times are ISO 8601 dates, and `~` finds a part of a text, ignoring case.

    solver < '0.2' and object ~ 'vase' and not (sigma > 1.5 or captured >= '2026-03-01')
"""

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from lark import Lark, Token, Transformer
from lark.exceptions import UnexpectedInput, VisitError

from acquisition.archive.catalogue import session
from acquisition.archive.entries import version_order
from acquisition.models.errors import ErrorCode, RigError

COLUMNS: dict[str, sa.Column[Any]] = {
    "object": session.c.object,
    "notes": session.c.notes,
    "id": session.c.session_id,
    "key": session.c.key,
    "cell": session.c.cell,
    "kind": session.c.kind,
    "method": session.c.method,
    "calibration": session.c.calibration,
    "solver": session.c.solver_order,
    "software": session.c.software,
    "sigma": session.c.sigma_deg,
    "lights": session.c.lights,
    "width": session.c.width,
    "height": session.c.height,
    "bytes": session.c.bytes,
    "captured": session.c.captured_at,
    "pushed": session.c.pushed_at,
}
"""Columns by the names that a condition may use."""

_TIMES, _VERSIONS = ("captured", "pushed"), ("solver",)
_GRAMMAR = r"""
?start: any
?any: all (_OR all)*
?all: one (_AND one)*
?one: _NOT one -> inverse
    | "(" any ")"
    | NAME OPERATOR value -> comparison
    | NAME _IS _UNKNOWN -> unknown
value: TEXT | NUMBER
_OR: /or\b/i
_AND: /and\b/i
_NOT: /not\b/i
_IS: /is\b/i
_UNKNOWN: /unknown\b/i
NAME: /[a-z_]+\b/
OPERATOR: "<=" | ">=" | "!=" | "<" | ">" | "=" | "~"
TEXT: /'[^']*'/ | /"[^"]*"/
NUMBER: /-?\d+(\.\d+)?([eE][-+]?\d+)?/
%ignore /\s+/
"""
_PARSER = Lark(_GRAMMAR, parser="earley")


class _ToSql(Transformer[Token, sa.ColumnElement[bool]]):
    """Transforms a parsed condition into SQLAlchemy's."""

    def any(self, parts: list[sa.ColumnElement[bool]]) -> sa.ColumnElement[bool]:
        return sa.or_(*parts)

    def all(self, parts: list[sa.ColumnElement[bool]]) -> sa.ColumnElement[bool]:
        return sa.and_(*parts)

    def inverse(self, parts: list[sa.ColumnElement[bool]]) -> sa.ColumnElement[bool]:
        return sa.not_(parts[0])

    def unknown(self, parts: list[Token]) -> sa.ColumnElement[bool]:
        return _column(str(parts[0])).is_(None)

    def value(self, parts: list[Token]) -> Token:
        return parts[0]

    def comparison(self, parts: list[Token]) -> sa.ColumnElement[bool]:
        name, operator, value = parts
        column = _column(str(name))
        text = None if value.type == "NUMBER" else str(value)[1:-1]
        if operator == "~":
            if text is None or not isinstance(column.type, sa.String) or name in _VERSIONS:
                raise ValueError(f"~ needs a text column and a text in quotes, not {name} ~ {value}")
            return column.icontains(text, autoescape=True)
        return _compared(column, str(operator), _value(str(name), column, text, str(value)))


def parse(condition: str) -> sa.ColumnElement[bool]:
    """Parses a condition on the table of sessions. Raises RigError archive.query_invalid: what is wrong, and where."""
    try:
        return _ToSql().transform(_PARSER.parse(condition))
    except VisitError as error:
        raise _refusal(condition, str(error.orig_exc)) from error
    except UnexpectedInput as error:
        place = f"at position {error.column}" if error.column > 0 else "at its end"
        raise _refusal(condition, f"cannot be read {place}") from error


def _column(name: str) -> sa.Column[Any]:
    if name not in COLUMNS:
        raise ValueError(f"{name} is unknown; choose one of {', '.join(COLUMNS)}")
    return COLUMNS[name]


def _value(name: str, column: sa.Column[Any], text: str | None, number: str) -> str | float:
    if name in _TIMES:
        if text is None:
            raise ValueError(f"{name} is compared with a date in quotes, such as '2026-03-01'")
        try:
            moment = datetime.fromisoformat(text)
        except ValueError as error:
            raise ValueError(f"{text!r} is not a date, such as '2026-03-01'") from error
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if name in _VERSIONS:
        if text is None:
            raise ValueError(f"{name} is compared with a version in quotes, such as '0.2'")
        return version_order(text)
    if isinstance(column.type, sa.String) != (text is not None):
        raise ValueError(f"{name} is compared with {'a text in quotes' if text is None else 'a number'}")
    return float(number) if text is None else text


def _compared(column: sa.Column[Any], operator: str, value: str | float) -> sa.ColumnElement[bool]:
    match operator:
        case "<":
            return column < value
        case "<=":
            return column <= value
        case ">":
            return column > value
        case ">=":
            return column >= value
        case "!=":
            return column != value
        case _:
            return column == value


def _refusal(condition: str, why: str) -> RigError:
    return RigError(
        ErrorCode.ARCHIVE_QUERY_INVALID, f"--where {condition!r}: {why}; an example: solver < '0.2' and object ~ 'vase'"
    )
