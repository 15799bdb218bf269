"""Compiler from URScript to Python: one closure per function, a generator where time may pass.

Walking a syntax tree at 500 Hz would cost more than the rest of the controller. Compiled once, one turn of the control
script's main loop takes a few microseconds. A function that can neither wait nor loop becomes a plain function, every
other one a generator whose `yield` gives up the time slot. URScript's names get a prefix, so that no program can reach
Python's own. Its operators become calls of `semantics` wherever Python's differ.

In each round, a loop or a recursive function checks whether the thread has used up its share of this tick. The cost of
a round is counted here, from the size of its body.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType

from hardware_sim.controller import syntax_tree as tree
from hardware_sim.controller.semantics import OPERATIONS
from hardware_sim.controller.syntax import ScriptSyntaxError, parse


@dataclass(frozen=True)
class Vocabulary:
    """The names of the controller's own functions; `waiting` are those that take time."""

    immediate: frozenset[str]
    waiting: frozenset[str]

    def __contains__(self, name: str) -> bool:
        return name in self.immediate or name in self.waiting


@dataclass(frozen=True)
class CompiledProgram:
    """Python code that defines `program`, and the URScript line of each of its lines."""

    name: str
    secondary: bool
    code: CodeType
    lines: tuple[int, ...]


_LOGIC = {"xor": "!=", "and": "and", "or": "or"}
_NATIVE = {"==", "!="}
NAMES_OF_OPERATIONS = {sign: f"o_{number}" for number, sign in enumerate(OPERATIONS)}
"""Names of the operators of `semantics.OPERATIONS` in a program's code."""
_COST_OF_BUILTIN = 10  # in nodes of the tree
_COST_OF_KINEMATICS = 500
_DEEPEST_COUNTED = 8  # calls inside calls
TURN_BUDGET = 5000  # nodes that loops may evaluate before their thread has to wait for its next slot


@lru_cache(maxsize=8)
def compile_program(text: str, vocabulary: Vocabulary, statement: bool = False) -> CompiledProgram:
    """Compiles one program, or a statement of the interpreter mode, whose variables are all global.

    Raises ScriptSyntaxError that names the line.
    """
    try:
        program = parse(text)
        if program.parameters:
            raise ScriptSyntaxError(f"line {program.line}: a program must not have parameters: {program.name}")
        source, lines = _Writer(program, vocabulary, statement).write()
        code = compile(source, f"<{program.name}>", "exec")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        # Nested too deeply for the stack, or a number of thousands of digits.
        raise ScriptSyntaxError(f"the program cannot be compiled: {error}") from error
    return CompiledProgram(program.name, program.kind == "sec", code, tuple(lines))


def _functions(function: tree.Function) -> Iterator[tree.Function]:
    yield function
    for inner in function.functions:
        yield from _functions(inner)


def _walk(nodes: list[tree.Node]) -> Iterator[tree.Node]:
    """All nodes below `nodes`, themselves included."""
    stack = list(reversed(nodes))
    while stack:
        node = stack.pop()
        yield node
        stack += node.children()


