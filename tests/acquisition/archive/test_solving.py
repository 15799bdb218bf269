"""Solves of archived sessions: equal to a local one, beside the old results, each once; exports read back."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import bagit
import cv2
import numpy as np
import pytest

from acquisition.archive import distributed, exports, solving
from acquisition.archive.archive import Archive
from acquisition.archive.entries import SolveIdentity, result_name
from acquisition.archive.solving import SolveJob, SolveOutcome
from acquisition.formats import export
from acquisition.formats.folders import session_folder as folders
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.runner.session_solve import solve_in_cell
from acquisition.store.folder import write_manifest

MakeSession = Callable[..., Path]
SETTINGS = SolveSettings(depth_rounds=1)


def job(archive: Archive, key: str, call: str = "first") -> SolveJob:
    return SolveJob(
        archive.address, archive.catalogue_address, key, SolveIdentity(settings=SETTINGS), version("lightpose"), call
    )


def solved_here(folder: Path) -> NormalMap:
    capture = folders.read(folder)
    last = max(shot.key.pass_number for shot in capture.shots)
    return solve_in_cell(capture.observations(last), capture.cell, capture.calibration, SETTINGS)


def test_solve_equals_a_local_solve_and_stands_beside(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    folder = session_folder(seed=3)
    key = archive.push(folder).key
    assert solving.solve(job(archive, key)).state == "done"
    entry = archive.result(result_name(key, version("lightpose"), SolveIdentity(settings=SETTINGS).hash))
    archive.fetch(entry.files, tmp_path / "back")
    (stored,) = (tmp_path / "back" / "results").iterdir()
    there, here = export.read(stored), solved_here(folder)
    for name in ("normals", "sigma_deg", "depth", "albedo", "mask", "flags"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name), err_msg=name)
    assert len(archive.results(key)) == 3
    assert archive.verify() == []


def test_solve_again_keeps_the_first(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder()).key
    states = [solving.solve(job(archive, key, call)).state for call in ("first", "second")]
    row = next(row for row in archive.catalogue.results(key) if row.origin == "archive")
    assert states == ["done", "done"]
    assert (row.attempts, row.finishes) == (1, 1)
    assert row.moved_mean_deg is not None


def test_solve_damaged_session_fails_by_file_and_holds_nothing(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder(seed=5)).key
    digest = archive.session(key).files["passes/0/shots/1.tiff"].sha256
    archive.contents.write(f"objects/{digest[:2]}/{digest}", b"rot")
    outcome = solving.solve(job(archive, key))
    assert outcome.state == "failed"
    assert "passes/0/shots/1.tiff" in outcome.detail
    assert [row.state for row in archive.catalogue.results(key) if row.origin == "archive"] == ["failed"]


def test_solve_by_another_version_is_refused(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder()).key
    other = SolveJob(archive.address, archive.catalogue_address, key, SolveIdentity(), "99.0", "first")
    with pytest.raises(RigError, match=r"the caller has 99\.0") as refused:
        solving.solve(other)
    assert refused.value.code is ErrorCode.CONFIG_INVALID


def test_export_folder_is_read_as_a_session(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    key = archive.push(session_folder()).key
    exports.write(archive, key, "folder", tmp_path / "out")
    assert folders.read(tmp_path / "out").results == (0, 1)
    with pytest.raises(RigError, match="exists"):
        exports.write(archive, key, "folder", tmp_path / "out")


def test_export_bagit_is_valid_and_describes_each_file(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    key = archive.push(session_folder(label="Vase <1>")).key
    exports.write(archive, key, "bagit", tmp_path / "bag")
    bag = bagit.Bag(str(tmp_path / "bag"))
    bag.validate()
    assert bag.info["Internal-Sender-Identifier"] == key
    crate = json.loads((tmp_path / "bag/data/ro-crate-metadata.json").read_text())
    described = {item["@id"] for item in crate["@graph"] if item["@type"] == "File"}
    stored = {path.relative_to(tmp_path / "bag/data").as_posix() for path in (tmp_path / "bag/data").rglob("*.tiff")}
    assert stored <= described
    assert any(item.get("name") == "Vase <1>" for item in crate["@graph"])


def test_export_relight_names_images_and_lights(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    key = archive.push(session_folder()).key
    exports.write(archive, key, "relight", tmp_path / "out")
    count, *rows = (tmp_path / "out/lights.lp").read_text().splitlines()
    directions = np.array([[float(value) for value in row.split()[1:]] for row in rows])
    assert int(count) == len(rows) == 5
    assert np.allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-5)
    for row in rows:
        image = cv2.imread(str(tmp_path / "out" / row.split()[0]), cv2.IMREAD_UNCHANGED)
        assert image is not None
        assert image.shape == (48, 48)
    assert sorted(path.suffix for path in (tmp_path / "out").iterdir()) == [".dome", ".lp", *[".png"] * 5]


@pytest.mark.parametrize(("whole", "images"), [(True, 5), (False, 4)])
def test_export_relight_with_a_newer_result_of_fewer_images(
    archive: Archive, session_folder: MakeSession, tmp_path: Path, whole: bool, images: int
):
    folder = session_folder()
    os.utime(folder / "results/0/manifest.json", (4e9, 4e9))
    if not whole:
        shutil.rmtree(folder / "results/1")
    exports.write(archive, archive.push(folder).key, "relight", tmp_path / "out")
    assert len(list((tmp_path / "out").glob("*.png"))) == images
    lights = json.loads((tmp_path / "out/lights.dome").read_text())
    assert len(lights["positions3d"]) == len(lights["ledAdjust"]) == images


def test_export_relight_of_a_mosaic_sensor_has_its_colours(
    archive: Archive, session_folder: MakeSession, tmp_path: Path
):
    folder = session_folder()
    exports.write(archive, archive.push(folder).key, "relight", tmp_path / "grey")
    calibration = json.loads((folder / "calibration.json").read_text())
    calibration["sensor"]["mosaic"] = "rggb"
    (folder / "calibration.json").write_text(json.dumps(calibration))
    stated = json.loads((folder / "manifest.json").read_text())
    write_manifest(folder, {name: stated[name] for name in ("session_id", "software", "shots")})
    exports.write(archive, archive.push(folder).key, "relight", tmp_path / "colours")
    for number in range(1, 6):
        grey, image = (
            cv2.imread(str(tmp_path / kind / f"{number:03d}.png"), cv2.IMREAD_UNCHANGED) for kind in ("grey", "colours")
        )
        assert grey is not None
        assert image is not None
        assert image.shape == (48, 48, 3)
        for channel, row, column in ((2, 0, 0), (1, 0, 1), (1, 1, 0), (0, 1, 1)):  # OpenCV's order: B G R
            np.testing.assert_array_equal(image[row::2, column::2, channel], grey[row::2, column::2])


def test_export_relight_whose_images_cannot_be_written_is_not_made(
    archive: Archive, session_folder: MakeSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """OpenCV returns False on a full disk and leaves no image, while the small files beside it still fit."""
    key = archive.push(session_folder()).key
    opened = Path.open

    def full(path: Path, mode: str = "r", *more: Any, **options: Any) -> Any:
        if path.name == "003.png" and "w" in mode:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return opened(path, mode, *more, **options)

    monkeypatch.setattr(Path, "open", full)
    monkeypatch.setattr(cv2, "imwrite", lambda *_: False)
    with pytest.raises(RigError) as refused:
        exports.write(archive, key, "relight", tmp_path / "out")
    assert refused.value.code is ErrorCode.STORE_DISK_FULL
    assert not (tmp_path / "out").exists()


def test_results_of_equal_times_are_sorted_by_passes(archive: Archive, session_folder: MakeSession) -> None:
    folder = session_folder()
    for manifest in folder.glob("results/*/manifest.json"):
        os.utime(manifest, (1e9, 1e9))
    results = archive.results(archive.push(folder).key)
    assert [result.identity.last_pass for result in results] == [0, None]


class _Future:
    """A task of Dask that has ended."""

    status = "finished"

    def __init__(self, outcome: SolveOutcome) -> None:
        self._outcome = outcome

    def result(self, timeout: float) -> SolveOutcome:
        assert timeout > 0
        return self._outcome

    def release(self) -> None:
        pass


class _Scheduler:
    """A client of Dask whose workers give a session back some times, then solve it."""

    status = "running"

    def __init__(self, *returned: str) -> None:
        self._outcomes = [*(("returned", why) for why in returned), ("done", "")]

    def map(self, _: object, jobs: list[SolveJob], **__: object) -> list[_Future]:
        return [_Future(SolveOutcome(job.session, *self._outcomes.pop(0))) for job in jobs]

    def close(self, timeout: float) -> None:
        pass


def test_solve_that_comes_back_says_why_once(
    archive: Archive, session_folder: MakeSession, monkeypatch: pytest.MonkeyPatch
):
    scheduler = _Scheduler("disk full: 1.part", "disk full: 2.part")
    monkeypatch.setattr(distributed, "_connect", lambda *_: scheduler)
    monkeypatch.setattr(distributed, "RETRY_S", 0.0)
    told: list[str] = []
    key = archive.push(session_folder(results=False)).key
    distributed.solve(archive, [key], SolveIdentity(), scheduler="tcp://none", workers=0, returned=told.append)
    assert told == ["disk full: 1.part"]
