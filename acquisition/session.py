"""The choice of a session's next step from its journal: read this first.

Two axes are kept apart. The state (`session_state`) answers "may the arm move?" and is stored. The stage answers "how
far has the work come?"; it is derived from the next step and never stored. The next step is a pure function of the
journal and of the measured joints, so running, pausing, crashing and resuming are one loop: `next_step` returns the
work that is left, and a new route is planned whenever the arm is not where the last route expects it.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import assert_never

from acquisition.models.calibration_recipe import AnyRecipe, CalibrationRecipe
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import Shot, ShotKey
from acquisition.models.step import (
    AwaitReview,
    AwaitTarget,
    ChooseLights,
    GoHome,
    PlanRoute,
    RepeatReference,
    SolveNormals,
    Step,
    TakeDark,
    TakeFurther,
    TakeScan,
    TakeShot,
)
from acquisition.session_state import State

SAME_JOINTS_RAD = 2e-3
"""Joint configurations (rad) closer than this are the same: twice the tolerance within which a move ends."""

FIRST_REFERENCE_NUMBER = 1000
"""Number of the first repeated image within a pass; above the number of lights of any pass."""


FIRST_FURTHER_NUMBER, FURTHER_PER_LIGHT = 10_000, 100
"""Number of the first further frame of a pass's first light, and the distance to that of the next light."""


class Stage(StrEnum):
    """How far the work has come; derived from the next step."""

    PILOT = "pilot"
    PLAN = "plan"
    WAYPOINTS = "waypoints"
    CAPTURE = "capture"
    NORMALS = "normals"
    ESTIMATE = "estimate"
    FINISHED = "finished"


@dataclass(frozen=True)
class PassRecord:
    """One pass as the journal records it."""

    plan: LightPlan | None = None
    route: Route | None = None
    shots: dict[int, Shot] = field(default_factory=dict[int, Shot])  # by light number
    further: dict[int, tuple[Shot, ...]] = field(default_factory=dict[int, tuple[Shot, ...]])  # by light number
    darks: dict[float, Shot] = field(default_factory=dict[float, Shot])  # by exposure time
    references: tuple[Shot, ...] = ()  # repeated images, of this pass or of one before
    repeated: frozenset[ShotKey] = frozenset()  # those repeated after the last of `shots`
    solved: bool = False
    reviewed: bool = False  # a person has approved the plan

    def missing_frame(self, light: int) -> int | None:
        """Number of the first further frame that a captured light lacks; None: it has all."""
        taken = {shot.key.number - further_number(light, 0) for shot in self.further.get(light, ())}
        return next((index for index in range(len(self.shots[light].further_s)) if index not in taken), None)

    @property
    def lights_left(self) -> tuple[int, ...]:
        """Numbers of the plan's lights that still lack frames."""
        lights = range(0 if self.plan is None else len(self.plan.lights))
        return tuple(one for one in lights if one not in self.shots or self.missing_frame(one) is not None)

    @property
    def exposures(self) -> list[float]:
        """The exposure times of all lit frames, ascending, s."""
        further = (shot for shots in self.further.values() for shot in shots)
        return sorted({shot.exposure_s for shot in (*self.shots.values(), *further)})


@dataclass(frozen=True)
class SessionRecord:
    """One session as the journal records it: the only input of `next_step` beside the measured joints."""

    session_id: str
    recipe: AnyRecipe
    state: State
    passes: tuple[PassRecord, ...] = ()
    references: int = 0  # how often an image was repeated
    unverified: bool = False  # it was interrupted, and no image has been repeated since


