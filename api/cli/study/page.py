"""Writes the study as one HTML page that needs no network, and as JSON."""

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from api.cli.study import chart, error_curves, paper_criterion, three_images
from api.cli.study.chart import Axis, Line
from api.cli.study.error_curves import Curve
from api.cli.study.study_result import StudyResult
from hardware_sim import footprint

STYLE = """
html { color-scheme: light dark }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; margin: 1em 0; font-variant-numeric: tabular-nums }
th, td { padding: .2em .8em; text-align: right; border-bottom: 1px solid #8884 }
th:first-child, td:first-child { text-align: left }
svg { width: 100%; max-width: 760px } svg text { fill: currentColor }
figcaption { font-size: 90%; opacity: .8 }
"""


def write(path: Path, result: StudyResult, figures: Mapping[str, Any]) -> None:
    """Writes the page atomically."""
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>lightpose study, seed {result.seed}</title>",
        f"<style>{STYLE}</style><h1>Benefit of planned lights</h1>",
        f"<p>Seed {result.seed}, simulated objects ({', '.join(result.scale.objects)}), "
        f"{result.scale.pixels} × {result.scale.pixels} pixels, profile "
        "<code>direct</code>: every image has an unknown intensity error of 1 % and an unknown lamp-position error of "
        "1 mm per axis, besides the sensor's noise. All methods use the same number of images (ours including its "
        "pilot) and the same solver. Errors are angles in degrees over all pixels whose true normal is within 78° of "
        "the viewing ray, "
        "shadowed ones included; mixed pixels, which show two surfaces and whose share is stated below, have no "
        "single normal and are left out. Intervals are 95 %, over draws of object and errors."
        + (" <b>A quick run: few draws.</b></p>" if result.quick else "</p>"),
        "<h2>Our method against each of the others</h2>",
        _ratios(figures["ratios"]),
        "<h2>Error against the number of images</h2>",
        *_errors("diffuse", result.diffuse),
        *_errors("slightly glossy", result.glossy),
        "<h2>By object, eight images, diffuse</h2>",
        _by_object(result.diffuse, 8),
        "<h2>Mixed pixels, and pixels with large errors</h2>",
        *_far_off(result),
        "<h2>Error predicted before the capture, relative to the observed one</h2>",
        _table(
            ["object", "predicted / observed mean error"],
            [[shape, f"{value:.2f}"] for shape, value in figures["predicted_over_found_by_object"].items()],
        ),
        "<p>The <code>part</code> has steps that its integrated depth does not show, and errors beside the steps that "
        "the predicted variance does not include.</p>",
        "<h2>The paper's figure 9: three unit lights, no shadows</h2>",
        *_placements(result),
        "<h2>The paper's formulas, checked numerically</h2>",
        *_errata(result.errata),
        "<h2>Exactly three images, plain inversion: which conditions give the paper's errors</h2>",
        *_three(result.table),
        "</html>",
    ]
    _write_atomically(path, "\n".join(parts))


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Writes the figures for programs atomically."""
    _write_atomically(path, json.dumps(figures, indent=1) + "\n")


def _write_atomically(path: Path, text: str) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = "".join(f"<th>{escape(name)}" for name in head)
    lines = "".join("<tr>" + "".join(f"<td>{escape(cell)}" for cell in row) for row in rows)
    return f"<table><tr>{cells}{lines}</table>"


def _with_interval(value: float, half_width: float, digits: int = 2) -> str:
    """Formats a value with its interval, if it was drawn more than once."""
    return f"{value:.{digits}f} ± {half_width:.{digits}f}" if half_width > 0 else f"{value:.{digits}f}"


def _ratios(items: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        [
            f"{item['rival']}{' (slant 35°)' if item['rival'] == 'ring' else ''}",
            "glossy" if item["glossy"] else "diffuse",
            str(item["lights"]),
            _with_interval(item["ratio"], item["half_width"], 3),
        ]
        for item in items
    ]
    return _table(["rival", "surface", "images", "our mean error / the rival's"], rows)


def _errors(surface: str, curves: Sequence[Curve]) -> list[str]:
    lines = [
        Line(
            curve.method,
            [(lights, error) for lights, error in curve.error_deg.items()],
            list(curve.half_width_deg.values()),
        )
        for curve in curves
        if curve.error_deg
    ]
    if not lines:
        return []
    numbers = sorted({lights for curve in curves for lights in curve.error_deg})
    rows = [
        [curve.method]
        + [
            _with_interval(curve.error_deg[lights], curve.half_width_deg[lights]) if lights in curve.error_deg else "–"
            for lights in numbers
        ]
        for curve in curves
    ]
    drawn = chart.svg(lines, Axis("images", marks=numbers), Axis("mean error, degrees"))
    return [
        f"<figure>{drawn}<figcaption>Mean angular error over the objects, {surface}.</figcaption></figure>",
        _table(["method", *(f"n = {lights}" for lights in numbers)], rows),
    ]


def _far_off(result: StudyResult) -> list[str]:
    shares = [error_curves.over_10(result.samples, method, 8) for method in error_curves.RIVALS]
    rows = [
        [
            shape,
            f"{100 * share:.2f} %",
            *(f"{100 * value:.3f} %" for of in shares if shape in of for value in of[shape]),
        ]
        for shape, share in error_curves.mixed_share(result.samples).items()
    ]
    far_off = [f"{method}{whose}" for method in error_curves.RIVALS for whose in (", graded pixels", ", all pixels")]
    return [
        "<p>A pixel is mixed when some of eight points of its outline lie off the tangent plane at its centre by "
        f"more than a pixel, or have a normal more than {footprint.WIDEST_BEND_DEG:.0f}° from the one there: its "
        "value is a mixture, and no light determines the normal at its centre. The rule uses the true shape only. "
        "Shares of pixels, and of those with an error above 10° with eight images, diffuse:</p>",
        _table(["object", "mixed, not graded", *far_off], rows),
    ]


def _by_object(curves: Sequence[Curve], lights: int) -> str:
    shapes = list(curves[0].by_object[lights])
    rows = [
        [curve.method, *(f"{error:.2f}" for error in curve.by_object[lights].values())]
        for curve in curves
        if lights in curve.by_object
    ]
    return _table(["method", *shapes], rows)


def _placements(result: StudyResult) -> list[str]:
    figure = result.placements[-1]
    flat = [point for point in figure.heuristic_curve if 20 <= point[0] <= 85]
    ends = (flat[0][0], flat[-1][0])
    levels = {"bound": figure.bound, "ours": figure.ours, "best of the random triples": figure.best_random}
    lines = [Line("evenly round the axis", flat)]
    lines += [Line(name, [(end, value) for end in ends], dashed=True) for name, value in levels.items()]
    drawn = chart.svg(lines, Axis("slant, degrees", marks=(20, 30, 40, 50, 60, 70, 85)), Axis("criterion"))
    head = ["object", "closed-form bound", "ours", "best heuristic", "at slant", "Drbohlav–Chantler", "best random"]
    rows = [
        [
            item.object,
            f"{item.bound:.4f}",
            f"{item.ours:.4f}",
            f"{item.best_heuristic:.4f}",
            f"{item.best_heuristic_slant_deg:.0f}°",
            f"{item.drbohlav:.4f}",
            f"{item.best_random:.4f}",
        ]
        for item in result.placements
    ]
    spread = [
        [f"{share:g} %", f"{value:.4g}"]
        for share, value in zip(paper_criterion.PERCENTS, figure.percentiles, strict=True)
    ]
    return [
        f"<figure>{drawn}<figcaption>tr(M (SᵀS)⁻¹) for the object <code>{figure.object}</code>.</figcaption></figure>",
        _table(head, rows),
        f"<p>{figure.triples:,} random triples for the object <code>{figure.object}</code>, by percentile:</p>",
        _table(["percentile", "criterion"], spread),
        f"<p>The paper reports {paper_criterion.REPORTED_PHI['ours']} for its own lights and "
        f"{paper_criterion.REPORTED_PHI['heuristic']} for the heuristic. No unit lights come below the bound over an "
        "object's normals: the first needs light vectors about nine times as long, and the second fits a single normal "
        "(bound 4/3), not an object.</p>",
    ]


def _errata(errata: paper_criterion.Errata) -> list[str]:
    b = [
        [albedo, f"{errata.idempotence[albedo]:.2g}", f"{errata.scaled_idempotence[albedo]:.2g}",
         f"{errata.trace_times_norm[albedo]:.3f}"]
        for albedo in errata.idempotence
    ]  # fmt: skip
    literal = [[str(step), f"{value:.4f}", f"{length:.2f}"] for step, value, length in errata.literal]
    return [
        "<p>Appendix B calls B = (I − nnᵀ)/|Ñ| idempotent. It is for albedo 1 only; what holds is B² = B/|Ñ|, and its "
        "trace is 2/|Ñ|:</p>",
        _table(["albedo |Ñ|", "‖B² − B‖ / ‖B‖", "‖B² − B/|Ñ|‖ / ‖B/|Ñ|‖", "tr(B) |Ñ|"], b),
        "<p>Appendix A's gradient, read with an element-wise product, agrees with finite differences to "
        f"{errata.gradient_error:.0e}; read with a matrix product, its cosine to the true gradient is "
        f"{errata.matrix_product_cosine:.3f} (median of 200 random light sets).</p>",
        "<p>Eq. 23 as it stands does not bound the light vectors, and Φ(cS) = Φ(S)/c² (checked to "
        f"{errata.scale_law_error:.0e}): minimising it makes the light vectors grow without limit.</p>",
        _table(["step", "Φ", "mean |s|"], literal),
        f"<p>For one normal the bound is {errata.single_normal_bound:.4f}; the best of the random triples has "
        f"{errata.single_normal_random:.4f}.</p>",
    ]


def _three(rows: Sequence[three_images.Row]) -> list[str]:
    objects = list(dict.fromkeys(row.object for row in rows))
    by_place = {(row.condition, row.object): row for row in rows}
    names = list(dict.fromkeys(row.condition for row in rows))
    body = [[f"{name} (reported)", f"{mean:.2f} / {median:.2f}", *[""] * (len(objects) - 1)]
            for name, (mean, median) in three_images.REPORTED.items()]  # fmt: skip
    for name in names:
        of_condition = [by_place[name, shape] for shape in objects]
        share = "" if all(row.share > 0.999 for row in of_condition) else " ({:.0f} % of the pixels)"
        body.append(
            [
                name,
                *(f"{row.mean_deg:.2f} / {row.median_deg:.2f}{share.format(100 * row.share)}" for row in of_condition),
            ]
        )
    return [
        _table(["condition: mean / median error", *objects], body),
        "<p>A mean near the median, both near nine degrees, is typical of a near lamp modelled as a distant one; a "
        "mean far above the median is typical of shadows. A ring at 25–35° under distant light gives the paper's "
        "2.0 / 0.6; the paper's own criterion with unit lights does not. Where all three lights are seen, all methods "
        "are close.</p>",
    ]
