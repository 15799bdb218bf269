"""Schemas of requests and responses besides the values of `acquisition.models`: resources, pages and problems.

Resources are built from the journal and the runner for each request; none of them is stored, so that a schema can
change without a migration. Times are ISO 8601 in UTC.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from acquisition.devices import DriverPriority
from acquisition.models.base import Matrix4, Vector3
from acquisition.models.errors import PROBLEMS, ErrorCode
from acquisition.models.light_plan import LightPlan, PriorForecast
from acquisition.models.recipe import Recipe
from acquisition.models.result import ResultSummary, SolveSettings
from acquisition.models.route import Route
from acquisition.models.shot import Shot
from acquisition.models.time_left import TimeLeft
from acquisition.session import Stage, State
from api.rest.keys import Role

ItemT = TypeVar("ItemT")
Links = dict[str, str]


class Resource(BaseModel):
    """Base of all responses; clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True)


class Page(Resource, Generic[ItemT]):
    """One page of a list, and the address of the next."""

    items: list[ItemT]
    next: str | None = Field(default=None, description="Address of the next page; null at the end")


# ------------------------------------------------------------------------------------------------------------ problems


class FieldError(Resource):
    """One field that is not valid."""

    field: str
    message: str


class Problem(Resource):
    """Problem object (RFC 9457): what went wrong and what to do; some codes add `allowed`, `holder` or `errors`."""

    model_config = ConfigDict(frozen=True, extra="allow")

    type: str = Field(description="Address of the page about this code")
    title: str
    status: int
    detail: str
    code: ErrorCode
    remedy: str
    instance: str | None = None

    @classmethod
    def of(
        cls, code: ErrorCode, detail: str, context: Mapping[str, Any] | None = None, instance: str | None = None
    ) -> "Problem":
        """The problem object of a code and a sentence about this case; `context` adds facts for programs."""
        entry = PROBLEMS[code]
        own = {
            "type": f"/problems/{code}",
            "title": entry.title,
            "status": entry.status,
            "detail": detail,
            "code": code,
            "remedy": entry.remedy,
            "instance": instance,
        }
        return cls.model_validate({**(context or {}), **own})


class ProblemPage(Resource):
    """Meaning and remedy of a code."""

    code: ErrorCode
    status: int
    title: str
    remedy: str


# ------------------------------------------------------------------------------------------------------------- tickets


class CallerResource(Resource):
    """Who asks: without keys `operator`, whose role is operator."""

    name: str
    role: Role


class TicketResource(Resource):
    """A short-lived permission to read, for addresses that a browser opens by itself."""

    ticket: str
    good_until: datetime


# ----------------------------------------------------------------------------------------------------------------- rig


class Reason(Resource):
    """Why the rig may not start."""

    code: ErrorCode
    detail: str
    remedy: str


class Fault(Resource):
    """A safety fault that nobody has acknowledged."""

    code: ErrorCode
    detail: str
    remedy: str
    since: datetime


class ArmResource(Resource):
    """Identity of the arm's controller."""

    model: str
    serial: str
    software: str


class ReadingResource(Resource):
    """The newest values from the arm's controller."""

    joints: list[float] = Field(description="rad")
    joint_speeds: list[float] = Field(description="rad/s")
    base_from_tool: Matrix4
    robot_mode: int
    safety_bits: int
    program_running: bool
    speed_fraction: float
    age_s: float


class CalibrationResource(Resource):
    """Age and validity of the calibration."""

    made_at: str
    valid_until: str
    valid: bool


class RigResource(Resource):
    """The rig: its devices, and whether a session may start."""

    version: str = Field(description="Version of this software")
    cell: str
    fingerprint: str = Field(description="SHA-256 of the cell file's values")
    arm_model: str
    arm_address: str
    arm: ArmResource | None = Field(description="Identity of the controller at that address")
    connected: bool
    driver_priority: DriverPriority | None = Field(
        description="Scheduling of the arm's driver that this machine has granted; below `real-time` other "
        "programs may make it stop the arm in mid-move, safely. None while there is no driver"
    )
    camera_ready: bool
    reading: ReadingResource | None
    holder: str | None = Field(description="The session that holds the rig")
    may_start: bool
    reasons: list[Reason] = Field(description="Why not")
    calibration: CalibrationResource
    faults: list[Fault]
    links: Links


class SafetyResource(Resource):
    """The latched faults: they stay until a person acknowledges that the cell is clear."""

    clear: bool
    faults: list[Fault]
    links: Links


class Health(Resource):
    """A probe's answer."""

    status: Literal["ok"] = "ok"


class Accepted(Resource):
    """The request was accepted; the links lead to its outcome."""

    links: Links


# ------------------------------------------------------------------------------------------------------------ sessions