def next_step(record: SessionRecord, joints: tuple[float, ...], home: tuple[float, ...]) -> Step | None:
    """Chooses the next step for an arm at `joints` (6, rad); None when the recipe is fulfilled. A pure function."""
    for number in range(max_passes(record.recipe)):
        current = record.passes[number] if number < len(record.passes) else PassRecord()
        if current.solved:
            continue
        if current.plan is None:
            return ChooseLights(number)
        if not current.plan.lights:
            break
        if not current.reviewed and (waiting := _waits_for(record.recipe, number)) is not None:
            return waiting if same_joints(joints, home) or isinstance(waiting, AwaitReview) else GoHome(number, None)
        left = current.lights_left
        darks = current.exposures if _takes_darks(record.recipe) else []
        reference_key = ShotKey(pass_number=number, number=FIRST_REFERENCE_NUMBER + record.references)
        first = _first_image(record, number)
        if not left and first is not None and first.key not in current.repeated and _may_have_moved(current):
            return RepeatReference(first, reference_key, closes_pass=True)
        newest = _newest_image(record, number)
        if record.unverified and newest is not None and (left or any(dark not in current.darks for dark in darks)):
            return RepeatReference(newest, reference_key)
        if left:
            legs = [] if current.route is None else _next_legs(current.route, left, joints)
            if not legs:
                return PlanRoute(number, left)
            shots = [_frame_of_light(current, number, light, waypoint) for light, waypoint in legs]
            firsts = tuple(shot for shot in shots if isinstance(shot, TakeShot))
            return TakeScan(firsts) if while_moving(record.recipe) and len(firsts) > 1 else shots[0]
        if not same_joints(joints, home):
            return GoHome(number, current.route)
        for dark_number, exposure_s in enumerate(darks):
            if exposure_s not in current.darks:
                key = ShotKey(pass_number=number, number=len(current.plan.lights) + dark_number)
                return TakeDark(key, exposure_s)
        return SolveNormals(number)
    return None if same_joints(joints, home) else GoHome(max(len(record.passes) - 1, 0), None)


def further_number(light: int, index: int) -> int:
    """Number within the pass of a light's further frame, both counted from 0."""
    return FIRST_FURTHER_NUMBER + FURTHER_PER_LIGHT * light + index


def max_passes(recipe: AnyRecipe) -> int:
    """The largest number of passes of a recipe.

    A fixed pattern has one, planned lights have a pilot and one more. A target accuracy may take a pass for each light,
    and ends with a pass that has no lights; so does a calibration.
    """
    if not isinstance(recipe, Recipe):
        return recipe.passes_most
    if recipe.target_sigma_deg is not None:
        return 2 + recipe.max_lights - recipe.pilot_lights
    return 2 if recipe.method == "optimal" and recipe.planned_lights > 0 else 1


def stage(record: SessionRecord, step: Step | None) -> Stage:
    """The stage that a step belongs to."""
    match step:
        case None:
            return Stage.FINISHED
        case ChooseLights():
            return Stage.PILOT if _is_pilot(record.recipe, step.pass_number) else Stage.PLAN
        case AwaitReview() | AwaitTarget():
            return Stage.PLAN
        case PlanRoute():
            return Stage.WAYPOINTS
        case RepeatReference() | TakeShot() | TakeScan() | TakeFurther() | TakeDark() | GoHome():
            return Stage.CAPTURE
        case SolveNormals():
            return Stage.NORMALS if isinstance(record.recipe, Recipe) else Stage.ESTIMATE
        case _:
            assert_never(step)


def progress(record: SessionRecord) -> float:
    """The fraction of the work that is done, 0–1, by captured images and completed solves.

    The length of a session with a target accuracy is not known before its last pass; until then the planned passes and
    one more are counted.
    """
    if record.state is State.COMPLETED:
        return 1.0
    recipe = record.recipe
    if not isinstance(recipe, Recipe):
        total = recipe.max_images + 2 * recipe.passes_most
    elif recipe.target_sigma_deg is None:
        total = recipe.lights_total + 2 * max_passes(recipe)
    else:
        planned = [len(work.plan.lights) for work in record.passes if work.plan is not None]
        more = not planned or planned[-1] > 0
        total = max(sum(planned), recipe.pilot_lights) + 2 * max(len(planned), 1) + 3 * more
    return min(1.0, sum(len(work.shots) + 2 * work.solved for work in record.passes) / total)


