"""Command of the chaos schedules and of the soak; both resume where they ended.

    python -m tests.chaos schedules 0:100 [--results FILE] [--address 127.0.14.40]
    python -m tests.chaos soak [--hours 24] [--seed 1] [--results FILE] [--address 127.0.14.50]

Seeds whose line is in FILE are not run again, so that a run may be ended and gone on with. Several machines may take a
part each, or several processes with addresses of their own. Ends with status 1 when a case failed.
"""

import argparse
import json
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from tests.chaos import fault_schedule, soak
from tests.chaos.scene import scene


def done(results: Path | None) -> list[dict[str, Any]]:
    """The lines so far."""
    if results is None or not results.exists():
        return []
    return [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]


def note(results: Path | None, line: dict[str, Any]) -> None:
    """Prints a line and appends it to the results."""
    text = json.dumps(line)
    print(text, flush=True)
    if results is not None:
        with results.open("a", encoding="utf-8") as file:
            file.write(text + "\n")


def schedules(seeds: list[int], address: str, results: Path | None) -> int:
    """Runs those of the seeds that have no line yet; the number that failed."""
    wanted = sorted(set(seeds) - {line["seed"] for line in done(results)})
    failed = 0
    while wanted:
        with (
            tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
            scene(Path(folder), address) as made,
        ):
            while wanted:
                seed = wanted.pop(0)
                try:
                    note(results, fault_schedule.run(made, seed))
                except Exception as error:
                    if isinstance(error.__context__, KeyboardInterrupt):
                        raise KeyboardInterrupt from error  # the cell ended with it, and the case says nothing
                    note(results, {"seed": seed, "failed": traceback.format_exc()})
                    failed += 1
                    break
    return failed


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    combined = commands.add_parser("schedules")
    combined.add_argument("seeds", help="first:last, the last not included")
    lasting = commands.add_parser("soak")
    lasting.add_argument("--hours", type=float, default=24.0, help="simulated")
    lasting.add_argument("--seed", type=int, default=1)
    for command, address in ((combined, "127.0.14.40"), (lasting, "127.0.14.50")):
        command.add_argument("--results", type=Path)
        command.add_argument("--address", default=address, help="of the simulated controller")
    options = parser.parse_args()
    if options.command == "schedules":
        first, _, last = options.seeds.partition(":")
        return int(schedules(list(range(int(first), int(last))), options.address, options.results) > 0)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        held = soak.run(
            Path(folder), options.address, options.hours, options.seed, lambda line: note(options.results, line)
        )
        return int(not held)


if __name__ == "__main__":
    sys.exit(main())
