"""Nodes of URScript's abstract syntax tree; `line` is the line on which a node begins."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, dataclass_transform


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Node:
    """A node of the tree and the line on which it begins; each kind of node is a frozen dataclass."""

    line: int

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    def children(self) -> Iterator["Node"]:
        """The nodes directly below it, in no particular order."""
        values: list[Any] = list(vars(self).values())
        while values:
            value = values.pop()
            if isinstance(value, Node):
                yield value
            elif isinstance(value, list | tuple | dict):
                values += value.values() if isinstance(value, dict) else value


class Literal(Node):
    """A number, a string or a truth value."""

    value: int | float | str | bool


class Name(Node):
    """A variable."""

    name: str


class ListLiteral(Node):
    """A list, or a pose if `pose` is set."""

    items: list[Node]
    pose: bool


class Index(Node):
    """`value[i]` or `value[i, j]`."""

    value: Node
    indices: list[Node]


class Member(Node):
    """`value.name`."""

    value: Node
    name: str


class StructLiteral(Node):
    """`struct(name=value, …)`."""

    members: dict[str, Node]


class Call(Node):
    """`name(arguments)`."""

    name: str
    arguments: list[Node]
    keywords: dict[str, Node]


class RunThread(Node):
    """`run name(arguments)`, whose value is the thread's handle."""

    name: str
    arguments: list[Node]
    keywords: dict[str, Node]


class Unary(Node):
    """`-x`, `not x`."""

    operator: str
    value: Node


class Binary(Node):
    """`a operator b`."""

    operator: str
    left: Node
    right: Node


class Assign(Node):
    """`[global | local] target = value`, where the target is a variable, an element or a member."""

    target: Name | Index | Member
    value: Node
    qualifier: str  # "global", "local" or ""


class ExpressionStatement(Node):
    """An expression as a statement."""

    value: Node


class If(Node):
    """Branches of (condition, body); the last condition is None for `else`."""

    branches: list[tuple[Node | None, list[Node]]]


class While(Node):
    """A loop."""

    condition: Node
    body: list[Node]


class KeywordStatement(Node):
    """`return`, `break`, `continue`, `kill`, `join`, `halt`, `pass`, `enter_critical`, `exit_critical`."""

    keyword: str
    value: Node | None = None


class Function(Node):
    """A `def`, `thread` or `sec` with its nested functions hoisted; a parameter without a default has None."""

    kind: str
    name: str
    parameters: dict[str, Node | None]
    functions: list["Function"] = field(default_factory=list["Function"])
    body: list[Node] = field(default_factory=list[Node])
