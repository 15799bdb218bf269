"""Only the intended number changes; numbers that are read are found; figures are made from lines written by hand."""

import json
from pathlib import Path

import numpy as np
import pytest

from acquisition import photometry
from acquisition.models.recipe import Exposure
from acquisition.normals.pixels import image_terms
from docs import generated_blocks
from tests import tuned_numbers
from tests.unseen import patterns, run, scenes, sensitivity, stages
from tests.unseen.captures import capture
from tests.unseen.plan_sensitivity import Planned
from tests.unseen.stages import Stage

PRIOR, OFFSET = sensitivity.named("photometry.prior_scale")[0], sensitivity.named("alternation.shift_sigma_m")[0]


def test_values_are_scaled_within_what_they_can_be() -> None:
    assert sensitivity.scaled(0.3, 2, "share") == 0.6
    assert sensitivity.scaled(0.8, 2, "cosine") == 1.0
    assert sensitivity.scaled(3.0, 2, "σ") == 6.0
    assert [sensitivity.scaled(1, factor, "px") for factor in (0.5, 2)] == [0, 2]
    assert sensitivity.scaled((0.25, 0.7), 0.5, "rank") == (0.125, 0.35)
    terms = image_terms.ImageTerms(roughness=0.3, ambient=0.1)
    assert sensitivity.scaled(terms, 2, "term") == image_terms.ImageTerms(roughness=0.6, ambient=0.2)


def test_every_number_of_the_solver_can_be_changed_and_comes_back() -> None:
    before = photometry.SETTINGS
    for number in sensitivity.named("all"):
        for factor in sensitivity.FACTORS.values():
            patch = sensitivity.changed(number, factor)
            with stages.off(Stage(number.key, "", (patch,))):
                present = getattr(patch.module.SETTINGS, number.name)
            assert present != getattr(patch.module.SETTINGS, number.name) or present == 1
    assert photometry.SETTINGS is before


def test_a_name_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match=r"photometry\.no"):
        sensitivity.named("photometry.no")


def test_a_number_changes_the_result_of_a_capture_that_reads_it() -> None:
    blob = scenes.scene("blob", 0, "lambert", 40)
    captured = capture(blob, patterns.fixed("two-rings", blob, 8, 0, 1))
    with sensitivity.reading() as read:
        usual = sensitivity.solve_with(None, blob, captured)
    assert PRIOR.key in read
    assert "grey_tile.min_share" not in read
    halved = sensitivity.solve_with(Stage("", "", (sensitivity.changed(PRIOR, 0.5),)), blob, captured)
    assert np.abs(halved.normals - usual.normals)[usual.mask].max() > 1e-4
    assert run.solve(blob, captured).normals.tobytes() == usual.normals.tobytes()


def test_a_number_of_the_planner_changes_its_forecast_and_not_the_truth() -> None:
    numbers = {one.key: one for one in sensitivity.named("planner")}
    assert not set(numbers) & {one.key for one in sensitivity.named("all")}
    planned = Planned(scenes.scene("blob", 0, "lambert", 48), 6)
    usual = planned.figures(Exposure())
    doubled = sensitivity.changed(numbers["planned_images.indirect_sigma"], 2.0)
    changed = planned.figures(Exposure(), Stage("", "", (doubled,)))
    assert changed["forecast"] > usual["forecast"]
    assert changed["error"] == pytest.approx(usual["error"], rel=0.1)
    assert planned.figures(Exposure()) == usual
    assert planned.figures(Exposure(plan="planned"))["error"] > 0


def line(family: str, number: str | None, change: str | None, error: float, rms: float) -> run.Line:
    return {
        "family": family, "seed": 0, "reflectance": None, "fault": None, "solver": "product",
        "pattern": "two-rings", "lights": 8, "azimuth": 0, "number": number, "change": change, "commit": "abc1234",
        "material": "lambert", "within_78_deg.mean": error, "rms": rms,
    }  # fmt: skip


def lines() -> list[run.Line]:
    """Two captures, the first of which reads the prior's scale."""
    base = [line("blob", None, None, 2.0, 1.0), line("knot", None, None, 1.0, 1.0)]
    base[0]["read"], base[1]["read"] = [PRIOR.key], []
    return [*base, line("blob", PRIOR.key, "doubled", 2.0 * 1.21, 0.81)]


def test_captures_that_do_not_read_a_number_count_as_unchanged() -> None:
    shown = sensitivity.moved(lines(), [PRIOR, OFFSET])["numbers"]
    assert shown[PRIOR.key]["doubled"] == {"error": [1.1, 0.0953], "rms": [0.9, 0.1054]}
    assert shown[OFFSET.key] == {"not measured": "no capture reads it"}


def test_a_number_with_a_capture_to_be_solved_yet_has_no_figures() -> None:
    unsolved = lines()
    unsolved[1]["read"] = [PRIOR.key]
    assert sensitivity.moved(unsolved, [PRIOR])["numbers"][PRIOR.key] == {"captures": 2}


def test_what_modules_read_at_import_is_not_measured() -> None:
    read = sensitivity.named("photometry.min_view_cosine")
    assert read[0].key in tuned_numbers.set_at_import()
    assert "import" in sensitivity.moved(lines(), read)["numbers"][read[0].key]["not measured"]


def test_page_of_tuned_numbers_shows_figures_and_reasons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "docs" / "reference" / "sensitivity.json"
    page.parent.mkdir(parents=True)
    monkeypatch.setattr(sensitivity, "PAGE", page)
    monkeypatch.setattr(generated_blocks, "ROOT", tmp_path)
    for measured in ([PRIOR], [OFFSET]):  # earlier figures stay
        sensitivity.write(sensitivity.moved(lines(), measured))
    assert json.loads(page.read_text(encoding="utf-8"))["solver"]["commits"] == ["abc1234"]
    text = generated_blocks.tuned_numbers()
    row = next(row for row in text.splitlines() if row.startswith("| `prior_scale`"))
    assert row.endswith("| not measured | error 1.100 ± 0.095, rms 0.900 ± 0.105 |")
    assert "not measured: no capture reads it" in text
