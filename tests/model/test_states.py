"""Random requests in random order: a session's states always follow the state table.

A machine of `hypothesis` sends requests over HTTP to a whole service with quick devices: one after the other and
several at once, between protective stops that come, are cleared and acknowledged, or not. What is held against the
table is what everybody can see: the answers, and the events in their order. In the end nothing may be stuck.
"""

import os
import shutil
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, rule, run_state_machine_as_test

from acquisition.runner import safety_monitor
from acquisition.session_state import ACTIONS, RIG_HOLDING, TRANSITIONS, Actor, State, Trigger, next_state
from api.rest.keys import Role
from tests.model.quick_rig import quick_service

HOST = "127.0.15.5"
SHARDS = 8
CASES = int(os.environ.get("LIGHTPOSE_CASES", "250"))
"""Runs of each shard of the long test."""
ANSWER_WITHIN_S = 60.0
ALLOWED = {(before, then) for (before, _), then in TRANSITIONS.items()}
WISHES = st.sampled_from([str(action) for action in ACTIONS])
RECIPES = st.sampled_from(
    [
        {"pilot_lights": 3, "planned_lights": 0},
        {"pilot_lights": 3, "planned_lights": 2},
        {"pilot_lights": 3, "planned_lights": 2, "review_plan": True},
    ]
)


