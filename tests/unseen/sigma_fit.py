"""Fits σ's constants, the weights of `error_variance`'s components, to errors of design captures by maximum likelihood.

Each capture gives the components of a sample of its pixels, with their errors. Errors follow Rayleigh's law with a
heavy tail (bivariate t of TAIL degrees of freedom). The weights maximise the likelihood over all captures without
uncorrected findings, each capture counting alike. They are then scaled to a stated P(e < σ), because σ is read by its
level, not by its tail. For captures with uncorrected findings the most likely E is stated separately. With a fault
(`--fault gamma`) no other model is selected, so that the fault stays uncorrected.
"""

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from acquisition import photometry
from acquisition.models.base import FloatArray
from acquisition.models.errors import RigError
from acquisition.models.result import NormalMap
from acquisition.normals.uncertainty import error_variance
from acquisition.normals.uncertainty.error_variance import ErrorVariance
from tests.unseen import faults, run, stages
from tests.unseen.captures import capture
from tests.unseen.patterns import fixed
from tests.unseen.scenes import Scene

TAIL = 20.0
"""Degrees of freedom of the bivariate t distribution. The constants depend on it: with fewer (`--tail 8`), the tail
explains large errors, so that the components need not."""

SHARE = 0.69
"""P(e < σ), over the pixels of all captures, to which the constants are scaled."""

PIXELS = 800
"""Number of pixels in each capture's sample."""

NAMES = ("posterior A", "misfit B", "crease M²", "detail M²", "line 1/2", "few lights E²")
"""Components and their constants; the posterior's A is 1 if the others are right to scale."""

CREASES_DEG = (8.0, 12.0, 16.0, 20.0, 24.0)
"""Values of Δ₀ that are compared."""

CHANGE = 2
"""Index of the component that is recorded before Δ₀² is subtracted."""

ARRAYS = ("error_deg", "components", "own_misfit", "by_field", "sigma_deg")
"""Arrays of a sample, as fields of `Errors`."""


@dataclass(frozen=True)
class Errors:
    """A sample of one capture's pixels: errors e (N,) and the solve's σ (N,), degrees, components (6, N), of which the
    third is χ² Δ², χ² itself (N,) of the pixel's own images, and 1/σ² by the Markov random field (N,), deg⁻²."""

    family: str
    seed: int
    lights: int
    unsound: bool
    error_deg: FloatArray
    components: FloatArray
    own_misfit: FloatArray
    by_field: FloatArray
    sigma_deg: FloatArray

    def regressors(self, crease_deg: float) -> FloatArray:
        """The components (6, N) for Δ₀."""
        out = self.components.copy()
        out[CHANGE] = np.maximum(out[CHANGE] - crease_deg**2 * self.own_misfit, 0)
        return out

    def variance(self, by_images: FloatArray) -> FloatArray:
        """σ² (N,), deg², of a variance by the images (N,): bounded, and lowered by the field."""
        return 1 / (1 / photometry.bounded_variance(by_images) + self.by_field)


