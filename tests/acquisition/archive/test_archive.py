"""An archive in a folder: pushed once, found, fetched, verified; what is damaged is named and the rest goes on."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from acquisition.archive import catalogue as catalogues
from acquisition.archive import claims, reading, where
from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import Catalogue
from acquisition.archive.contents import ContentStore
from acquisition.archive.entries import session_name
from acquisition.models.errors import ErrorCode, RigError
from tests.acquisition.archive import session_copies

MakeSession = Callable[..., Path]
SECRET = hashlib.sha256(b"").hexdigest()


def object_files(archive: Archive) -> list[Path]:
    folder = archive.contents.folder
    assert folder is not None
    return sorted(path for path in (folder / "objects").rglob("*") if path.is_file())


def test_push_then_fetch_gives_the_same_folder(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    folder = session_folder()
    pushed = archive.push(folder)
    for files in (archive.session(pushed.key).files, *(result.files for result in archive.results(pushed.key))):
        archive.fetch(files, tmp_path / "back")
    one, two = (
        {path.relative_to(top).as_posix(): path.read_bytes() for path in top.rglob("*") if path.is_file()}
        for top in (folder, tmp_path / "back")
    )
    assert pushed.new
    assert one == two


def test_push_twice_stores_nothing_new(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    first = archive.push(folder)
    again = archive.push(folder)
    assert (again.key, again.new, again.new_files) == (first.key, False, 0)
    assert len(archive.catalogue.sessions()) == 1


def test_push_shares_equal_files_between_sessions(archive: Archive, session_folder: MakeSession):
    first = archive.push(session_folder("20261121-190041-aaaaaa", 1))
    second = archive.push(session_folder("20261121-190041-bbbbbb", 2))
    assert second.new
    assert second.new_files < first.new_files / 2  # calibration, cell, darks and results are the same here


def test_push_two_cells_with_one_id_and_clock_keeps_both(archive: Archive, tmp_path: Path):
    for cell in ("north", "south"):
        archive.push(session_copies.make(tmp_path / cell / "20261121-190041-aaaaaa", label="vase", cell=cell))
    rows = archive.catalogue.sessions()
    assert sorted(row.cell for row in rows) == ["north", "south"]
    assert len({row.key for row in rows}) == 2
    assert {row.session_id for row in rows} == {"20261121-190041-aaaaaa"}
    assert archive.verify() == []


def test_push_damaged_session_is_refused_by_file(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    frame = folder / "passes/0/shots/1.tiff"
    frame.write_bytes(frame.read_bytes()[:-1] + b"\x00\x01")
    with pytest.raises(RigError, match=r"shots/1\.tiff: is damaged") as refused:
        archive.push(folder)
    assert refused.value.code is ErrorCode.FOLDER_INVALID
    assert archive.catalogue.sessions() == []


def test_push_unfinished_session_is_refused(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    (folder / "manifest.json").unlink()
    with pytest.raises(RigError, match=r"manifest\.json: is missing"):
        archive.push(folder)


def test_push_with_lost_frame_is_refused(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    (folder / "passes/0/shots/2.tiff").unlink()
    with pytest.raises(RigError, match=r"shots/2\.tiff: is missing"):
        archive.push(folder)


def test_push_of_files_that_file_managers_made_is_the_same_session(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    first = archive.push(folder)
    (folder / "passes" / ".DS_Store").write_bytes(b"places of icons")
    again = archive.push(folder)
    assert (again.key, again.new, again.new_files) == (first.key, False, 0)


def test_push_leaves_out_a_copy_of_a_result(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    shutil.copytree(folder / "results" / "1", folder / "results" / "1 (copy)")
    pushed = archive.push(folder)
    assert len(archive.results(pushed.key)) == 2
    names = sorted(result.name for result in archive.results(pushed.key))
    assert reading.result_names(folder, pushed.key) == names


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("manifest.json", {"shots": None}),
        ("manifest.json", {"session_id": ...}),
        ("results/1/manifest.json", {"software": {"lightpose": "my-build"}}),
        ("results/1/manifest.json", {"passes": ["one"]}),
        ("results/1/manifest.json", {"files": {"../../../secret": {"sha256": SECRET, "bytes": 0}}}),
    ],
)
def test_push_of_another_manifest_is_refused(
    archive: Archive, session_folder: MakeSession, file: str, changed: dict[str, object]
):
    folder = session_folder()
    stated = json.loads((folder / file).read_text()) | changed
    (folder / file).write_text(json.dumps({name: value for name, value in stated.items() if value is not ...}))
    (folder.parent / "secret").touch()
    with pytest.raises(RigError, match=r"manifest\.json: is not") as refused:
        archive.push(folder)
    assert refused.value.code is ErrorCode.FOLDER_INVALID
    assert archive.verify() == []


def test_push_of_a_file_whose_name_is_no_text_is_refused(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    Path(os.fsdecode(os.fsencode(folder) + b"/caf\xe9.txt")).touch()
    with pytest.raises(RigError, match="rename it") as refused:
        archive.push(folder)
    assert refused.value.code is ErrorCode.FOLDER_INVALID


@pytest.mark.parametrize("path", ["../outside", "/outside", "passes/../../outside", "", "."])
def test_entry_of_a_file_outside_of_its_folder_is_damaged(archive: Archive, session_folder: MakeSession, path: str):
    pushed = archive.push(session_folder())
    name = session_name(pushed.key)
    entry = json.loads(archive.contents.read(name) or b"")
    entry["files"][path] = next(iter(entry["files"].values()))
    archive.contents.write(name, json.dumps(entry).encode())
    with pytest.raises(RigError) as refused:
        archive.session(pushed.key)
    assert refused.value.code is ErrorCode.ARCHIVE_DAMAGED


def test_push_with_new_label_renames_the_object(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    key = archive.push(folder).key
    assert archive.push(folder, label="amphora", notes="found in 1911").key == key
    (row,) = archive.catalogue.sessions()
    assert (row.object, row.notes) == ("amphora", "found in 1911")
    assert archive.session(key).facts.object == "amphora"


@pytest.mark.parametrize("write", range(0, 47, 6))
def test_interrupted_push_is_completed_by_the_next(
    archive: Archive, session_folder: MakeSession, monkeypatch: pytest.MonkeyPatch, write: int
):
    folder, put, count = session_folder(), ContentStore.put, 0

    def dying(self: ContentStore, file: Path, digest: str) -> bool:
        nonlocal count
        count += 1
        if count > write:
            raise RigError(ErrorCode.ARCHIVE_UNREACHABLE, "the store is away")
        return put(self, file, digest)

    with monkeypatch.context() as patch:
        patch.setattr(ContentStore, "put", dying)
        with pytest.raises(RigError):
            archive.push(folder)
    assert archive.verify() == []  # nothing is named that is not there
    archive.push(folder)
    assert archive.verify() == []
    assert len(archive.catalogue.sessions()) == 1


def test_verify_names_damaged_and_missing_files_and_goes_on(archive: Archive, session_folder: MakeSession):
    archive.push(session_folder())
    one, two, *_ = object_files(archive)
    one.write_bytes(b"bit rot")
    two.unlink()
    faults = archive.verify()
    assert sorted(fault.what for fault in faults) == ["damaged", "missing"]
    assert all(fault.needed_by for fault in faults)


def test_verify_unreadable_entry_names_it(archive: Archive, session_folder: MakeSession):
    archive.push(session_folder("20261121-190041-aaaaaa", 1))
    archive.push(session_folder("20261121-190041-bbbbbb", 2))
    first = archive.catalogue.sessions()[0].key
    archive.contents.write(f"sessions/{first}/session.json", b"{}")
    (fault,) = archive.verify()
    assert fault.file == f"sessions/{first}/session.json"


def test_verify_unreadable_result_names_it_and_enters_the_others(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder()).key
    damaged, sound = archive.contents.names(f"sessions/{key}/results")
    archive.contents.write(damaged, b"{}")
    (fault,) = archive.verify()
    assert (fault.file, fault.what) == (damaged, "damaged")
    assert archive.contents.read(sound) is not None


@pytest.mark.parametrize("catalogue", ["kept", "lost"])
def test_verify_names_the_lost_entry_of_a_session(
    archive: Archive, session_folder: MakeSession, lose_catalogue: Callable[[Archive], Archive], catalogue: str
):
    folder = session_folder()
    name = f"sessions/{archive.push(folder).key}/session.json"
    archive.contents.remove(name)
    if catalogue == "lost":
        archive = lose_catalogue(archive)
    assert [(fault.file, fault.what) for fault in archive.verify()] == [(name, "missing")]
    archive.push(folder)
    assert archive.verify() == []


def test_verify_names_a_session_of_which_only_the_catalogue_knows(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder()).key
    archive.push(session_folder("20261121-190041-bbbbbb", 2))
    shutil.rmtree(Path(archive.address, "sessions", key))
    faults = archive.verify()
    assert sorted(fault.file for fault in faults)[-1] == f"sessions/{key}/session.json"
    assert len(faults) == 3
    assert {fault.what for fault in faults} == {"missing"}


def test_verify_names_the_lost_entry_of_a_result_and_has_it_solved_again(archive: Archive, session_folder: MakeSession):
    folder = session_folder()
    key = archive.push(folder).key
    lost, _ = archive.contents.names(f"sessions/{key}/results")
    archive.contents.remove(lost)
    (fault,) = archive.verify()
    assert (fault.file, fault.what) == (lost, "missing")
    (row,) = [row for row in archive.catalogue.results(key) if row.state == "failed"]
    assert "lost" in str(row.error)
    wanted = claims.Claim(claims.SolveKey(key, row.solver, row.settings, row.last_pass), "a worker", "a call")
    assert claims.claim(archive.catalogue, wanted) == "claimed"
    claims.release(archive.catalogue, wanted)
    archive.push(folder)
    assert archive.verify() == []
    assert {row.state for row in archive.catalogue.results(key)} == {"done"}


def test_verify_enters_sessions_of_a_lost_catalogue(
    archive: Archive, session_folder: MakeSession, lose_catalogue: Callable[[Archive], Archive]
):
    archive.push(session_folder())
    (before,) = archive.catalogue.sessions()
    again = lose_catalogue(archive)
    assert again.catalogue.sessions() == []
    assert again.verify() == []
    (row,) = again.catalogue.sessions()
    assert (row.key, row.solver, row.sigma_deg) == (before.key, before.solver, before.sigma_deg)
    assert len(again.catalogue.results(row.key)) == 2


def test_results_of_the_cell_are_entered_by_their_images(archive: Archive, session_folder: MakeSession):
    key = archive.push(session_folder()).key
    results = archive.catalogue.results(key)
    assert sorted((row.last_pass is None, row.origin, row.state) for row in results) == [
        (False, "cell", "done"), (True, "cell", "done"),
    ]  # fmt: skip
    whole = next(row for row in results if row.last_pass is None)
    assert archive.catalogue.sessions()[0].sigma_deg == whole.sigma_deg


def test_find_ambiguous_or_unknown_name_is_refused(archive: Archive, session_folder: MakeSession):
    archive.push(session_folder("20261121-190041-aaaaaa", 1))
    archive.push(session_folder("20261121-190041-bbbbbb", 2))
    assert archive.find("20261121-190041-b") in {row.key for row in archive.catalogue.sessions()}
    with pytest.raises(RigError, match="Several sessions begin with"):
        archive.find("20261121")
    with pytest.raises(RigError, match="No session's key or id begins with"):
        archive.find("vase")


def test_open_folder_of_other_files_is_refused(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(RigError, match="holds other files"):
        Archive.create(str(tmp_path))
    with pytest.raises(RigError, match="holds no archive"):
        Archive(str(tmp_path))
    with pytest.raises(RigError, match="there is no such folder"):
        Archive(str(tmp_path / "nowhere"))
    assert not (tmp_path / "nowhere").exists()


def test_open_newer_catalogue_or_archive_is_refused(archive: Archive, tmp_path: Path):
    newer = Catalogue(catalogues.in_folder(tmp_path))
    newer.repeatedly(lambda connection: connection.execute(catalogues.meta.insert().values(format=99)).close())
    newer.close()
    with pytest.raises(RigError) as refused:
        Catalogue(catalogues.in_folder(tmp_path))
    assert refused.value.code is ErrorCode.ARCHIVE_CATALOGUE_NEWER
    archive.contents.write("archive.json", json.dumps({"format": 2}).encode())
    with pytest.raises(RigError) as refused:
        Archive(archive.address)
    assert refused.value.code is ErrorCode.ARCHIVE_CATALOGUE_NEWER


@pytest.mark.parametrize("address", ["mysql://host/name", "nonsense", "postgresql://127.0.0.1:9/lightpose"])
def test_open_catalogue_elsewhere_names_its_address(archive: Archive, address: str):
    with pytest.raises(RigError, match=address.partition(":")[0]) as refused:
        Archive(archive.address, address)
    assert refused.value.code in (ErrorCode.ARCHIVE_ADDRESS_INVALID, ErrorCode.ARCHIVE_UNREACHABLE)


def test_sessions_are_selected_by_condition(archive: Archive, session_folder: MakeSession):
    archive.push(session_folder("20261121-190041-aaaaaa", 1, label="Große Vase"))
    archive.push(session_folder("20261121-190041-bbbbbb", 2, label="amphora"))
    archive.push(session_folder("20261121-190041-cccccc", 3, label="vase 2", results=False))

    def labels(condition: str) -> list[str]:
        return sorted(row.object for row in archive.catalogue.sessions(where.parse(condition)))

    assert labels("object ~ 'VASE'") == ["Große Vase", "vase 2"]
    assert labels("object ~ 'große'") == ["Große Vase"]
    assert labels("solver < '0.10' and sigma > 0") == ["Große Vase", "amphora"]
    assert labels("solver is unknown or object = 'amphora'") == ["amphora", "vase 2"]
    assert labels("not (object ~ 'vase')") == ["amphora"]
    assert labels("captured >= '2026-11-21' and captured < '2026-11-22' and lights = 5") == [
        "Große Vase", "amphora", "vase 2",
    ]  # fmt: skip


def test_archive_folder_can_be_moved(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    archive.push(session_folder())
    archive.close()
    shutil.move(archive.address, tmp_path / "moved")
    on_a_server = None if (tmp_path / "moved" / catalogues.FILE).exists() else archive.catalogue_address
    moved = Archive(str(tmp_path / "moved"), on_a_server)
    assert len(moved.catalogue.sessions()) == 1
    assert moved.verify() == []
    moved.close()


def test_catalogue_of_another_archive_is_refused(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    """Its sessions would be listed here, and named as lost; those of this archive would be listed there."""
    archive.push(session_folder())
    archive.close()
    with pytest.raises(RigError, match="is that of another archive than") as refused:
        Archive.create(str(tmp_path / "other"), archive.catalogue_address)
    assert refused.value.code is ErrorCode.ARCHIVE_ADDRESS_INVALID
    own = Archive(str(tmp_path / "other"))
    own.close()
    assert own.identity not in (None, archive.identity)


def test_archive_without_identity_is_used_as_before(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    """Archives that were made before there were identities have neither their own nor one in the catalogue."""
    archive.push(session_folder())
    archive.contents.write("archive.json", b'{"format":1}')
    archive.catalogue.repeatedly(catalogues._archive.drop)
    archive.close()
    older = Archive(archive.address, archive.catalogue_address)
    assert older.identity is None
    assert older.verify() == []
    older.close()
    with pytest.raises(RigError, match="is that of another archive than"):
        Archive.create(str(tmp_path / "other"), archive.catalogue_address)


def test_copy_of_an_archive_is_the_same_archive(archive: Archive, session_folder: MakeSession, tmp_path: Path):
    archive.push(session_folder())
    archive.close()
    shutil.copytree(archive.address, tmp_path / "mirror")
    mirror = Archive(str(tmp_path / "mirror"), archive.catalogue_address)
    assert mirror.identity == archive.identity
    assert mirror.verify() == []
    mirror.close()
