"""Schemas of calibration sessions, separate from their routes because the clients use them as well."""

from datetime import datetime

from pydantic import Field

from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.cell_config import Tool
from api.rest.schemas import ArtefactResource, Links, Resource


class CalibrationKindResource(Resource):
    """A kind of calibration session, and the newest calibration that such a session has made."""

    kind: str = Field(description="`kind` of the recipe: `camera`, `hand-eye`, …")
    recipe: str = Field(description="Name of its recipe's schema in /openapi.json")
    explanation: str = Field(description="Description of the kind, from its recipe")
    tool: Tool = Field(description="What its sessions need on the flange; PUT /v1/rig/tool states what is there")
    made_at: str | None = Field(
        description="When the newest calibration or check of this kind was made, ISO 8601; null: none"
    )
    age_days: float | None = Field(description="Days since then; null: none was made")
    calibration: str | None = Field(
        description="Identifier of that calibration; null: none was made, and a check makes none"
    )
    links: Links


class EstimateResource(Resource):
    """Estimate that a calibration session made after a pass, from all its images so far."""

    number: int = Field(ge=0, description="Number of the pass after which it was made")
    created: datetime = Field(description="When it was made, UTC")
    seconds: float = Field(description="Time that it took, s")
    summary: CalibrationSummary = Field(description="The figures that a person reads first")
    artefacts: list[ArtefactResource] = Field(description="Its files: values, residuals of each image, pictures")
    links: Links
