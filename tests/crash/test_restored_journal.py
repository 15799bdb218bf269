"""A journal that was copied away and restored in mid-life, and a data folder of the first release: both are taken up.

Events that were heard before are of another journal then: a listener is told (`stream.reset`), one that follows a
session that the journal lacks is told so (`session.not_found`), and nothing is doubled.
"""

import shutil
import sqlite3
from pathlib import Path

import httpx
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.session_state import State
from api import Client, ProblemError
from tests.crash.crashing import Bench, assert_rests, bench

pytestmark = pytest.mark.long

RELEASE = Path(__file__).parents[1] / "data" / "release_0.1"


def complete(made: Bench, client: Client) -> str:
    """Runs a session to its end; the machine may be too busy once."""
    for _ in range(3):
        session_id = made.start(client)
        if client.wait(session_id).state is State.COMPLETED:
            return session_id
        client.stop(session_id)
    raise AssertionError("no session completed")


def events(client: Client, after: int = 0) -> list[tuple[int, str]]:
    """Ids and types of all events so far, as a listener with this Last-Event-ID hears them."""
    text = client._http.get(
        "/v1/events", params={"follow": False}, headers={"Last-Event-ID": str(after)}, timeout=60
    ).text
    heard: list[tuple[int, str]] = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if ": " in line)
        if "event" in fields:
            heard.append((int(fields["id"]), fields["event"]))
    return heard


def end(made: Bench) -> None:
    """Ends the service in good order."""
    made.close()
    made.service = None


def test_journal_restored_from_a_copy_resets_listeners_and_goes_on(tmp_path: Path) -> None:
    with bench(tmp_path, "127.0.14.60") as made:
        with made.serve() as client:
            first = complete(made, client)
        end(made)
        shutil.copy(made.data / "rig.db", tmp_path / "copy.db")
        with made.serve() as client:
            second = complete(made, client)
            newest = events(client)[-1][0]
        end(made)
        for file in made.data.glob("rig.db*"):
            file.unlink()
        shutil.copy(tmp_path / "copy.db", made.data / "rig.db")
        with made.serve() as client:
            heard = events(client, newest)
            for following in (lambda: next(client.events(second, after=newest)), lambda: client.wait(second)):
                with pytest.raises(ProblemError) as lost:  # no stream without end of a session that there is not
                    following()
                assert lost.value.code is ErrorCode.SESSION_NOT_FOUND
            third = complete(made, client)
            after = events(client)
            known = {session.id for session in client.sessions()}
        assert_rests(made)

    assert heard[0] == (heard[0][0], "stream.reset")
    assert heard[0][0] < newest
    assert {first, third} <= known
    assert second not in known
    assert (made.data / "sessions" / second / "manifest.json").is_file()  # what was captured stays
    assert [number for number, _ in after] == list(range(1, len(after) + 1))
    with sqlite3.connect(made.data / "rig.db") as opened:
        assert opened.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_data_folder_of_the_first_release_is_served_and_goes_on(tmp_path: Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(RELEASE, data)
    with sqlite3.connect(data / "rig.db") as opened:
        before = opened.execute("SELECT max(id) FROM event").fetchone()[0]
    with bench(tmp_path, "127.0.14.61", data) as made, made.serve() as client:
        assert made.undisturbed is not None  # two sessions have run beside the old ones
        states = {session.id: session.state for session in client.sessions()}
        old = [name for name in states if name.startswith("20261121")]
        (completed,) = (name for name in old if states[name] is State.COMPLETED)
        result = client.results(completed)[-1]
        picture = client._http.get(f"/v1/sessions/{completed}/results/{result.number}/normals.png", timeout=60)
        heard = events(client)
        solved = client.resolve(completed)

    assert len(old) == 2
    assert states[made.undisturbed.session_id] is State.COMPLETED
    assert isinstance(picture, httpx.Response)
    assert picture.status_code == 200
    assert [number for number, _ in heard] == list(range(1, len(heard) + 1))
    assert len(heard) > before
    assert solved > result.number
