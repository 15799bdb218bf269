"""Captures of a scene: its images with lamp errors, exposure, sensor and faults, as the solver's input or as a folder.

Errors and noise depend on the scene, the draw and the lamp's position. A light that several patterns share therefore
has the same image in all of them, and differences between patterns are paired.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from acquisition import geometry, image_values
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import Light
from acquisition.normals.images.normalised_images import ImageBlock, Images
from hardware_sim import families
from tests.unseen.faults import NONE, Fault
from tests.unseen.scenes import INTENSITY_SIGMA, POSITION_SIGMA_M, TARGET, Scene


@dataclass(frozen=True)
class Capture:
    """Solver input of a scene (images, nominal lights, exact camera), and the true log intensities (F,)."""

    stack: Images
    calibration: Calibration
    dn: np.ndarray  # (F, H, W) uint16
    again: np.ndarray  # (F, H, W) uint16, second reads of the same lights
    seconds: np.ndarray  # (F,) exposure times at `lamp_intensity` 1
    log_intensity: np.ndarray
    rough_depth_m: float

    def of(self, chosen: list[int]) -> Images:
        """The images of some of the lights."""
        s, block = self.stack, self.stack.whole
        lights = tuple(s.lights[k] for k in chosen)
        some = ImageBlock(block.values[chosen], block.clipped[chosen])
        return Images(some.rows, lights, s.rows, s.columns, s.shot[chosen], s.floor[chosen])


def capture(scene: Scene, positions: np.ndarray, draw: int = 0, fault: Fault = NONE) -> Capture:
    """Captures lamps at positions (F, 3), m, view frame; the solver's lamps are off by 1 mm and 1 % (1 σ)."""
    y = scene.images(positions)
    streams = [_stream(scene, draw, position) for position in positions]
    log_intensity = np.array([rng.normal(0, INTENSITY_SIGMA) for rng in streams])
    nominal = positions + np.array([rng.normal(0, POSITION_SIGMA_M, 3) for rng in streams])
    shared = np.random.default_rng([families.NAMES.index(scene.family), scene.seed, draw, 29])

    y = y * np.exp(log_intensity)[:, None, None]
    y = fault.light(y, scene, shared)
    seconds = np.array([TARGET / max(np.percentile(one[scene.truth.object], 99.5), 1e-6) for one in y])
    signal = fault.signal(y * seconds[:, None, None], scene, shared)
    sensor = scene.sensor
    reads = []
    for _ in range(2):
        electrons = np.array([
            rng.poisson(one * sensor.full_well_e) + rng.normal(0, sensor.read_noise_e, one.shape)
            for rng, one in zip(streams, np.maximum(signal, 0), strict=True)
        ])  # fmt: skip
        reads.append(np.clip(np.round(electrons / sensor.gain_e_per_dn), 0, 2**sensor.bits - 1).astype(np.uint16))
    dn, again = (fault.encoding(read, int(sensor.full_scale_dn)) for read in reads)

    nominal, claimed = fault.lamps(nominal, scene, shared)
    scale = sensor.full_scale_dn * seconds * claimed
    floor = sensor.read_noise_e**2 + sensor.gain_e_per_dn**2 / 12
    lights = tuple(
        Light(position=tuple(place.tolist()), axis=tuple(axis.tolist()))
        for place, axis in zip(nominal, scene.axes(nominal), strict=True)
    )
    clipped = dn >= image_values.SATURATION_SHARE * sensor.full_scale_dn
    stack = Images(
        read=ImageBlock((dn / scale[:, None, None]).astype(np.float32), clipped).rows,
        lights=lights,
        rows=slice(0, scene.pixels),
        columns=slice(0, scene.pixels),
        shot=1 / (sensor.full_well_e * seconds * claimed),
        floor=floor / (sensor.full_well_e * seconds * claimed) ** 2,
    )
    return Capture(
        stack, scene.calibration, dn, again, seconds * claimed, log_intensity - np.log(claimed), scene.rough_depth_m
    )


def _stream(scene: Scene, draw: int, position: np.ndarray) -> np.random.Generator:
    """Random numbers of one lamp's image."""
    place = hashlib.sha256((np.round(position, 7) + 0.0).tobytes()).digest()
    number = families.NAMES.index(scene.family)
    return np.random.default_rng([number, scene.seed, draw, int.from_bytes(place[:8], "little")])


def write_folder(folder: Path, scene: Scene, captured: Capture) -> None:
    """Writes the capture as a near-light folder: lights.json, 16-bit images, masks and true normals."""
    folder.mkdir(parents=True, exist_ok=True)
    lights: list[dict[str, object]] = []
    for number, (image, light) in enumerate(zip(captured.dn, captured.stack.lights, strict=True)):
        name = f"{number + 1:03d}.png"
        scaled = (image.astype(np.uint32) * 65535 // int(scene.sensor.full_scale_dn)).astype(np.uint16)
        cv2.imwrite(str(folder / name), scaled)
        position = geometry.rotate(geometry.CAMERA_FROM_VIEW, np.array(light.position)) * 1000
        lights.append({"file": name, "position": position.tolist(), "intensity": float(captured.seconds[number])})
    camera = {"K": [list(row) for row in captured.calibration.camera_matrix], "distortion": [0.0] * 5}
    described = {
        "unit": "mm", "reference_mm": scene.radius_m * 1000, "camera": camera, "lights": lights,
        "depth_mm": scene.rough_depth_m * 1000, "black_level": 0,
    }  # fmt: skip
    (folder / "lights.json").write_text(json.dumps(described, indent=1))
    cv2.imwrite(str(folder / "mask.png"), scene.truth.object.astype(np.uint8) * 255)
    cv2.imwrite(str(folder / "eval_mask.png"), scene.truth.within_78_deg.astype(np.uint8) * 255)
    np.save(folder / "normals_gt.npy", scene.truth.normals.astype(np.float32))
