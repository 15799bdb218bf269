"""The report as one page that needs no network, and as one picture.

It is for a reader with one minute: figures first, then faults and remedies, then the maps, and a light to move by hand.
"""

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

from acquisition import geometry, photometry
from acquisition.formats.report import advice, pictures
from acquisition.formats.report.context import ReportContext
from acquisition.formats.report.pictures import ReducedMaps
from acquisition.models.base import BoolArray
from acquisition.models.result import MEAN_ERROR_PER_SIGMA, MEDIAN_ERROR_PER_SIGMA, NormalMap
from acquisition.models.rounding import percent

PAGE, PICTURE = "report.html", "report.png"
DOME_PX = 300


def write(normal_map: NormalMap, context: ReportContext, folder: Path) -> None:
    """Writes report.html and report.png into an existing folder."""
    small = pictures.reduced(normal_map)
    maps = _maps(small)
    (folder / PICTURE).write_bytes(_contact_sheet(maps))
    (folder / PAGE).write_text(_page(normal_map, context, small, maps), encoding="utf-8")


def _page(normal_map: NormalMap, context: ReportContext, small: ReducedMaps, maps: list["_MapPicture"]) -> str:
    warnings = advice.quality_warnings(normal_map, context)
    parts = {
        "TITLE": html.escape(context.title),
        "FIGURES": _figures(normal_map, context),
        "WARNINGS": "".join(f"<li>{html.escape(sentence)}" for sentence in warnings) or "<li class=good>No warnings.",
        "MAPS": "".join(_figure(one) for one in maps),
        "DOME": _dome(context),
        "DRAWINGS": "".join(
            f"<figure>{svg}<figcaption>{html.escape(what)}</figcaption></figure>" for what, svg in context.drawings
        ),
        "LIGHTS": _lights(normal_map, context),
        "SECONDS": ", ".join(f"{html.escape(name)} {value:.2f} s" for name, value in context.seconds.items()),
        "NORMALS_DATA": _data(pictures.normals(small)),
        "ALBEDO_DATA": _data(_albedo(small)),
    }
    page = template()
    for name, value in parts.items():
        page = page.replace(f"@{name}@", value)
    return page


@dataclass(frozen=True)
class _MapPicture:
    """One map as a picture (h, w, 3) with its name, what it means, and the ends of its scale."""

    name: str
    meaning: str
    picture: np.ndarray
    scale: tuple[str, str] | None = None


def _maps(small: ReducedMaps) -> list[_MapPicture]:
    white = float(np.quantile(small.albedo[small.solved], 0.995)) if np.any(small.solved) else 1.0
    sigma_top = pictures.scale_top(small.sigma_deg, small.solved, 0.1)
    residual_top = pictures.scale_top(small.residual, small.solved, 1.0)
    most = float(max(1.0, np.ceil(np.max(small.lights, initial=1.0))))
    maps = [
        _MapPicture("Normals", "(n + 1)/2: red right, green up, blue to the camera", pictures.normals(small)),
        _MapPicture("Albedo", f"white is {white:.2f}", pictures.gamma_encoded(small.albedo, small.solved, white)),
        _MapPicture(
            "Uncertainty σ",
            "degrees; the mean error is 0.89 σ; hatched: σ is unreliable",
            _hatched(pictures.coloured(small.sigma_deg, small.solved, sigma_top), small.doubtful > 0.5),
            ("0°", f"{sigma_top:g}°"),
        ),
        _MapPicture(
            "Lights used",
            "number of images that each normal is solved from",
            pictures.coloured(small.lights, small.mask, most),
            ("0", f"{most:.0f}"),
        ),
        _MapPicture(
            "Residual",
            "residuals divided by the expected noise; 1: as expected",
            pictures.coloured(small.residual, small.solved, residual_top),
            ("0", f"{residual_top:g}"),
        ),
    ]
    if small.indirect is not None:
        top = pictures.scale_top(small.indirect, small.solved, 0.01)
        picture = pictures.coloured(small.indirect, small.solved, top)
        maps.append(
            _MapPicture(
                "Light from other surfaces",
                "share of the measured light; subtracted",
                picture,
                ("0", percent(top, 0)),
            )
        )
    return maps


def _figures(normal_map: NormalMap, context: ReportContext) -> str:
    sigma, fit = normal_map.sigma_deg[normal_map.mask], normal_map.fit
    sigma = sigma[np.isfinite(sigma)]
    pixels, object_pixels = np.count_nonzero(normal_map.mask), max(1, np.count_nonzero(normal_map.silhouette))
    stated = expected = ""
    if sigma.size:
        mean, median = np.mean(sigma), np.median(sigma)
        stated = f"mean {mean:.2f}°, median {median:.2f}°"
        expected = f"mean {MEAN_ERROR_PER_SIGMA * mean:.2f}°, median {MEDIAN_ERROR_PER_SIGMA * median:.2f}°"
    fitted = "" if fit is None else (
        f"residuals are {fit.misfit:.2f} times the stated noise; {percent(fit.probability, 0)} of sound captures "
        "fit as badly"
    )  # fmt: skip
    facing, predicted = context.facing_sigma_deg, context.predicted_sigma_deg
    counted = f"mean σ within {photometry.GRADED_SLANT_DEG:.0f}° of the viewing ray"
    rows = [
        ("images", f"{len(normal_map.flags)}"),
        ("normals", f"{pixels:,}".replace(",", " ") + f" ({percent(pixels / object_pixels)} of the object)"),
        ("σ of all solved pixels", stated),
        ("expected error", expected),
        ("fit of the images", fitted),
        (counted, "" if facing is None else f"{facing:.2f}°"),
        (f"{counted}, as the plan predicted it", "" if predicted is None else f"{predicted:.2f}°"),
        ("error against the truth", ", ".join(f"{name} {value:.2f}°" for name, value in context.error_deg.items())),
        ("calibration checked", context.calibration_checked),
        ("solver", ": ".join(filter(None, (context.solver, context.why)))),
        ("sensor", str(normal_map.notes.get("sensor", ""))),
    ]
    return table_rows([(name, said) for name, said in rows if said])


