"""The report of a calibration session: report.html, one page that needs no network, made from an estimate's files.

It helps to decide whether to use the calibration: next steps first, then values with 1 σ, their correlations, the
residual of each image, pictures, and what it was made with. It is made from the files of the result, so that page and
files cannot differ.
"""

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, degrees, log10, sqrt
from pathlib import Path
from typing import Any

from acquisition.formats.report.page import PAGE, table_rows, template
from acquisition.models.rounding import percent

PICTURES: Mapping[str, str] = {
    "projection_sigma.png": "Projection uncertainty of the camera model, 1 σ, and the corners that were seen: where "
    "there are none, views are missing",
    "residuals.png": "Residuals of the corners: neighbouring arrows that point the same way show a distortion that "
    "five coefficients do not describe",
    "lobe.png": "The lamp's lobe with 2 σ",
    "photon_transfer.png": "Noise against brightness, and the lamp's brightness from image to image",
}
"""Pictures of an estimate, with their captions."""

OUTLIER_RATIO = 2.0
"""Ratio of an image's residual to the median above which the image is marked."""


@dataclass(frozen=True)
class _Part:
    """Values with names and units, 1 σ and covariance in the order of the names, and deviations of images."""

    title: str
    values: Sequence[tuple[str, float, float | None, str]]
    names: Sequence[str] = ()
    covariance: Sequence[Sequence[float]] = ()
    images: Sequence[tuple[str, float | None, str]] = ()
    unit: str = ""
    facts: Sequence[tuple[str, str]] = ()


def write(folder: Path, title: str, facts: Mapping[str, str], advice: Sequence[str]) -> None:
    """Writes report.html into an estimate's folder; `facts`: date, version, serial numbers, sessions, for people."""
    stated = {name: folder / name for name in _PARTS if (folder / name).exists()}
    parts = [_section(_PARTS[name](json.loads(file.read_text(encoding="utf-8")))) for name, file in stated.items()]
    pictures = [
        f'<figure><img alt="" src="data:image/png;base64,{base64.b64encode((folder / name).read_bytes()).decode()}">'
        f"<figcaption>{html.escape(what)}</figcaption></figure>"
        for name, what in PICTURES.items()
        if (folder / name).exists()
    ]
    style, _, _ = template().partition("</style>")
    page = [
        "<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n<meta name=viewport content='width=device-width'>",
        f"<title>{html.escape(title)}</title>",
        style[style.index("<style>") :] + _STYLE,
        f"<h1>{html.escape(title)}</h1>",
        "<ul class=warnings>" + "".join(f"<li>{html.escape(sentence)}" for sentence in advice) + "</ul>",
        *parts,
        "<h2>Pictures</h2><div class=grid>" + "".join(pictures) + "</div>" if pictures else "",
        f"<h2>Made with</h2><table>{table_rows(list(facts.items()))}</table>",
    ]
    (folder / PAGE).write_text("\n".join(page), encoding="utf-8")


_STYLE = """
.part td { text-align: right; font-variant-numeric: tabular-nums } .part td:last-child { text-align: left }
.correlation td, .correlation th { font-size: .8em; text-align: right; padding: .1em .4em }
.bar { display: inline-block; height: .7em; background: #2b6cb0 } .far .bar { background: #c05621 }
</style>"""


def _section(part: _Part) -> str:
    rows = "".join(
        f"<tr><th>{html.escape(name)}<td>{_number(value, sigma)}<td>"
        + (f"± {_short(sigma)}" if sigma is not None else "")
        + f"<td>{html.escape(unit)}"
        for name, value, sigma, unit in part.values
    )
    made = f"<h2>{html.escape(part.title)}</h2><table class=part>{rows}</table>"
    made += f"<table>{table_rows(part.facts)}</table>" if part.facts else ""
    if part.names:
        made += _correlations(part.names, part.covariance)
    if part.images:
        made += _images(part.images, part.unit)
    return made


def _correlations(names: Sequence[str], covariance: Sequence[Sequence[float]]) -> str:
    """Correlations as a table, with colours that deepen with their size."""
    sigma, rows = _sigmas(covariance), ""
    for one, name in enumerate(names):
        cells = ""
        for other in range(one + 1):
            scale = sigma[one] * sigma[other]
            value = covariance[one][other] / scale if scale else 0.0
            share = min(abs(value), 1.0) if one != other else 0.0
            colour = "43,108,176" if value > 0 else "192,86,33"
            cells += f"<td style='background:rgba({colour},{0.7 * share:.2f})'>{value:+.2f}"
        rows += f"<tr><th>{html.escape(name)}{cells}"
    head = "".join(f"<th>{html.escape(name)}" for name in names)
    return f"<details><summary>Correlations</summary><table class=correlation>{rows}<tr><th>{head}</table></details>"


