"""What may happen in a session, and what comes next: read this first.

Two axes, never multiplied. `State` answers "may the arm move?" and changes only by the table `TRANSITIONS`. `Stage`
answers "how far has the work come?"; it is read off the next step and never stored. The next step is a pure function of
the journal and of where the arm stands, so running, pausing, crashing and resuming are one loop: whoever asks
`next_step` again gets the work that is left, and a route is planned anew whenever the arm is not where the last one
expects it.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import assert_never

from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import Shot, ShotKey

SAME_PLACE_RAD = 2e-3
"""Joints closer than this are the same place; a move ends within half of it."""

REFERENCES_FROM = 1000
"""Numbers of repeated images within a pass; no pass has so many lights."""


class State(StrEnum):
    """What the arm may be doing."""

    CREATED = "created"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    INTERRUPTED = "interrupted"
    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"


THE_ARM: dict[State, str] = {
    State.CREATED: "The arm is not this session's.",
    State.RUNNING: "The arm may move.",
    State.PAUSING: "The arm finishes the present step.",
    State.PAUSED: "The arm is at rest.",
    State.STOPPING: "The arm decelerates.",
    State.INTERRUPTED: "The arm is at rest or its state is unknown; nothing may move before an operator decides.",
    State.COMPLETED: "The arm is not this session's.",
    State.STOPPED: "The arm is not this session's.",
    State.FAILED: "The arm is not this session's.",
}

HOLDS_THE_RIG = frozenset({State.RUNNING, State.PAUSING, State.PAUSED, State.STOPPING, State.INTERRUPTED})
ENDED = frozenset({State.COMPLETED, State.STOPPED, State.FAILED})


class Trigger(StrEnum):
    """What changes a state."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    SETTLE = "settle"
    FINISH = "finish"
    FAIL = "fail"
    INTERRUPT = "interrupt"


class Actor(StrEnum):
    """Who pulls a trigger."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    RUNNER = "runner"
    SERVICE = "service"

    @classmethod
    def of(cls, name: str) -> "Actor":
        """The actor behind a name in the journal: the service's own two parts, else a person who operates."""
        return cls(name) if name in (cls.RUNNER, cls.SERVICE) else cls.OPERATOR


ACTIONS = (Trigger.START, Trigger.PAUSE, Trigger.RESUME, Trigger.STOP)
"""The triggers that a person has."""

MAY: dict[Actor, frozenset[Trigger]] = {
    Actor.VIEWER: frozenset(),
    Actor.OPERATOR: frozenset(ACTIONS),
    # The runner pauses for a plan that a person wants to see, and for what a person has to mend; it never resumes.
    Actor.RUNNER: frozenset({Trigger.PAUSE, Trigger.SETTLE, Trigger.FINISH, Trigger.FAIL, Trigger.INTERRUPT}),
    # At start-up, for sessions found active, and when the safety monitor latches a fault.
    Actor.SERVICE: frozenset({Trigger.INTERRUPT}),
}
"""Who may pull which trigger at all; whether it does anything, the state says."""

TRANSITIONS: dict[tuple[State, Trigger], State] = {
    (State.CREATED, Trigger.START): State.RUNNING,
    (State.CREATED, Trigger.STOP): State.STOPPED,
    (State.RUNNING, Trigger.PAUSE): State.PAUSING,
    (State.RUNNING, Trigger.STOP): State.STOPPING,
    (State.RUNNING, Trigger.FINISH): State.COMPLETED,
    (State.RUNNING, Trigger.FAIL): State.FAILED,
    (State.RUNNING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.PAUSING, Trigger.SETTLE): State.PAUSED,
    (State.PAUSING, Trigger.RESUME): State.RUNNING,
    (State.PAUSING, Trigger.STOP): State.STOPPING,
    (State.PAUSING, Trigger.FINISH): State.COMPLETED,
    (State.PAUSING, Trigger.FAIL): State.FAILED,
    (State.PAUSING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.PAUSED, Trigger.RESUME): State.RUNNING,
    (State.PAUSED, Trigger.STOP): State.STOPPING,
    (State.PAUSED, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.STOPPING, Trigger.SETTLE): State.STOPPED,
    (State.STOPPING, Trigger.FAIL): State.FAILED,
    (State.STOPPING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.INTERRUPTED, Trigger.RESUME): State.RUNNING,
    (State.INTERRUPTED, Trigger.STOP): State.STOPPED,
}

