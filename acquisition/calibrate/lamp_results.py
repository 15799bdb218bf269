"""Results of the lamp's calibration as their files hold them, and the picture of its lobe.

Sessions and the commands on folders write the same files, so that either can be read in place of the other.
"""

from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from acquisition.calibrate.board_results import now
from acquisition.calibrate.lamp_lobe import LobeFit
from acquisition.calibrate.lamp_position import Highlight, LampFit
from acquisition.calibrate.plane_shading import PlaneImage
from acquisition.models.calibration import Calibration
from acquisition.models.calibration_result import HighlightResidual, LampResult, LobeResult, PlaneResidual


def lamp_result(
    found: LampFit, used: Sequence[Highlight], why_not: Mapping[str, str], hashes: Mapping[str, str]
) -> LampResult:
    """Result of the lamp's place with all that was estimated beside it; `hashes` of all the sphere's images by name,
    `why_not`: reasons for which images were not used."""
    lengths = dict(zip((one.name for one in used), np.linalg.norm(found.residuals_px, axis=1).tolist(), strict=True))
    return LampResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"),
            "tool_from_lamp_m": found.tool_from_lamp_m.tolist(), "covariance": found.covariance.tolist(),
            "position_sigma_m": found.sigma_m, "sphere_center_m": found.sphere_center_m.tolist(),
            "sphere_radius_m": found.sphere_radius_m, "highlight_sigma_px": found.highlight_sigma_px,
            "images": [
                HighlightResidual(
                    image=name, sha256=digest, residual_px=lengths.get(name), why_not=why_not.get(name, "")
                )
                for name, digest in hashes.items()
            ],
        }
    )  # fmt: skip


def lobe_result(
    found: LobeFit, images: Sequence[PlaneImage], fitted: Sequence[PlaneImage], hashes: Mapping[str, str],
    verified_deg: float | None, full_scale_dn: float,
) -> LobeResult:  # fmt: skip
    """Result of intensity and lobe; `fitted` are those of `images` that took part, `hashes` of all by name."""
    offsets = dict(zip((one.name for one in fitted), found.offsets.tolist(), strict=True))
    return LobeResult.model_validate(
        {
            "made_at": now(), "version": metadata.version("lightpose"), "lamp_intensity": found.lamp_intensity,
            "full_scale_dn": full_scale_dn, "lobe": found.lobe.model_dump(), "covariance": found.covariance.tolist(),
            "intensity_sigma": float(np.sqrt(found.covariance[0, 0])), "flat_field": found.flat_field.tolist(),
            "flat_field_covariance": found.flat_covariance.tolist(), "image_sigma": found.image_sigma,
            "patch_sigma": found.patch_sigma, "lamp_sigma_m": found.lamp_sigma_m,
            "held_out": [[float(count), residual] for count, residual in found.held_out.items()],
            "verified_deg": verified_deg,
            "images": [
                PlaneResidual(
                    image=one.name, sha256=hashes[one.name], patches=len(one.values), offset=offsets.get(one.name)
                )
                for one in images
            ],
        }
    )  # fmt: skip


def draw_lobe(found: LobeFit, calibration: Calibration, path: Path) -> None:
    """Draws the lobe over the angle with its 2 σ, beside the power of the cosine."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load and seldom needed

    knots = np.degrees(found.lobe.knots_rad)
    base = np.cos(np.radians(knots)) ** calibration.lobe_exponent
    sigma = np.r_[0.0, np.sqrt(np.diag(found.covariance)[1:-2])]
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    factors = np.array(found.lobe.factors)
    axes.errorbar(knots, base * factors, 2 * sigma * factors, fmt="o-", label="found, 2 σ")
    axes.plot(knots, base, "--", label=f"cos^{calibration.lobe_exponent:g}")
    axes.set(xlabel="angle off the lamp's axis, °", ylabel="intensity relative to the axis")
    axes.legend()
    figure.savefig(path, dpi=120)
