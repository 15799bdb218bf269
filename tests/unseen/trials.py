"""Records model selection in a solve: scores of the missing terms, and the trial of each alternative.

The thresholds of `acquisition.normals.alternatives` (`model_trial`, `term_alternatives`, `lamp_alternatives`) lie
between the values of sound and of faulty captures. A run stores the values with each solve (`recorded`). `python -m
tests.unseen table FILE --trials` shows their ranges, so that a threshold can be checked on scenes to which it was not
tuned.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, cast
from unittest.mock import patch

import numpy as np

from acquisition.normals.alternatives import lamp_alternatives, model_selection, model_trial, term_alternatives
from acquisition.normals.alternatives.alternative import Alternative
from acquisition.normals.alternatives.model_trial import Hypothesis, Solution

Line = dict[str, object]


@dataclass(frozen=True)
class Trial:
    """One trial: amounts of its term by one `step` and as the descent's `estimate`; ratios after / before of misfit,
    share of residuals and loss; and whether it was accepted."""

    kind: str
    step: float
    estimate: float
    misfit: float
    share: float
    accepted: bool
    loss: float = math.nan


@dataclass
class Record:
    """`scores` of the plain model, as (gain, amount by one step) of each term, and `trials` in order."""

    scores: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    trials: list[Trial] = field(default_factory=list[Trial])

    def line(self) -> Line:
        """The record as keys of a run's line."""
        return {"scores": self.scores, "trials": [asdict(trial) for trial in self.trials]}


@contextmanager
def recorded() -> Generator[Record]:
    """Records the solves within its context, and restores the product's functions afterwards."""
    record = Record()
    solve, accepted = model_selection.solve, Alternative.accepted

    def recording_solve(hypothesis: Hypothesis) -> Solution:
        solution = solve(hypothesis)
        if not hypothesis.corrected and solution.scores is not None:
            of_term = vars(solution.scores)
            record.scores = {name: (float(one.gain), float(one.step)) for name, one in of_term.items()}
        return solution

    def recording_accepted(self: Alternative, before: Solution, trial: Solution) -> bool:
        verdict, terms = accepted(self, before, trial), trial.state.shared.terms
        record.trials.append(
            Trial(
                self.kind,
                float(self.step),
                float(terms.roughness + terms.ambient + terms.offset + terms.gloss + terms.metal),
                float(trial.fit.misfit / before.fit.misfit),
                float(trial.fit.relative_residual / before.fit.relative_residual),
                bool(verdict),
                float(trial.fit.loss / before.fit.loss),
            )
        )
        return verdict

    with (
        patch.object(model_selection, "solve", recording_solve),
        patch.object(Alternative, "accepted", recording_accepted),
    ):
        yield record


def score_table(lines: Sequence[Line], group: Callable[[Line], str], table: Callable[[list[list[str]]], str]) -> str:
    """Log-likelihood gains by group and term, 0 where the step's amount is too small to be tried: number of captures,
    median, 90th percentile and maximum of the gain, and number of captures that demand a trial."""
    least = asdict(term_alternatives.SETTINGS.min_step) | {
        "exponent": model_trial.SETTINGS.coded_exponent,
        "turn": math.radians(lamp_alternatives.REFINED_DEG),
        "excess": term_alternatives.SETTINGS.min_step.offset,
    }
    gains: dict[tuple[str, str], list[float]] = defaultdict(list)
    for line in lines:
        scores = cast("dict[str, tuple[float, float]]", line.get("scores") or {})
        for term, (gain, step) in scores.items():
            amount = {"exponent": -step, "excess": -step, "turn": abs(step)}.get(term, step)
            gains[group(line), term].append(gain if amount > least[term] else 0.0)
    rows = [
        [name, term, str(len(all_)), *(f"{value:.1f}" for value in _range(all_)), f"{_demanded(all_)}"]
        for (name, term), all_ in sorted(gains.items())
        if max(all_) > 0
    ]
    head = ["scores", "term", "captures", "median gain", "p90", "greatest", "demanded"]
    return table([head, *rows]) if rows else ""


def trial_table(lines: Sequence[Line], group: Callable[[Line], str], table: Callable[[list[list[str]]], str]) -> str:
    """Accepted and refused trials by group and kind: ranges of the ratios after / before of misfit, share of residuals
    and loss, and of the ratio of the estimate to the amount by one step."""
    trials: dict[tuple[str, str, bool], list[Trial]] = defaultdict(list)
    for line in lines:
        for one in cast("list[dict[str, Any]]", line.get("trials") or []):
            trial = Trial(**one)
            trials[group(line), trial.kind, trial.accepted].append(trial)
    rows: list[list[str]] = []
    for (name, kind, accepted), all_ in sorted(trials.items()):
        promised = [trial.estimate / trial.step for trial in all_ if trial.step > 0]
        ratios = [[trial.misfit for trial in all_], [trial.share for trial in all_], [trial.loss for trial in all_]]
        verdict = "accepted" if accepted else "refused"
        rows.append([name, kind, verdict, str(len(all_)), *map(_extremes, [*ratios, promised])])
    head = ["trials", "kind", "", "trials", "misfit ×", "share ×", "loss ×", "estimate / promised"]
    return table([head, *rows]) if rows else ""


def _extremes(values: Sequence[float]) -> str:
    """Range of the known values; fits that cannot be judged and older lines have unknown ones."""
    known = [value for value in values if math.isfinite(value)]
    return f"{min(known):.2f}–{max(known):.2f}" if known else ""


def _demanded(gains: Sequence[float]) -> int:
    return sum(gain > model_trial.SETTINGS.min_gain for gain in gains)


def _range(gains: Sequence[float]) -> tuple[float, float, float]:
    return float(np.median(gains)), float(np.quantile(gains, 0.9)), max(gains, default=math.nan)
