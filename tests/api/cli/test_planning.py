"""`lightpose plan`: lights to add to a folder of any format, and what is refused."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from acquisition import geometry, lamp_pose, pilot
from acquisition.formats import folders
from acquisition.formats.folders.session_folder import read as read_session
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.normals import near_light
from api.cli import lights_file, planning
from api.cli.commands import app
from tests.acquisition import scenes, session_folder
from tests.acquisition.formats.folders import small

ROOT = Path(__file__).parents[3]
KINDS = {"near": small.near, "diligent": small.diligent, "lp": small.lp}
CENTER_MM = np.array([0.0, 0.0, 470.0])
"""Of the near-light folder's ball, OpenCV's frame."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One folder of each format."""
    folder = tmp_path_factory.mktemp("folders")
    given = {kind: make(folder / kind) for kind, make in KINDS.items()}
    return given | {"session": session_folder.make(folder / "session")}


def planned(folder: Path, count: int, **options: object) -> dict[str, object]:
    return planning.run(planning.plan_request(folder, count, **options))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def three(made: dict[str, Path]) -> dict[str, dict[str, object]]:
    """Three lights for the folder of each format."""
    return {kind: planned(folder, 3) for kind, folder in made.items()}


def word_of(kind: str) -> str:
    return "direction" if kind in {"diligent", "lp"} else "position"


def offsets(outcome: dict[str, object], kind: str, center: np.ndarray | None = None) -> np.ndarray:
    """The lights as seen from the object, view frame; the conversion of the near-light folder is written out again."""
    rows = np.array([light[word_of(kind)] for light in outcome["lights"]])  # type: ignore[attr-defined, index]
    if kind == "near":
        return (rows - CENTER_MM) * [1, -1, -1]
    return rows if center is None else rows - center


@pytest.mark.parametrize("kind", ["near", "diligent", "lp", "session"])
def test_plan_every_format_gives_lights_of_its_own_kind(kind: str, three: dict[str, dict[str, object]]) -> None:
    outcome = three[kind]
    assert [list(light) for light in outcome["lights"]] == [[word_of(kind)]] * 3  # type: ignore[union-attr]
    assert outcome["unit"] == {"near": "mm", "session": "m"}.get(kind)
    assert 0.1 < outcome["forecast_mean_deg"] < 5  # type: ignore[operator]
    assert len(outcome["reasons"]) == len(outcome["gains"]) == 3  # type: ignore[arg-type]
    assert json.loads(json.dumps(outcome)) == outcome
    forecast = [point["mean_deg"] for point in outcome["forecast"]]  # type: ignore[union-attr, index]
    assert forecast == sorted(forecast, reverse=True)


def test_plan_near_free_dome_stands_at_radius_and_slant(made: dict[str, Path]) -> None:
    lights = json.loads((made["near"] / "lights.json").read_text())["lights"]
    usual = np.mean(np.linalg.norm([np.array(light["position"]) - CENTER_MM for light in lights], axis=1))
    for radius_mm, slant_deg, radius in ((None, None, usual), (333.0, 40.0, 333.0)):
        outcome = planned(made["near"], 4, radius_mm=radius_mm, max_slant_deg=slant_deg)
        places = offsets(outcome, "near")
        np.testing.assert_allclose(np.linalg.norm(places, axis=1), radius, rtol=0.04)
        slants = np.degrees(geometry.slant_azimuth(places)[0])
        assert np.all(slants < (slant_deg or 70) + 3)
        assert np.all(slants > 5)


def test_plan_distant_free_dome_gives_unit_directions(made: dict[str, Path]) -> None:
    for kind in ("diligent", "lp"):
        units = offsets(planned(made[kind], 5, max_slant_deg=50.0), kind)
        np.testing.assert_allclose(np.linalg.norm(units, axis=1), 1, atol=1e-9)
        assert np.all(units[:, 2] >= np.cos(np.radians(50)) - 1e-9)


