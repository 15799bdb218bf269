"""Schemas of requests and responses that are not values of `acquisition.models`: resources, pages and problems.

Resources are built from the journal and the runner for each request. None of them is stored, so a schema can change
without a migration. Times are ISO 8601 in UTC.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from acquisition.models.base import Vector3
from acquisition.models.calibration_recipe import AnyRecipe
from acquisition.models.calibration_result import CalibrationSummary
from acquisition.models.errors import ErrorCode
from acquisition.models.light_plan import LightPlan, PriorForecast
from acquisition.models.problem_table import PROBLEMS
from acquisition.models.result import ResultSummary, SolveSettings
from acquisition.models.route import Route
from acquisition.models.shot import Shot
from acquisition.models.time_left import TimeLeft
from acquisition.session import Stage
from acquisition.session_state import State

ItemT = TypeVar("ItemT")
SessionAction = Literal["start", "pause", "resume", "stop"]
Links = Annotated[dict[str, str], Field(description="Addresses of what belongs to it, by relation")]


class Resource(BaseModel):
    """Base of all responses. Clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True)


class RequestBody(BaseModel):
    """Base of all request bodies that are not values of `acquisition.models`.

    Strict like those: 0 is not a boolean and "4" is not a number. A value of another type is refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Page(Resource, Generic[ItemT]):
    """One page of a list, and the address of the next."""

    items: list[ItemT] = Field(description="The items of this page")
    next: str | None = Field(default=None, description="Address of the next page; null at the end")


# ------------------------------------------------------------------------------------------------------------ problems


class FieldError(Resource):
    """One field that is not valid."""

    field: str = Field(description="Dotted name of the field as it was sent")
    message: str = Field(description="What is wrong with it, one sentence")


class Problem(Resource):
    """Problem object (RFC 9457): what went wrong and what to do. Some codes add `allowed`, `holder` or `errors`."""

    model_config = ConfigDict(frozen=True, extra="allow")

    type: str = Field(description="Address of the page about this code")
    title: str = Field(description="What the code means, for people")
    status: int = Field(description="HTTP status of this answer")
    detail: str = Field(description="What happened in this case, for people")
    code: ErrorCode = Field(description="The stable code; switch on this")
    remedy: str = Field(description="What to do, for people")
    instance: str | None = Field(default=None, description="Address that was requested; null where it is not known")

    @classmethod
    def of(
        cls, code: ErrorCode, detail: str, context: Mapping[str, Any] | None = None, instance: str | None = None
    ) -> "Problem":
        """Builds the problem object of a code and a sentence about this case; `context` adds facts for programs."""
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
    """Meaning and remedy of a problem code."""

    code: ErrorCode = Field(description="The stable code")
    status: int = Field(description="HTTP status that the code is answered with")
    title: str = Field(description="What the code means, for people")
    remedy: str = Field(description="What to do, for people")


class Accepted(Resource):
    """Answer to an accepted request; its links lead to the outcome."""

    links: Links


# ------------------------------------------------------------------------------------------------------------ sessions


class ActionRequest(RequestBody):
    """An action on a session."""

    action: SessionAction = Field(
        description="`start` moves the arm; `pause` rests after the present step; `resume` goes on; `stop` halts "
        "at once and ends the session"
    )
    from_here: bool = Field(
        default=False,
        description="With `resume`: a person has inspected the cell and allows the arm to continue from its present "
        "position, although it is not where the session left it",
    )


class OwnLights(RequestBody):
    """Lights chosen by a person, which replace those of a plan."""

    lights: list[Vector3] = Field(
        min_length=1,
        max_length=80,
        description="Positions: m, view frame (origin camera, x right, y up, z to the camera)",
    )


class DryRunResource(Resource):
    """What the first pass of a recipe would do, and the accuracy to expect of its session. Nothing has moved."""

    plan: LightPlan = Field(description="The lights of the first pass")
    route: Route = Field(description="The certified path through them")
    seconds: float = Field(description="Time from the first move to the arm's return, images included, s")
    forecast: PriorForecast = Field(
        description="Expected σ against the number of images, of an assumed object: its own is not known yet"
    )


class ActionResource(Resource):
    """An action, its actor and its outcome: the state that followed, or `refused`."""

    action: str = Field(
        description="What was asked: start, pause, resume, stop, solve, choose-answer, draw-region, replan, …"
    )
    actor: str = Field(description="Who asked: name of the key and address, or `service`")
    outcome: str = Field(description="The state that followed, `refused`, or what it led to")
    at: datetime = Field(description="When, UTC")


class ActionAccepted(Resource):
    """The action was accepted."""

    state: State = Field(description="The session's state after the action")
    links: Links


class ArtefactResource(Resource):
    """One file of a result."""

    name: str = Field(description="File name")
    bytes: int = Field(ge=0, description="Size, bytes")
    sha256: str = Field(description="SHA-256 of the content, 64 hexadecimal digits")
    href: str = Field(description="Its address")


class ResultResource(Resource):
    """One result: its figures and its files."""

    number: int = Field(ge=0, description="Number within the session; 0 is the pilot's")
    passes: list[int] = Field(description="The passes whose images were solved")
    origin: Literal["session", "resolve"] = Field(
        default="session", description="`session`: a pass of the session itself; `resolve`: solved again on request"
    )
    settings: SolveSettings | None = Field(
        default=None, description="How it was solved; null in results of old releases"
    )
    calibration: str | None = Field(
        default=None, description="Identifier of the calibration it was solved with; null: that of the capture"
    )
    created: datetime = Field(description="When it was made, UTC")
    seconds: float = Field(description="Time that the solve took, s")
    summary: ResultSummary = Field(description="The figures that a person reads first")
    artefacts: list[ArtefactResource] = Field(description="Its files")
    exports: dict[str, str] = Field(
        default_factory=dict[str, str], description="Addresses of files that are made on their first request"
    )
    links: Links


class ResolveRequest(RequestBody):
    """Settings and images of a re-solve."""

    settings: SolveSettings = Field(default=SolveSettings(), description="How normals are solved")
    last_pass: int | None = Field(
        default=None, ge=0, le=10_000, description="Use the images of the passes up to this one; null: all images"
    )
    calibration: str | None = Field(
        default=None,
        max_length=80,
        description="Identifier of the calibration to solve with (GET /v1/rig/calibrations); null: that of the capture",
    )


class ResolveAccepted(Resource):
    """An accepted re-solve, with the number that its result will have."""

    number: int = Field(ge=0, description="Number that the result will have")
    links: Links


class SessionEdit(RequestBody):
    """Changes that a person makes to a session. A field that is left out keeps its value."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    label: str | None = Field(default=None, max_length=200, description="New label; empty: none")
    notes: str | None = Field(default=None, max_length=10_000, description="New notes; empty: none")
    answer: int | None = Field(default=None, ge=0, le=10_000, description="Number of the result that is the answer")

    @model_validator(mode="after")
    def _changes_something(self) -> "SessionEdit":
        if self.label is None and self.notes is None and self.answer is None:
            raise ValueError("give at least one of label, notes, answer")
        return self