class Cell:
    """One running service for many runs; each run begins with nobody holding the rig."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="lightpose-model-"))
        self._running = quick_service(self.folder, HOST)
        self.server, self.arm, url, secrets = self._running.__enter__()
        self.journal = self.server.service.store.journal
        self.http = {
            role: httpx.Client(
                base_url=url, timeout=ANSWER_WITHIN_S, headers={"Authorization": f"Bearer {secret}"}, trust_env=False
            )
            for role, secret in secrets.items()
        }
        self.pool = ThreadPoolExecutor(4)

    def close(self) -> None:
        for client in self.http.values():
            client.close()
        self.pool.shutdown()
        self._running.__exit__(None, None, None)
        shutil.rmtree(self.folder)


class Machine(RuleBasedStateMachine):
    """People and an arm."""

    cell: Cell  # set for the module
    sessions = Bundle("sessions")

    def __init__(self) -> None:
        super().__init__()
        self.began_at = self.cell.journal.last_event_id()
        self.mine: set[str] = set()

    # -------------------------------------------------------------------------------------------------- what happens

    @rule(target=sessions, recipe=RECIPES)
    def create(self, recipe: dict[str, Any]) -> str:
        made = self.cell.http[Role.OPERATOR].post("/v1/sessions", json=recipe)
        assert made.status_code == 201, made.text
        assert made.json()["state"] == State.CREATED
        self.mine.add(made.json()["id"])
        return made.json()["id"]

    @rule(session_id=sessions, action=WISHES)
    def act(self, session_id: str, action: str) -> None:
        self.judge(*self.send(session_id, action))

    @rule(wishes=st.lists(st.tuples(sessions, WISHES), min_size=2, max_size=4))
    def act_at_once(self, wishes: list[tuple[str, str]]) -> None:
        for sent in self.cell.pool.map(lambda wish: self.send(*wish), wishes):
            self.judge(*sent)

    @rule(session_id=sessions, action=WISHES)
    def a_viewer_may_not(self, session_id: str, action: str) -> None:
        answer = self.cell.http[Role.VIEWER].post(f"/v1/sessions/{session_id}/actions", json={"action": action})
        assert answer.status_code == 403

    @rule(role=st.sampled_from(list(Role)))
    def halt(self, role: Role) -> None:
        assert self.cell.http[role].post("/v1/rig/stop").status_code == 202

    @rule()
    def push_the_arm(self) -> None:
        self.cell.arm.stop_protectively()

    @rule()
    def unlock(self) -> None:
        self.cell.arm.unlock()

    @rule()
    def acknowledge(self) -> None:
        answer = self.cell.http[Role.OPERATOR].post("/v1/rig/safety/acknowledgement")
        assert answer.status_code in (200, 409)
        assert (answer.status_code == 200) == answer.json().get("clear", False)

    @rule(session_id=consumes(sessions))
    def delete(self, session_id: str) -> None:
        answer = self.cell.http[Role.ADMIN].delete(f"/v1/sessions/{session_id}")
        assert answer.status_code in (204, 409), answer.text
        if answer.status_code == 409:
            assert answer.json()["state"] in RIG_HOLDING

    @rule(milliseconds=st.integers(1, 60))
    def wait(self, milliseconds: int) -> None:
        time.sleep(milliseconds / 1000)

    @rule(session_id=sessions, role=st.sampled_from(list(Role)))
    def look(self, session_id: str, role: Role) -> None:
        answer = self.cell.http[role].get(f"/v1/sessions/{session_id}")
        assert answer.status_code == 200, answer.text
        session = answer.json()
        state = State(session["state"])
        changing = [action for action in ACTIONS if (state, action) in TRANSITIONS]
        assert session["allowed_actions"] == ([] if role is Role.VIEWER else changing)
        assert 0 <= session["progress"] <= 1
        assert (session["ended"] is not None) == (state in (State.COMPLETED, State.STOPPED, State.FAILED))

    # ------------------------------------------------------------------------------------------------ what must hold

    def send(self, session_id: str, action: str) -> tuple[str, str, int, int, httpx.Response]:
        """Asks for an action; tells between which two events the answer was made."""
        first = self.cell.journal.last_event_id()
        answer = self.cell.http[Role.OPERATOR].post(f"/v1/sessions/{session_id}/actions", json={"action": action})
        return session_id, action, first, self.cell.journal.last_event_id(), answer

    def judge(self, session_id: str, action: str, first: int, last: int, answer: httpx.Response) -> None:
        """Some state that the session had meanwhile explains the answer."""
        held = self.states_between(session_id, first, last)
        trigger = Trigger(action)
        body = answer.json()
        if answer.status_code == 202:
            reached = {next_state(state, trigger, Actor.OPERATOR) for state in held}
            assert State(body["state"]) in reached, (held, body)
        elif body["code"] == "session.action_not_allowed":
            assert State(body["state"]) in held, (held, body)
            assert next_state(State(body["state"]), trigger, Actor.OPERATOR) is None
            assert trigger not in (Trigger.STOP,) or State(body["state"]) in (State.COMPLETED, State.FAILED)
        elif body["code"] == "rig.busy":
            assert body["holder"] != session_id
        else:
            assert trigger in (Trigger.START, Trigger.RESUME), body
            assert body["code"] in (
                "arm.protective_stop", "safety.not_acknowledged", "rig.not_ready", "arm.elsewhere",
            ), body  # fmt: skip

    def states_between(self, session_id: str, first: int, last: int) -> set[State]:
        """The states of a session at the event `first`, at `last`, and between them."""
        state, held = State.CREATED, set[State]()
        for event in self.cell.journal.events(self.began_at, 100_000, session_id, ("session.state",)):
            if event.id > last:
                break
            if event.id > first:
                held.add(state)
            state = State(event.body["state"])
        return held | {state}

    def teardown(self) -> None:
        """Nothing is stuck: what holds the rig can be stopped, and then another session runs to its end."""
        self.cell.arm.unlock()
        time.sleep(3 * safety_monitor.PERIOD_S)  # what the monitor has seen is latched by now
        operator = self.cell.http[Role.OPERATOR]
        self.until(lambda: operator.post("/v1/rig/safety/acknowledgement").status_code == 200)
        for session_id in self.mine:
            operator.post(f"/v1/sessions/{session_id}/actions", json={"action": "stop"})
        self.until(lambda: self.cell.journal.holder() is None)
        reading = self.cell.arm.reading
        assert max(reading.joint_speeds) == 0
        assert not self.cell.arm.lamp
        self.events_follow_the_table()
        last = self.create({"pilot_lights": 3, "planned_lights": 0})
        self.until(lambda: self.send(last, "start")[-1].status_code == 202 or self.acknowledge())
        self.until(lambda: self.cell.journal.session(last).state is State.COMPLETED)

    def events_follow_the_table(self) -> None:
        """Every change is one of the table's and begins where the last one ended; at most one session holds the rig."""
        states: dict[str, State] = {}
        for event in self.cell.journal.events(self.began_at, 100_000):
            if event.type == "session.created" and event.session_id is not None:
                states[event.session_id] = State.CREATED
            elif event.type == "session.state" and event.session_id is not None:
                before, then = State(event.body["from"]), State(event.body["state"])
                assert states[event.session_id] is before, event
                assert (before, then) in ALLOWED, event
                states[event.session_id] = then
            elif event.type == "session.deleted":
                assert states.pop(event.body["session_id"]) not in RIG_HOLDING
            assert sum(state in RIG_HOLDING for state in states.values()) <= 1, (event, states)

    def until(self, true: Any) -> None:
        deadline = time.monotonic() + ANSWER_WITHIN_S
        while not true():
            assert time.monotonic() < deadline, (
                self.cell.journal.sessions(2),
                self.cell.journal.unacknowledged_faults(),
            )
            time.sleep(0.01)


@pytest.fixture(scope="module", autouse=True)
def cell() -> Any:
    Machine.cell = Cell()
    yield Machine.cell
    Machine.cell.close()


def run(cases: int, shard: int) -> None:
    run_state_machine_as_test(
        seed(shard)(Machine),
        settings=settings(
            max_examples=cases,
            stateful_step_count=15,
            deadline=None,
            database=None,
            phases=(Phase.generate,),
            suppress_health_check=list(HealthCheck),
        ),
    )


def test_state_machine_few_random_runs_keep_the_invariants() -> None:
    run(3, SHARDS)


@pytest.mark.long
@pytest.mark.parametrize("shard", range(SHARDS))
def test_state_machine_many_random_runs_keep_the_invariants(shard: int) -> None:
    run(CASES, shard)