@pytest.mark.parametrize("kind", ["near", "diligent", "lp", "session"])
def test_plan_of_some_images_offers_the_others(kind: str, made: dict[str, Path]) -> None:
    """Numbers are those of the images, and the lights are theirs as the folder writes them."""
    if kind == "near":
        given = [light["position"] for light in json.loads((made[kind] / "lights.json").read_text())["lights"]]
    elif kind == "session":
        shots = read_session(made[kind]).observations(99).shots
        given = [shot.light.position for shot in shots if shot.light is not None]
    else:
        given = small.DIRECTIONS.tolist()
    outcome = planned(made[kind], 2, pilot="3,0,1,2")
    lights = outcome["lights"]
    assert outcome["pilot"] == [3, 0, 1, 2]
    assert outcome["candidates"] == len(given) - 4
    assert len({light["number"] for light in lights}) == 2  # type: ignore[union-attr, index]
    for light in lights:  # type: ignore[union-attr]
        assert light["number"] not in {0, 1, 2, 3}  # type: ignore[index]
        np.testing.assert_allclose(light[word_of(kind)], given[light["number"]], atol=1e-9)  # type: ignore[index]


def write(path: Path, rows: np.ndarray, separator: str = " ") -> Path:
    path.write_text("\n".join(separator.join(f"{value:.9g}" for value in row) for row in rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("kind", "separator"),
    [("near", " "), ("lp", ", "), ("near", "\t")]
    + [pytest.param(*case, marks=pytest.mark.long) for case in (("lp", " "), ("near", ", "), ("lp", "\t"))],
)
def test_plan_candidates_of_file_are_numbered_by_line(
    kind: str, separator: str, made: dict[str, Path], tmp_path: Path
) -> None:
    azimuth = np.arange(24) * np.pi * (3 - np.sqrt(5))
    units = geometry.direction(np.linspace(0.2, 1.2, 24), azimuth)
    rows = CENTER_MM + 300 * units * [1, -1, -1] if kind == "near" else 7 * units
    outcome = planned(made[kind], 5, candidates=write(tmp_path / "dome.txt", rows, separator))
    lights = outcome["lights"]
    assert len({light["number"] for light in lights}) == 5  # type: ignore[union-attr, index]
    for light in lights:  # type: ignore[union-attr]
        np.testing.assert_allclose(light[word_of(kind)], rows[light["number"]], rtol=1e-6)  # type: ignore[index]


def test_plan_one_sided_pilot_asks_for_the_other_side(made: dict[str, Path], tmp_path: Path) -> None:
    """The directions' pilot lacks light from the image's top, the positions' one, with y downwards, from its bottom."""
    lower, upper = [0.1, -0.7, 0.7], [0.1, 0.7, 0.7]
    rows = np.array([lower, upper])
    for kind, missing in (("lp", upper), ("near", lower)):
        own = CENTER_MM + 300 * rows * [1, -1, -1] if kind == "near" else rows
        file = write(tmp_path / f"{kind}.txt", own)
        chosen = planned(made[kind], 1, candidates=file, pilot="0,1,2,4")["lights"]
        assert chosen[0]["number"] == [lower, upper].index(missing)  # type: ignore[index]


def test_plan_candidates_that_are_the_pilots_are_left_out(made: dict[str, Path], tmp_path: Path) -> None:
    file = write(tmp_path / "dome.txt", small.DIRECTIONS)
    outcome = planned(made["lp"], 2, candidates=file, pilot="0,1,2,4")
    assert sorted(light["number"] for light in outcome["lights"]) == [3, 5]  # type: ignore[union-attr, index]
    assert any("4 candidates are lights of the pilot" in note for note in outcome["notes"])  # type: ignore[union-attr]
    with pytest.raises(RigError, match="leaves no candidates"):
        planned(made["lp"], 1, candidates=file)


def test_plan_max_slant_leaves_out_steep_candidates(made: dict[str, Path], tmp_path: Path) -> None:
    slants = np.radians([20.0, 35.0, 40.0, 65.0, 72.0])
    file = write(tmp_path / "dome.txt", geometry.direction(slants, np.arange(5) * 1.3 + 0.4))
    outcome = planned(made["lp"], 3, candidates=file, max_slant_deg=50.0)
    assert sorted(light["number"] for light in outcome["lights"]) == [0, 1, 2]  # type: ignore[union-attr, index]
    with pytest.raises(RigError, match="leaves 3 candidates"):
        planned(made["lp"], 4, candidates=file, max_slant_deg=50.0)


@pytest.mark.parametrize("kind", ["near", "diligent"])
def test_plan_same_folder_gives_same_plan(
    kind: str, made: dict[str, Path], three: dict[str, dict[str, object]]
) -> None:
    first, second = three[kind], planned(made[kind], 3)
    assert first["lights"] == second["lights"]
    assert first["forecast_mean_deg"] == second["forecast_mean_deg"]


def test_plan_out_holds_what_json_prints(made: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "new" / "plan.json"
    done = subprocess.run(
        [sys.executable, "-m", "api.cli", "plan", str(made["session"]), "--count", "2", "--out", str(out), "--json"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert json.loads(out.read_text()) == outcome
    assert [path.name for path in out.parent.iterdir()] == ["plan.json"]
    assert "Expected mean error" in done.stderr
    # A session's lights are metres in the view frame, which `demo --method user --lights` takes.
    assert [list(position) for position in lights_file.read(out)] == [light["position"] for light in outcome["lights"]]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"count": 0}, "--count 0"),
        ({"count": 301}, "--count 301: at most 300 lights"),
        ({"count": 3, "pilot": "0,1,2,3"}, "--count 3: .* leaves 2 candidates"),
        ({"pilot": "0,1"}, r"2 image\(s\)"),
        ({"pilot": "0,1,6,2"}, "--pilot 6: .* 6 images"),
        ({"pilot": "0,1,2,1"}, "--pilot 1: given more than once"),
        ({"pilot": "0,-1,2"}, "--pilot 0,-1,2: give"),
        ({"pilot": "a,b,c"}, "--pilot a,b,c: give"),
        ({"pilot": ""}, "--pilot : give"),
        ({"radius_mm": 0.0}, "--radius-mm 0"),
        ({"radius_mm": float("nan")}, "--radius-mm nan"),
        ({"radius_mm": 300.0, "pilot": "0,1,2,3"}, "--radius-mm is the radius of a free dome, but"),
        ({"radius_mm": 300.0, "candidates": Path("x")}, "--radius-mm is the radius of a free dome and cannot"),
        ({"max_slant_deg": 95.0}, "--max-slant-deg 95"),
        ({"max_slant_deg": 3.0}, "--max-slant-deg 3"),
        ({"candidates": Path("nowhere.txt")}, "--candidates nowhere.txt: cannot be read"),
        ({"out": ROOT}, "--out .*: is not a file"),
    ],
)
def test_plan_bad_option_is_refused_by_name(options: dict[str, object], said: str, made: dict[str, Path]) -> None:
    with pytest.raises(RigError, match=said) as refused:
        planned(made["near"], **({"count": 1} | options))  # type: ignore[arg-type]
    assert refused.value.code is ErrorCode.REQUEST_INVALID


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("1 2 3\n1 2\n", "line 2: '1 2' is not three numbers"),
        ("1 2 3\n\n4 5 6\n", "line 2: '' is not"),
        ("1 2 3\n4 5 six\n", "line 2: '4 5 six'"),
        ("1 2 3 4\n", "line 1"),
        ("1 2 inf\n", "line 1"),
        ("0 0 0\n", "light 0, counted from 0, has no direction"),
    ],
)
def test_plan_bad_candidates_name_their_line(text: str, said: str, made: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "dome.txt").write_text(text)
    with pytest.raises(RigError, match=said) as refused:
        planned(made["lp"], 1, candidates=tmp_path / "dome.txt")
    assert refused.value.code is ErrorCode.REQUEST_INVALID