def same_joints(joints: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Whether two joint configurations (rad) are the same within `SAME_JOINTS_RAD`; full turns differ."""
    return len(joints) == len(other) and all(
        abs(one - two) < SAME_JOINTS_RAD for one, two in zip(joints, other, strict=True)
    )


def _frame_of_light(work: PassRecord, number: int, light: int, waypoint: Waypoint) -> TakeShot | TakeFurther:
    """The next frame of a light of pass `number`: its first, or the first further one that it lacks."""
    key = ShotKey(pass_number=number, number=light)
    if light not in work.shots or (index := work.missing_frame(light)) is None:
        return TakeShot(key, waypoint)
    further = ShotKey(pass_number=number, number=further_number(light, index))
    return TakeFurther(further, key, index, work.shots[light].further_s[index], waypoint)


def _is_pilot(recipe: AnyRecipe, pass_number: int) -> bool:
    """Whether the lights of a pass come from the pilot's fixed pattern."""
    return pass_number == 0 and isinstance(recipe, Recipe) and recipe.method == "optimal"


def while_moving(recipe: AnyRecipe) -> bool:
    """Whether images are taken as the arm arrives."""
    return isinstance(recipe, Recipe) and recipe.capture.while_moving


def _takes_darks(recipe: AnyRecipe) -> bool:
    """Whether each exposure time of a pass has a lamp-off frame."""
    return isinstance(recipe, Recipe) or recipe.takes_darks


def _may_have_moved(work: PassRecord) -> bool:
    """Whether the object could have moved unnoticed within a pass: some image was not compared with a predicted one."""
    return any(shot.quality.shift_px is None for shot in work.shots.values())


def _waits_for(recipe: AnyRecipe, pass_number: int) -> AwaitReview | AwaitTarget | None:
    """What a pass waits for before its images: the review of its plan, or another target in the object's place. The
    target of the first pass is there already."""
    if isinstance(recipe, CalibrationRecipe):
        return AwaitTarget(pass_number) if pass_number > 0 and recipe.waits_for_targets else None
    return AwaitReview(pass_number) if recipe.review_plan and not _is_pilot(recipe, pass_number) else None


def _same_scene(record: SessionRecord, pass_number: int) -> tuple[PassRecord, ...]:
    """The passes that show the same scene as this one: all, unless each has a target of its own."""
    if isinstance(record.recipe, CalibrationRecipe) and record.recipe.waits_for_targets:
        return record.passes[pass_number : pass_number + 1]
    return record.passes


def _first_image(record: SessionRecord, pass_number: int) -> Shot | None:
    """The lit image of a pass's scene that was captured first."""
    return next((shot for work in _same_scene(record, pass_number) for shot in work.shots.values()), None)


def _newest_image(record: SessionRecord, pass_number: int) -> Shot | None:
    """The lit image of a pass's scene that was captured last: the arm is near its joints, or on the path from there."""
    shots = [shot for work in _same_scene(record, pass_number) for shot in work.shots.values()]
    return max(shots, key=lambda shot: shot.taken_at) if shots else None


def _next_legs(route: Route, left: tuple[int, ...], joints: tuple[float, ...]) -> list[tuple[int, Waypoint]]:
    """The remaining lights and waypoints without a gap, from the leg at whose start or end the arm is."""
    if not set(left) <= set(route.light_numbers):
        return []
    leg_start: tuple[float, ...] = route.start
    legs: list[tuple[int, Waypoint]] = []
    for light_number, waypoint in zip(route.light_numbers, route.waypoints, strict=True):
        if light_number in left:
            if not legs and not (same_joints(joints, leg_start) or same_joints(joints, waypoint.joints)):
                return []
            legs.append((light_number, waypoint))
        elif legs:
            break
        leg_start = waypoint.joints
    return legs
