"""Validation errors are told in our own words, wherever a file or a setting is read."""

from collections.abc import Callable
from pathlib import Path

import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import PROBLEMS
from api.rest import settings, tls

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("[arm]\n", "[arm]\nsettle = 3\n", "settle: There is no such field"),
        ("[camera]\n", '[camera]\nkind = "avaris"\n', "camera: `kind` must be one of 'sim', 'pylon', 'aravis'"),
    ],
)
def test_cell_file_names_what_is_misspelt_in_words(tmp_path: Path, before: str, after: str, said: str) -> None:
    text = (ROOT / "hardware_sim" / "cells" / "cell.sim.toml").read_text(encoding="utf-8")
    wrong = tmp_path / "cell.toml"
    wrong.write_text(text.replace(before, after, 1), encoding="utf-8")

    with pytest.raises(RigError) as refused:
        cell_config.load(wrong)

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert said in refused.value.detail


def test_setting_that_is_refused_is_told_without_the_name_of_an_exception() -> None:
    with pytest.raises(RigError) as refused:
        settings.read(trusted_proxies=["foo"])

    assert "LIGHTPOSE_TRUSTED_PROXIES" in refused.value.detail
    assert "Value error" not in refused.value.detail


@pytest.mark.parametrize(
    "cause",
    [
        lambda folder: settings.refuse_open_bind("0.0.0.0", keys=False),  # noqa: S104 - what is refused
        lambda folder: tls.context(folder / "cert.pem", None),
    ],
    ids=["open without keys", "half of TLS"],
)
def test_remedy_of_config_invalid_requires_no_named_file(cause: Callable[[Path], None], tmp_path: Path) -> None:
    with pytest.raises(RigError) as refused:
        cause(tmp_path)

    assert refused.value.code is ErrorCode.CONFIG_INVALID
    assert "file" not in refused.value.context
    assert PROBLEMS[refused.value.code].remedy.startswith("Do what the detail says, or ")