def around(count: int, slant_deg: float = 55.0) -> np.ndarray:
    return geometry.direction(np.full(count, np.radians(slant_deg)), np.arange(count) * 2.4 + 0.3)


def test_plan_candidates_all_behind_the_object_are_refused(made: dict[str, Path], tmp_path: Path) -> None:
    """Of some of them a note tells."""
    units = around(8)
    with pytest.raises(RigError, match="8 behind it: correct the axes") as refused:
        planned(made["lp"], 2, candidates=write(tmp_path / "behind.txt", units * [1, 1, -1]))
    assert refused.value.code is ErrorCode.REQUEST_INVALID
    some = write(tmp_path / "some.txt", np.concatenate([units, units[:3] * [1, 1, -1]]))
    notes = planned(made["lp"], 2, candidates=some)["notes"]
    assert any("3 candidates are behind the object" in note for note in notes)  # type: ignore[union-attr]


def test_plan_repeated_candidates_count_once(made: dict[str, Path], tmp_path: Path) -> None:
    units = around(2)
    file = write(tmp_path / "dome.txt", np.concatenate([units[:1]] * 9 + [3 * units[1:]]))
    outcome = planned(made["lp"], 2, candidates=file)
    assert sorted(light["number"] for light in outcome["lights"]) == [0, 9]  # type: ignore[union-attr, index]
    assert any("8 candidates repeat another one" in note for note in outcome["notes"])  # type: ignore[union-attr]
    with pytest.raises(RigError, match=r"leaves 2 candidates.* give each light once"):
        planned(made["lp"], 3, candidates=file)


