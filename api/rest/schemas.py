"""What crosses HTTP besides the values of `acquisition.types`: resources, links, lists and problems.

Resources are read off the journal and the runner for each request; nothing here is stored. Times are ISO 8601 in UTC.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from acquisition.models.base import Matrix4, Vector3
from acquisition.models.errors import PROBLEMS, ErrorCode
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import ResultSummary, SolveSettings
from acquisition.models.route import Route
from acquisition.models.shot import Shot
from acquisition.session import Stage, State

ItemT = TypeVar("ItemT")
Links = dict[str, str]


class Resource(BaseModel):
    """Base of what the service answers; clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True)


class Page(Resource, Generic[ItemT]):
    """A part of a list, and the address of the next part."""

    items: list[ItemT]
    next: str | None = Field(default=None, description="Address of the next page; null at the end")


# ------------------------------------------------------------------------------------------------------------ problems


class FieldError(Resource):
    """One field that is not valid."""

    field: str
    message: str


class Problem(Resource):
    """What went wrong and what to do (RFC 9457); some codes add facts, such as `allowed`, `holder` or `errors`."""

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
    """What a code means."""

    code: ErrorCode
    status: int
    title: str
    remedy: str


# ------------------------------------------------------------------------------------------------------------- tickets


class TicketResource(Resource):
    """A short-lived right to look, for addresses that a browser opens by itself."""

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
    """Who answered at the arm's address."""

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
    """How old the calibration is."""

    made_at: str
    valid_until: str
    valid: bool


class RigResource(Resource):
    """The rig: who is there, and whether a session may start."""

    cell: str
    fingerprint: str = Field(description="SHA-256 of the cell file's values")
    arm_model: str
    arm_address: str
    arm: ArmResource | None = Field(description="Who answered at that address")
    connected: bool
    camera_ready: bool
    reading: ReadingResource | None
    holder: str | None = Field(description="The session that holds the rig")
    may_start: bool
    reasons: list[Reason] = Field(description="Why not")
    calibration: CalibrationResource
    faults: list[Fault]
    links: Links


class SafetyResource(Resource):
    """The latch: faults stay until a person says that the cell is clear."""

    clear: bool
    faults: list[Fault]
    links: Links


class Health(Resource):
    """A probe's answer."""

    status: Literal["ok"] = "ok"


class Accepted(Resource):
    """The request was taken; follow the link for what comes of it."""

    links: Links


# ------------------------------------------------------------------------------------------------------------ sessions


class ActionRequest(BaseModel):
    """What a person asks of a session."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    action: Literal["start", "pause", "resume", "stop"]
    from_here: bool = Field(
        default=False,
        description="With `resume`: a person has looked and lets the arm go on from where it stands, although it is "
        "not where the session left it",
    )


class OwnLights(BaseModel):
    """A person's own lights in the place of a plan."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    lights: list[Vector3] = Field(
        min_length=1,
        max_length=80,
        description="Positions: m, view frame (origin camera, x right, y up, z to the camera)",
    )


class DryRunResource(Resource):
    """What the first pass of a recipe would do; nothing has moved."""

    plan: LightPlan
    route: Route
    seconds: float = Field(description="From the first move to the arm's return, images included")


class RecoveryRequest(BaseModel):
    """One step out of a stop."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    step: Literal["unlock", "power", "brakes"]


class ActionResource(Resource):
    """Who asked for what, and what came of it: the state that followed, or `refused`."""

    action: str
    actor: str
    outcome: str
    at: datetime


class ActionAccepted(Resource):
    """The action was taken."""

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
        default_factory=dict[str, str], description="Addresses of files that are made when they are first fetched"
    )
    links: Links


class ResolveRequest(BaseModel):
    """How a session is to be solved again."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    settings: SolveSettings = SolveSettings()
    last_pass: int | None = Field(
        default=None, ge=0, le=10_000, description="Use the images of the passes up to this one; null: all images"
    )


class ResolveAccepted(Resource):
    """A solve was accepted; its result will have this number."""

    number: int
    links: Links


class AnswerChoice(BaseModel):
    """Which result is the session's answer."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    answer: int = Field(ge=0, le=10_000, description="The result's number")


class SessionResource(Resource):
    """A session: what was asked, how far it is, what may be done."""

    id: str
    number: int
    state: State
    arm: str = Field(description="What the arm may be doing in this state")
    stage: Stage
    progress: float = Field(ge=0, le=1)
    seconds_left: float | None
    reason: Problem | None = Field(description="Why the session is in this state, when something went wrong")
    conclusion: str | None = Field(
        default=None, description="Why no more lights are taken, where an accuracy was ordered and this is decided"
    )
    allowed_actions: list[str]
    recipe: Recipe
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
    """One pass in short."""

    number: int
    method: str
    lights: int
    shots: int
    predicted_sigma_deg: float | None
    links: Links


class PassResource(Resource):
    """One pass: its lights, the way through them, its images."""

    number: int
    plan: LightPlan
    route: Route | None
    shots: list[ShotResource]
    gain_pictures: list[str] = Field(description="For each planned light, the address of the picture of what it gains")
    links: Links


class RegionResource(Resource):
    """The region of interest that was taken."""

    pixels: int
    links: Links


class EventResource(Resource):
    """One thing that happened; `id` rises without end and names the place to read on from."""

    id: int
    session_id: str | None
    type: str
    at: datetime
    body: dict[str, Any]


def moment(seconds: float) -> datetime:
    """A time of the journal (seconds since 1970, UTC) as ISO 8601."""
    return datetime.fromtimestamp(seconds, UTC)
