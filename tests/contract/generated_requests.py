"""Runs schemathesis, all phases, against a service, and sums up what it was answered.

A process of its own (its command line), because only that runs the phases as a whole: examples of the description,
coverage of its boundaries, fuzzing, and sequences along its links. What each request was answered is noted by the
hooks, so that the sum does not rest on schemathesis' own judgement alone.
"""

import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from api.rest.app import description
from tests.contract.progress import Notes, follow
from tests.contract.steering import CONFORMANCE

HERE = Path(__file__).parent
PHASES = ("examples", "coverage", "fuzzing", "stateful")
CHECKS = (
    *CONFORMANCE,
    "not_a_server_error",
    "missing_required_header",
    "unsupported_method",
    "allow_header_conformance",
    "use_after_free",
    "ignored_auth",
)
HANG_S = 120.0
"""What takes longer counts as a hang, s: planning for odd recipes takes up to half of that on a busy machine."""


@dataclass(frozen=True)
class Run:
    """What a run of schemathesis has shown."""

    answers: list[dict[str, Any]]
    output: str
    failures: list[str]
    links: str

    @property
    def faults(self) -> list[dict[str, Any]]:
        """The answers above 499."""
        return [item for item in self.answers if item["status"] is not None and item["status"] >= 500]

    def undeclared(self, description: Mapping[str, Any]) -> list[dict[str, Any]]:
        """The faults whose status the description does not name for their operation."""
        return [item for item in self.faults if not _declares(description, item)]

    @property
    def hangs(self) -> list[dict[str, Any]]:
        """Requests without an answer, and answers that came late."""
        return [item for item in self.answers if item["status"] is None or item["seconds"] > HANG_S]

    def table(self) -> str:
        """The number of answers by phase and class of status, and each kind of fault."""
        lines = []
        for phase in PHASES:
            of_phase = [item for item in self.answers if item["phase"] == phase]
            classes = Counter("none" if item["status"] is None else f"{item['status'] // 100}xx" for item in of_phase)
            slowest = max((item.get("seconds") or 0.0 for item in of_phase), default=0.0)
            lines.append(f"{phase}: {len(of_phase)} requests, {dict(sorted(classes.items()))}, slowest {slowest:.1f} s")
        faults = Counter(
            (item["method"], item["path"], item["status"], item["code"], f"Retry-After {item['retry_after']}")
            for item in self.faults
        )
        return "\n".join([*lines, *(f"  {number} × {' '.join(map(str, fault))}" for fault, number in faults.items())])


def run(url: str, key: str, known: Mapping[str, Any], folder: Path, most: int) -> Run:
    """Sends at most `most` cases for each operation and phase to a service, as an admin, and waits for the end.

    `known` are path parameters that exist; `folder` receives the notes.
    """
    described = folder / "openapi.json"
    described.write_text(json.dumps(_with_items(description())), encoding="utf-8")
    notes = Notes(folder / "notes.jsonl")
    notes.path.touch()
    log = folder / "schemathesis.log"
    command = [
        sys.executable, "-m", "schemathesis.cli", "--config-file", str(HERE / "schemathesis.toml"), "run",
        str(described), "--url", url, "--phases", ",".join(PHASES), "--checks", ",".join(CHECKS),
        "--max-examples", str(most), "--header", f"Authorization: Bearer {key}",
        "--report-json-path", str(folder / "report.json"), "--output-truncate", "true",
    ]  # fmt: skip
    environment = {
        **os.environ, "PYTHONPATH": str(HERE.parents[1]), "SCHEMATHESIS_HOOKS": "tests.contract.hooks",
        "CONTRACT_KNOWN": json.dumps(dict(known)), "CONTRACT_NOTES": str(notes.path), "NO_COLOR": "1", "COLUMNS": "160",
    }  # fmt: skip
    with log.open("wb") as file:
        process = subprocess.Popen(command, env=environment, cwd=folder, stdout=file, stderr=file)
        try:
            follow(process, notes)
        finally:
            process.kill()
            process.wait()
    output = log.read_text(encoding="utf-8")
    return Run(notes.answers, output, _failures(output), _links(output))


def _with_items(described: dict[str, Any]) -> dict[str, Any]:
    """The description with what OpenAPI has from 3.2 on: the schema of each item of a stream (`itemSchema`)."""
    (stream,) = described["paths"]["/v1/events"]["get"]["responses"]["200"]["content"].values()
    data = {key: value for key, value in stream.pop("schema").items() if key.startswith("content")}
    text = {"type": "string"}
    stream["itemSchema"] = {
        "type": "object",
        "required": ["id", "event", "data"],
        "properties": {"id": text, "event": text, "data": {**text, **data}},
    }
    return described


def _failures(output: str) -> list[str]:
    """The titles of what schemathesis complains of, with their operations."""
    found: list[str] = []
    operation = ""
    for line in output.splitlines():
        if match := re.match(r"_+ (.+?) _+$", line):
            operation = match[1]
        elif match := re.match(r"- (?:\w.+)$", line):
            found.append(f"{operation}: {line[2:]}")
    return found


def _links(output: str) -> str:
    match = re.search(r"API Links:.*|API links:.*", output)
    return match[0].strip() if match else ""


def _declares(description: Mapping[str, Any], item: Mapping[str, Any]) -> bool:
    operation = description["paths"].get(item["path"], {}).get(item["method"].lower())
    return operation is not None and str(item["status"]) in operation["responses"]
