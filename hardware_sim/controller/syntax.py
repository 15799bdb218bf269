"""Recursive-descent parser of URScript: from text to a syntax tree.

New lines have no meaning in the language: the control script of `ur-rtde` has an expression that continues after a
comment, and two statements on one line without a separator. So the parser reads tokens, and a statement ends where no
operator follows.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from hardware_sim.controller import syntax_tree as tree


class ScriptSyntaxError(Exception):
    """The text is not valid URScript for this controller; the message names the line."""


@dataclass(frozen=True)
class Token:
    """A token of a program."""

    kind: str  # number, string, name, label, operator, end-of-text
    text: str
    line: int


_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\f]+|\#[^\n]*)
      | (?P<newline>\n)
      | (?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
      | (?P<name>[A-Za-z_][A-Za-z_0-9]*)
      | (?P<string>"[^"\n]*"|'[^'\n]*')
      | (?P<label>\$[^\n]*)
      | (?P<operator>==|!=|<=|>=|[-+*/%<>=()\[\],:.])
      | (?P<other>.)
    """,
    re.VERBOSE,
)
_OPENERS = {"def", "thread", "sec", "if", "while", "for"}
_SIMPLE = {"break", "continue", "halt", "pass", "enter_critical", "exit_critical"}
_RESERVED = (
    _OPENERS
    | _SIMPLE
    | {"end", "else", "elif", "return", "kill", "join", "global", "local", "run"}
    | {"and", "or", "not", "xor", "True", "False"}
)
_LABEL = re.compile(r'\$\s*(\d+)\s*(?:"([^"]*)")?')
_PRECEDENCE = (
    ("name", {"or", "xor"}),
    ("name", {"and"}),
    ("name", {"not"}),
    ("operator", {"==", "!=", "<", ">", "<=", ">="}),
    ("operator", {"+", "-"}),
    ("operator", {"*", "/", "%"}),
)
"""Kinds and texts of the operators, from the lowest precedence up; all but `not` are binary."""
_POSE_ITEMS = 6


def tokens(text: str) -> list[Token]:
    """Tokenises a program. Raises ScriptSyntaxError at a character that belongs to no token."""
    result: list[Token] = []
    line = 1
    for match in _TOKEN.finditer(text):
        kind = match.lastgroup or ""
        if kind == "other":
            raise ScriptSyntaxError(f"line {line}: unexpected character {match.group()!r}")
        if kind == "newline":
            line += 1
        elif kind != "space":
            result.append(Token(kind, match.group(), line))
    result.append(Token("end-of-text", "", line))
    return result


_BLOCK_TOKEN = re.compile(r"#.*|\"[^\"]*\"|'[^']*'|\b(?:def|thread|sec|if|while|for|end)\b")


def depth_change(line: str) -> int:
    """Number of blocks that one line of text opens, minus those it closes; comments and strings do not count."""
    words = _BLOCK_TOKEN.findall(line)
    return sum(1 for w in words if w in _OPENERS) - sum(1 for w in words if w == "end")


def parse(text: str) -> tree.Function:
    """Parses one program: a `def` or `sec`, or bare statements, which become a program of their own.

    Raises ScriptSyntaxError, also if the text is nested too deeply.
    """
    parser = _Parser(tokens(text))
    try:
        if parser.peek().text in ("def", "sec"):
            program = parser.function()
        else:
            program = tree.Function(1, "def", "line", {}, *parser.block(frozenset({""})))
    except RecursionError as error:
        raise ScriptSyntaxError("nested too deeply") from error
    token = parser.peek()
    if token.kind != "end-of-text":
        raise ScriptSyntaxError(f"line {token.line}: unexpected {token.text!r} after the program's end")
    return program