def _images(images: Sequence[tuple[str, float | None, str]], unit: str) -> str:
    """Each image's deviation with a bar; those far above the median are marked."""
    known = sorted(abs(value) for _, value, _ in images if value is not None)
    median, most = (known[len(known) // 2], known[-1]) if known else (0.0, 0.0)
    rows = ""
    for name, value, why in images:
        if value is None:
            rows += f"<tr><th>{html.escape(name)}<td><td>{html.escape(why or 'not used')}"
            continue
        far = " class=far" if abs(value) > OUTLIER_RATIO * median else ""
        width = 14 * abs(value) / most if most else 0.0
        rows += f"<tr{far}><th>{html.escape(name)}<td>{_short(value)} {html.escape(unit)}"
        rows += f"<td><span class=bar style='width:{width:.2f}em'></span>"
    return f"<h2>Residual of each image</h2><table>{rows}</table>"


def _number(value: float, sigma: float | None) -> str:
    """Formats a value to the second digit of its σ."""
    if not sigma:
        return f"{value:.6g}"
    return f"{value:.{min(max(ceil(log10(9.95 / sigma)), 0), 9)}f}"


def _short(value: float) -> str:
    return f"{value:.2g}"


def _sigmas(covariance: Sequence[Sequence[float]]) -> list[float]:
    return [sqrt(max(covariance[one][one], 0.0)) for one in range(len(covariance))]


def _views(stated: dict[str, Any]) -> list[tuple[str, float | None, str]]:
    return [(one["image"], one["rms_px"], "the board is not seen") for one in stated["views"]]


def _camera(stated: dict[str, Any]) -> _Part:
    matrix, sigma = stated["camera_matrix"], _sigmas(stated["covariance"])
    names = ["f_x", "f_y", "c_x", "c_y", "k1", "k2", "p1", "p2", "k3"]
    values = [matrix[0][0], matrix[1][1], matrix[0][2], matrix[1][2], *stated["distortion"]]
    units = ["px"] * 4 + [""] * 5
    return _Part(
        "Camera", list(zip(names, values, sigma, units, strict=True)), names, stated["covariance"], _views(stated),
        "px",
        [
            ("noise of a corner", f"{_short(stated['corner_sigma_px'])} px"),
            ("projection uncertainty, 1 σ", f"{_short(stated['projection_sigma_px'])} px in the median, "
             f"{_short(stated['worst_projection_sigma_px'])} px at worst"),
            ("sag of the board", ", ".join(f"{1e3 * one:.2f} mm" for one in stated["warp_m"])),
        ],
    )  # fmt: skip


def _hand_eye(stated: dict[str, Any]) -> _Part:
    names = ["x", "y", "z", "about x", "about y", "about z"]
    sigma, pose = _sigmas(stated["covariance"]), stated["base_from_camera"]
    values = [
        (f"camera {axis} in the base frame", 1e3 * pose[row][3], None, "mm") for row, axis in enumerate(("x", "y", "z"))
    ]
    values += [(f"1 σ along the camera's {axis}", 1e3 * sigma[row], None, "mm") for row, axis in enumerate("xyz")]
    values += [(f"1 σ about the camera's {axis}", degrees(sigma[3 + row]), None, "°") for row, axis in enumerate("xyz")]
    offsets = zip(stated["joint_offsets_rad"], stated["joint_offset_sigmas_rad"], strict=True)
    values += [
        (f"offset of joint {number}", degrees(value), degrees(one), "°")
        for number, (value, one) in enumerate(offsets, start=1)
        if one
    ]
    return _Part(
        "Camera against the arm", values, names, stated["covariance"], _views(stated), "px",
        [
            ("side of the squares, estimated / stated", f"{stated['square_scale']:.5f}"),
            ("the arm's deviation from its model, 1 σ per axis", f"{1e3 * stated['arm_sigma_m']:.3f} mm, "
             f"{degrees(stated['arm_sigma_rad']):.4f}°"),
        ],
    )  # fmt: skip


def _lamp(stated: dict[str, Any]) -> _Part:
    sigma = _sigmas(stated["covariance"])
    values = [
        (f"lamp {axis} in the tool's frame", 1e3 * value, 1e3 * one, "mm")
        for axis, value, one in zip("xyz", stated["tool_from_lamp_m"], sigma, strict=True)
    ]
    images = [(one["image"], one["residual_px"], one["why_not"]) for one in stated["images"]]
    center = ", ".join(f"{1e3 * one:.1f}" for one in stated["sphere_center_m"])
    facts = [
        ("sphere", f"radius {1e3 * stated['sphere_radius_m']:.3f} mm at {center} mm in the base frame"),
        ("noise of a highlight", f"{_short(stated['highlight_sigma_px'])} px"),
    ]
    return _Part("Lamp's position", values, ["x", "y", "z"], stated["covariance"], images, "px", facts)


def _lobe(stated: dict[str, Any]) -> _Part:
    sigma, lobe = _sigmas(stated["covariance"]), stated["lobe"]
    knots = [f"{degrees(one):.0f}°" for one in lobe["knots_rad"][1:]]
    values = [
        (
            "intensity, fraction of full scale per second",
            stated["lamp_intensity"],
            stated["lamp_intensity"] * sigma[0],
            "1/s",
        )
    ]
    factors = zip(knots, lobe["factors"][1:], sigma[1:], strict=False)
    values += [(f"factor at {knot} off the axis", value, value * one, "") for knot, value, one in factors]
    values += [("brighter towards x", lobe["tilt"][0], sigma[-2], ""), ("towards y", lobe["tilt"][1], sigma[-1], "")]
    facts = [
        ("images differ in brightness by", f"{percent(stated['image_sigma'], 2)} (1 σ)"),
        ("scatter of patches about the fit", f"{percent(stated['patch_sigma'], 2)} (1 σ)"),
    ]
    if stated["verified_deg"] is not None:
        facts.append(
            ("verified on a placing that was not fitted", f"mean error of normals {stated['verified_deg']:.2f}°")
        )
    images = [
        (one["image"], None if one["offset"] is None else 100 * one["offset"], f"{one['patches']} patches, not fitted")
        for one in stated["images"]
    ]
    names = ["ln intensity", *knots, "x", "y"]
    return _Part("Lamp's intensity and lobe", values, names, stated["covariance"], images, "%", facts)


def _response(stated: dict[str, Any]) -> _Part:
    names = ["black level", "gain", "read noise", "full well", "nonlinearity"]
    keys = ["black_level_dn", "gain_e_per_dn", "read_noise_e", "full_well_e", "nonlinearity"]
    units = ["DN", "e⁻ per DN", "e⁻", "e⁻", "at full scale"]
    values = [
        (name, stated[key], one, unit)
        for name, key, one, unit in zip(names, keys, _sigmas(stated["covariance"]), units, strict=True)
    ]
    drift, drift_sigma = stated["lamp_drift_per_h"], stated["lamp_drift_sigma_per_h"]
    facts = [
        ("saturation limited by", stated["full_by"]),
        ("defective pixels", str(len(stated["defects"]))),
        ("room light / lamp light", percent(stated["room_over_lamp"], 2)),
        ("brightness scatter between images", f"{percent(stated['lamp_sigma'], 2)} (1 σ)"),
        ("drift of the lamp", f"{percent(drift, 2, signed=True)} ± {percent(drift_sigma, 2)} an hour"),
    ]
    steps = [(f"{1e3 * one['exposure_s']:.4g} ms", 100 * one["nonlinear"], "") for one in stated["exposures"]]
    return _Part("Camera's response", values, names, stated["covariance"], steps, "%", facts)


def _check(stated: dict[str, Any]) -> _Part:
    unit = "px" if stated["target"] == "board" else "%"
    scale = 1.0 if stated["target"] == "board" else 100.0
    images = [
        (one["image"], None if one["deviation"] is None else scale * one["deviation"], "the target is not seen")
        for one in stated["images"]
    ]
    tests = [
        (
            one["name"],
            f"{one['sentence']}; χ² {one['chi_square']:.1f} with {one['freedom']} d.o.f., p {one['probability']:.2g}",
        )
        for one in stated["tests"]
    ]
    head = [
        ("still true", "yes" if stated["passed"] else "no"),
        ("probability that a correct calibration deviates as much", f"{stated['probability']:.2g}"),
        ("the image that deviates most", stated["worst"]),
    ]
    return _Part("Check of the calibration in use", [], images=images, unit=unit, facts=[*head, *tests])


_PARTS = {
    "camera.json": _camera,
    "hand_eye.json": _hand_eye,
    "lamp.json": _lamp,
    "lobe.json": _lobe,
    "response.json": _response,
    "check.json": _check,
}
"""Files of results in the order of the page, and the functions that read their parts of it."""
