"""Niceness and real time, tested in subprocesses so that the suite's own is unchanged."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

BEGIN = "import json, os, threading, time; from acquisition.process_priority import RealTime, set_niceness\n"
THREADED = f"""{BEGIN}
waiting = threading.Event()
threading.Thread(target=waiting.wait).start()
def policies(): return sorted({{os.sched_getscheduler(int(t)) & 0xff for t in os.listdir("/proc/self/task")}})
"""
IN_TURN = f"""{THREADED}
real_time = RealTime(0.5)
before = policies()
real_time.enter()
inside = policies()
child = os.popen("awk '{{print $41}}' /proc/self/stat").read().strip()
real_time.leave()
print(json.dumps(dict(before=before, inside=inside, child=int(child), after=policies(), granted=real_time.granted)))
waiting.set()
"""
OVERDRAWN = f"""{THREADED}
real_time = RealTime(0.05)
real_time.enter()
seen, until = [policies()], time.process_time() + 0.2
while time.process_time() < until:
    real_time.keep_share()
    if policies() != seen[-1]: seen.append(policies())
while real_time.granted and policies() == [0]:
    time.sleep(0.01)
    real_time.keep_share()
print(json.dumps(dict(seen=seen[:2], after=policies(), granted=real_time.granted)))
waiting.set()
"""
NOBODY = 65534
ORDINARY, ROUND_ROBIN = [os.SCHED_OTHER], [os.SCHED_RR]


def run(script: str, user: int | None = None, **environment: str) -> Any:
    """What a Python process prints as JSON. Raises CalledProcessError, OSError."""
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, check=True, user=user, env={**os.environ, **environment}
    )
    return json.loads(done.stdout)


def granted(script: str) -> dict[str, Any]:
    """The same where this process may be in real time; the test is skipped elsewhere."""
    told = run(script)
    if not told["granted"]:
        pytest.skip("this process may not run in real time")
    return told


def other_user_can_import() -> bool:
    """Whether another user may read the interpreter and the checkout."""
    try:
        run("import acquisition.devices; print(1)", user=NOBODY)
    except (OSError, subprocess.CalledProcessError):  # a user namespace has no such user
        return False
    return True


def test_set_niceness_background_process_has_low_priority() -> None:
    script = f"{BEGIN}print(json.dumps([set_niceness(10), os.getpriority(os.PRIO_PROCESS, 0)]))"
    assert run(script) == [True, 10]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may choose the user of a process")
def test_priorities_without_permission_are_not_granted() -> None:
    if not other_user_can_import():
        pytest.skip("the checkout cannot be read by another user")
    script = f"{BEGIN}r = RealTime(0.5); r.enter(); r.keep_share(); r.leave()\n"
    assert run(f"{script}print(json.dumps([set_niceness(-10), r.granted]))", user=NOBODY) == [False, False]


def test_real_time_covers_all_threads_and_no_child() -> None:
    told = granted(IN_TURN)
    assert (told["before"], told["inside"], told["after"]) == (ORDINARY, ROUND_ROBIN, ORDINARY)
    assert told["child"] == os.SCHED_OTHER


def test_real_time_is_left_when_the_share_is_used_up_and_taken_again() -> None:
    told = granted(OVERDRAWN)
    assert told["seen"] == [ROUND_ROBIN, ORDINARY]
    assert told["after"] == ROUND_ROBIN


def test_real_time_is_forgone_where_the_environment_says_so() -> None:
    told = run(IN_TURN, LIGHTPOSE_REAL_TIME="no")
    assert told["inside"] == ORDINARY
    assert not told["granted"]
