"""Images of a re-solve: the journal's record and the folder's manifest give the same ones."""

from pathlib import Path

from acquisition.formats.folders.session_folder import SessionCapture
from acquisition.models import cell_config
from acquisition.models.recipe import Recipe
from acquisition.models.shot import Shot
from acquisition.runner import results
from acquisition.session import PassRecord, SessionRecord
from acquisition.session_state import State
from hardware_sim import nominal


def shot(pass_number: int, number: int, kind: str, exposure_s: float = 0.05) -> Shot:
    return Shot.model_validate(
        {
            "key": {"pass_number": pass_number, "number": number}, "kind": kind, "exposure_s": exposure_s,
            "frame": {"path": f"{pass_number}/{number}.tiff", "width": 8, "height": 8, "sha256": ""},
            "taken_at": float(10 * pass_number + number),
            "quality": {"saturated": 0, "bright_level": 0.8, "accepted": True},
        }
    )  # fmt: skip


def test_observations_record_and_folder_give_the_same_images() -> None:
    lit = [shot(0, 0, "light"), shot(1, 0, "light", 0.08)]
    old, other, new = shot(0, 1, "dark"), shot(1, 1, "dark", 0.08), shot(1, 2, "dark")
    again = shot(0, 1000, "reference")
    passes = (
        PassRecord(shots={0: lit[0]}, darks={0.05: old}, references=(again,)),
        PassRecord(shots={0: lit[1]}, darks={0.08: other, 0.05: new}),
    )
    record = SessionRecord("small", Recipe(), State.COMPLETED, passes)
    cell, calibration = cell_config.load(nominal.default_cell_file()), nominal.calibration(8)
    capture = SessionCapture(
        Path("small"), Recipe(), cell, calibration, (again, new, other, old, *lit), plans=(), results=()
    )
    for observations in (results.observations(record, Path("small")), capture.observations(1)):
        assert list(observations.shots) == lit
        assert observations.darks == {0.05: new, 0.08: other}
        assert list(observations.repeats) == [again, old]
    for observations in (results.observations(record, Path("small"), 0), capture.observations(0)):
        assert observations.darks == {0.05: old}
        assert list(observations.repeats) == [again]
