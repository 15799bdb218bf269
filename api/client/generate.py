"""Generates the synchronous client from the asynchronous one: `python -m api.client.generate` after a change of that.

The two clients differ only in `async` and `await`, so one is derived from the other by replacing tokens, as httpcore
does with `unasync`. A fix of one fixes both, and the synchronous client needs no event loop. A test fails if the
committed modules are not what this module generates.
"""

import re
from pathlib import Path

TARGETS = {
    source: source.with_name(source.name.removeprefix("async_")) for source in Path(__file__).parent.glob("async_*.py")
}
"""The synchronous module of each asynchronous one."""

REPLACEMENTS = (
    (r"^import asyncio\n", ""),
    (r"\basyncio\.sleep\b", "time.sleep"),
    (r"\bawait asyncio\.to_thread\(([\w.]+)(?:, )?", r"\1("),
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\bawait ", ""),
    (r"\bAsync(Client|Connection)\b", r"\1"),
    (r"\basync_connection\b", "connection"),
    (r"\bAsyncGenerator\[(\w+), None\]", r"Generator[\1, None, None]"),
    (r"\bAsyncGenerator, Callable\b", "Callable, Generator"),
    (r"\b__a(enter|exit)__\b", r"__\1__"),
    (r"\ba(close|read|iter_bytes|iter_sse|connect_sse)\b", r"\1"),
    (r"\ban async context manager\b", "a context manager"),
)
"""Regular expressions and their replacements, applied in this order."""


def synchronous(source: str) -> str:
    """Translates the source of an asynchronous module into that of the synchronous one."""
    for pattern, replacement in REPLACEMENTS:
        source = re.sub(pattern, replacement, source, flags=re.MULTILINE)
    return source


def generated(source: Path) -> str:
    """Returns the text of the synchronous module of an asynchronous one."""
    header = f"# Generated from {source.name} by `python -m api.client.generate`: change that one.\n"
    return header + synchronous(source.read_text(encoding="utf-8"))


def main() -> None:
    """Writes the synchronous modules."""
    for source, target in TARGETS.items():
        target.write_text(generated(source), encoding="utf-8")


if __name__ == "__main__":
    main()
