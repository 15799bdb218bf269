"""The order of steps from `next_step`, stages and progress."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest

from acquisition import session
from acquisition.models.calibration_recipe import LampRecipe
from acquisition.models.light_plan import Light, LightPlan
from acquisition.models.recipe import Capture, Recipe
from acquisition.models.route import Route, Waypoint
from acquisition.models.shot import FrameQuality, FrameRef, Shot, ShotKey
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
from acquisition.session import PassRecord, SessionRecord, Stage
from acquisition.session_state import State

HOME = (0.0,) * 6
LIGHT = Light(position=(0.0, 0.0, -0.4), axis=(0.0, 0.0, -1.0))


def joints(number: int) -> tuple[float, float, float, float, float, float]:
    return (0.1 * (number + 1), 0.0, 0.0, 0.0, 0.0, 0.0)


def route(order: list[int], start: tuple[float, ...] = HOME) -> Route:
    waypoints = [Waypoint(light=LIGHT, path=[joints(light)], speeds=[1.0], seconds=1.0) for light in order]
    return Route(
        start=start, waypoints=waypoints, light_numbers=order, home_path=[HOME], home_speeds=[1.0],
        seconds=len(order) + 1.0, lower_bound_s=1.0,
    )  # fmt: skip


def plan(count: int) -> LightPlan:
    return LightPlan(lights=[LIGHT] * count, method="pilot", reasons=["test"] * count)


def shot(number: int, exposure_s: float = 0.05, kind: str = "light", shift_px: float | None = None) -> Shot:
    return Shot(
        key=ShotKey(pass_number=0, number=number), kind="dark" if kind == "dark" else "light",
        frame=FrameRef(path="x.tiff", width=4, height=4, sha256="0"), exposure_s=exposure_s,
        light_number=None if kind == "dark" else number, taken_at=0.0,
        quality=FrameQuality(saturated=0.0, bright_level=0.8, shift_px=shift_px, accepted=True),
    )  # fmt: skip


def record(recipe: Recipe | LampRecipe, *passes: PassRecord) -> SessionRecord:
    return SessionRecord("s", recipe, State.RUNNING, passes)


def walk(recipe: Recipe, lights: Sequence[int] = (3,)) -> list[Step]:
    """All steps in the order of `next_step`, each applied to the record; `lights` of planned passes in turn."""
    work: dict[int, PassRecord] = {}
    at_joints: tuple[float, ...] = HOME
    steps: list[Step] = []
    for _ in range(200):
        step = session.next_step(record(recipe, *(work[number] for number in sorted(work))), at_joints, HOME)
        if step is None:
            return steps
        steps.append(step)
        match step:
            case ChooseLights():
                is_pilot = step.pass_number == 0 and recipe.method == "optimal"
                count = recipe.pilot_lights if is_pilot else lights[max(step.pass_number - 1, 0)]
                work[step.pass_number] = PassRecord(plan=plan(count))
            case AwaitReview():
                work[step.pass_number] = replace(work[step.pass_number], reviewed=True)
            case RepeatReference():
                assert step.closes_pass  # nothing was interrupted
                assert step.shot == next(iter(work[0].shots.values()))
                number = step.key.pass_number
                work[number] = replace(work[number], repeated=frozenset({step.shot.key}))
                at_joints = joints(step.shot.key.number)
            case PlanRoute():
                order = sorted(step.light_numbers, reverse=True)
                work[step.pass_number] = replace(work[step.pass_number], route=route(order, at_joints))
            case TakeShot():
                at_joints = step.waypoint.joints
                number, was = step.key.pass_number, work[step.key.pass_number]
                shift_px = None if number == 0 else 0.1
                captured = shot(step.key.number, 0.05 if step.key.number % 2 else 0.1, shift_px=shift_px)
                work[number] = replace(was, shots={**was.shots, step.key.number: captured})
            case GoHome():
                at_joints = HOME
            case TakeDark():
                was = work[step.key.pass_number]
                work[step.key.pass_number] = replace(was, darks={**was.darks, step.exposure_s: shot(9, kind="dark")})
            case SolveNormals():
                work[step.number] = replace(work[step.number], solved=True)
    raise AssertionError("the steps have no end")


def test_next_step_full_session_has_the_stated_order() -> None:
    names = [type(step).__name__ for step in walk(Recipe(pilot_lights=4, planned_lights=3))]
    after_lights = ["GoHome", "TakeDark", "TakeDark", "SolveNormals"]
    pilot = ["ChooseLights", "PlanRoute", *["TakeShot"] * 4, "RepeatReference", *after_lights]
    assert [name for name, _ in itertools.groupby(names)].count("SolveNormals") == 2
    assert names == [*pilot, "ChooseLights", "PlanRoute", *["TakeShot"] * 3, *after_lights]


def test_max_passes_fixed_pattern_and_pilot_alone_have_one() -> None:
    assert session.max_passes(Recipe(method="two-rings")) == 1
    assert session.max_passes(Recipe(planned_lights=0)) == 1
    assert session.max_passes(Recipe()) == 2


def test_next_step_target_accuracy_ends_with_an_empty_plan() -> None:
    steps = walk(Recipe(target_sigma_deg=0.7), lights=(3, 1, 1, 0))
    assert [step.pass_number for step in steps if isinstance(step, ChooseLights)] == [0, 1, 2, 3, 4]
    assert [step.number for step in steps if isinstance(step, SolveNormals)] == [0, 1, 2, 3]
    assert sum(isinstance(step, TakeShot) for step in steps) == 4 + 3 + 1 + 1
    assert isinstance(steps[-1], ChooseLights)  # the arm is home already
    most = Recipe(target_sigma_deg=0.1, max_lights=8)
    assert len([step for step in walk(most, lights=(1, 1, 1, 1, 0)) if isinstance(step, SolveNormals)]) == 5


def test_recipe_target_accuracy_replaces_planned_lights() -> None:
    ordered = Recipe(target_sigma_deg=0.7)
    assert (ordered.planned_lights, ordered.lights_total) == (0, ordered.max_lights)
    assert Recipe.model_validate_json(ordered.model_dump_json()) == ordered
    for wrong in ({"planned_lights": 4}, {"method": "two-rings"}, {"pilot_lights": 6, "max_lights": 5}):
        with pytest.raises(ValueError, match=r"target|max_lights"):
            Recipe.model_validate({"target_sigma_deg": 0.7, **wrong})


def test_progress_target_accuracy_stays_below_one_until_met() -> None:
    recipe = Recipe(target_sigma_deg=0.7)
    pilot = PassRecord(plan=plan(4), shots={number: shot(number) for number in range(4)}, solved=True)
    planned = PassRecord(plan=plan(3), shots={number: shot(number) for number in range(3)}, solved=True)
    shares = [session.progress(record(recipe, *passes)) for passes in ((), (pilot,), (pilot, planned))]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert shares[-1] < 1


def test_next_step_displaced_arm_replans_for_remaining_lights() -> None:
    half = PassRecord(plan=plan(3), route=route([0, 1, 2]), shots={0: shot(0)})
    displaced = session.next_step(record(Recipe(), half), joints(0), HOME)
    assert isinstance(displaced, TakeShot)
    assert displaced.key.number == 1
    at_the_next = session.next_step(record(Recipe(), half), joints(1), HOME)  # moved, but cut off before its frame
    assert isinstance(at_the_next, TakeShot)
    elsewhere = session.next_step(record(Recipe(), half), (0.5,) * 6, HOME)
    assert elsewhere == PlanRoute(0, (1, 2))


def test_next_step_takes_further_frames_before_the_next_light() -> None:
    first = shot(0).model_copy(update={"further_s": [0.4, 0.4]})
    work = PassRecord(plan=plan(3), route=route([0, 1, 2]), shots={0: first})
    one = session.next_step(record(Recipe(), work), joints(0), HOME)
    key = ShotKey(pass_number=0, number=session.further_number(0, 0))
    assert one == TakeFurther(key, first.key, 0, 0.4, route([0]).waypoints[0])
    assert session.stage(record(Recipe()), one) is Stage.CAPTURE
    taken = shot(session.further_number(0, 0), 0.4).model_copy(update={"kind": "bracket", "light_number": 0})
    half = replace(work, further={0: (taken,)})
    two = session.next_step(record(Recipe(), half), joints(0), HOME)
    assert isinstance(two, TakeFurther)
    assert (two.number, two.key.number) == (1, key.number + 1)
    other = taken.model_copy(update={"key": two.key})
    all_taken = session.next_step(record(Recipe(), replace(work, further={0: (taken, other)})), joints(0), HOME)
    assert isinstance(all_taken, TakeShot)
    assert all_taken.key.number == 1


def test_next_step_lost_further_frame_is_taken_before_those_after_it() -> None:
    first = shot(0).model_copy(update={"further_s": [0.2, 0.4]})
    second = shot(session.further_number(0, 1), 0.4).model_copy(update={"kind": "bracket", "light_number": 0})
    work = PassRecord(plan=plan(1), route=route([0]), shots={0: first}, further={0: (second,)})
    step = session.next_step(record(Recipe(), work), joints(0), HOME)
    assert isinstance(step, TakeFurther)
    assert (step.number, step.exposure_s) == (0, 0.2)


def test_next_step_arm_away_from_half_taken_light_returns_to_it() -> None:
    first = shot(0).model_copy(update={"further_s": [0.4]})
    work = PassRecord(plan=plan(2), route=route([0, 1]), shots={0: first})
    assert session.next_step(record(Recipe(), work), (0.5,) * 6, HOME) == PlanRoute(0, (0, 1))


def test_next_step_darks_are_of_all_exposure_times() -> None:
    first = shot(0, shift_px=0.1).model_copy(update={"further_s": [0.4]})
    taken = shot(session.further_number(0, 0), 0.4).model_copy(update={"kind": "bracket", "light_number": 0})
    work = PassRecord(
        plan=plan(1), shots={0: first}, further={0: (taken,)}, darks={0.05: shot(9, kind="dark")},
    )  # fmt: skip
    step = session.next_step(record(Recipe(), work), HOME, HOME)
    assert isinstance(step, TakeDark)
    assert step.exposure_s == 0.4


def test_same_joints_full_turn_differs() -> None:
    assert not session.same_joints(HOME, (6.283185307179586, 0, 0, 0, 0, 0))
    assert session.same_joints(HOME, (1e-3, 0, 0, 0, 0, 0))


def test_stage_and_progress_follow_from_the_record() -> None:
    empty = record(Recipe())
    assert session.stage(empty, session.next_step(empty, HOME, HOME)) is Stage.PILOT
    assert session.stage(empty, None) is Stage.FINISHED
    assert session.progress(empty) == 0.0
    one = record(Recipe(), PassRecord(plan=plan(4), shots={0: shot(0)}))
    assert 0 < session.progress(one) < session.progress(replace(one, state=State.COMPLETED)) == 1.0


def test_next_step_review_plan_waits_for_planned_lights_only() -> None:
    names = [type(step).__name__ for step in walk(Recipe(review_plan=True))]
    assert names.count("AwaitReview") == 1
    assert names[names.index("AwaitReview") - 1 :][:3] == ["ChooseLights", "AwaitReview", "PlanRoute"]
    fixed = [type(step).__name__ for step in walk(Recipe(review_plan=True, method="two-rings", planned_lights=0))]
    assert fixed[:3] == ["ChooseLights", "AwaitReview", "PlanRoute"]


def test_next_step_after_interruption_repeats_an_image_first() -> None:
    half = PassRecord(plan=plan(3), route=route([0, 1, 2]), shots={0: shot(0)})
    cut_off = replace(record(Recipe(), half), unverified=True)
    step = session.next_step(cut_off, joints(0), HOME)
    assert step == RepeatReference(shot(0), ShotKey(pass_number=0, number=1000))
    assert session.stage(cut_off, step) is Stage.CAPTURE
    again = replace(cut_off, unverified=False, references=1)
    assert isinstance(session.next_step(again, joints(0), HOME), TakeShot)


def test_next_step_interruption_without_open_shots_repeats_none() -> None:
    none = replace(record(Recipe(), PassRecord(plan=plan(3), route=route([0, 1, 2]))), unverified=True)
    assert isinstance(session.next_step(none, HOME, HOME), TakeShot)
    shots = {number: shot(number) for number in range(3)}
    repeated = frozenset({shot(0).key})
    full = PassRecord(plan=plan(3), shots=shots, darks={0.05: shot(3, kind="dark")}, repeated=repeated)
    assert session.next_step(replace(record(Recipe(), full), unverified=True), HOME, HOME) == SolveNormals(0)
    dark = replace(record(Recipe(), replace(full, darks={})), unverified=True)
    assert isinstance(session.next_step(dark, HOME, HOME), RepeatReference)


def test_next_step_unpredicted_pass_ends_with_repeated_first_image() -> None:
    pilot = PassRecord(plan=plan(2), shots={1: shot(1), 0: shot(0)}, darks={0.05: shot(2, kind="dark")})
    step = session.next_step(record(Recipe(), pilot), HOME, HOME)
    assert step == RepeatReference(shot(1), ShotKey(pass_number=0, number=1000), closes_pass=True)
    cut_off = replace(record(Recipe(), pilot), unverified=True)
    assert session.next_step(cut_off, HOME, HOME) == step  # which shows what the newest image would, and more
    other = replace(pilot, repeated=frozenset({shot(0).key}))
    assert session.next_step(record(Recipe(), other), HOME, HOME) == step
    solved = replace(pilot, repeated=frozenset({shot(1).key}), solved=True)
    predicted, unpredicted = (PassRecord(plan=plan(1), shots={0: shot(0, shift_px=shift)}) for shift in (0.2, None))
    assert isinstance(session.next_step(record(Recipe(), solved, predicted), HOME, HOME), TakeDark)
    again = session.next_step(record(Recipe(), solved, unpredicted), HOME, HOME)
    assert again == RepeatReference(shot(1), ShotKey(pass_number=1, number=1000), closes_pass=True)


def test_next_step_lamp_session_waits_at_home_for_each_target() -> None:
    recipe = LampRecipe(kind="lamp", max_images=36, placings=1)
    images = {number: shot(number) for number in range(2)}
    sphere = PassRecord(plan=plan(2), shots=images, solved=True)
    chosen = record(recipe, sphere, PassRecord(plan=plan(2)))
    assert session.next_step(chosen, joints(0), HOME) == GoHome(1, None)
    assert session.next_step(chosen, HOME, HOME) == AwaitTarget(1)
    assert session.stage(chosen, AwaitTarget(1)) is Stage.PLAN
    placed = record(recipe, sphere, PassRecord(plan=plan(2), reviewed=True))
    assert session.next_step(placed, HOME, HOME) == PlanRoute(1, (0, 1))
    first = session.next_step(record(recipe, PassRecord(plan=plan(2))), HOME, HOME)
    assert first == PlanRoute(0, (0, 1))  # the sphere is there when somebody starts


def test_next_step_lamp_session_repeats_images_of_the_same_target() -> None:
    recipe = LampRecipe(kind="lamp", max_images=36, placings=1)
    sphere = PassRecord(plan=plan(1), shots={0: shot(0)}, solved=True)
    own = shot(1).model_copy(update={"key": ShotKey(pass_number=1, number=1), "taken_at": 1.0})
    plane = PassRecord(plan=plan(2), shots={1: own}, route=route([1, 0]), reviewed=True)
    cut_off = replace(record(recipe, sphere, plane), unverified=True)
    assert session.next_step(cut_off, joints(1), HOME) == RepeatReference(own, ShotKey(pass_number=1, number=1000))
    fresh = replace(record(recipe, sphere, replace(plane, shots={}, route=route([0, 1]))), unverified=True)
    assert isinstance(session.next_step(fresh, HOME, HOME), TakeShot)  # the sphere is not there any more
    full = replace(plane, shots={0: own.model_copy(update={"key": ShotKey(pass_number=1, number=0)}), 1: own})
    closing = session.next_step(record(recipe, sphere, full), HOME, HOME)
    assert isinstance(closing, RepeatReference)
    assert closing.shot.key.pass_number == 1


def test_next_step_on_the_way_scans_what_follows_without_a_gap() -> None:
    recipe = Recipe(method="two-rings", capture=Capture(while_moving=True))
    work = PassRecord(plan=plan(4), route=route([0, 1, 2, 3]))
    whole = session.next_step(record(recipe, work), HOME, HOME)
    assert isinstance(whole, TakeScan)
    assert [step.key.number for step in whole.shots] == [0, 1, 2, 3]
    assert whole.pass_number == 0
    gap = replace(work, shots={0: shot(0), 2: shot(2)})
    single = session.next_step(record(recipe, gap), joints(0), HOME)
    assert isinstance(single, TakeShot)  # 1 alone; 3 follows by a leg that begins at 2
    assert single.key.number == 1
    assert isinstance(session.next_step(record(recipe, gap), HOME, HOME), PlanRoute)
    assert isinstance(session.next_step(record(Recipe(method="two-rings"), work), HOME, HOME), TakeShot)
    assert session.stage(record(recipe, work), whole) is session.Stage.CAPTURE
