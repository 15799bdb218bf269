"""Light positions from text, JSON, plan and session files; errors of invalid files."""

import json
from pathlib import Path

import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light, LightPlan
from api.cli import lights_file

POSITIONS = [(0.0, 0.25, -0.5), (0.1, -0.2, -0.45), (-0.125, 0.0, -1e-1)]


def test_lights_file_text_json_and_plan_are_read(tmp_path: Path) -> None:
    text = tmp_path / "lights.txt"
    text.write_text("# x y z, m\n0 0.25 -0.5\n\n0.1, -0.2, -0.45  # left\n-0.125;0;-1e-1\n", encoding="utf-8")
    listed = tmp_path / "lights.json"
    listed.write_text(json.dumps(POSITIONS), encoding="utf-8")
    plan = tmp_path / "plan.json"
    lights = [Light(position=position, axis=(0.0, 0.0, -1.0)) for position in POSITIONS]
    plan.write_text(LightPlan(lights=lights, method="optimal", reasons=[""] * 3).model_dump_json(), encoding="utf-8")

    assert lights_file.read(text) == lights_file.read(listed) == lights_file.read(plan) == POSITIONS


def test_lights_file_session_folder_gives_all_passes_in_order(tmp_path: Path) -> None:
    many = [(0.01 * number, 0.2, -0.5) for number in range(11)]
    for number, position in enumerate(many):  # of which 10 comes after 9, not after 1
        folder = tmp_path / "passes" / str(number)
        folder.mkdir(parents=True)
        plan = LightPlan(lights=[Light(position=position, axis=(0.0, 0.0, -1.0))], method="optimal", reasons=[""])
        (folder / "plan.json").write_text(plan.model_dump_json(), encoding="utf-8")

    assert lights_file.read(tmp_path) == many
    with pytest.raises(RigError, match="is not a session's folder"):
        lights_file.read(tmp_path / "passes")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("0 0 -0.5\n1 2\n", "line 2"),
        ("0 0 x", "line 1"),
        ("0 0 nan", "finite"),
        ("[[0, 0, -0.5], [1, 2, 3, 4]]", "light 1"),
        ("[0, 1, 2]", "light 0"),
        ('{"plan": []}', "lights"),
        ("[[0, 0", "JSON"),
    ],
)
def test_lights_file_bad_content_is_named(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "lights"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RigError, match=said) as wrong:
        lights_file.read(path)
    assert wrong.value.code is ErrorCode.REQUEST_INVALID
    with pytest.raises(RigError, match="cannot be read"):
        lights_file.read(tmp_path / "none")
