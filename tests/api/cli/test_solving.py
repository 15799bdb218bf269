"""`lightpose solve` and `lightpose replay`: folders to results, written atomically."""

import errno
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from acquisition import photometry
from acquisition.formats import export, folders
from acquisition.formats.folders.session_folder import read as read_session
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import SolveSettings
from acquisition.runner import jobs
from api.cli import replaying, solving
from api.cli.commands import app
from tests.acquisition import session_folder
from tests.acquisition.formats.folders import small

ROOT = Path(__file__).parents[3]
RECORDED = ROOT / "tests/data/release_0.1/sessions/20261121-190041-de2be6"


def request(folder: Path, **more: object) -> solving.FolderSolveOptions:
    given = {"solver": "auto", "near": False, "out": None, "sphere": None, "exports": ()} | more
    return solving.solve_request(folder, **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return session_folder.make(tmp_path_factory.mktemp("sessions") / "small")


def test_solve_json_prints_one_object_as_last_line(tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    sphere = f"{small.SIZE / 2},{small.SIZE / 2},{small.RADIUS}"
    done = subprocess.run(
        [sys.executable, "-m", "api.cli", "solve", str(folder), "--out", str(tmp_path / "out"),
         "--sphere", sphere, "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert outcome["mean_deg"] < 0.8
    assert outcome["median_deg"] <= outcome["p95_deg"] < 3
    assert outcome["pixels"] == np.count_nonzero(small.sphere()[1])
    assert outcome["solver"] == "distant"
    assert outcome["seconds"] > 0
    assert outcome["sigma_ratio"] > 0
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"normals.png", "normals.tiff", "sigma_deg.tiff", "mask.png", "report.html", "report.png"} <= written
    kept = json.loads((tmp_path / "out" / solving.SUMMARY).read_text())
    assert kept["mean_deg"] == outcome["mean_deg"]
    assert kept["depth_unit"] == "pixel"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "out"]


def test_solve_folder_without_truth_has_null_errors(tmp_path: Path) -> None:
    outcome = solving.run(request(small.lp(tmp_path / "in")))
    assert outcome["mean_deg"] is None
    assert outcome["sigma_ratio"] is None
    assert outcome["normals"] > 500
    assert any("no light intensities" in sentence for sentence in outcome["warnings"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


@pytest.mark.parametrize(("make", "known"), [(small.lp, "assumed"), (small.diligent, "stated")])
def test_solve_brighter_light_is_told_against_what_was_known(
    make: Callable[[Path], Path], known: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing of such folders is calibrated, and an .lp file states no intensity at all."""
    folder = make(tmp_path / "in")
    name = folders.read(folder, tmp_path).names[2]
    pixels = cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(folder / name), np.round(pixels * 1.1).astype(np.uint16))
    solving.run(request(folder))
    told = " ".join(capsys.readouterr().err.split())
    assert re.search(f"{name}: its light was [0-9.]+ % brighter than {known}; this is corrected", told)
    assert "than calibrated" not in told


def test_solve_near_light_folder_gives_absolute_albedo(tmp_path: Path) -> None:
    folder, out = small.near(tmp_path / "in"), tmp_path / "out"
    outcome = solving.run(request(folder, near=True, out=out, exports=["all"]))
    assert outcome["solver"] == "near"
    assert outcome["depth_unit"] == "m"
    assert outcome["median_deg"] < 0.5
    assert outcome["coverage"] > 0.9
    albedo = tifffile.imread(out / "albedo.tiff")
    assert np.median(albedo[albedo > 0]) == pytest.approx(small.ALBEDO, rel=0.03)
    depth = tifffile.imread(out / "depth.tiff")
    assert np.median(depth[depth > 0]) == pytest.approx(0.467, abs=0.02)
    assert {*export.FILES, *export.FOLDERS} <= {path.name for path in out.iterdir()}


def test_solve_near_light_folder_mirrored_lamps_are_mirrored_back(tmp_path: Path) -> None:
    """The y of the lamps' positions with the wrong sign, which no residual of a ball can tell."""
    folder = small.near(tmp_path / "in")
    content = json.loads((folder / "lights.json").read_text())
    for light in content["lights"]:
        light["position"][1] *= -1
    (folder / "lights.json").write_text(json.dumps(content))
    outcome = solving.run(request(folder, near=True, out=tmp_path / "out"))
    assert [(one["kind"], one["corrected"]) for one in outcome["findings"]] == [("axes of the lamps", True)]
    assert outcome["fit"]["probability"] > 0.01
    assert outcome["median_deg"] < 0.5
    assert "axes differ from the camera&#x27;s: x and −y" in (tmp_path / "out" / "report.html").read_text(
        encoding="utf-8"
    )


def test_solve_near_light_least_squares_gives_normals(tmp_path: Path) -> None:
    """Without a shadow beyond the rim it is as good; at the rough depth alone it would not be."""
    folder, out = small.near(tmp_path / "in"), tmp_path / "out"
    outcome = solving.run(request(folder, solver="ls", near=True, out=out))
    assert outcome["solver"] == "ls"
    assert outcome["median_deg"] < 0.7
    assert outcome["coverage"] == 1
    albedo, depth = (tifffile.imread(out / f"{name}.tiff") for name in ("albedo", "depth"))
    assert np.median(albedo[albedo > 0]) == pytest.approx(small.ALBEDO, rel=0.06)
    assert np.ptp(depth[depth > 0]) == pytest.approx(0.035, abs=0.01)


@pytest.mark.parametrize(
    ("number", "code"), [(errno.ENOSPC, ErrorCode.STORE_DISK_FULL), (errno.EACCES, ErrorCode.FOLDER_INVALID)]
)
def test_solve_full_or_locked_disk_is_told(
    number: int, code: ErrorCode, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object) -> None:
        raise OSError(number, "as the system says")

    monkeypatch.setattr(export, "write_maps", fail)
    with pytest.raises(RigError) as told:
        solving.run(request(small.diligent(tmp_path / "in"), solver="ls", out=tmp_path / "out"))
    assert told.value.code is code
    assert str(tmp_path / "out") in told.value.detail
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_solve_image_left_out_is_named_by_number_from_0_and_file(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """In figures, on the screen and in the report, whose table says nothing of clipped pixels there."""
    folder = small.lp(tmp_path / "in")
    (folder / "img 3.png").write_bytes((folder / "img 1.png").read_bytes())
    outcome = solving.run(request(folder, out=tmp_path / "out"))
    sentence = "image 3 (img 3.png) does not fit the others: it is left out"
    assert [(one["message"], one["value"]) for one in outcome["findings"]] == [(sentence, 3)]
    assert sentence[1:] in " ".join(capsys.readouterr().err.split())
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    rows = re.findall(r"<tr><td>(\d+)<td>(img [^<]*)<td>.*?<td>([^<]*)<td>([^<]*)(?=<tr>|</table>)", page)
    assert [(number, name) for number, name, *_ in rows] == [(str(one), f"img {one}.png") for one in range(6)]
    assert rows[3][2:] == ("left out", "–")
    assert rows[2][2:] != ("left out", "–")


def test_solve_refused_option_has_advice_for_a_command_line(tmp_path: Path) -> None:
    """Not that of a service's requests, whose fields are named."""
    done = CliRunner().invoke(app, ["solve", str(small.lp(tmp_path / "in")), "--solver", "magic"])
    assert done.exit_code == 2
    assert "errors" not in done.stderr
    assert "run the command again" in done.stderr


def test_solve_full_scale_of_folder_is_used(tmp_path: Path) -> None:
    folder = small.lp(tmp_path / "in")
    with pytest.raises(RigError, match="values above 255"):
        solving.run(request(folder, full_scale=255.0))
    for wrong in (0.0, float("nan")):
        with pytest.raises(RigError, match="--full-scale"):
            request(folder, full_scale=wrong)


@pytest.mark.parametrize("solver", solving.GONE_SOLVERS)
def test_solve_solver_of_earlier_releases_is_refused(solver: str, tmp_path: Path) -> None:
    with pytest.raises(RigError, match="auto finds") as refused:
        request(tmp_path, solver=solver)
    assert refused.value.code is ErrorCode.REQUEST_INVALID


@pytest.mark.parametrize("light", ["distant", "near"])
def test_solve_keep_steps_allows_depth_discontinuities(light: str, tmp_path: Path) -> None:
    """The normals are the same, the depth is not."""
    folder = (small.diligent if light == "distant" else small.near)(tmp_path / "in")
    for name, keep in (("smooth", False), ("kept", True)):
        solving.run(request(folder, out=tmp_path / name, keep_steps=keep))
    normals, depth = (
        [tifffile.imread(tmp_path / name / f"{what}.tiff") for name in ("smooth", "kept")]
        for what in ("normals", "depth")
    )
    assert np.any(depth[0] != depth[1])
    np.testing.assert_array_equal(normals[0], normals[1])


def test_solve_exported_folder_gives_same_normals(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    solving.run(request(small.diligent(tmp_path / "in"), out=first, exports=["diligent"]))
    solving.run(request(first / "diligent", out=second))
    one, two = (tifffile.imread(folder / "normals.tiff") for folder in (first, second))
    np.testing.assert_allclose(one, two, atol=5e-4)


def test_solve_out_replaces_own_result_only(tmp_path: Path) -> None:
    folder, out = small.diligent(tmp_path / "in"), tmp_path / "out"
    solving.run(request(folder, solver="ls", out=out))
    assert solving.run(request(folder, out=out))["out"] == str(out)
    assert json.loads((out / solving.SUMMARY).read_text())["solver"] == "distant"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letters.txt").write_text("kept")
    for target in (tmp_path / "mine", folder):
        before = sorted(target.iterdir())
        with pytest.raises(RigError) as refused:
            solving.run(request(folder, out=target))
        assert refused.value.code is ErrorCode.FOLDER_INVALID
        assert sorted(target.iterdir()) == before


@pytest.mark.parametrize("what", ["another result", "file", "corrected mask", "capture", "exported capture"])
def test_solve_out_with_anything_of_somebody_is_refused(what: str, tmp_path: Path) -> None:
    folder, out = small.diligent(tmp_path / "in"), tmp_path / "out"
    solving.run(request(folder, solver="ls", out=out, exports=["diligent"]))
    match what:
        case "another result":
            solving.run(request(folder, solver="ls", out=out / "of u8"))
        case "file":
            (out / "mask_corrected.png").write_bytes(b"drawn by hand")
        case "corrected mask":
            (out / "mask.png").write_bytes(b"drawn by hand")
        case "capture":
            folder = small.diligent(out / "in")
        case _:
            folder = out / "diligent"
    before = {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    with pytest.raises(RigError) as refused:
        solving.run(request(folder, solver="ls", out=out))
    assert refused.value.code is ErrorCode.FOLDER_INVALID
    named = {"another result": "of u8/", "file": "mask_corrected.png", "corrected mask": "mask.png"}
    assert named.get(what, str(folder)) in refused.value.detail
    assert {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()} == before


def test_solve_out_that_is_a_link_is_written_where_it_leads(tmp_path: Path) -> None:
    folder, link = small.diligent(tmp_path / "in"), tmp_path / "link"
    (tmp_path / "disk").mkdir()
    link.symlink_to(tmp_path / "disk")
    for _ in range(2):
        solving.run(request(folder, solver="ls", out=link))
    assert link.is_symlink()
    assert (tmp_path / "disk" / solving.SUMMARY).is_file()


def test_solve_out_that_is_the_current_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be deleted under the command and under its user's shell."""
    folder, here = small.diligent(tmp_path / "in"), tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    with pytest.raises(RigError, match="in which this command runs"):
        solving.run(request(folder, solver="ls", out=Path()))
    solving.run(request(folder, solver="ls", out=Path("normals")))
    assert [path.name for path in here.iterdir()] == ["normals"]


@pytest.mark.parametrize("broken", ["image", "directions", "mask", "truth"])
def test_solve_bad_folder_writes_nothing(broken: str, tmp_path: Path) -> None:
    folder, out = small.diligent(tmp_path / "in"), tmp_path / "out"
    match broken:
        case "image":
            (folder / "003.png").write_bytes((folder / "003.png").read_bytes()[:300])
        case "directions":
            (folder / "light_directions.txt").write_text("nan 0 1\n" * 6)
        case "mask":
            (folder / "mask.png").unlink()
        case _:
            np.save(folder / "normals_gt.npy", np.zeros((2, 2, 3)))
    with pytest.raises(RigError) as refused:
        solving.run(request(folder, out=out))
    assert refused.value.code is ErrorCode.FOLDER_INVALID
    assert refused.value.context["file"].startswith(str(folder))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"sphere": "1,2"}, "cx,cy,r"),
        ({"sphere": "a,b,c"}, "cx,cy,r"),
        ({"sphere": "1,2,-3"}, "positive"),
        ({"exports": ["mesh.stl"], "out": Path("x")}, "mesh.ply"),
        ({"exports": ["mesh.ply"]}, "--out"),
        ({"near": True}, "lights.json"),
        ({"solver": "magic"}, "auto, ls"),
    ],
)
def test_solve_request_impossible_option_is_refused(more: dict[str, object], said: str, tmp_path: Path) -> None:
    folder = small.diligent(tmp_path / "in")
    with pytest.raises(RigError, match=said):
        solving.run(request(folder, **more))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_solve_session_folder_writes_result(session: Path, tmp_path: Path) -> None:
    outcome = solving.run(request(session, out=tmp_path / "out", exports=["all"]))
    assert outcome["format"] == "session"
    assert outcome["images"] == len(session_folder.LIGHTS)
    assert session_folder.error_deg(tifffile.imread(tmp_path / "out" / "normals.tiff")) < 2
    assert len((tmp_path / "out" / "lights.lp").read_text().splitlines()) == 1 + outcome["images"]
    assert np.loadtxt(tmp_path / "out" / "diligent" / "light_intensities.txt").shape == (outcome["images"], 3)


@pytest.mark.parametrize(("number", "images"), [(None, 6), (0, 3)])
def test_replay_unchanged_session_gives_stored_normals(number: int | None, images: int, session: Path) -> None:
    before = sorted(session.rglob("*"))
    outcome = replaying.replay(session, number)
    assert outcome["same"]
    assert outcome["images"] == images
    assert outcome["max_deg"] < replaying.SAME_DEG
    assert outcome["sigma_deg"] == pytest.approx(outcome["sigma_before_deg"], rel=1e-3)
    assert sorted(session.rglob("*")) == before


def test_solve_replay_and_summary_have_same_mean_sigma(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Over the facing pixels; the mean over all solved pixels is another figure, so the test tells both apart."""
    folder = tmp_path / "a [b]"  # which is no markup
    shutil.copytree(RECORDED, folder)
    shutil.rmtree(folder / "results")
    observations, result = read_session(folder), folder / "results" / "1"
    summary = jobs.solve_normals(
        observations.observations(1), observations.cell, observations.calibration, SolveSettings(), None, None, result
    )
    replayed, solved = replaying.replay(folder), solving.run(request(folder))
    assert replayed["sigma_before_deg"] == summary.mean_sigma_deg
    assert solved["sigma_mean_deg"] == replayed["sigma_deg"] == pytest.approx(summary.mean_sigma_deg, rel=1e-6)
    stored = export.read(result)
    assert np.mean(stored.sigma_deg[stored.mask]) != pytest.approx(summary.mean_sigma_deg, rel=1e-5)
    facing = photometry.facing(stored, observations.calibration)
    assert summary.median_sigma_deg == float(np.median(stored.sigma_deg[facing]))
    assert summary.median_sigma_deg != float(np.median(stored.sigma_deg[stored.mask]))
    report = (result / "report.html").read_text(encoding="utf-8")
    assert f"<th>mean σ within 78° of the viewing ray<td>{summary.mean_sigma_deg:.2f}°" in report
    said = capsys.readouterr().err
    assert "a [b]" in said
    assert said.count(f"{summary.mean_sigma_deg:.3f}°") == 3


def test_replay_changed_result_reports_difference(session: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(session, other)
    stored = tifffile.imread(other / "results" / "1" / "normals.tiff")
    turned = stored[..., [1, 0, 2]]
    tifffile.imwrite(other / "results" / "1" / "normals.tiff", turned, photometric="rgb")
    outcome = replaying.replay(other)
    assert not outcome["same"]
    assert outcome["mean_deg"] > 5


@pytest.mark.parametrize(("pixels", "over_sigma", "same"), [(1, 0.5, True), (1, 1.5, False), (40, 0.5, False)])
def test_replay_few_normals_within_sigma_are_the_same(
    pixels: int, over_sigma: float, same: bool, session: Path, tmp_path: Path
) -> None:
    """A pixel at the threshold of one of its measurements is solved otherwise after a rounding error."""
    other = tmp_path / "other"
    shutil.copytree(session, other)
    result = other / "results" / "1"
    stored = export.read(result)
    rows, columns = (places[100 : 100 + pixels] for places in np.nonzero(stored.mask))
    normals = stored.normals.copy()
    for row, column in zip(rows, columns, strict=True):
        normal = normals[row, column].astype(float)
        aside = np.cross(normal, [0.0, 1.0, 0.0])
        step = np.tan(np.radians(over_sigma * stored.sigma_deg[row, column]))
        moved = normal + step * aside / np.linalg.norm(aside)
        normals[row, column] = moved / np.linalg.norm(moved)
    assert np.min(stored.sigma_deg[rows, columns]) > 4 * replaying.SAME_DEG
    tifffile.imwrite(result / "normals.tiff", normals, photometric="rgb")
    assert replaying.replay(other)["same"] is same


def test_replay_uses_settings_of_stored_result(session: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(session, other)
    manifest = other / "results" / "1" / "manifest.json"
    manifest.write_text('{"settings": {"depth_rounds": 1, "shadow_threshold": 0.4, "robust": true}}')
    assert not replaying.replay(other)["same"]
    manifest.write_text("{}")
    with pytest.raises(RigError) as refused:
        replaying.replay(other)
    assert refused.value.context["file"] == str(manifest)


def test_session_is_neither_graded_by_a_sphere_nor_replayed_from_another_format(session: Path, tmp_path: Path) -> None:
    with pytest.raises(RigError, match="--sphere"):
        solving.run(request(session, sphere="8,8,4"))
    with pytest.raises(RigError, match="is not a session's folder"):
        replaying.replay(small.lp(tmp_path / "in"))


def test_replay_missing_result_or_settings_is_refused(session: Path, tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no result 7; it has 0, 1: name one with --result"):
        replaying.replay(session, 7)
    other = tmp_path / "other"
    shutil.copytree(session, other)
    (other / "passes" / "1" / "shots" / "2.tiff").write_bytes(b"")
    with pytest.raises(RigError) as cut:
        replaying.replay(other)
    assert cut.value.code is ErrorCode.STORE_CORRUPT
    for name in ("calibration.json", "recipe.json", "manifest.json"):
        (other / name).write_text("[]")
        with pytest.raises(RigError) as refused:
            replaying.replay(other)
        assert refused.value.context["file"] == str(other / name)
        shutil.copy(session / name, other / name)
