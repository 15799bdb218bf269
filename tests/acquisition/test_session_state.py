"""The state table for every state × trigger."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition import session_state
from acquisition.session_state import Actor, State, Trigger

# For each state, what a person and the service may bring about; all else is refused.
OPERATOR = """
created      start→running  stop→stopped
running      start→running resume→running pause→pausing stop→stopping
pausing      start→pausing pause→pausing resume→running stop→stopping
paused       start→paused pause→paused resume→running stop→stopping
stopping     start→stopping stop→stopping
interrupted  start→interrupted resume→running stop→stopped
completed
stopped      stop→stopped
failed
"""
RUNNER = """
created
running      pause→pausing finish→completed fail→failed interrupt→interrupted
pausing      pause→pausing settle→paused finish→completed fail→failed interrupt→interrupted
paused       pause→paused interrupt→interrupted
stopping     settle→stopped fail→failed interrupt→interrupted
interrupted
completed
stopped
failed
"""
SERVICE = """
created
running      interrupt→interrupted
pausing      interrupt→interrupted
paused       interrupt→interrupted
stopping     interrupt→interrupted
interrupted
completed
stopped
failed
"""
BY_ACTOR = {Actor.OPERATOR: OPERATOR, Actor.RUNNER: RUNNER, Actor.SERVICE: SERVICE, Actor.VIEWER: ""}


def expected(actor: Actor, state: State) -> dict[str, str]:
    lines = {line.split()[0]: line.split()[1:] for line in BY_ACTOR[actor].strip().splitlines()}
    return dict(case.split("→") for case in lines.get(state, []))


@pytest.mark.parametrize("trigger", Trigger, ids=str)
@pytest.mark.parametrize("state", State, ids=str)
@pytest.mark.parametrize("actor", Actor, ids=str)
def test_next_state_every_actor_state_and_trigger_follows_the_table(
    actor: Actor, state: State, trigger: Trigger
) -> None:
    after = session_state.next_state(state, trigger, actor)
    assert (None if after is None else str(after)) == expected(actor, state).get(str(trigger))


def test_actor_of_other_name_is_operator() -> None:
    assert Actor.of("runner") is Actor.RUNNER
    assert Actor.of("service") is Actor.SERVICE
    assert Actor.of("runner@127.0.0.1") is Actor.OPERATOR
    assert Actor.of("viewer") is Actor.OPERATOR  # a viewer's key reaches no trigger


def test_allowed_actions_change_the_state_and_end_states_have_none() -> None:
    for state in State:
        allowed = session_state.allowed_actions(state)
        after = {action: session_state.next_state(state, action, Actor.OPERATOR) for action in session_state.ACTIONS}
        changing = [action for action, then in after.items() if then not in (None, state)]
        assert allowed == changing
        assert (allowed == []) == (state in session_state.ENDED or state is State.STOPPING)
        assert session_state.allowed_actions(state, Actor.VIEWER) == []


@given(st.lists(st.tuples(st.sampled_from(list(Trigger)), st.sampled_from(list(Actor))), max_size=12))
def test_next_state_no_sequence_leaves_an_end_state(triggers: list[tuple[Trigger, Actor]]) -> None:
    state = State.CREATED
    for trigger, actor in triggers:
        then = session_state.next_state(state, trigger, actor)
        if state in session_state.ENDED:
            assert then in (None, state)
        state = then or state
    assert set(session_state.ARM_STATE) == set(State)


def test_module_docstring_diagram_shows_the_transition_table() -> None:
    drawn = re.findall(r"^    (\w+) --> (\w+): (\w+)$", session_state.__doc__ or "", re.MULTILINE)
    assert len(drawn) == len(set(drawn))
    assert set(drawn) == {(str(old), str(new), str(by)) for (old, by), new in session_state.TRANSITIONS.items()}
    ends = re.findall(r"^    (\w+) --> \[\*\]$", session_state.__doc__ or "", re.MULTILINE)
    assert set(ends) == set(map(str, session_state.ENDED))
