"""Tables of the bench's lines: errors by pattern, ratios to two rings, σ, and one run against another.

The statistical unit is a scene: azimuths are averaged first, in numerator and denominator. Means over scenes of a
family and over families are geometric; standard errors come from resampling scenes within families (bootstrap).
"""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from acquisition.models.result import MEAN_ERROR_PER_SIGMA
from acquisition.normals.alternatives import term_alternatives
from acquisition.normals.indirect_light import translucency
from tests.unseen import trials

Line = dict[str, object]
Cell = tuple[str, int]  # family, seed
RESAMPLES = 2000
PUT_RIGHT = 1.3
"""Greatest ratio of the error to that without the fault at which a fault counts as put right."""
OF_SURFACES = {term_alternatives.TERMS[name][0] for name in ("roughness", "gloss", "metal")} | {translucency.KIND}
"""Kinds of findings about the surface, not about a fault of the capture."""
SIGMA_KEYS = (
    "within_1",
    "within_2",
    "rms",
    "forecast",
    "within_1.all",
    "within_2.all",
    "rms.all",
    "doubtful",
    "solved",
)


def all_tables(lines: Sequence[Line], grading: str, older: Sequence[Line] | None) -> str:
    """All tables for which the lines hold values, as text."""
    failed = [line for line in lines if "error" in line]
    good = [line for line in lines if "error" not in line]
    parts = [f"{len(good)} solves, {len(failed)} refused; grading {grading}"]
    parts += [f"  refused: {line['family']} {line['seed']} {line['pattern']}: {line['error']}" for line in failed[:5]]
    sound = [line for line in good if line.get("fault") is None]
    parts += [error_table(sound, grading), ratio_table(sound, grading), ratio_table(sound, grading, "oracle")]
    parts += [sigma_table(sound), forecast_table(sound), alarm_table(sound)]
    parts.append(fault_table(good, grading))
    if older is not None:
        parts.append(against_table(good, [line for line in older if "error" not in line], grading))
    return "\n\n".join(part for part in parts if part)


def selection_tables(lines: Sequence[Line]) -> str:
    """Scores and trials of model selection, by fault, or by material without a fault."""
    return "\n\n".join([trials.score_table(lines, _condition, _table), trials.trial_table(lines, _condition, _table)])