def table_rows(rows: Sequence[tuple[str, str]]) -> str:
    """Rows of an HTML table: a name and a text each."""
    return "".join(f"<tr><th>{html.escape(name)}<td>{html.escape(said)}" for name, said in rows)


def template() -> str:
    """The template of the page with style and script; names between `@` mark the places of its parts."""
    return resources.files("acquisition.formats.report").joinpath("template.html").read_text(encoding="utf-8")


def _figure(one: _MapPicture) -> str:
    scale = ""
    if one.scale is not None:
        stops = ",".join(pictures.scale_colours())
        bar = f'<i style="background:linear-gradient(90deg,{stops})"></i>'
        scale = f"<span class=scale>{one.scale[0]}{bar}{one.scale[1]}</span>"
    return (
        f'<figure><img alt="{html.escape(one.name)}" src="{_data(one.picture)}">'
        f"<figcaption><b>{html.escape(one.name)}</b> {html.escape(one.meaning)} {scale}</figcaption></figure>"
    )


def _dome(context: ReportContext) -> str:
    """The lights as seen from the camera: rings are 30°, 60° and 90° off the viewing axis."""
    middle, radius = DOME_PX / 2, DOME_PX / 2 - 18
    parts = [
        f'<circle cx="{middle}" cy="{middle}" r="{radius * slant / 90:.1f}" class=ring />'
        f'<text x="{middle + 3}" y="{middle - radius * slant / 90 - 2:.1f}" class=tick>{slant}°</text>'
        for slant in (30, 60, 90)
    ]
    kinds = sorted(set(context.groups))
    for number, (slant, azimuth) in enumerate(zip(*geometry.slant_azimuth(context.directions), strict=True)):
        outwards = radius * slant / (np.pi / 2)
        column, row = middle + outwards * np.cos(azimuth), middle - outwards * np.sin(azimuth)
        kind = kinds.index(context.groups[number]) if context.groups else 0
        parts.append(
            f'<g class="light kind{kind}"><circle cx="{column:.1f}" cy="{row:.1f}" r="8" />'
            f'<text x="{column:.1f}" y="{row + 3.5:.1f}">{number}</text></g>'
        )
    legend = "".join(f'<span class="key kind{number}">{html.escape(kind)}</span> ' for number, kind in enumerate(kinds))
    view = f'<svg viewBox="0 0 {DOME_PX} {DOME_PX}" role=img aria-label="light positions">{"".join(parts)}</svg>'
    return f"{view}<figcaption><b>Lights</b> as the camera sees them. {legend}</figcaption>"


def _lights(normal_map: NormalMap, context: ReportContext) -> str:
    slants, azimuths = np.degrees(geometry.slant_azimuth(context.directions))
    figures = zip(
        context.names, slants, azimuths, normal_map.intensity_factors, pictures.shares(normal_map), strict=True
    )  # fmt: skip
    left_out = advice.images_left_out(normal_map)
    return "".join(
        f"<tr><td>{number}<td>{html.escape(name)}<td>{slant:.0f}°<td>{azimuth:.0f}°<td>{factor:.3f}"
        + ("<td>left out<td>–" if number in left_out else f"<td>{percent(used, 0)}<td>{percent(clipped)}")
        for number, (name, slant, azimuth, factor, (used, clipped, _)) in enumerate(figures)
    )


def _albedo(small: ReducedMaps) -> np.ndarray:
    """Albedo for relighting in red and green (8 bits, linear, the brightest as white), and the mask in blue."""
    grey = small.albedo if small.albedo.ndim == 2 else small.albedo.mean(axis=-1)
    top = float(np.quantile(grey[small.solved], 0.995)) if np.any(small.solved) else 1.0
    level = np.round(np.clip(grey / max(top, 1e-9), 0, 1) * 255)
    return np.stack([level, level, small.solved * 255.0], axis=-1).astype(np.uint8)


def _hatched(picture: np.ndarray, where: BoolArray) -> np.ndarray:
    row, column = np.indices(where.shape)
    out = picture.copy()
    out[where & ((row + column) % 6 < 2)] = (230, 60, 60)
    return out


def _encoded(pixels: np.ndarray) -> bytes:
    worked, content = cv2.imencode(".png", np.ascontiguousarray(pixels[..., ::-1]), [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not worked:
        raise OSError("a picture of the report could not be encoded")
    return content.tobytes()


def _data(pixels: np.ndarray) -> str:
    return f"data:image/png;base64,{base64.b64encode(_encoded(pixels)).decode('ascii')}"


def _contact_sheet(maps: list[_MapPicture]) -> bytes:
    """All maps side by side with their names, three in a row."""
    tiles: list[np.ndarray] = []
    for one in maps:
        title = one.name.replace("σ", "sigma") + ("" if one.scale is None else f"  {one.scale[0]} - {one.scale[1]}")
        tile = np.pad(one.picture, ((26, 0), (0, max(0, 260 - one.picture.shape[1])), (0, 0)), constant_values=255)
        title = title.replace("°", " deg")
        cv2.putText(tile, title, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % 3)
    rows = [np.concatenate(tiles[start : start + 3], axis=1) for start in range(0, len(tiles), 3)]
    return _encoded(np.concatenate(rows, axis=0))
