"""Every tuned number is measured; a number's own scenes show its changes, and are refused if they do not read it."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from acquisition.normals.images import silhouette
from docs import generated_blocks
from tests import tuned_numbers
from tests.tuned_numbers import Number
from tests.unseen import fresh_process, height_scenes, own_benches, sensitivity, sensor_scenes
from tests.unseen.fresh_process import Errors
from tests.unseen.own_benches import Drawn, Fresh

CONTRAST = sensitivity.named("silhouette.min_contrast")[0]
OVERLAP = height_scenes.OVERLAP


class ByHand:
    """Three scenes, two of which change when the number is doubled."""

    scenes = "scenes made by hand"

    def errors(self, number: Number, factor: float | None) -> Sequence[Errors]:
        assert number is CONTRAST
        return [{"error": one} for one in ([1.0, 2.0, 7.0] if factor == 2 else [1.0, 1.0, 4.0])]


def test_every_tuned_number_has_figures() -> None:
    parts = json.loads(sensitivity.PAGE.read_text(encoding="utf-8"))
    known = {key: one for part in parts.values() for key, one in part["numbers"].items()}
    unmeasured = [
        one.key for one in tuned_numbers.settings() if not {"halved", "doubled"} <= set(known.get(one.key, {}))
    ]
    assert unmeasured == []
    assert set(parts["own"]["numbers"]) == set(own_benches.BENCHES)


def test_what_modules_read_at_import_is_measured_in_a_process_of_its_own() -> None:
    compiled = tuned_numbers.set_at_import() & {one.key for one in tuned_numbers.settings()}
    assert compiled
    assert all(isinstance(own_benches.BENCHES[key], Fresh) for key in compiled)


@pytest.mark.long
def test_masks_before_tables_tell_the_least_contrast() -> None:
    before = silhouette.SETTINGS
    figures = own_benches.measured(CONTRAST, Drawn("tables", height_scenes.before_table, 10))
    assert 0.8 < figures["usual"][OVERLAP] <= 1
    for change in sensitivity.FACTORS:
        mean, error, changed = figures[change][OVERLAP]
        assert 0 < mean < figures["usual"][OVERLAP]
        assert 0 < error < 0.3
        assert 0 < changed < 10
    assert silhouette.SETTINGS is before


def test_scenes_of_one_seed_are_alike() -> None:
    for draw in (height_scenes.on_black, sensor_scenes.sensor):
        first, other, again = draw(1)(), draw(2)(), draw(1)()
        assert first == again
        assert first != other
        assert all(np.isfinite(value) for value in first.values())


def test_scenes_that_do_not_read_the_number_are_refused() -> None:
    with pytest.raises(ValueError, match=r"no scene reads silhouette\.min_contrast"):
        own_benches.measured(CONTRAST, Drawn("sensors", sensor_scenes.sensor, 1))


def test_figures_are_means_errors_of_differences_and_counts() -> None:
    figures = own_benches.measured(CONTRAST, ByHand())
    assert figures["usual"] == {"error": 2.0}
    assert figures["halved"] == {"error": [2.0, 0.0, 0]}
    assert figures["doubled"] == {"error": [3.3333, 0.8819, 2]}


def test_a_compiled_constant_has_the_value_that_its_process_starts_with() -> None:
    code = (
        "from tests.unseen import fresh_process; fresh_process.start('min_view_cosine', 0.1);"
        "from acquisition.normals.pixels import microfacet; print(microfacet.LEAST_COSINE)"
    )
    environment = dict(os.environ) | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0.1"]
    with pytest.raises(RuntimeError, match="imported already"):
        fresh_process.start("min_view_cosine", 0.1)


def test_page_shows_figures_of_own_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "docs" / "reference" / "sensitivity.json"
    page.parent.mkdir(parents=True)
    page.write_text("{}")
    monkeypatch.setattr(sensitivity, "PAGE", page)
    monkeypatch.setattr(generated_blocks, "ROOT", tmp_path)
    monkeypatch.setattr(own_benches, "BENCHES", {CONTRAST.key: ByHand()})
    own_benches.measure([CONTRAST], write=True)
    text = generated_blocks.tuned_numbers()
    assert "- `silhouette.min_contrast`: 3 scenes made by hand." in text
    row = next(row for row in text.splitlines() if row.startswith("| `min_contrast`"))
    assert row.endswith("| error 2 → 2 ± 0 (0 of 3 change) | error 2 → 3.333 ± 0.88 (2 of 3 change) |")
