"""Recursive-descent parser of URScript: from text to a syntax tree.

New lines mean nothing to the language: the control script of `ur-rtde` has an expression that goes on after a comment
and two statements on one line without a separator. So the parser reads tokens, and statements end where no operator
follows.
"""

import re
from dataclasses import dataclass

from hardware_sim.controller.syntax_tree import (
    Assign,
    Binary,
    Call,
    ExpressionStatement,
    Function,
    If,
    Index,
    KeywordStatement,
    ListLiteral,
    Literal,
    Member,
    Name,
    Node,
    RunThread,
    StructLiteral,
    Unary,
    While,
)


class ScriptSyntaxError(Exception):
    """The text is not URScript that this controller reads; the message names the line."""


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
_COMPARISONS = {"==", "!=", "<", ">", "<=", ">="}
_POSE_ITEMS = 6


def tokens(text: str) -> list[Token]:
    """Tokenises a program. Raises ScriptSyntaxError at a character that belongs to none."""
    result: list[Token] = []
    line, position = 1, 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise ScriptSyntaxError(f"line {line}: unexpected character {text[position]!r}")
        position = match.end()
        kind = match.lastgroup or ""
        if kind == "newline":
            line += 1
        elif kind != "space":
            result.append(Token(kind, match.group(), line))
    result.append(Token("end-of-text", "", line))
    return result


_BLOCK_TOKEN = re.compile(r"#.*|\"[^\"]*\"|'[^']*'|\b(?:def|thread|sec|if|while|for|end)\b")


def depth_change(line: str) -> int:
    """By how much one line of text opens (+) or closes (−) blocks; comments and strings do not count."""
    words = _BLOCK_TOKEN.findall(line)
    return sum(1 for w in words if w in _OPENERS) - sum(1 for w in words if w == "end")


def parse(text: str) -> Function:
    """Reads one program: a `def` or `sec`, or bare statements, which become a program of their own.

    Raises ScriptSyntaxError, also where the text is nested too deeply.
    """
    try:
        return _parse(text)
    except RecursionError as error:
        raise ScriptSyntaxError("nested too deeply") from error


