"""Nominal calibration and cell file of the simulated cell, as its operators would have measured them.

The calibration holds nominal values; only `world` knows the deviations from them.
"""

import json
import re
from pathlib import Path
from typing import Literal

from acquisition.models import cell_config
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig

FULL_PIXELS = 1024
MADE_AT = "2026-11-01T00:00:00Z"
"""The time at which the nominal calibration says that it was made."""
ROBOT_API_PORT = 30080
"""Port of a simulated PolyScope X's Robot API. The real one, 80, may need a right that users of the simulator lack."""


def calibration(pixels: int, over_m: tuple[float, float] = (0.55, 0.0)) -> Calibration:
    """The nominal calibration for an image of `pixels` × `pixels`; the field of view does not depend on `pixels`.

    The camera looks down from 0.9 m on the point `over_m` of the table, base frame.
    """
    scale = pixels / FULL_PIXELS
    focal, centre = 4600.0 * scale, 512.0 * scale - 0.5  # the image's centre is the edge between two pixels
    identity = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    return Calibration.model_validate(
        {
            "width": pixels,
            "height": pixels,
            "camera_matrix": ((focal, 0.0, centre), (0.0, focal, centre), (0.0, 0.0, 1.0)),
            "distortion": (-0.08, 0.05, 0.0004, -0.0003, 0.0),
            "base_from_camera": (
                (1.0, 0.0, 0.0, over_m[0]),
                (0.0, -1.0, 0.0, over_m[1]),
                (0.0, 0.0, -1.0, 0.9),
                (0.0, 0.0, 0.0, 1.0),
            ),
            "tool_from_lamp": identity,
            "lamp_intensity": 20.0,
            "reference_m": 0.45,
            "lobe_exponent": 0.8,
            "sensor": {
                "bits": 12,
                "gain_e_per_dn": 2.5,
                "read_noise_e": 5.0,
                "full_well_e": 10077.5,
                "black_level_dn": 64.0,
            },
            "intensity_sigma": 0.01,
            "lamp_position_sigma_m": 0.001,
            "made_at": MADE_AT,
            "valid_days": 3650.0,
        }
    )


def is_nominal(path: Path) -> bool:
    """Whether a calibration file holds nominal values, as `write` leaves them; False: others, or there is none."""
    try:
        return json.loads(path.read_bytes())["made_at"] == MADE_AT
    except (OSError, ValueError, LookupError, TypeError):
        return False


def default_cell_file() -> Path:
    """The cell file of the simulated cell, `cells/cell.sim.toml` of this package."""
    return Path(__file__).with_name("cells") / "cell.sim.toml"


def write(
    folder: Path, address: str, pixels: int, cell_file: Path, polyscope: Literal["5", "x"] | None = None
) -> CellConfig:
    """Writes `cell.toml` (from `cell_file`, at `address`) and `calibration.json` into a folder, and reads them back.

    The camera is above the object's place in the cell file. `polyscope` is the controller's software, by default that
    of the cell file. Raises RigError config.invalid.
    """
    folder.mkdir(parents=True, exist_ok=True)
    given = cell_config.load(cell_file)
    x, y, _ = given.object.keep_out.base_from_object.position_m
    text = cell_file.read_text(encoding="utf-8")
    text = re.sub(r"^address\s*=.*$", f"address = {json.dumps(address)}", text, flags=re.MULTILINE)
    text = re.sub(r"^calibration\s*=.*$", 'calibration = "calibration.json"', text, flags=re.MULTILINE)
    polyscope = polyscope or given.arm.polyscope
    if "x" in (polyscope, given.arm.polyscope):
        text = re.sub(r"^(polyscope|robot_api_port)\s*=.*\n", "", text, flags=re.MULTILINE)
        lines = f'[arm]\npolyscope = "{polyscope}"\nrobot_api_port = {ROBOT_API_PORT}\n'
        text = re.sub(r"^\[arm\][^\n]*\n", lines, text, flags=re.MULTILINE)
    written = folder / "cell.toml"
    written.write_text(text, encoding="utf-8")
    (folder / "calibration.json").write_text(
        calibration(pixels, (x, y)).model_dump_json(indent=2) + "\n", encoding="utf-8"
    )
    cell_config.load_calibration(folder / "calibration.json")
    return cell_config.load(written)
