"""The log of runs on report seeds: when, on which commit, by which command, with what result."""

import subprocess
from datetime import UTC, datetime
from pathlib import Path

REPORTS = Path(__file__).with_name("reports.md")


def write(command: str, summary: str, path: Path = REPORTS) -> None:
    """Appends one run."""
    root = Path(__file__).parents[2]
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=root, capture_output=True, text=True, check=True
    ).stdout.strip()
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    with path.open("a", encoding="utf-8") as file:
        file.write(f"\n## {when}, {commit}\n\n`python -m tests.unseen {command}`\n\n```\n{summary}\n```\n")
