"""The log of runs on report seeds: date, commit, command and result."""

import subprocess
from datetime import UTC, datetime
from pathlib import Path

REPORTS = Path(__file__).with_name("reports.md")


def commit() -> str:
    """The commit that runs, with `-dirty` if files differ from it."""
    return subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip


def write(command: str, summary: str, path: Path = REPORTS) -> None:
    """Appends one run to the log."""
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    with path.open("a", encoding="utf-8") as file:
        file.write(f"\n## {when}, {commit()}\n\n`python -m tests.unseen {command}`\n\n```\n{summary}\n```\n")
