"""Nodes of URScript's abstract syntax tree; `line` is where each began."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Node:
    """A part of the tree and the line it began on."""

    line: int


@dataclass(frozen=True)
class Literal(Node):
    """A number, a string or a truth value."""

    value: int | float | str | bool


@dataclass(frozen=True)
class Name(Node):
    """A variable."""

    name: str


@dataclass(frozen=True)
class ListLiteral(Node):
    """A list, or a pose where `pose` is set."""

    items: list[Node]
    pose: bool


@dataclass(frozen=True)
class Index(Node):
    """`value[i]` or `value[i, j]`."""

    value: Node
    indices: list[Node]


@dataclass(frozen=True)
class Member(Node):
    """`value.name`."""

    value: Node
    name: str


@dataclass(frozen=True)
class StructLiteral(Node):
    """`struct(name=value, …)`."""

    members: dict[str, Node]


@dataclass(frozen=True)
class Call(Node):
    """`name(arguments)`."""

    name: str
    arguments: list[Node]
    keywords: dict[str, Node]


@dataclass(frozen=True)
class RunThread(Node):
    """`run name(arguments)`, whose value is the thread's handle."""

    call: Call


@dataclass(frozen=True)
class Unary(Node):
    """`-x`, `not x`."""

    operator: str
    value: Node


@dataclass(frozen=True)
class Binary(Node):
    """`a operator b`."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True)
class Assign(Node):
    """`[global | local] target = value`, the target a variable, an element or a member."""

    target: Name | Index | Member
    value: Node
    qualifier: str  # "global", "local" or ""


@dataclass(frozen=True)
class ExpressionStatement(Node):
    """An expression as a statement."""

    value: Node


@dataclass(frozen=True)
class If(Node):
    """Branches of (condition, body); the last condition is None for `else`."""

    branches: list[tuple[Node | None, list[Node]]]


@dataclass(frozen=True)
class While(Node):
    """A loop."""

    condition: Node
    body: list[Node]


@dataclass(frozen=True)
class KeywordStatement(Node):
    """`return`, `break`, `continue`, `kill`, `join`, `halt`, `pass`, `enter_critical`, `exit_critical`."""

    keyword: str
    value: Node | None = None


@dataclass(frozen=True)
class Function(Node):
    """A `def`, `thread` or `sec` with its nested functions hoisted; a parameter without a default has None."""

    kind: str
    name: str
    parameters: dict[str, Node | None]
    functions: list["Function"] = field(default_factory=list["Function"])
    body: list[Node] = field(default_factory=list[Node])