@pytest.mark.parametrize("factor", [12, 1])
def test_plan_candidates_in_another_unit_are_noted(factor: float, made: dict[str, Path], tmp_path: Path) -> None:
    rows = CENTER_MM + factor * 300 * around(8) * [1, -1, -1]
    notes = planned(made["near"], 2, candidates=write(tmp_path / "dome.txt", rows))["notes"]
    said = [note for note in notes if "are they in mm" in note]  # type: ignore[union-attr]
    assert len(said) == (factor != 1)


@pytest.mark.parametrize(("factor", "said"), [(1000, "behind it"), (0.001, "leaves no candidates")])
def test_plan_candidates_in_another_unit_are_refused_with_a_hint(
    factor: float, said: str, made: dict[str, Path], tmp_path: Path
) -> None:
    """In µm they are all behind the object, in m all at the camera, where a lamp of the pilot stands."""
    rows = (CENTER_MM + 300 * around(8) * [1, -1, -1]) * factor
    with pytest.raises(RigError, match=rf"{said}.*are they in mm, as the folder's are"):
        planned(made["near"], 2, candidates=write(tmp_path / "dome.txt", rows))


def test_plan_slant_that_leaves_nothing_is_named(made: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(RigError, match="leaves no candidates: raise --max-slant-deg 20"):
        planned(made["lp"], 1, candidates=write(tmp_path / "dome.txt", around(8)), max_slant_deg=20.0)


def test_plan_radius_of_directions_is_refused(made: dict[str, Path]) -> None:
    with pytest.raises(RigError, match="directions, which have no radius"):
        planned(made["diligent"], 1, radius_mm=300.0)


def test_plan_coplanar_pilot_is_refused(tmp_path: Path) -> None:
    """Three lamps on a line through the ball's middle, as the camera sees it."""
    folder = small.near(tmp_path / "in", np.array([[-200.0, 0, 150], [0, 0, 100], [200, 0, 150], [0, 200, 150]]))
    with pytest.raises(RigError, match="one plane") as refused:
        planned(folder, 1, pilot="0,1,2")
    assert refused.value.code is ErrorCode.NORMALS_INFEASIBLE
    directions = small.lp(tmp_path / "lp")
    rows = (directions / "lights.lp").read_text().splitlines()
    rows[1:4] = [f"img {number}.png {x} 0.0 0.9" for number, x in enumerate((-0.4, 0.0, 0.4))]
    (directions / "lights.lp").write_text("\n".join(rows))
    with pytest.raises(RigError, match="one plane"):
        planned(directions, 1, pilot="0,1,2")


def test_plan_refusal_exits_as_solve_does(tmp_path: Path, made: dict[str, Path]) -> None:
    for folder, images in ((tmp_path / "none", "0,1,2"), (made["lp"], "0,0,0")):
        done = CliRunner().invoke(app, ["plan", str(folder), "--count", "1", "--pilot", images])
        assert done.exit_code == 2
        assert "What to do" in done.stderr
        assert not done.stdout
        assert isinstance(done.exception, SystemExit)  # a printed message, not a traceback


def near_folder(folder: Path, true: scenes.Scene, lights: list[Light]) -> Path:
    """A near-light folder of a scene, in cm, with the errors of lamps and the noise that `scenes.capture` draws."""
    folder.mkdir()
    known, captured = true.calibration, scenes.capture(true, lights, seed=5)
    listed: list[dict[str, object]] = []
    for shot in captured.shots:
        assert shot.light is not None
        name = shot.frame.path.replace(".tiff", ".png")
        signal = captured.frames.rows(shot.frame, 0, known.height) - known.sensor.black_level_dn
        cv2.imwrite(
            str(folder / name), np.clip(signal / known.sensor.full_scale_dn * 65535, 0, 65535).astype(np.uint16)
        )
        x, y, z = (100 * value for value in shot.light.position)
        listed.append({"file": name, "position": [x, -y, -z], "intensity": shot.exposure_s * known.lamp_intensity})
    camera = {"K": [list(row) for row in known.camera_matrix], "distortion": []}
    content = {
        "unit": "cm", "reference_mm": 1000 * known.reference_m, "camera": camera, "lights": listed, "depth_mm": 870,
        "black_level": 0,
    }  # fmt: skip
    (folder / "lights.json").write_text(json.dumps(content))
    cv2.imwrite(str(folder / "mask.png"), true.mask.astype(np.uint8) * 255)
    return folder


@pytest.mark.long
def test_plan_replayed_dome_beats_most_random_choices(tmp_path: Path) -> None:
    """Found errors of pilot and four further lights: the plan's and those of twelve random choices of a dome of 24."""
    true = scenes.scene(scenes.bumps, scenes.calibration(112, lobe_exponent=0.0))
    reach = scenes.Dome(refused=0)
    slants, azimuths = np.radians(np.linspace(15, 72, 24)), np.arange(24) * np.pi * (3 - np.sqrt(5))
    dome = [
        lamp_pose.light_at(reach.center + 0.45 * unit, reach.center) for unit in geometry.direction(slants, azimuths)
    ]
    first = pilot.pattern(Recipe(), reach)
    folder = near_folder(tmp_path / "dome", true, [*first, *dome])
    images = folders.read(folder, tmp_path)

    def found_deg(further: list[int]) -> float:
        solved = near_light.solve(images.only([0, 1, 2, 3, *further]), SolveSettings())
        return float(np.mean(true.error_deg(solved.normals)))

    outcome = planned(folder, 4, pilot="0,1,2,3")
    chosen = [light["number"] for light in outcome["lights"]]  # type: ignore[union-attr, index]
    assert outcome["unit"] == "cm"
    assert outcome["candidates"] == 24
    ours = found_deg(chosen)
    rng = np.random.default_rng(8)
    random = sorted(found_deg([int(number) for number in 4 + rng.permutation(24)[:4]]) for _ in range(12))
    assert ours < random[3]
    assert ours < 0.8 * found_deg([])
    assert outcome["forecast_mean_deg"] == pytest.approx(ours, rel=0.4)
