"""The states of a session, the triggers between them, and who may fire them.

A state answers "may the arm move?". It changes only by the table `TRANSITIONS`, is stored in the journal, and decides
which session holds the rig. How far the work has come is another question, which `session` answers.

```mermaid
stateDiagram-v2
    [*] --> created
    created --> running: start
    created --> stopped: stop
    running --> pausing: pause
    running --> stopping: stop
    running --> completed: finish
    running --> failed: fail
    running --> interrupted: interrupt
    pausing --> paused: settle
    pausing --> running: resume
    pausing --> stopping: stop
    pausing --> completed: finish
    pausing --> failed: fail
    pausing --> interrupted: interrupt
    paused --> running: resume
    paused --> stopping: stop
    paused --> interrupted: interrupt
    stopping --> stopped: settle
    stopping --> failed: fail
    stopping --> interrupted: interrupt
    interrupted --> running: resume
    interrupted --> stopped: stop
    completed --> [*]
    stopped --> [*]
    failed --> [*]
```

created      The session does not hold the rig; it moves nothing.
running      The session holds the rig; the arm may move.
pausing      The step in progress is completed, moves included; no further one begins.
paused       The arm is at rest, as a reading has shown; the session still holds the rig.
stopping     A halt has been sent; the arm decelerates to rest.
interrupted  The arm is at rest or its state is unknown; nothing moves before an operator resumes or stops.
completed, stopped, failed  The session has released the rig; it never moves the arm again.
"""

from enum import StrEnum


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


ARM_STATE: dict[State, str] = {
    State.CREATED: "This session does not use the arm.",
    State.RUNNING: "The arm may move.",
    State.PAUSING: "The arm finishes the present step.",
    State.PAUSED: "The arm is at rest.",
    State.STOPPING: "The arm decelerates.",
    State.INTERRUPTED: "The arm is at rest or its state is unknown; nothing may move before an operator decides.",
    State.COMPLETED: "This session does not use the arm.",
    State.STOPPED: "This session does not use the arm.",
    State.FAILED: "This session does not use the arm.",
}
"""Each state, as a sentence for people about the arm."""

RIG_HOLDING = frozenset({State.RUNNING, State.PAUSING, State.PAUSED, State.STOPPING, State.INTERRUPTED})
"""States in which a session holds the lease of the rig. A unique index of the database admits one such session."""

ENDED = frozenset({State.COMPLETED, State.STOPPED, State.FAILED})
"""States without a transition out of them."""


class Trigger(StrEnum):
    """Inputs of the state machine; the values stand in the journal. The first four are actions of a person."""

    START = "start"
    """Begin a session that was created: takes the rig, connects the devices and moves the arm."""
    PAUSE = "pause"
    """Rest after the step in progress, to inspect or mend something. Not for danger: that step is still completed."""
    RESUME = "resume"
    """Continue after a pause or an interruption, once the cell has been inspected. The arm may move at once."""
    STOP = "stop"
    """Halt the arm now and end the session for good; its frames and results are kept."""
    AT_REST = "settle"
    """The arm is at rest, as a reading has shown, or a halt has been carried out. Ends `pausing` and `stopping`."""
    FINISH = "finish"
    """The runner has no step left: the recipe is fulfilled."""
    FAIL = "fail"
    """A step failed for a reason that neither a pause nor an inspection of the devices can remedy."""
    INTERRUPT = "interrupt"
    """A device failed, a safety fault was latched, or the service ended. A person decides how the session continues."""


class Actor(StrEnum):
    """Who fires a trigger."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    RUNNER = "runner"
    SERVICE = "service"

    @classmethod
    def of(cls, name: str) -> "Actor":
        """Returns the actor of a name in the journal: the runner or the service, otherwise an operator."""
        return cls(name) if name in (cls.RUNNER, cls.SERVICE) else cls.OPERATOR


ACTIONS = (Trigger.START, Trigger.PAUSE, Trigger.RESUME, Trigger.STOP)
"""The triggers that a person may fire."""

PERMISSIONS: dict[Actor, frozenset[Trigger]] = {
    Actor.VIEWER: frozenset(),
    Actor.OPERATOR: frozenset(ACTIONS),
    # The runner pauses for the review of a plan, and for what a person has to mend; it never resumes.
    Actor.RUNNER: frozenset({Trigger.PAUSE, Trigger.AT_REST, Trigger.FINISH, Trigger.FAIL, Trigger.INTERRUPT}),
    # At start-up, for sessions that were active, and when the safety monitor latches a fault.
    Actor.SERVICE: frozenset({Trigger.INTERRUPT}),
}
"""The triggers that each actor may fire in some state; `TRANSITIONS` says in which."""

TRANSITIONS: dict[tuple[State, Trigger], State] = {
    (State.CREATED, Trigger.START): State.RUNNING,
    (State.CREATED, Trigger.STOP): State.STOPPED,
    (State.RUNNING, Trigger.PAUSE): State.PAUSING,
    (State.RUNNING, Trigger.STOP): State.STOPPING,
    (State.RUNNING, Trigger.FINISH): State.COMPLETED,
    (State.RUNNING, Trigger.FAIL): State.FAILED,
    (State.RUNNING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.PAUSING, Trigger.AT_REST): State.PAUSED,
    (State.PAUSING, Trigger.RESUME): State.RUNNING,
    (State.PAUSING, Trigger.STOP): State.STOPPING,
    (State.PAUSING, Trigger.FINISH): State.COMPLETED,
    (State.PAUSING, Trigger.FAIL): State.FAILED,
    (State.PAUSING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.PAUSED, Trigger.RESUME): State.RUNNING,
    (State.PAUSED, Trigger.STOP): State.STOPPING,
    (State.PAUSED, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.STOPPING, Trigger.AT_REST): State.STOPPED,
    (State.STOPPING, Trigger.FAIL): State.FAILED,
    (State.STOPPING, Trigger.INTERRUPT): State.INTERRUPTED,
    (State.INTERRUPTED, Trigger.RESUME): State.RUNNING,
    (State.INTERRUPTED, Trigger.STOP): State.STOPPED,
}
"""The transition table; the diagram above shows the same edges."""

NO_OP: dict[Trigger, frozenset[State]] = {
    Trigger.START: RIG_HOLDING,
    Trigger.RESUME: frozenset({State.RUNNING}),
    Trigger.PAUSE: frozenset({State.PAUSING, State.PAUSED}),
    Trigger.STOP: frozenset({State.STOPPING, State.STOPPED}),
}
"""States in which an action has already taken effect: it succeeds and changes nothing (actions are idempotent)."""


def next_state(state: State, trigger: Trigger, actor: Actor) -> State | None:
    """Returns the state after a trigger: the same one if the trigger is a no-op, None if it is not allowed."""
    if trigger not in PERMISSIONS[actor]:
        return None
    if trigger in NO_OP and state in NO_OP[trigger]:
        return state
    return TRANSITIONS.get((state, trigger))


def allowed_actions(state: State, actor: Actor = Actor.OPERATOR) -> list[Trigger]:
    """The actions that a person may take in this state and that change it."""
    return [action for action in ACTIONS if action in PERMISSIONS[actor] and (state, action) in TRANSITIONS]