def collect(plan: run.Plan, folder: Path, jobs: int) -> None:
    """Solves the plan's captures and writes each one's sample into the folder; existing samples are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    run.over_scenes(partial(_collect_scene, plan, folder), plan.families, plan.seeds, jobs)


def read(folder: Path) -> list[Errors]:
    """The samples of a folder."""
    return [_read(path) for path in sorted(folder.glob("*.npz"))]


def fit(
    captures: Sequence[Errors], crease_deg: float, without: int | None = None, *, tail: float = TAIL
) -> tuple[FloatArray, float]:
    """Weights (6,) of greatest likelihood over captures without findings, and the mean negative log-likelihood; the
    weight of number `without` is held near zero."""
    data = [(one, one.regressors(crease_deg), one.error_deg**2) for one in captures]
    bounds = [(-12.0, -12.0 if number == without else 6.0) for number in range(len(NAMES))]

    def objective(log_weights: FloatArray) -> tuple[float, FloatArray]:
        weights, value, slope = np.exp(log_weights), 0.0, np.zeros(len(log_weights))
        for one, parts, square in data:
            by_images = weights @ parts + 1e-4
            variance = one.variance(by_images)
            value += _negative_log_likelihood(variance, square, tail)
            # ∂ ln(variance)/∂(by_images) = variance/by_images²
            q = square / (tail * variance)
            change = (1 - (tail + 2) / 2 * q / (1 + q)) * variance / by_images**2
            slope += weights * np.mean(change * parts, axis=1)
        return value / len(data), slope / len(data)

    found = minimize(objective, np.zeros(len(NAMES)), jac=True, method="L-BFGS-B", bounds=bounds)
    weights = np.exp(found.x)
    # e < σ if 1/e² less what bound and field contribute to 1/σ² is above the inverse of the variance by the images.
    far = 1 / photometry.RANDOM_NORMAL_SIGMA_DEG**2
    ratio = np.concatenate(
        [
            1 / np.maximum(1 / square - far - one.by_field, 1e-9) / (weights @ parts + 1e-4)
            for one, parts, square in data
        ]
    )
    return weights * np.quantile(ratio, SHARE), float(found.fun)


def unsound_sigma_deg(
    captures: Sequence[Errors], weights: FloatArray, crease_deg: float, *, tail: float = TAIL
) -> float:
    """The most likely E, degrees, of captures with uncorrected findings, in steps of 0.5° up to 90°."""
    trials = np.arange(0.0, 90.0, 0.5)
    level = tail * ((1 - SHARE) ** (-2 / tail) - 1)  # σ² below which SHARE of e² lies, over the variance of one axis

    def value(trial: float) -> float:
        by_images = [weights @ one.regressors(crease_deg) + trial**2 for one in captures]
        return float(
            np.mean(
                [
                    _negative_log_likelihood(one.variance(variance) / level, one.error_deg**2, tail)
                    for variance, one in zip(by_images, captures, strict=True)
                ]
            )
        )

    return float(min(trials, key=value))


def summary(captures: Sequence[Errors], tail: float = TAIL) -> str:
    """Fits for each Δ₀, the constants of the best one, E, and figures of the solves' σ by family and light count."""
    sound = [one for one in captures if not one.unsound]
    lines = [f"{len(captures)} captures, {len(captures) - len(sound)} of them with uncorrected findings", ""]
    fits = {crease: fit(sound, crease, tail=tail) for crease in CREASES_DEG}
    for crease, (weights, value) in fits.items():
        shown = "  ".join(f"{name} {weight:.3f}" for name, weight in zip(NAMES, weights, strict=True))
        lines.append(f"Δ₀ {crease:.0f}°  −log likelihood {value:.4f}  {shown}")
    best = min(fits, key=lambda crease: fits[crease][1])
    weights = fits[best][0]
    lines.append(
        f"best Δ₀ {best:.0f}°: A {weights[0]:.2f}, B {weights[1]:.2f}, M {weights[2] ** 0.5:.2f}, "
        f"of detail {weights[3] ** 0.5:.2f}, E {weights[5] ** 0.5:.1f}°"
    )
    for number, name in enumerate(NAMES):
        value = fit(sound, best, number, tail=tail)[1]
        lines.append(f"without {name}: −log likelihood {value - fits[best][1]:+.4f}")
    if unsound := [one for one in captures if one.unsound]:
        lines.append(f"E {unsound_sigma_deg(unsound, weights, best, tail=tail):.1f}°")
    return "\n".join([*lines, "", *_cells(captures)])


def _negative_log_likelihood(variance: FloatArray, square: FloatArray, tail: float) -> float:
    """Mean over pixels, for a variance (N,) along each axis and squared errors (N,), deg²."""
    return float(np.mean(np.log(variance) + (tail + 2) / 2 * np.log1p(square / (tail * variance))))