class _Writer:
    """Writes the Python of one program."""

    def __init__(self, program: tree.Function, vocabulary: Vocabulary, statement: bool) -> None:
        self._program = program
        self._vocabulary = vocabulary
        self._all = list(_functions(program))
        self._names = {f.name for f in self._all}
        self._globals = {
            node.target.name
            for f in self._all
            for node in _walk(f.body)
            if isinstance(node, tree.Assign) and node.qualifier == "global" and isinstance(node.target, tree.Name)
        }
        if statement:
            self._globals |= {n.name for f in self._all for n in _walk(f.body) if isinstance(n, tree.Name)}
        self._bodies = {
            f.name: list(_walk([*(d for d in f.parameters.values() if d is not None), *f.body])) for f in self._all
        }
        self._prefixes: dict[str, dict[str, str]] = {}
        self._outer: dict[str, list[str]] = {}
        self._bind(program, {})
        self._scope = self._prefixes[program.name]
        reached = self._reached()
        self._recursive = {name for name, names in reached.items() if name in names}
        self._waiting = self._find_waiting(reached)
        self._source: list[str] = []
        self._lines: list[int] = [0]

    def _bind(self, f: tree.Function, around: dict[str, str]) -> None:
        """Determines the scopes of the variables of a function and its inner functions; `around` are visible in it.

        Scopes are lexical. `local` and parameters belong to the function, `global` to the program. Any other assignment
        changes the visible variable of this name, or creates one of the function's own if there is none.
        """
        assignments = [node for node in self._bodies[f.name] if isinstance(node, tree.Assign)]
        assigned = [(n.target.name, n.qualifier) for n in assignments if isinstance(n.target, tree.Name)]
        names = {name for name, _ in assigned}
        own = {*f.parameters, *(name for name, qualifier in assigned if qualifier == "local")}
        own |= names - around.keys() - self._globals
        visible = {**around, **{name: "g_" for name, qualifier in assigned if qualifier == "global"}}
        visible |= dict.fromkeys(own, "v_")
        self._outer[f.name] = [visible.get(name, "g_") + name for name in sorted(names - own)]
        self._prefixes[f.name] = visible
        for inner in f.functions:
            self._bind(inner, visible)

    def _variable(self, name: str) -> str:
        return self._scope.get(name, "g_" if name in self._globals else "v_") + name

    def _reached(self) -> dict[str, set[str]]:
        """For each function of the program, the names of all functions that its calls reach."""
        reached = {name: {n.name for n in nodes if isinstance(n, tree.Call)} for name, nodes in self._bodies.items()}
        while True:
            more = {name: names.union(*(reached[n] for n in names & reached.keys())) for name, names in reached.items()}
            if more == reached:
                return reached
            reached = more

    def _find_waiting(self, reached: dict[str, set[str]]) -> set[str]:
        """Names of the functions that may give up their time slot: by a loop, a wait, or a call of such a function."""
        waiting = {f.name for f in self._all if f.kind == "thread"} | {self._program.name} | self._recursive
        waiting |= {
            name
            for name, nodes in self._bodies.items()
            if any(
                isinstance(n, tree.While) or (isinstance(n, tree.KeywordStatement) and n.keyword in ("join", "halt"))
                for n in nodes
            )
        }
        ends = waiting | (self._vocabulary.waiting - self._names)
        return waiting | {name for name, names in reached.items() if names & ends}

    def _cost(self, nodes: list[tree.Node], depth: int = 0) -> int:
        """Cost of one run through `nodes`, in nodes; functions that may wait count their own cost."""
        cost = 0
        for node in nodes:
            cost += 1
            if isinstance(node, tree.Call) and node.name in self._names:
                if node.name not in self._waiting and depth < _DEEPEST_COUNTED:
                    cost += self._cost(self._bodies[node.name], depth + 1)
            elif isinstance(node, tree.Call):
                cost += _COST_OF_KINEMATICS if "_kin" in node.name else _COST_OF_BUILTIN
            if cost > TURN_BUDGET:
                return TURN_BUDGET
        return cost

    def write(self) -> tuple[str, list[int]]:
        self._emit(0, 0, "def program():")
        self._function(self._program, 1)
        self._emit(1, 0, f"return f_{self._program.name}()")
        return "\n".join(self._source) + "\n", self._lines

    def _emit(self, indent: int, line: int, text: str) -> None:
        self._source.append("    " * indent + text)
        self._lines.append(line)

    def _function(self, f: tree.Function, indent: int) -> None:
        parameters = [f"v_{p}" if default is None else f"v_{p}=..." for p, default in f.parameters.items()]
        self._emit(indent, f.line, f"def f_{f.name}({', '.join(parameters)}):")
        scope, self._scope = self._scope, self._prefixes[f.name]
        for keyword, prefix in (("global", "g_"), ("nonlocal", "v_")):
            if outer := [name for name in self._outer[f.name] if name.startswith(prefix)]:
                self._emit(indent + 1, f.line, f"{keyword} {', '.join(outer)}")
        if f.name in self._waiting:
            self._emit(indent + 1, f.line, "if False: yield")
        if f.name in self._recursive:
            self._emit(indent + 1, f.line, f"if turn_is_spent({self._cost(self._bodies[f.name])}): yield")
        for parameter, default in f.parameters.items():
            # A default is evaluated at the call, where the globals have their values.
            given = "" if default is None else f" if v_{parameter} is not ... else {self._value(default)}"
            self._emit(indent + 1, f.line, f"v_{parameter} = copy_of(v_{parameter}){given}")
        for inner in f.functions:
            self._function(inner, indent + 1)
        self._block(f.body, indent + 1)
        self._scope = scope

    def _block(self, body: list[tree.Node], indent: int) -> None:
        if not body:
            self._emit(indent, 0, "pass")
        for node in body:
            self._statement(node, indent)

    def _statement(self, node: tree.Node, indent: int) -> None:
        match node:
            case tree.Assign(line, target, value):
                self._emit(indent, line, self._assignment(target, self._value(value)))
            case tree.ExpressionStatement(line, value):
                self._emit(indent, line, self._expression(value))
            case tree.If(line, branches):
                for number, (condition, body) in enumerate(branches):
                    if condition is None:
                        self._emit(indent, line, "else:")
                    else:
                        word = "elif" if number else "if"
                        self._emit(indent, condition.line, f"{word} {self._condition(condition)}:")
                    self._block(body, indent + 1)
            case tree.While(line, condition, body):
                self._emit(indent, line, f"while {self._condition(condition)}:")
                cost = self._cost([*_walk([condition]), *_walk(body)])
                self._emit(indent + 1, line, f"if turn_is_spent({cost}): yield")
                self._block(body, indent + 1)
            case tree.KeywordStatement():
                self._simple(node, indent)
            case _:
                raise ScriptSyntaxError(f"line {node.line}: not a statement")

    def _assignment(self, target: tree.Node, value: str) -> str:
        match target:
            case tree.Name(_, name):
                return f"{self._variable(name)} = {value}"
            case tree.Member(_, container, name):
                return f"put_member({self._expression(container)}, {name!r}, {value})"
            # Outputs as lists: the notation of early versions, which urx still sends.
            case tree.Index(_, tree.Name(_, "digital_out" | "analog_out" as n), [i]) if n not in {
                *self._scope,
                *self._globals,
            }:
                return f"b_set_{n}({self._expression(i)}, {value})"
            case tree.Index(_, container, [*outer, last]):
                place = self._expression(container)
                for index in outer:
                    place = f"item({place}, {self._expression(index)})"
                return f"put({place}, {self._expression(last)}, {value})"
            case _:
                raise ScriptSyntaxError(f"line {target.line}: nothing can be assigned to this")

    def _value(self, node: tree.Node) -> str:
        """An expression whose value is kept: copied, unless the value is new anyway."""
        text = self._expression(node)
        return (
            text
            if isinstance(node, tree.Literal | tree.Binary | tree.Unary | tree.ListLiteral | tree.StructLiteral)
            else f"copy_of({text})"
        )

    def _condition(self, node: tree.Node) -> str:
        """An expression that must be a truth value; checked at run time unless its form guarantees that."""
        text = self._expression(node)
        match node:
            case tree.Literal(_, True | False) | tree.Binary(
                _, "and" | "or" | "xor" | "==" | "!=" | "<" | "<=" | ">" | ">=", _, _
            ):
                return text
            case tree.Unary(_, "not", _):
                return text
            case _:
                return f"truth({text})"

    def _simple(self, node: tree.KeywordStatement, indent: int) -> None:
        value = "" if node.value is None else self._expression(node.value)
        text = {
            "return": f"return {value}",
            "kill": f"kill({value})",
            "join": f"yield from join({value})",
            "halt": "yield from halt()",
            "enter_critical": "set_critical(True)",
            "exit_critical": "set_critical(False)",
        }.get(node.keyword, node.keyword)
        self._emit(indent, node.line, text)

    def _expression(self, node: tree.Node) -> str:  # noqa: PLR0912 - one branch per kind of node
        match node:
            case tree.Literal(_, value):
                return repr(value)
            case tree.Name(_, name):
                return self._variable(name)
            case tree.ListLiteral(_, items, is_pose):
                inner = "[" + ", ".join(self._value(i) for i in items) + "]"
                return f"pose({inner})" if is_pose else inner
            case tree.StructLiteral(_, members):
                return "Struct({" + ", ".join(f"{k!r}: {self._value(v)}" for k, v in members.items()) + "})"
            case tree.Index(_, value, indices):
                place = self._expression(value)
                for index in indices:
                    place = f"item({place}, {self._expression(index)})"
                return place
            case tree.Member(_, value, name):
                return f"member({self._expression(value)}, {name!r})"
            case tree.Unary(_, "not", value):
                return f"(not {self._condition(value)})"
            case tree.Unary(_, "-", tree.Literal(_, int() | float() as number)):
                return f"(-{number!r})"
            case tree.Unary(_, operator, value):
                return f"{NAMES_OF_OPERATIONS[operator]}(0, {self._expression(value)})"
            case tree.Binary(_, operator, left, right) if operator in _LOGIC:
                return f"({self._condition(left)} {_LOGIC[operator]} {self._condition(right)})"
            case tree.Binary(_, operator, left, right) if operator in _NATIVE:
                return f"({self._expression(left)} {operator} {self._expression(right)})"
            case tree.Binary(_, operator, left, right):
                return f"{NAMES_OF_OPERATIONS[operator]}({self._expression(left)}, {self._expression(right)})"
            case tree.Call():
                return self._call(node)
            case tree.RunThread(line, name):
                if name not in self._names:
                    raise ScriptSyntaxError(f"line {line}: there is no thread {name!r} to run")
                return f"run({name!r}, f_{name}({', '.join(self._arguments(node, 'v_'))}))"
            case _:
                raise ScriptSyntaxError(f"line {node.line}: not an expression")

    def _arguments(self, call: tree.Call | tree.RunThread, prefix: str) -> list[str]:
        given = [self._expression(a) for a in call.arguments]
        return given + [f"{prefix}{key}={self._expression(value)}" for key, value in call.keywords.items()]

    def _call(self, call: tree.Call) -> str:
        if call.name in self._names:
            text = f"f_{call.name}({', '.join(self._arguments(call, 'v_'))})"
            return f"(yield from {text})" if call.name in self._waiting else text
        if call.name not in self._vocabulary:
            raise ScriptSyntaxError(f"line {call.line}: there is no function {call.name!r}")
        text = f"b_{call.name}({', '.join(self._arguments(call, ''))})"
        return f"(yield from {text})" if call.name in self._vocabulary.waiting else text
