"""A whole session over GigE Vision: the simulated cell seen by Aravis' simulated camera, over loopback."""

from pathlib import Path

import pytest

from acquisition.models import cell_config
from acquisition.models.recipe import Recipe
from acquisition.session_state import ENDED, State
from api.rest import settings, wiring
from hardware_sim import grade
from hardware_sim import truth as truth_file
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.acquisition.devices.gige import gige_process, needs_aravis
from tests.acquisition.runner import simulated_rig

PIXELS, OUTPUT = 160, 3
RECIPE = Recipe(pilot_lights=4, planned_lights=4)
GIGE = f"""[camera]
kind = "aravis"
device = "127.0.0.1"
pixel_format = "Mono16"
bits = 12
width = {PIXELS}
height = {PIXELS}
"""
LINE = f'trigger = "hardware"\ntrigger_output = {OUTPUT}\n'


def run(cell: Cell, cell_file: Path, data: Path) -> tuple[float, int]:
    """Mean error within 78° and number of faults of the camera, of a session with this cell file in a running cell."""
    service = wiring.build(settings.read(cell=cell_file, data=data))
    service.open()
    with ControlClient(cell.address) as control:
        rig = simulated_rig.Rig(service.runner, service.store, control)
        session_id = simulated_rig.new(rig, RECIPE)
        simulated_rig.start(rig, session_id)
        assert simulated_rig.wait_for(rig, session_id, *ENDED, within_s=900.0) is State.COMPLETED
        shots = service.store.journal.shots(session_id)
        assert len({shot.camera.settings for shot in shots if shot.camera is not None}) == 1
        faults = service.store.journal.events(0, 500, session_id, ("camera.fault",))
        folder = service.store.folder(session_id)
    service.close()
    truth, calibration = truth_file.load(cell.truth_file), cell_config.load_calibration(cell.calibration_file)
    return grade.grade_folder(folder / "results" / "1", truth, calibration).mean_deg, len(faults)


@needs_aravis
@pytest.mark.long
@pytest.mark.timeout(3000)
def test_aravis_session_equals_the_simulated_cameras(tmp_path: Path) -> None:
    options = CellOptions("127.0.49.61", "sphere", 1, "direct", 8.0, pixels=PIXELS, cell_file=simulated_rig.CELL_FILE)
    with Cell(options, tmp_path / "cell") as cell:
        simulated, _ = run(cell, cell.cell_file, tmp_path / "simulated")
        text = cell.cell_file.read_text()
        errors, faults = {}, {}
        for name, section in {"software": GIGE, "hardware": GIGE + LINE, "lossy": GIGE}.items():
            start = text.index("[camera]")
            end = text.index("\n[", start)
            file = cell.folder / f"{name}.toml"
            file.write_text(text[:start] + section + text[end:])
            # Each session has a camera of its own: a scene that was seen before has other noise.
            with gige_process(cell.cell_file, "--trigger-output", str(OUTPUT)) as gige:
                if name == "lossy":
                    gige.say("lost 0.002")
                errors[name], faults[name] = run(cell, file, tmp_path / name)
    print(simulated, errors, faults)
    assert errors["software"] == pytest.approx(simulated, rel=0.01)
    assert errors["hardware"] == pytest.approx(simulated, rel=0.01)
    assert faults["software"] == faults["hardware"] == 0
    assert faults["lossy"] > 0
    assert errors["lossy"] == pytest.approx(simulated, rel=0.3)  # frames that are taken again have other noise
