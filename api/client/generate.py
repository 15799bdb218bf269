"""Generates `client.py` from `async_client.py`: `python -m api.client.generate` after a change of the latter.

The two clients differ only in `async` and `await`, so one is derived from the other by replacing tokens, as httpcore
does with `unasync`. A fix of one fixes both, and the synchronous client needs no event loop. A test fails if the
committed `client.py` is not what this module generates.
"""

import re
from pathlib import Path

SOURCE = Path(__file__).with_name("async_client.py")
TARGET = Path(__file__).with_name("client.py")

HEADER = "# Generated from async_client.py by `python -m api.client.generate`: change that one.\n"

REPLACEMENTS = (
    (r"^import asyncio\n", ""),
    (r"\basyncio\.sleep\b", "time.sleep"),
    (r"\bawait asyncio\.to_thread\(([\w.]+)(?:, )?", r"\1("),
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\bawait ", ""),
    (r"\bAsyncClient\b", "Client"),
    (r"\bAsyncGenerator\[(\w+), None\]", r"Generator[\1, None, None]"),
    (r"\bAsyncGenerator, Callable\b", "Callable, Generator"),
    (r"\b__a(enter|exit)__\b", r"__\1__"),
    (r"\ba(close|read|iter_bytes|iter_sse|connect_sse)\b", r"\1"),
    (r"\ban async context manager\b", "a context manager"),
)
"""Regular expressions and their replacements, applied in this order."""


def synchronous(source: str) -> str:
    """Translates the source of the asynchronous client into that of the synchronous one."""
    for pattern, replacement in REPLACEMENTS:
        source = re.sub(pattern, replacement, source, flags=re.MULTILINE)
    return HEADER + source


def main() -> None:
    """Writes `client.py`."""
    TARGET.write_text(synchronous(SOURCE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