class SessionResource(Resource):
    """A session: its recipe, its progress and its allowed actions."""

    id: str = Field(description="Identifier: date, time, six hexadecimal digits")
    number: int = Field(ge=1, description="Running number in this data folder; `after` of the list")
    state: State = Field(description="State of the session")
    arm: str = Field(description="What the arm may be doing in this state")
    stage: Stage = Field(description="Stage of the work that it has reached")
    progress: float = Field(ge=0, le=1, description="Share of the work that is done, 0 to 1")
    seconds_left: float | None = Field(description="`time_left.seconds` while it runs, s; else null")
    time_left: TimeLeft | None = Field(description="What is left and what the time rests on, while it holds the rig")
    reason: Problem | None = Field(description="Why the session is in this state, when something went wrong")
    conclusion: str | None = Field(
        default=None, description="With a target accuracy: why no more lights are added, once this is decided"
    )
    allowed_actions: list[SessionAction] = Field(
        description="Actions that this caller may take now and that change the state"
    )
    recipe: AnyRecipe = Field(description="As it was requested; label and notes may have been changed since")
    label: str = Field(description="Its present label: that of the last edit, else of the recipe")
    notes: str = Field(description="Its present notes: those of the last edit, else of the recipe")
    cell: str = Field(description="Name of the cell that it was made for")
    created: datetime = Field(description="When it was made, UTC")
    started: datetime | None = Field(description="When it first started, UTC; null: not yet")
    ended: datetime | None = Field(description="When it ended, UTC; null: not yet")
    calibration: str | None = Field(
        default=None, description="SHA-256 of the calibration that it was created with; null: its folder is not there"
    )
    estimate: CalibrationSummary | None = Field(
        default=None, description="Figures of a calibration session's newest estimate; null: none, or a capture session"
    )
    answer: ResultResource | None = Field(
        description="The result that a person chose; else the newest that the session itself made"
    )
    damage: Problem | None = Field(
        default=None,
        description="In a list: the file that is missing or damaged; `progress` is then as last announced, `answer` "
        "and `calibration` are null. A request for the session itself is answered with this problem",
    )
    links: Links


class ShotResource(Resource):
    """One image and the address of its picture."""

    shot: Shot = Field(description="The image and what was measured while it was exposed")
    links: Links


class PassSummary(Resource):
    """Summary of one pass."""

    number: int = Field(ge=0, description="Number within the session; 0 is the pilot")
    method: str = Field(description="How its lights were chosen: a recipe's `method`")
    lights: int = Field(ge=0, description="Number of planned lights")
    shots: int = Field(ge=0, description="Number of images so far, lamp-off frames included")
    predicted_sigma_deg: float | None = Field(
        description="Expected mean angular σ after this pass, degrees; null: no prediction"
    )
    links: Links


class PassResource(Resource):
    """One pass: its lights, the path through them and its images."""

    number: int = Field(ge=0, description="Number within the session; 0 is the pilot")
    plan: LightPlan = Field(description="Its lights")
    route: Route | None = Field(description="The certified path through them; null: not computed yet")
    shots: list[ShotResource] = Field(description="Its images so far")
    gain_pictures: list[str] = Field(description="For each planned light, the address of its gain map")
    links: Links


class RegionResource(Resource):
    """The region of interest that was set."""

    pixels: int = Field(ge=0, description="Number of pixels in the region")
    links: Links


class EventResource(Resource):
    """One event. The `id` increases for ever, and a listener resumes after the last id that it has received."""

    id: int = Field(
        ge=0, description="Increases for ever; resume after the last one received (`Last-Event-ID` or `after`)"
    )
    session_id: str | None = Field(description="The session that it is about; null: the rig, the queue or the service")
    type: str = Field(
        description="Type, such as `session.state`, `shot.captured`, `normals.ready`; clients ignore types "
        "that they do not know"
    )
    at: datetime = Field(description="When, UTC")
    body: dict[str, Any] = Field(description="Facts for programs; its keys depend on the type")


def as_datetime(seconds: float) -> datetime:
    """Converts a time of the journal (s since 1970, UTC) to a datetime."""
    return datetime.fromtimestamp(seconds, UTC)
