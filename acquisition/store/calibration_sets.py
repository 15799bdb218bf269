"""Sets of calibration values in a data folder, each in a folder of its own that is complete and never changed.

A set outlives the session that made it: pruning that session does not remove a calibration that others were captured
with.
"""

import shutil
import tempfile
from pathlib import Path

from pydantic import ValidationError

from acquisition.formats.atomic_write import publish
from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_set import CalibrationSet
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.folder import write_value

SET, CALIBRATION = "set.json", "calibration.json"


class CalibrationSets:
    """The folder `calibrations/` of a data folder: `<id>/set.json`, `calibration.json`, and the estimate's files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def all(self) -> list[CalibrationSet]:
        """Returns all sets, oldest first. Raises RigError store.corrupt for one that cannot be read."""
        made = [self._read(file) for file in self._folder.glob(f"[!.]*/{SET}")]
        return sorted(made, key=lambda one: (one.made_at, one.id))

    def get(self, identity: str) -> CalibrationSet:
        """Returns one set. Raises RigError calibration.not_found."""
        known = {one.id: one for one in self.all()}
        if identity not in known:
            raise RigError(
                ErrorCode.CALIBRATION_NOT_FOUND, f"No calibration {identity[:80]!r}", known=["cell", *sorted(known)]
            )
        return known[identity]

    def calibration(self, identity: str) -> Calibration:
        """Returns a set's values. Raises RigError calibration.not_found, and store.corrupt if they have changed."""
        known = self.get(identity)
        values = cell_config.load_calibration(self._folder / known.id / CALIBRATION)
        if values.fingerprint != known.fingerprint:
            raise RigError(
                ErrorCode.STORE_CORRUPT,
                f"calibrations/{known.id}/{CALIBRATION} was changed since it was made: restore it from a backup",
                file=CALIBRATION,
            )
        return values

    def file(self, identity: str, name: str) -> Path:
        """Returns a file of a set by its name. Raises RigError calibration.not_found, request.not_found."""
        folder = self._folder / self.get(identity).id
        names = sorted(path.name for path in folder.iterdir())
        if name not in names:
            raise RigError(
                ErrorCode.REQUEST_NOT_FOUND, f"Calibration {identity} has no file {name[:80]!r}", files=names
            )
        return folder / name

    def files(self, identity: str) -> list[str]:
        """Returns the names of a set's files."""
        return sorted(path.name for path in (self._folder / self.get(identity).id).iterdir())

    def folder(self, identity: str) -> Path:
        """Returns the folder of a set. Raises RigError calibration.not_found."""
        return self._folder / self.get(identity).id

    def add(self, made: CalibrationSet, estimate: Path, before: Path | None = None) -> None:
        """Keeps an estimate's folder as a set unless it exists, with the files of the set `before` that the estimate
        does not replace."""
        if (self._folder / made.id / SET).exists():
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".", dir=self._folder))
        try:
            if before is not None:
                shutil.copytree(before, partial, dirs_exist_ok=True)
            shutil.copytree(estimate, partial, dirs_exist_ok=True)
            write_value(partial / SET, made)
            publish(partial, self._folder / made.id)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise

    @staticmethod
    def _read(file: Path) -> CalibrationSet:
        try:
            return CalibrationSet.model_validate_json(file.read_bytes())
        except (OSError, ValidationError) as error:
            raise RigError(ErrorCode.STORE_CORRUPT, f"calibrations/{file.parent.name}/{SET}: {error}") from error