_ALREADY_TRUE: dict[Trigger, frozenset[State]] = {
    Trigger.START: HOLDS_THE_RIG,
    Trigger.RESUME: frozenset({State.RUNNING}),
    Trigger.PAUSE: frozenset({State.PAUSING, State.PAUSED}),
    Trigger.STOP: frozenset({State.STOPPING, State.STOPPED}),
}


def after(state: State, trigger: Trigger, actor: Actor) -> State | None:
    """The state after a trigger; the same state when what is asked for is already so; None when it is not allowed."""
    if trigger not in MAY[actor]:
        return None
    if trigger in _ALREADY_TRUE and state in _ALREADY_TRUE[trigger]:
        return state
    return TRANSITIONS.get((state, trigger))


def allowed(state: State, actor: Actor = Actor.OPERATOR) -> list[Trigger]:
    """The actions that a person may take in this state and that would change it."""
    return [action for action in ACTIONS if action in MAY[actor] and (state, action) in TRANSITIONS]


class Stage(StrEnum):
    """How far the work has come."""

    PILOT = "pilot"
    PLAN = "plan"
    WAYPOINTS = "waypoints"
    CAPTURE = "capture"
    NORMALS = "normals"
    FINISHED = "finished"


# ------------------------------------------------------------------------------------------------------------ the steps


@dataclass(frozen=True)
class ChooseLights:
    """Choose the lights of a pass: the pilot's pattern, a fixed pattern, or the planned ones."""

    pass_number: int


@dataclass(frozen=True)
class AwaitReview:
    """Wait until a person has looked at the lights of a pass, and perhaps put others in their place."""

    pass_number: int


@dataclass(frozen=True)
class RepeatReference:
    """Take an image again, to see that nothing has moved since: one that was taken before an interruption, or, when a
    pass has all its images, the session's first."""

    shot: Shot
    key: ShotKey
    closes_pass: bool = False


@dataclass(frozen=True)
class PlanRoute:
    """Find certified joint paths from where the arm is through the lights that are left, and home."""

    pass_number: int
    light_numbers: tuple[int, ...]


@dataclass(frozen=True)
class TakeShot:
    """Move along a waypoint's path and take its image."""

    key: ShotKey
    waypoint: Waypoint


@dataclass(frozen=True)
class GoHome:
    """Follow a certified path home, so that the arm is out of the picture."""

    pass_number: int
    route: Route | None


@dataclass(frozen=True)
class TakeDark:
    """Take the lamp-off frame of one exposure time."""

    key: ShotKey
    exposure_s: float


@dataclass(frozen=True)
class SolveNormals:
    """Solve all images taken so far."""

    number: int


Step = ChooseLights | AwaitReview | RepeatReference | PlanRoute | TakeShot | GoHome | TakeDark | SolveNormals


@dataclass(frozen=True)
class PassRecord:
    """What the journal holds of one pass."""

    plan: LightPlan | None = None
    route: Route | None = None
    shots: dict[int, Shot] = field(default_factory=dict[int, Shot])  # by light number
    darks: dict[float, Shot] = field(default_factory=dict[float, Shot])  # by exposure time
    references: tuple[Shot, ...] = ()  # images taken again, of this pass or of one before
    repeated: frozenset[ShotKey] = frozenset()  # those taken again since the last of `shots`
    solved: bool = False
    reviewed: bool = False  # a person has seen the plan and let it pass


@dataclass(frozen=True)
class Record:
    """What the journal holds of one session."""

    session_id: str
    recipe: Recipe
    state: State
    passes: tuple[PassRecord, ...] = ()
    references: int = 0  # how often an image was repeated
    unverified: bool = False  # it was interrupted, and no image has been repeated since