class _Parser:
    """Recursive descent over the tokens of one program."""

    def __init__(self, words: list[Token]) -> None:
        self._tokens = words
        self._position = 0

    def peek(self) -> Token:
        return self._tokens[self._position]

    def _next(self) -> Token:
        token = self._tokens[self._position]
        self._position += 1
        return token

    def _accept(self, text: str) -> bool:
        token = self._tokens[self._position]
        if token.text == text and token.kind != "string":
            self._position += 1
            return True
        return False

    def _expect(self, text: str) -> None:
        token = self._next()
        if token.text != text or token.kind == "string":
            raise ScriptSyntaxError(f"line {token.line}: expected {text!r}, found {token.text!r}")

    def _identifier(self) -> str:
        token = self._next()
        if token.kind != "name" or token.text in _RESERVED:
            raise ScriptSyntaxError(f"line {token.line}: expected a name, found {token.text!r}")
        return token.text

    def function(self) -> tree.Function:
        opener = self._next()
        name = self._identifier()
        parameters: dict[str, tree.Node | None] = {}
        self._expect("(")
        for _ in self._separated(")"):
            parameter = self._identifier()
            if parameter in parameters:
                raise ScriptSyntaxError(f"line {opener.line}: two parameters of {name} are called {parameter!r}")
            parameters[parameter] = self._expression() if self._accept("=") else None
        self._accept(":")
        functions, body = self.block(frozenset({"end"}))
        self._expect("end")
        return tree.Function(opener.line, opener.text, name, parameters, functions, body)

    def block(self, closers: frozenset[str]) -> tuple[list[tree.Function], list[tree.Node]]:
        functions: list[tree.Function] = []
        body: list[tree.Node] = []
        while True:
            token = self.peek()
            if token.kind == "end-of-text":
                if "" in closers:
                    return functions, body
                raise ScriptSyntaxError(f"line {token.line}: a block is not closed by `end`")
            if token.kind == "name" and token.text in closers:
                return functions, body
            if token.kind == "name" and token.text in ("def", "thread"):
                functions.append(self.function())
            else:
                body.append(self._statement())

    def _body(self, closers: frozenset[str]) -> list[tree.Node]:
        functions, body = self.block(closers)
        if functions:
            raise ScriptSyntaxError(f"line {functions[0].line}: a function inside a branch or loop")
        return body

    def _statement(self) -> tree.Node:
        token = self.peek()
        keyword = token.text if token.kind == "name" else ""
        if keyword in ("global", "local"):
            self._next()
            return self._assigned(token.line, tree.Name(token.line, self._identifier()), keyword)
        if token.kind == "label":
            return self._label()
        if keyword == "if":
            return self._if()
        if keyword == "while":
            self._next()
            condition = self._expression()
            self._accept(":")
            body = self._body(frozenset({"end"}))
            self._expect("end")
            return tree.While(token.line, condition, body)
        if keyword in ("kill", "join"):
            self._next()
            return tree.KeywordStatement(token.line, keyword, self._expression())
        if keyword == "return":
            self._next()
            follower = self.peek()
            bare = follower.line != token.line or follower.text in ("end", "else", "elif") or follower.kind == ""
            return tree.KeywordStatement(token.line, keyword, None if bare else self._expression())
        if keyword in _SIMPLE:
            self._next()
            return tree.KeywordStatement(token.line, keyword)
        if token.kind == "name" and keyword not in _RESERVED:
            begin = self._position
            target = self._postfix()
            if self.peek().kind == "operator" and self.peek().text == "=":
                return self._assigned(token.line, target)
            self._position = begin
        return tree.ExpressionStatement(token.line, self._expression())

    def _assigned(self, line: int, target: tree.Node, qualifier: str = "") -> tree.Assign:
        self._expect("=")
        if not isinstance(target, tree.Name | tree.Index | tree.Member):
            raise ScriptSyntaxError(f"line {line}: nothing can be assigned to this")
        return tree.Assign(line, target, self._expression(), qualifier)

    def _label(self) -> tree.Node:
        """`$ 3 "MoveJ"`: PolyScope's label of the node from which the following lines come."""
        token = self._next()
        label = _LABEL.match(token.text)
        if label is None:
            raise ScriptSyntaxError(f"line {token.line}: a label is a number and a text, not {token.text!r}")
        number, text = tree.Literal(token.line, int(label[1])), tree.Literal(token.line, label[2] or "")
        return tree.ExpressionStatement(token.line, tree.Call(token.line, "program_label", [number, text], {}))

    def _if(self) -> tree.If:
        line = self._next().line
        branches: list[tuple[tree.Node | None, list[tree.Node]]] = []
        condition: tree.Node | None = self._expression()
        while True:
            self._accept(":")
            branches.append((condition, self._body(frozenset({"end", "else", "elif"}))))
            token = self._next()
            if token.text == "end":
                return tree.If(line, branches)
            if condition is None:
                raise ScriptSyntaxError(f"line {token.line}: {token.text!r} after `else`")
            condition = self._expression() if token.text == "elif" else None

    def _items(self, closer: str) -> list[tree.Node]:
        return [self._expression() for _ in self._separated(closer)]

    def _separated(self, closer: str) -> Iterator[None]:
        """Yields once for each item of a list, between commas and up to its closer."""
        while not self._accept(closer):
            yield
            if self.peek().text != closer:
                self._expect(",")

    def _expression(self, level: int = 0) -> tree.Node:
        """An expression of operators with at least the precedence of `_PRECEDENCE[level]`."""
        if level == len(_PRECEDENCE):
            return self._unary()
        kind, signs = _PRECEDENCE[level]
        token = self.peek()
        if "not" in signs and token.kind == kind and token.text in signs:
            self._next()
            return tree.Unary(token.line, "not", self._expression(level))
        left = self._expression(level + 1)
        while "not" not in signs and self.peek().kind == kind and self.peek().text in signs:
            operator = self._next()
            left = tree.Binary(operator.line, operator.text, left, self._expression(level + 1))
        return left

    def _unary(self) -> tree.Node:
        token = self.peek()
        if token.kind == "operator" and token.text in ("-", "+"):
            self._next()
            return tree.Unary(token.line, token.text, self._unary())
        return self._postfix()

    def _postfix(self) -> tree.Node:
        node = self._atom()
        while self.peek().kind == "operator" and self.peek().text in ("[", "."):
            if self._accept("."):
                node = tree.Member(node.line, node, self._identifier())
                continue
            self._expect("[")
            indices = self._items("]")
            if isinstance(node, tree.Name) and node.name == "p" and len(indices) == _POSE_ITEMS:
                # `p` may also be an ordinary variable; only the number of items tells a pose from an index.
                node = tree.ListLiteral(node.line, indices, pose=True)
            else:
                node = tree.Index(node.line, node, indices)
        return node

    def _atom(self) -> tree.Node:
        token = self._next()
        if token.kind == "number":
            text = token.text
            if text[:2] in ("0x", "0X"):
                return tree.Literal(token.line, int(text, 16))
            return tree.Literal(token.line, int(text) if text.isdigit() else float(text))
        if token.kind == "string":
            return tree.Literal(token.line, token.text[1:-1])
        if token.text == "(":
            inner = self._expression()
            self._expect(")")
            return inner
        if token.text == "[":
            return tree.ListLiteral(token.line, self._items("]"), pose=False)
        if token.kind == "name" and token.text in ("True", "False"):
            return tree.Literal(token.line, token.text == "True")
        if token.kind == "name" and token.text == "run":
            call = self._call(self._identifier(), token.line)
            return tree.RunThread(call.line, call.name, call.arguments, call.keywords)
        if token.kind != "name" or token.text in _RESERVED:
            raise ScriptSyntaxError(f"line {token.line}: unexpected {token.text!r}")
        if self.peek().kind != "operator" or self.peek().text != "(":
            return tree.Name(token.line, token.text)
        call = self._call(token.text, token.line)
        if call.name != "struct":
            return call
        if call.arguments:
            raise ScriptSyntaxError(f"line {call.line}: members of a struct have names")
        return tree.StructLiteral(call.line, call.keywords)

    def _call(self, name: str, line: int) -> tree.Call:
        arguments: list[tree.Node] = []
        keywords: dict[str, tree.Node] = {}
        self._expect("(")
        for _ in self._separated(")"):
            token = self.peek()
            if token.kind == "name" and self._tokens[self._position + 1].text == "=":
                keyword = self._identifier()
                self._expect("=")
                keywords[keyword] = self._expression()
            elif keywords:
                raise ScriptSyntaxError(f"line {token.line}: an argument without a name after one with a name")
            else:
                arguments.append(self._expression())
        return tree.Call(line, name, arguments, keywords)
