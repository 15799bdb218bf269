"""Switches turn off their stage alone and are undone; tables and page are made from lines written by hand."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acquisition import photometry
from acquisition.models.result import NormalMap
from tests.unseen import ablation, faults, patterns, run, scenes, stages
from tests.unseen.captures import Capture, capture
from tests.unseen.scenes import Scene
from tests.unseen.stages import STAGES, Patch, Stage

SMALL, LIGHTS = 48, 8
SELECTION = ablation.BY_NAME["model selection"]
SELECTED = {"gloss": "gloss", "metal": "metal", "translucent surfaces": "translucent surface"}
"""Stages of model selection, and the finding that each gives if its model is chosen."""
SHADOWS = ablation.BY_NAME["ambient and stray light in shadows"]
PLAIN = [stage for stage in STAGES if stage not in (SELECTION, SHADOWS) and stage.name not in SELECTED]
"""Stages switched off with the plain model; trials of others take ten times as long and undo part of the change."""


@pytest.fixture(scope="module")
def part() -> Scene:
    """A glossy part with steps and cavities, on which every stage has an effect."""
    return scenes.scene("machined", 0, "ggx:0.25", SMALL)


@pytest.fixture(scope="module")
def captured(part: Scene) -> Capture:
    return capture(part, patterns.fixed("two-rings", part, LIGHTS, 0, 1))


@pytest.fixture(scope="module")
def complete(part: Scene, captured: Capture) -> NormalMap:
    return ablation.solve_without(SELECTION, part, captured)


@pytest.fixture(scope="module")
def without(part: Scene, captured: Capture) -> dict[str, NormalMap]:
    with stages.off(SELECTION):
        return {stage.name: ablation.solve_without(stage, part, captured) for stage in PLAIN}


@pytest.mark.long
@pytest.mark.parametrize("name", [stage.name for stage in PLAIN])
def test_switch_changes_the_result(name: str, complete: NormalMap, without: dict[str, NormalMap]) -> None:
    changed = without[name]
    both = complete.mask & changed.mask
    turned = np.linalg.norm(changed.normals - complete.normals, axis=-1)[both]
    other_sigma = np.abs(changed.sigma_deg - complete.sigma_deg)[both] > 0.01 * complete.sigma_deg[both]
    assert max(np.mean(turned > 1e-3), np.mean(other_sigma)) > 0.05


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "scene"),
    [
        ("gloss", lambda: scenes.scene("blob", 0, "ggx:0.25", 40)),
        ("metal", lambda: scenes.scene("sheet", 0, "metal:0.3", 36)),
        ("translucent surfaces", lambda: scenes.scene("cluster", 15, None, 96)),
    ],
)
def test_switch_of_a_selected_model_leaves_it_out(name: str, scene: Callable[[], Scene]) -> None:
    drawn = scene()
    captured = capture(drawn, patterns.fixed("two-rings", drawn, LIGHTS, 0, 1))
    kinds = [
        {finding.kind for finding in ablation.solve_without(stage, drawn, captured).findings}
        for stage in (None, ablation.BY_NAME[name])
    ]
    assert [SELECTED[name] in found for found in kinds] == [True, False]


@pytest.mark.long
def test_switch_of_shadows_leaves_weak_ambient_light_unnoticed() -> None:
    sheet = scenes.scene("sheet", 204, "lambert")
    lit = capture(sheet, patterns.fixed("two-rings", sheet, LIGHTS, 0, 1), fault=faults.named("ambient:0.03"))
    kinds = [{one.kind for one in ablation.solve_without(stage, sheet, lit).findings} for stage in (None, SHADOWS)]
    assert ["ambient light" in found for found in kinds] == [True, False]


@pytest.mark.long
def test_switches_leave_nothing_behind(
    part: Scene, captured: Capture, complete: NormalMap, without: dict[str, NormalMap]
) -> None:
    assert len(without) == len(PLAIN)
    again = ablation.solve_without(SELECTION, part, captured)
    np.testing.assert_allclose(again.normals, complete.normals, atol=1e-5)
    np.testing.assert_allclose(again.sigma_deg, complete.sigma_deg, rtol=1e-3)


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_switch_is_undone_after_an_error(stage: Stage) -> None:
    def present() -> list[object]:
        return [getattr(patch.module, patch.name) for patch in stage.patches]

    def failing() -> None:
        with stages.off(stage):
            during.extend(present())
            raise ArithmeticError

    before, during = present(), list[object]()
    with pytest.raises(ArithmeticError):
        failing()
    assert all(there is patch.value for there, patch in zip(during, stage.patches, strict=True))
    assert len(during) == len(stage.patches)
    assert all(there is value for there, value in zip(present(), before, strict=True))


def test_switch_of_a_name_that_is_gone_is_refused() -> None:
    with pytest.raises(AttributeError), stages.off(Stage("none", "", (Patch(photometry, "NO_SUCH_NAME", 0),))):
        pass


@pytest.mark.long
def test_switches_take_away_what_they_say(complete: NormalMap, without: dict[str, NormalMap]) -> None:
    assert np.ptp(complete.intensity_factors) > 1e-3
    np.testing.assert_allclose(without["self-calibration of intensities"].intensity_factors, 1, atol=1e-9)
    assert np.max(np.abs(complete.notes["lamps_aside_m"])) > 1e-5
    assert np.max(np.abs(without["lamps' places"].notes["lamps_aside_m"])) < 1e-9
    assert abs(complete.notes["shift_m"]) > 1e-4
    assert abs(without["the object's shift"].notes["shift_m"]) < 1e-9
    assert complete.notes["interreflection"]["share"] > 0.01
    assert without["interreflection"].notes["interreflection"]["share"] == 0


@pytest.mark.long
def test_switch_of_one_shared_parameter_leaves_the_others(without: dict[str, NormalMap]) -> None:
    held = without["self-calibration of intensities"]
    assert np.max(np.abs(held.notes["lamps_aside_m"])) > 1e-5
    assert np.ptp(without["lamps' places"].intensity_factors) > 1e-3


def test_switch_of_model_selection_keeps_the_plain_model() -> None:
    blob = scenes.scene("blob", 0, "lambert", 40)
    mirrored = capture(blob, patterns.fixed("two-rings", blob, LIGHTS, 0, 1), fault=faults.named("mirrored-y"))
    selected, plain = run.solve(blob, mirrored), ablation.solve_without(SELECTION, blob, mirrored)
    assert any(finding.corrected for finding in selected.findings)
    assert not any(finding.corrected for finding in plain.findings)
    errors = [np.mean(blob.truth.error_deg(one.normals)[blob.truth.within_78_deg]) for one in (selected, plain)]
    assert errors[0] < 0.2 * errors[1]


def line(seed: int, stage: str | None, error: float, rms: float = 1.0, family: str = "blob") -> run.Line:
    return {
        "family": family, "seed": seed, "reflectance": None, "fault": None, "solver": "product",
        "pattern": "two-rings", "lights": 8, "azimuth": 0, "stage": stage, "commit": "abc1234", "material": "ggx:0.2",
        "within_78_deg.mean": error, "within_1": 0.5, "rms": rms,
    }  # fmt: skip


def test_stages_with_captures_of_their_own_are_compared_on_these(tmp_path: Path) -> None:
    plan = run.Plan(("blob",), (41,), (8,), ("two-rings",), 1, tmp_path / "out.jsonl")
    names = ["interreflection", "metal", SHADOWS.name, "translucent surfaces"]
    assert ablation.all_seeds(plan, names) == [41, 45, 55, 65]
    asked = [(one["reflectance"], one["fault"], one["stage"]) for one in ablation.asked(plan, names, "blob", 41)]
    assert asked == [
        (None, None, None),
        (None, None, "interreflection"),
        ("metal:0.3", None, None),
        ("metal:0.3", None, "metal"),
        ("lambert", "ambient:0.03", None),
        ("lambert", "ambient:0.03", SHADOWS.name),
    ]
    assert [one["stage"] for one in ablation.asked(plan, names, "blob", 45)] == [None, "translucent surfaces"]


def test_tables_pair_the_scenes_that_both_have() -> None:
    lines = [line(0, None, 1.0), line(1, None, 1.0), line(2, None, 7.0)]
    lines += [line(0, "interreflection", 1.0, 2.0), line(1, "interreflection", 4.0, 4.0)]
    table = ablation.all_tables(lines, "within_78_deg")
    row = next(row for row in table.splitlines() if row.startswith("| interreflection"))
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    assert cells[1].startswith("2.000 ±")
    assert float(cells[1].split("±")[1]) == pytest.approx(2.0 * math.log(4) / 2 / math.sqrt(2), rel=0.25)
    assert cells[2:] == ["3.00 → 1.00", "0.50 → 0.50", "2"]


def test_tables_begin_with_what_buys_most() -> None:
    lines = [line(0, None, 1.0), line(0, "interreflection", 1.1), line(0, "lamps' places", 1.3)]
    table = ablation.all_tables(lines, "within_78_deg").partition("## Error")[0]
    assert table.index("lamps' places") < table.index("interreflection")


def test_tables_tell_refusals() -> None:
    refused = {**line(1, "interreflection", 1.0), "error": "normals.infeasible: no"}
    lines = [line(0, None, 1.0), line(1, None, 1.0), line(0, "interreflection", 1.1), refused]
    table = ablation.all_tables(lines, "within_78_deg")
    assert "Refused: interreflection: 1 (normals.infeasible: no)" in table
    assert "| 1.100 | 1.00 → 1.00 | 0.50 → 0.50 | 1 |" in table


def test_page_holds_command_commit_and_every_switch(tmp_path: Path) -> None:
    path = tmp_path / "ablation.md"
    ablation.write(path, "ablate --seeds 0", [line(0, None, 1.0), line(0, "interreflection", 1.1)], "within_78_deg")
    text = path.read_text(encoding="utf-8")
    words = " ".join(text.split())
    assert "`python -m tests.unseen ablate --seeds 0`" in words
    assert "`abc1234`, 1 scenes (ggx 1)" in words
    assert all(f"| {stage.name} | {stage.without} |" in text for stage in STAGES)
    assert "`shadow_threshold` 0.15" in text


def test_run_skips_what_is_in_the_file(tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    kept = [line(0, name, 1.0) for name in (None, "interreflection")]
    out.write_text("".join(json.dumps(one) + "\n" for one in kept), encoding="utf-8")
    plan = run.Plan(("blob",), (0,), (8,), ("two-rings",), 1, out)
    assert ablation.run_all(plan, ["interreflection"], jobs=1) == 0


def test_tables_are_of_what_is_asked(tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    kept = [line(seed, name, 1.0) for seed in (0, 1) for name in (None, "interreflection", "lamps' places")]
    out.write_text("".join(json.dumps(one) + "\n" for one in kept), encoding="utf-8")
    plan = run.Plan(("blob",), (1,), (8,), ("two-rings",), 1, out)
    lines = ablation.of_plan(plan, ["interreflection"])
    assert [(one["seed"], one["stage"]) for one in lines] == [(1, None), (1, "interreflection")]


def test_run_of_a_report_seed_is_refused_without_report(tmp_path: Path) -> None:
    plan = run.Plan(("blob",), (1000,), (8,), ("two-rings",), 1, tmp_path / "out.jsonl")
    with pytest.raises(ValueError, match="--report"):
        ablation.run_all(plan, ["interreflection"], jobs=1)
