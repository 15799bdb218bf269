"""Records the data folder of this release: `python tests/data/record.py FOLDER`, from the top of the checkout."""

import shutil
import sys
import tempfile
from pathlib import Path

from acquisition.models.recipe import Recipe
from api import Client
from api.rest import settings
from hardware_sim.cell import Cell, CellOptions
from tests.api.conftest import serve

ADDRESS = "127.0.14.40"


def record(folder: Path) -> None:
    """Runs one session to its end and stops another before it starts."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        cell_file = Path(__file__).with_name("cell.test.toml")
        with Cell(
            CellOptions(ADDRESS, "bumps", 1, "direct", 20.0, pixels=48, cell_file=cell_file), place / "cell"
        ) as cell:
            chosen = settings.read(cell=cell.cell_file, data=place / "data", host=ADDRESS, port=0)
            with serve(chosen) as running:
                client: Client = running.client
                client.wait_ready()
                client.capture(Recipe(pilot_lights=4, planned_lights=1, label="first release"), progress=False)
                client.stop(client.create(Recipe(label="never started")).id)
        shutil.copytree(place / "data", folder, ignore=shutil.ignore_patterns("cache", "rig.lock", "*-wal", "*-shm"))


if __name__ == "__main__":
    record(Path(sys.argv[1]))
