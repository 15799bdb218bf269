"""The calibration of camera, hand–eye, lamp and sensor."""

from typing import Annotated

from pydantic import Field

from acquisition.models.base import Matrix4, Value, Vector3


class SensorModel(Value):
    """Sensor noise model (photon transfer): a value is black_level + electrons / gain_e_per_dn, rounded, clipped at
    2^bits − 1."""

    bits: int = Field(ge=8, le=16)
    gain_e_per_dn: float = Field(gt=0)
    read_noise_e: float = Field(ge=0)
    full_well_e: float = Field(gt=0)
    black_level_dn: float = Field(ge=0)

    @property
    def full_scale_dn(self) -> float:
        """Range from the black level to clipping, DN."""
        return float(2**self.bits - 1) - self.black_level_dn


class Calibration(Value):
    """Calibration of camera, hand–eye and lamp with uncertainties; `calibration.json`.

    `lamp_intensity` is the signal, as a fraction of full scale (SensorModel.full_scale_dn) per second of exposure, of a
    perfectly white diffuse surface that faces the lamp at `reference_m` on its axis: albedo is absolute. The lamp's
    radiant intensity falls off its axis as cos^lobe_exponent.
    """

    width: int
    height: int
    camera_matrix: tuple[Vector3, Vector3, Vector3] = Field(strict=False)
    distortion: Annotated[tuple[float, float, float, float, float], Field(strict=False)]  # k1 k2 p1 p2 k3, OpenCV
    base_from_camera: Matrix4
    tool_from_lamp: Matrix4
    lamp_intensity: float = Field(gt=0)
    reference_m: float = Field(gt=0)
    lobe_exponent: float = Field(ge=0)
    sensor: SensorModel
    intensity_sigma: float = Field(ge=0, description="1 σ of each image's lamp intensity, as a fraction")
    lamp_position_sigma_m: float = Field(ge=0, description="1 σ of the lamp's position, per axis")
    made_at: str
    valid_days: float = Field(gt=0)
