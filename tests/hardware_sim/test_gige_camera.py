"""The GigE Vision camera of the simulated cell says in a sentence what it lacks."""

import importlib
from pathlib import Path
from typing import NoReturn

import pytest

from hardware_sim import gige_camera

CELL = Path(__file__).parents[2] / "hardware_sim" / "cells" / "cell.sim.toml"


def _missing(name: str) -> NoReturn:
    raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.mark.parametrize(("cell", "said"), [("nix.toml", "cannot be read"), (str(CELL), "aravis-camera.md")])
def test_gige_camera_that_cannot_start_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], cell: str, said: str
) -> None:
    monkeypatch.setattr("sys.argv", ["gige_camera", cell])
    monkeypatch.setattr(importlib, "import_module", _missing)

    with pytest.raises(SystemExit) as ended:
        gige_camera.main()

    assert ended.value.code == 2
    assert said in capsys.readouterr().err
