"""A set of calibration values for sessions, with the record of how it was made."""

from pydantic import Field

from acquisition.models.base import Value
from acquisition.models.calibration_result import CalibrationSummary

CELL_FILE = "cell"
"""Identifier of the calibration that the cell file names."""


class CalibrationSet(Value):
    """A complete calibration that was made by a session; `set.json` beside its `calibration.json`."""

    id: str = Field(description="Identifier: that of the session that made it")
    kind: str = Field(description="What was calibrated: `camera`, `hand-eye`, …; other values are unchanged")
    fingerprint: str = Field(description="SHA-256 of its values; sessions captured with it record this")
    before: str = Field(description="SHA-256 of the values before it")
    made_at: str = Field(description="When it was made, ISO 8601")
    version: str = Field(description="Version of the software")
    width: int = Field(description="Pixels of an image's row")
    height: int = Field(description="Pixels of an image's column")
    camera: str = Field(description="The camera: its kind, with serial number or address")
    arm: str = Field(description="The arm: model and serial number")
    images: dict[str, str] = Field(description="SHA-256 of each image that it rests on, by name")
    summary: CalibrationSummary = Field(description="The figures of the estimate")
