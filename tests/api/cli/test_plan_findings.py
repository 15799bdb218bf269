"""`lightpose plan`: what it tells of its pilot, and the file that it writes."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ModelFinding, NormalMap
from acquisition.normals import near_light
from api.cli import planning
from tests.acquisition.formats.folders import small


def planned(folder: Path, count: int, **options: object) -> dict[str, Any]:
    return planning.run(planning.plan_request(folder, count, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["lights", "text", "unwritable"])
def test_plan_out_that_is_no_plan_or_cannot_be_written_is_refused_first(kind: str, tmp_path: Path) -> None:
    """Before the folder is read, which there is none of."""
    out = tmp_path / "plan.json"
    match kind:
        case "lights":
            out.write_bytes((small.near(tmp_path / "in") / "lights.json").read_bytes())
        case "text":
            out.write_text("years of work")
        case _:
            out = Path("/proc/new/plan.json")
    before = out.read_bytes() if out.exists() else None
    with pytest.raises(RigError, match="cannot be written" if kind == "unwritable" else "is not a plan"):
        planned(tmp_path / "nothing", 1, out=out)
    assert (out.read_bytes() if out.exists() else None) == before


def test_plan_out_replaces_a_plan(tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    for count in (2, 1):
        planned(small.lp(tmp_path / "in"), count, out=out)
    assert len(json.loads(out.read_text())["lights"]) == 1


def test_plan_tells_what_is_wrong_with_the_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither shows in the findings, and both change the forecast."""
    folder = small.lp(tmp_path / "in")
    for path in folder.glob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) // 16)
    notes = planned(folder, 1)["notes"]
    for said in ("full_scale 4095", "no light intensities"):
        assert any(said in note for note in notes)
    assert " ".join(capsys.readouterr().err.split()).count("full_scale 4095") == 1


def test_plan_refused_because_of_a_copied_file_tells_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = small.lp(tmp_path / "in")
    (folder / "img 5.png").write_bytes((folder / "img 4.png").read_bytes())
    with pytest.raises(RigError, match="a bad one can look like wrong axes"):
        planned(folder, 1)
    assert "img 4.png, img 5.png hold the same values" in " ".join(capsys.readouterr().err.split())


def test_plan_of_corrected_axes_is_refused(tmp_path: Path) -> None:
    """The candidates of the same file would be in the same wrong frame."""
    folder = small.near(tmp_path / "in")
    content = json.loads((folder / "lights.json").read_text())
    for light in content["lights"]:
        light["position"][1] *= -1
    (folder / "lights.json").write_text(json.dumps(content))
    with pytest.raises(
        RigError, match=r"axes differ from the camera's: x and −y .* Correct the lamps' axes"
    ) as refused:
        planned(folder, 1)
    assert refused.value.code is ErrorCode.FOLDER_INVALID


def test_plan_tells_when_the_pilot_is_not_to_be_trusted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    solve = near_light.solve

    def misfitting(*args: Any, **more: Any) -> NormalMap:
        wrong = (
            ModelFinding(kind="misfit", message="the images fit the model badly", corrected=False),
            ModelFinding(kind="bad image", message="image 3 (img 3.png) is left out", corrected=True, value=1.0),
        )
        return replace(solve(*args, **more), findings=wrong)

    monkeypatch.setattr(near_light, "solve", misfitting)
    outcome = planned(small.lp(tmp_path / "in"), 1, pilot="0,3,1,2")
    assert [(one["kind"], one["value"]) for one in outcome["findings"]] == [("misfit", None), ("bad image", 3)]  # type: ignore[union-attr, index]
    assert "Do not rely on this plan: the images fit the model badly." in " ".join(capsys.readouterr().err.split())