def next_step(record: Record, joints: tuple[float, ...], home: tuple[float, ...]) -> Step | None:
    """The work that comes next for an arm standing at `joints` (rad); None when the recipe is fulfilled."""
    for number in range(passes_wanted(record.recipe)):
        work = record.passes[number] if number < len(record.passes) else PassRecord()
        if work.solved:
            continue
        if work.plan is None:
            return ChooseLights(number)
        if not work.plan.lights:
            break
        if record.recipe.review_plan and not work.reviewed and not _is_pilot(record.recipe, number):
            return AwaitReview(number)
        left = tuple(light for light in range(len(work.plan.lights)) if light not in work.shots)
        darks = sorted({shot.exposure_s for shot in work.shots.values()})
        reference_key = ShotKey(pass_number=number, number=REFERENCES_FROM + record.references)
        first = _first_image(record)
        if not left and first is not None and first.key not in work.repeated and _may_have_moved(work):
            return RepeatReference(first, reference_key, closes_pass=True)
        newest = _newest_image(record)
        if record.unverified and newest is not None and (left or any(dark not in work.darks for dark in darks)):
            return RepeatReference(newest, reference_key)
        if left:
            leg = None if work.route is None else _next_leg(work.route, left, joints)
            if leg is None:
                return PlanRoute(number, left)
            light_number, waypoint = leg
            return TakeShot(ShotKey(pass_number=number, number=light_number), waypoint)
        if not same_place(joints, home):
            return GoHome(number, work.route)
        for dark_number, exposure_s in enumerate(darks):
            if exposure_s not in work.darks:
                key = ShotKey(pass_number=number, number=len(work.plan.lights) + dark_number)
                return TakeDark(key, exposure_s)
        return SolveNormals(number)
    return None if same_place(joints, home) else GoHome(max(len(record.passes) - 1, 0), None)


def passes_wanted(recipe: Recipe) -> int:
    """How many passes the recipe has at most.

    A fixed pattern has a single one, planned lights a pilot and one more. A target of accuracy may take a pass for each
    light, and ends with one that has no lights.
    """
    if recipe.target_sigma_deg is not None:
        return 2 + recipe.max_lights - recipe.pilot_lights
    return 2 if recipe.method == "optimal" and recipe.planned_lights > 0 else 1


def stage(record: Record, step: Step | None) -> Stage:
    """The stage that a step belongs to."""
    match step:
        case None:
            return Stage.FINISHED
        case ChooseLights():
            return Stage.PILOT if _is_pilot(record.recipe, step.pass_number) else Stage.PLAN
        case AwaitReview():
            return Stage.PLAN
        case PlanRoute():
            return Stage.WAYPOINTS
        case RepeatReference() | TakeShot() | TakeDark() | GoHome():
            return Stage.CAPTURE
        case SolveNormals():
            return Stage.NORMALS
        case _:
            assert_never(step)


def progress(record: Record) -> float:
    """The share of the work that is done, 0–1, by the images taken and the solves made.

    How much a target of accuracy will take is not known before its last pass; what is planned, and one pass more, is
    counted until then.
    """
    if record.state is State.COMPLETED:
        return 1.0
    recipe = record.recipe
    if recipe.target_sigma_deg is None:
        total = recipe.lights_total + 2 * passes_wanted(recipe)
    else:
        planned = [len(work.plan.lights) for work in record.passes if work.plan is not None]
        more = not planned or planned[-1] > 0
        total = max(sum(planned), recipe.pilot_lights) + 2 * max(len(planned), 1) + 3 * more
    return min(1.0, sum(len(work.shots) + 2 * work.solved for work in record.passes) / total)


def same_place(joints: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Whether two joint configurations (rad) are the same within `SAME_PLACE_RAD`; full turns differ."""
    return len(joints) == len(other) and all(
        abs(one - two) < SAME_PLACE_RAD for one, two in zip(joints, other, strict=True)
    )


def _is_pilot(recipe: Recipe, pass_number: int) -> bool:
    """Whether the lights of a pass come from the pilot's pattern, which nobody has planned."""
    return pass_number == 0 and recipe.method == "optimal"


def _may_have_moved(work: PassRecord) -> bool:
    """Whether a movement of the object within a pass could be unseen: an image was not judged by a foretold one."""
    return any(shot.quality.shift_px is None for shot in work.shots.values())


def _first_image(record: Record) -> Shot | None:
    """The lit image that was taken first."""
    return next((shot for work in record.passes for shot in work.shots.values()), None)


def _newest_image(record: Record) -> Shot | None:
    """The lit image that was taken last: the arm stands near its place, or on the way from there."""
    taken = [shot for work in record.passes for shot in work.shots.values()]
    return max(taken, key=lambda shot: shot.taken_at) if taken else None


def _next_leg(route: Route, left: tuple[int, ...], joints: tuple[float, ...]) -> tuple[int, Waypoint] | None:
    """The first light left and its waypoint, if the arm stands where that leg begins (or at its end)."""
    if not set(left) <= set(route.light_numbers):
        return None
    place: tuple[float, ...] = route.start
    for light_number, waypoint in zip(route.light_numbers, route.waypoints, strict=True):
        if light_number in left:
            here = same_place(joints, place) or same_place(joints, waypoint.joints)
            return (light_number, waypoint) if here else None
        place = waypoint.joints
    return None
