"""Lights are planned with the lamp on the flange, whatever the cell file says is there, and nothing moves with the
payload of another tool than the one that is stated."""

from pathlib import Path
from typing import Any

import pytest

from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.jog import JogMotion
from acquisition.models.recipe import Recipe
from acquisition.runner.runner import Runner
from acquisition.session_state import State, Trigger
from tests.acquisition.runner.test_stop_while_planning import wait_for
from tests.model.quick_rig import CELL_FILE, quick_service

ADDRESS = "127.0.6.45"


def tools_of_jobs(runner: Runner, monkeypatch: pytest.MonkeyPatch) -> dict[str, set[str]]:
    """The tools on the flanges of the cells that jobs are given from now on, by job."""
    compute: Any = runner._compute  # pyright: ignore[reportPrivateUsage]
    tools, run = dict[str, set[str]](), compute.run

    def noted(stop: Any, job: str, *arguments: Any, **options: Any) -> Any:
        for cell in arguments:
            if isinstance(cell, CellConfig):
                tools.setdefault(job, set()).add(cell.arm.tool)
        return run(stop, job, *arguments, **options)

    def own_lights(_: Any, cell: CellConfig, *known: Any) -> Any:
        plan = compute._first_lights(Recipe(pilot_lights=3))
        return plan, compute._plan_route(plan.lights, known[-1], cell, known[0])

    monkeypatch.setattr(compute, "run", noted)
    monkeypatch.setattr(compute, "_own_lights", own_lights, raising=False)
    return tools


def test_lights_are_planned_with_the_lamp_where_the_cell_file_says_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "cell.toml"
    text = CELL_FILE.read_text(encoding="utf-8").replace("[arm]\n", '[arm]\ntool = "board"\n')
    file.write_text(text, encoding="utf-8")
    with quick_service(tmp_path, ADDRESS, with_keys=False, cell_file=file) as (server, _, _, _):
        runner, store = server.service.runner, server.service.store
        tools = tools_of_jobs(runner, monkeypatch)
        runner.state_tool("lamp", "a")
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1, review_plan=True))[0].id
        runner.act(session_id, Trigger.START, "a")
        wait_for(lambda: store.journal.session(session_id).state is State.PAUSED)
        runner.planning.replace_plan(session_id, 1, [(0.0, 0.0, -0.4)], "a")
    planning = ("first_lights", "plan_route", "further_lights", "own_lights")
    assert {job: tools[job] for job in planning} == {job: {"lamp"} for job in planning}


def test_nothing_moves_with_the_payload_of_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A controller that refuses the stated tool's payload is told it once more before a jog."""
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, arm, _, _):
        runner = server.service.runner
        wait_for(lambda: runner.status().may_start)
        prepare, refusals = arm.prepare, [RigError(ErrorCode.ARM_NOT_READY, "The payload was refused")]
        told = list[int]()

        def refuses_first() -> None:
            told.append(len(arm.moves))
            if refusals:
                raise refusals.pop()
            prepare()

        monkeypatch.setattr(arm, "prepare", refuses_first)
        runner.state_tool("board", "a")
        wait_for(lambda: not refusals)
        runner.moves.jog("press-0001", JogMotion(joint=0, direction=1), "a", once=True)
        wait_for(lambda: arm.moves)
    assert told == [0, 0]