def error_table(lines: Sequence[Line], grading: str) -> str:
    """Mean error in degrees of each family by pattern and number of lights, over scenes and azimuths."""
    cells: dict[str, dict[tuple[int, str], list[float]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        if f"{grading}.mean" in line:
            cells[_text(line, "family")][_count(line), _text(line, "pattern")].append(_number(line, f"{grading}.mean"))
    columns = sorted({column for row in cells.values() for column in row})
    rows = [
        [name, *(_shown(np.mean(row[c]) if c in row else math.nan) for c in columns)] for name, row in cells.items()
    ]
    head = ["mean error °", *(f"{pattern} {count}" for count, pattern in columns)]
    return _table([head, *rows])


def ratio_table(lines: Sequence[Line], grading: str, baseline: str = "two-rings") -> str:
    """Each pattern's ratio of error to that of the baseline (means over azimuths): geometric means over each family's
    scenes, then over all families, each with its standard error over scenes."""
    names = sorted({_text(line, "pattern") for line in lines} - {baseline})
    counts = sorted({_count(line) for line in lines})
    ratios = {
        (count, name): paired(
            by_scene(lines, grading, lambda line, c=count, n=name: (_count(line), line["pattern"]) == (c, n)),
            by_scene(lines, grading, lambda line, c=count: (_count(line), line["pattern"]) == (c, baseline)),
        )
        for count in counts
        for name in names
    }
    return _ratios({f"{name} {count}": value for (count, name), value in ratios.items()}, f"over {baseline}")


def against_table(lines: Sequence[Line], older: Sequence[Line], grading: str) -> str:
    """Ratio of this run's error to the older one's on the same captures, by pattern and number of lights."""
    columns = sorted({(_count(line), _text(line, "pattern")) for line in lines})
    ratios: dict[str, dict[Cell, float]] = {}
    for count, pattern in columns:

        def chosen(line: Line, c: int = count, p: str = pattern) -> bool:
            return (_count(line), line["pattern"]) == (c, p)

        common = {_identity(line) for line in lines} & {_identity(line) for line in older}
        pair = [[line for line in run if _identity(line) in common] for run in (lines, older)]
        ratios[f"{pattern} {count}"] = paired(*(by_scene(run, grading, chosen) for run in pair))
    return _ratios(ratios, "new over old")


def sigma_table(lines: Sequence[Line]) -> str:
    """Figures of σ by family and number of lights, over all patterns: P(e < σ), P(e < 2σ) and rms e/σ within 78°
    without doubtful pixels; ratio of 0.886 mean σ to the mean error; then the first three over all object pixels."""
    cells: dict[tuple[str, int], list[Line]] = defaultdict(list)
    for line in lines:
        if "rms" in line:
            cells[_text(line, "family"), _count(line)].append(line | {"forecast": _forecast(line)})
    rows: list[list[str]] = []
    for (family, count), group in cells.items():
        figures = [_mean([_number(line, key) for line in group if key in line]) for key in SIGMA_KEYS]
        sound = all((0.55 <= figures[0] <= 0.75, figures[1] >= 0.92, figures[2] <= 1.6, 0.7 <= figures[3] <= 1.3))
        rows.append([f"{family} {count}", *(_shown(figure) for figure in figures), "" if sound else "*"])
    return _table([["σ", *SIGMA_KEYS, "out of bounds"], *rows]) if rows else ""


def forecast_table(lines: Sequence[Line]) -> str:
    """Ratio of the mean error that plans forecast (0.886 mean σ) to that found: geometric means over each family's
    scenes, then over all families."""
    expected = [
        line | {"expected.mean": MEAN_ERROR_PER_SIGMA * _number(line, "predicted_sigma")}
        for line in lines
        if math.isfinite(_number(line, "predicted_sigma") if "predicted_sigma" in line else math.nan)
    ]
    expected = [line | {"found.mean": line["found_mean"]} for line in expected]
    columns = sorted({(_count(line), _text(line, "pattern")) for line in expected})
    ratios: dict[str, dict[Cell, float]] = {}
    for count, pattern in columns:

        def chosen(line: Line, c: int = count, p: str = pattern) -> bool:
            return (_count(line), line["pattern"]) == (c, p)

        ratios[f"{pattern} {count}"] = paired(*(by_scene(expected, name, chosen) for name in ("expected", "found")))
    return _ratios(ratios, "forecast over found")


def fault_table(lines: Sequence[Line], grading: str) -> str:
    """For each fault: ratio of the error to that of the same capture without it, number of captures put right (ratio at
    most PUT_RIGHT), number of the others with a finding, and mean rms e/σ."""

    def capture_of(line: Line) -> tuple[object, ...]:
        return tuple(line.get(key) for key in ("family", "seed", "reflectance", "pattern", "lights", "azimuth"))

    key = f"{grading}.mean"
    without = {capture_of(line): _number(line, key) for line in lines if line.get("fault") is None and key in line}
    faulty: dict[str, list[Line]] = defaultdict(list)
    for line in lines:
        if line.get("fault") is not None and key in line and capture_of(line) in without:
            faulty[_text(line, "fault")].append(line)
    rows: list[list[str]] = []
    for fault, group in faulty.items():
        ratios = [_number(line, key) / without[capture_of(line)] for line in group]
        left = [line for line, ratio in zip(group, ratios, strict=True) if ratio > PUT_RIGHT]
        named = [line for line in left if line.get("findings")]
        rms = [_number(line, "rms") for line in group if "rms" in line]
        unnamed = ", ".join(f"{line['family']} {line['seed']}" for line in left if not line.get("findings"))
        figures = [np.median(ratios), max(ratios)], [_mean(rms), max(rms, default=math.nan)]
        shown = [[_shown(float(figure)) for figure in pair] for pair in figures]
        rows.append(
            [fault, str(len(group)), *shown[0], str(len(group) - len(left)), str(len(named)), *shown[1], unnamed]
        )
    head = ["fault", "captures", "error ×", "worst ×", "put right", "else named", "rms e/σ", "worst", "neither"]
    return _table([head, *rows]) if rows else ""


def _condition(line: Line) -> str:
    """The fault of a capture, or its material without one."""
    return str(line.get("fault") or _material(line))


def _material(line: Line) -> str:
    scattering = float(str(line.get("scatter_mm", 0))) > 0
    return "scatter" if scattering else _text(line, "material").split(":")[0]


def alarm_table(lines: Sequence[Line]) -> str:
    """False positives on captures without a fault, by material: uncorrected findings, with their mean errors, and
    corrected faults of the capture, which it does not have."""
    groups: dict[str, list[Line]] = defaultdict(list)
    for line in lines:
        if "findings" in line:
            groups[_material(line)].append(line)
    rows: list[list[str]] = []
    for material, group in groups.items():
        alarms = [line for line in group if any(not corrected for _, corrected in line["findings"])]  # type: ignore[attr-defined]
        error = _mean([_number(line, "found_mean") for line in alarms])
        rest = _mean([_number(line, "found_mean") for line in group if line not in alarms])
        corrected = [line for line in group if _corrected_kinds(line) - OF_SURFACES]
        shares = [f"{len(some) / len(group):.1%}" for some in (alarms, corrected)]
        rows.append([material, str(len(group)), shares[0], _shown(error), _shown(rest), shares[1]])
    head = ["no fault", "captures", "uncorrected findings", "their error °", "the others' °", "corrected faults"]
    return _table([head, *rows]) if rows else ""


def _corrected_kinds(line: Line) -> set[str]:
    return {kind for kind, corrected in line["findings"] if corrected}  # type: ignore[attr-defined]


def _forecast(line: Line) -> float:
    return MEAN_ERROR_PER_SIGMA * _number(line, "sigma_mean") / max(_number(line, "found_mean"), 1e-9)


def paired(above: dict[Cell, float], below: dict[Cell, float]) -> dict[Cell, float]:
    """Ratios for the scenes that both have."""
    return {cell: above[cell] / below[cell] for cell in above if cell in below}


def geometric(ratios: dict[Cell, float], rng: np.random.Generator | None = None) -> tuple[float, float]:
    """Geometric mean over families of the geometric means over scenes, and its standard error by resampling scenes."""
    by_family: dict[str, list[float]] = defaultdict(list)
    for (family, _), ratio in ratios.items():
        by_family[family].append(math.log(ratio))
    groups = [np.array(values) for values in by_family.values()]
    if not groups:
        return math.nan, math.nan
    center = math.exp(float(np.mean([np.mean(group) for group in groups])))
    if max(len(group) for group in groups) < 2:
        return center, math.nan
    rng = rng or np.random.default_rng(0)
    draws = np.mean([group[rng.integers(len(group), size=(RESAMPLES, len(group)))].mean(1) for group in groups], axis=0)
    return center, float(np.std(np.exp(draws)))


def _ratios(columns: dict[str, dict[Cell, float]], title: str) -> str:
    columns = {name: ratios for name, ratios in columns.items() if ratios}
    if not columns:
        return ""
    rows = [[title, *columns]]
    for family in dict.fromkeys(family for ratios in columns.values() for family, _ in ratios):
        row = [geometric({cell: r for cell, r in ratios.items() if cell[0] == family}) for ratios in columns.values()]
        rows.append([family, *(with_error(*one) for one in row)])
    rows.append(["all", *(with_error(*geometric(ratios)) for ratios in columns.values())])
    return _table(rows)


def by_scene(lines: Sequence[Line], grading: str, chosen: Callable[[Line], bool]) -> dict[Cell, float]:
    """Mean over azimuths of the mean error of each scene's chosen lines."""
    values: dict[Cell, list[float]] = defaultdict(list)
    for line in lines:
        if chosen(line) and f"{grading}.mean" in line:
            values[_text(line, "family"), int(str(line["seed"]))].append(_number(line, f"{grading}.mean"))
    return {cell: float(np.mean(errors)) for cell, errors in values.items()}


def _identity(line: Line) -> tuple[object, ...]:
    keys = ("family", "seed", "reflectance", "fault", "pattern", "lights", "azimuth")
    return tuple(line.get(key) for key in keys)


def _text(line: Line, key: str) -> str:
    return str(line[key])


def _count(line: Line) -> int:
    return int(str(line["lights"]))


def _number(line: Line, key: str) -> float:
    return float(str(line[key]))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan


def _shown(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2f}"


def with_error(value: float, error: float) -> str:
    """A figure ± its standard error; empty if there is no figure."""
    if math.isnan(value):
        return ""
    return f"{value:.3f}" if math.isnan(error) else f"{value:.3f} ±{error:.3f}"


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