def _parse(text: str) -> Function:
    parser = _Parser(tokens(text))
    if parser.peek().text in ("def", "sec"):
        program = parser.function()
        parser.expect_end_of_text()
        return program
    functions, body = parser.block(frozenset({""}))
    parser.expect_end_of_text()
    return Function(1, "def", "line", {}, functions, body)


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

    def expect_end_of_text(self) -> None:
        token = self.peek()
        if token.kind != "end-of-text":
            raise ScriptSyntaxError(f"line {token.line}: unexpected {token.text!r} after the program's end")

    def function(self) -> Function:
        opener = self._next()
        name = self._identifier()
        parameters: dict[str, Node | None] = {}
        self._expect("(")
        while not self._accept(")"):
            parameter = self._identifier()
            if parameter in parameters:
                raise ScriptSyntaxError(f"line {opener.line}: two parameters of {name} are called {parameter!r}")
            parameters[parameter] = self._expression() if self._accept("=") else None
            if self.peek().text != ")":
                self._expect(",")
        self._accept(":")
        functions, body = self.block(frozenset({"end"}))
        self._expect("end")
        return Function(opener.line, opener.text, name, parameters, functions, body)

    def block(self, closers: frozenset[str]) -> tuple[list[Function], list[Node]]:
        functions: list[Function] = []
        body: list[Node] = []
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

    def _body(self, closers: frozenset[str]) -> list[Node]:
        functions, body = self.block(closers)
        if functions:
            raise ScriptSyntaxError(f"line {functions[0].line}: a function inside a branch or loop")
        return body

    def _statement(self) -> Node:
        token = self.peek()
        keyword = token.text if token.kind == "name" else ""
        if keyword in ("global", "local"):
            self._next()
            return self._assigned(token.line, Name(token.line, self._identifier()), keyword)
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
            return While(token.line, condition, body)
        if keyword in ("kill", "join"):
            self._next()
            return KeywordStatement(token.line, keyword, self._expression())
        if keyword == "return":
            self._next()
            follower = self.peek()
            bare = follower.line != token.line or follower.text in ("end", "else", "elif") or follower.kind == ""
            return KeywordStatement(token.line, keyword, None if bare else self._expression())
        if keyword in _SIMPLE:
            self._next()
            return KeywordStatement(token.line, keyword)
        if token.kind == "name" and keyword not in _RESERVED:
            begin = self._position
            target = self._postfix()
            if self.peek().kind == "operator" and self.peek().text == "=":
                return self._assigned(token.line, target)
            self._position = begin
        return ExpressionStatement(token.line, self._expression())

    def _assigned(self, line: int, target: Node, qualifier: str = "") -> Assign:
        self._expect("=")
        if not isinstance(target, Name | Index | Member):
            raise ScriptSyntaxError(f"line {line}: nothing can be assigned to this")
        return Assign(line, target, self._expression(), qualifier)

    def _label(self) -> Node:
        """`$ 3 "MoveJ"`: PolyScope's label of the node that the following lines come from."""
        token = self._next()
        label = _LABEL.match(token.text)
        if label is None:
            raise ScriptSyntaxError(f"line {token.line}: a label is a number and a text, not {token.text!r}")
        number, text = Literal(token.line, int(label[1])), Literal(token.line, label[2] or "")
        return ExpressionStatement(token.line, Call(token.line, "program_label", [number, text], {}))

    def _if(self) -> If:
        line = self._next().line
        branches: list[tuple[Node | None, list[Node]]] = []
        condition: Node | None = self._expression()
        while True:
            self._accept(":")
            branches.append((condition, self._body(frozenset({"end", "else", "elif"}))))
            token = self._next()
            if token.text == "end":
                return If(line, branches)
            if condition is None:
                raise ScriptSyntaxError(f"line {token.line}: {token.text!r} after `else`")
            condition = self._expression() if token.text == "elif" else None

    def _items(self, closer: str) -> list[Node]:
        items: list[Node] = []
        while not self._accept(closer):
            items.append(self._expression())
            if self.peek().text != closer:
                self._expect(",")
        return items

    def _expression(self) -> Node:
        left = self._conjunction()
        while self.peek().text in ("or", "xor") and self.peek().kind == "name":
            operator = self._next()
            left = Binary(operator.line, operator.text, left, self._conjunction())
        return left

    def _conjunction(self) -> Node:
        left = self._negation()
        while self.peek().text == "and" and self.peek().kind == "name":
            operator = self._next()
            left = Binary(operator.line, "and", left, self._negation())
        return left

    def _negation(self) -> Node:
        token = self.peek()
        if token.kind == "name" and token.text == "not":
            self._next()
            return Unary(token.line, "not", self._negation())
        left = self._sum()
        while self.peek().kind == "operator" and self.peek().text in _COMPARISONS:
            operator = self._next()
            left = Binary(operator.line, operator.text, left, self._sum())
        return left

    def _sum(self) -> Node:
        left = self._product()
        while self.peek().kind == "operator" and self.peek().text in ("+", "-"):
            operator = self._next()
            left = Binary(operator.line, operator.text, left, self._product())
        return left

    def _product(self) -> Node:
        left = self._unary()
        while self.peek().kind == "operator" and self.peek().text in ("*", "/", "%"):
            operator = self._next()
            left = Binary(operator.line, operator.text, left, self._unary())
        return left

    def _unary(self) -> Node:
        token = self.peek()
        if token.kind == "operator" and token.text in ("-", "+"):
            self._next()
            return Unary(token.line, token.text, self._unary())
        return self._postfix()

    def _postfix(self) -> Node:
        node = self._atom()
        while self.peek().kind == "operator" and self.peek().text in ("[", "."):
            if self._accept("."):
                node = Member(node.line, node, self._identifier())
                continue
            self._expect("[")
            indices = self._items("]")
            if isinstance(node, Name) and node.name == "p" and len(indices) == _POSE_ITEMS:
                # `p` is an ordinary variable too; only the number of items tells a pose from an index.
                node = ListLiteral(node.line, indices, pose=True)
            else:
                node = Index(node.line, node, indices)
        return node

    def _atom(self) -> Node:
        token = self._next()
        if token.kind == "number":
            text = token.text
            if text[:2] in ("0x", "0X"):
                return Literal(token.line, int(text, 16))
            return Literal(token.line, int(text) if text.isdigit() else float(text))
        if token.kind == "string":
            return Literal(token.line, token.text[1:-1])
        if token.text == "(":
            inner = self._expression()
            self._expect(")")
            return inner
        if token.text == "[":
            return ListLiteral(token.line, self._items("]"), pose=False)
        if token.kind == "name" and token.text in ("True", "False"):
            return Literal(token.line, token.text == "True")
        if token.kind == "name" and token.text == "run":
            return RunThread(token.line, self._call(self._identifier(), token.line))
        if token.kind != "name" or token.text in _RESERVED:
            raise ScriptSyntaxError(f"line {token.line}: unexpected {token.text!r}")
        if self.peek().kind != "operator" or self.peek().text != "(":
            return Name(token.line, token.text)
        call = self._call(token.text, token.line)
        if call.name != "struct":
            return call
        if call.arguments:
            raise ScriptSyntaxError(f"line {call.line}: members of a struct have names")
        return StructLiteral(call.line, call.keywords)

    def _call(self, name: str, line: int) -> Call:
        arguments: list[Node] = []
        keywords: dict[str, Node] = {}
        self._expect("(")
        while not self._accept(")"):
            token = self.peek()
            if token.kind == "name" and self._tokens[self._position + 1].text == "=":
                keyword = self._identifier()
                self._expect("=")
                keywords[keyword] = self._expression()
            elif keywords:
                raise ScriptSyntaxError(f"line {token.line}: an argument without a name after one with a name")
            else:
                arguments.append(self._expression())
            if self.peek().text != ")":
                self._expect(",")
        return Call(line, name, arguments, keywords)
