"""Files that every estimate of a calibration session has, beside those of its kind."""

from pathlib import Path

from acquisition.models.base import Value

SUMMARY, CALIBRATION, BASIS = "summary.json", "calibration.json", "basis.json"
"""Figures for people; the calibration in use with the estimated values; for boards, the basis of further views."""


def write_json(path: Path, value: Value) -> None:
    """Writes a value as a file."""
    path.write_text(value.model_dump_json(indent=2), encoding="utf-8")