class ActionRequest(BaseModel):
    """An action requested of a session."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    action: Literal["start", "pause", "resume", "stop"]
    from_here: bool = Field(
        default=False,
        description="With `resume`: a person has inspected the cell and allows the arm to continue from its present "
        "position, although it is not where the session left it",
    )


class OwnLights(BaseModel):
    """A person's own lights, which replace those of a plan."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    lights: list[Vector3] = Field(
        min_length=1,
        max_length=80,
        description="Positions: m, view frame (origin camera, x right, y up, z to the camera)",
    )


class DryRunResource(Resource):
    """What the first pass of a recipe would do, and what its session may reach; nothing has moved."""

    plan: LightPlan
    route: Route
    seconds: float = Field(description="From the first move to the arm's return, images included")
    forecast: PriorForecast = Field(
        description="Expected σ against the number of images, of an assumed object: its own is not known yet"
    )


class RecoveryRequest(BaseModel):
    """One step of recovery from a stop."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    step: Literal["unlock", "power", "brakes"]


class ActionResource(Resource):
    """An action, its actor and its outcome: the state that followed, or `refused`."""

    action: str
    actor: str
    outcome: str
    at: datetime


class ActionAccepted(Resource):
    """The action was accepted."""

    state: State
    links: Links


class ArtefactResource(Resource):
    """One file of a result."""

    name: str
    bytes: int
    sha256: str
    href: str


class ResultResource(Resource):
    """One result: its figures and its files."""

    number: int
    passes: list[int] = Field(description="The passes whose images were solved")
    origin: Literal["session", "resolve"] = "session"
    settings: SolveSettings | None = Field(
        default=None, description="How it was solved; null in results of old releases"
    )
    created: datetime
    seconds: float = Field(description="Time that the solve took")
    summary: ResultSummary
    artefacts: list[ArtefactResource]
    exports: dict[str, str] = Field(
        default_factory=dict[str, str], description="Addresses of files that are made on their first request"
    )
    links: Links


class ResolveRequest(BaseModel):
    """Settings and images of a re-solve."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    settings: SolveSettings = SolveSettings()
    last_pass: int | None = Field(
        default=None, ge=0, le=10_000, description="Use the images of the passes up to this one; null: all images"
    )


class ResolveAccepted(Resource):
    """A re-solve was accepted; its result will have this number."""

    number: int
    links: Links


class SessionEdit(BaseModel):
    """What a person changes about a session; a field that is left out stays as it is."""

    model_config = ConfigDict(frozen=True, extra="forbid", json_schema_extra={"minProperties": 1})

    label: str | None = Field(default=None, max_length=200, description="New label; empty: none")
    notes: str | None = Field(default=None, max_length=10_000, description="New notes; empty: none")
    answer: int | None = Field(default=None, ge=0, le=10_000, description="Number of the result that is the answer")

    @model_validator(mode="after")
    def _changes_something(self) -> "SessionEdit":
        if self.label is None and self.notes is None and self.answer is None:
            raise ValueError("give at least one of label, notes, answer")
        return self


class SessionResource(Resource):
    """A session: its recipe, its progress, its allowed actions."""

    id: str
    number: int
    state: State
    arm: str = Field(description="What the arm may be doing in this state")
    stage: Stage
    progress: float = Field(ge=0, le=1)
    seconds_left: float | None = Field(description="`time_left.seconds` while it runs, s; else null")
    time_left: TimeLeft | None = Field(description="What is left and what the time rests on, while it holds the rig")
    reason: Problem | None = Field(description="Why the session is in this state, when something went wrong")
    conclusion: str | None = Field(
        default=None, description="With an ordered accuracy: why no more lights are added, once this is decided"
    )
    allowed_actions: list[str]
    recipe: Recipe = Field(description="As it was ordered; label and notes may have been changed since")
    label: str = Field(description="Its present label: that of the last edit, else of the recipe")
    notes: str = Field(description="Its present notes: those of the last edit, else of the recipe")
    cell: str
    created: datetime
    started: datetime | None
    ended: datetime | None
    answer: ResultResource | None = Field(
        description="The result that a person chose; else the newest that the session itself made"
    )
    links: Links


class ShotResource(Resource):
    """One image and the address of its picture."""

    shot: Shot
    links: Links


class PassSummary(Resource):
    """Summary of a pass."""

    number: int
    method: str
    lights: int
    shots: int
    predicted_sigma_deg: float | None
    links: Links


class PassResource(Resource):
    """One pass: its lights, the path through them, its images."""

    number: int
    plan: LightPlan
    route: Route | None
    shots: list[ShotResource]
    gain_pictures: list[str] = Field(description="For each planned light, the address of its gain map")
    links: Links


class RegionResource(Resource):
    """The region of interest that was set."""

    pixels: int
    links: Links


class EventResource(Resource):
    """One event; `id` increases for ever, and a listener resumes after the last id that it has received."""

    id: int
    session_id: str | None
    type: str
    at: datetime
    body: dict[str, Any]


def as_datetime(seconds: float) -> datetime:
    """Converts a time of the journal (seconds since 1970, UTC)."""
    return datetime.fromtimestamp(seconds, UTC)