def _cells(captures: Sequence[Errors]) -> Iterator[str]:
    """P(e < σ), P(e < 2σ) and rms e/σ of the solves by family and number of lights, as means over captures."""
    cells: dict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    for one in captures:
        ratio = one.error_deg / one.sigma_deg
        cells[one.family, one.lights].append(
            (float(np.mean(ratio < 1)), float(np.mean(ratio < 2)), float(np.sqrt(np.mean(ratio**2))))
        )
    for (family, lights), rows in sorted(cells.items()):
        within_1, within_2, rms = np.mean(rows, axis=0)
        yield f"{family:9s} {lights:2d}  P(e<σ) {within_1:.2f}  P(e<2σ) {within_2:.2f}  rms e/σ {rms:.2f}"


def _collect_scene(plan: run.Plan, folder: Path, family: str, seed: int) -> int:
    """Writes the missing samples of one scene; returns the number of its samples."""
    fault = f"-{plan.fault}" if plan.fault else ""
    paths = {count: folder / f"{family}-{seed}-{count}{fault}.npz" for count in plan.lights}
    if all(path.exists() for path in paths.values()):
        return len(paths)
    scene = run.drawn(plan, family, seed)
    for count, path in paths.items():
        if path.exists():
            continue
        try:
            sample = _solve(scene, count, plan.fault)
        except RigError:
            continue
        part = path.with_suffix(".part")
        with part.open("wb") as file:
            np.savez(file, **sample)
        part.rename(path)
    return sum(path.exists() for path in paths.values())


def _solve(scene: Scene, count: int, fault: str | None) -> dict[str, np.ndarray]:
    """Solves a capture under two rings of `count` lights, with an azimuth by the seed, and samples graded pixels. A
    capture with a fault is solved by the plain model."""
    recorded: list[tuple[FloatArray, ...]] = []

    def record(*maps: np.ndarray, capture_deg: float, sharpened: bool) -> ErrorVariance:
        found = original(*maps, capture_deg=capture_deg, sharpened=sharpened)
        *of_components, _ = maps
        parts = error_variance.components(*of_components, typical=found.typical_excess)
        own = error_variance.own_misfit(maps[1], maps[2])
        parts[CHANGE] = own * error_variance.crease_deg2(of_components[-1], np.isfinite(maps[0]))
        recorded.append((parts, own, found.sigma_deg))
        return found

    original = error_variance.evaluate
    captured = capture(scene, fixed("two-rings", scene, count, scene.seed % 4, 4), fault=faults.named(fault))
    patches = [stages.Patch(error_variance, "evaluate", record)]
    if fault is not None:
        patches += next(stage for stage in stages.STAGES if stage.name == "model selection").patches
    with stages.off(stages.Stage("", "", tuple(patches))):
        solved = run.solve(scene, captured)
    chosen = _graded(scene, solved)
    findings = [finding for finding in solved.findings if not finding.corrected]
    about = {"family": scene.family, "seed": scene.seed, "lights": count, "unsound": bool(findings)}
    components, own, by_images_deg = (values.reshape(*values.shape[:-2], -1)[..., chosen] for values in recorded[-1])
    sigma_deg = solved.sigma_deg.ravel()[chosen]
    return {
        "error_deg": scene.truth.error_deg(solved.normals).ravel()[chosen],
        "sigma_deg": sigma_deg,
        "components": components,
        "own_misfit": own,
        "by_field": np.maximum(1 / sigma_deg**2 - 1 / by_images_deg**2, 0),
        "about": np.array(json.dumps(about)),
    }


def _graded(scene: Scene, solved: NormalMap) -> np.ndarray:
    """Numbers of a sample of pixels: solved, not doubtful, within 78°."""
    graded = solved.mask & scene.truth.within_78_deg & np.isfinite(solved.sigma_deg) & ~solved.doubtful
    return np.random.default_rng(0).permutation(np.flatnonzero(graded))[:PIXELS]


def _read(path: Path) -> Errors:
    with np.load(path) as kept:
        about = json.loads(str(kept["about"]))
        arrays = {name: kept[name].astype(float) for name in ARRAYS}
    return Errors(**about, **arrays)
