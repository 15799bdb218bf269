"""Urgency, in processes of their own so that the suite's stays as it is."""

import os
import subprocess
import sys

import pytest

TOLD = "print(os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0))"
NOBODY = 65534


def urgency_after(does: str, user: int | None = None) -> tuple[int, int, str]:
    """Scheduling policy, niceness and log of a process that does so."""
    script = f"import os; from acquisition import priority; {does}; {TOLD}"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, user=user)
    policy, niceness = map(int, done.stdout.split())
    return policy, niceness, done.stderr


def test_background_work_gives_way() -> None:
    assert urgency_after("priority.take(priority.BACKGROUND)")[:2] == (os.SCHED_OTHER, 10)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may run in real time unasked")
def test_what_keeps_the_arm_safe_runs_in_real_time_and_its_helpers_do_not() -> None:
    policy, _, said = urgency_after("priority.take_real_time()")
    if "not allowed to run in real time" in said:
        pytest.skip("this machine grants no real time")
    assert policy == os.SCHED_RR
    assert urgency_after("priority.take_real_time(); priority.take(priority.ORDINARY)")[:2] == (os.SCHED_OTHER, 0)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may choose the user of a process")
def test_without_the_right_it_runs_on_and_says_so() -> None:
    try:
        policy, kept, said = urgency_after("priority.take_real_time()", user=NOBODY)
    except (PermissionError, subprocess.CalledProcessError):
        pytest.skip("the checkout cannot be read by another user")
    assert (policy, kept >= 0) == (os.SCHED_OTHER, True)
    assert "not allowed to run in real time" in said
    assert "not allowed to run at niceness -10" in said
