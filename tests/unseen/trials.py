"""What model selection looked at in a solve: scores of the missing terms, and the trial of each alternative.

The thresholds of `acquisition.normals.alternatives` (`model_trial`, `term_alternatives`, `lamp_alternatives`) stand
between what sound and what faulty captures have of these. A run keeps them with each solve (`recorded`); `python -m
tests.unseen table FILE --trials` shows their ranges, so that a threshold can be checked against scenes that it was not
set on.
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
    """One trial: what one step promised and the descent estimated of its term, misfit, share of residuals and loss
    after over before, and whether it was accepted."""

    kind: str
    step: float
    estimate: float
    misfit: float
    share: float
    accepted: bool
    loss: float = math.nan


@dataclass
class Record:
    """`scores` of the plain model, (gain, amount by one step) of each term; `trials` in their order."""

    scores: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    trials: list[Trial] = field(default_factory=list[Trial])

    def line(self) -> Line:
        """As keys of a run's line."""
        return {"scores": self.scores, "trials": [asdict(trial) for trial in self.trials]}


@contextmanager
def recorded() -> Generator[Record]:
    """Records the solves of its context; what it has put in place of the product's functions is gone afterwards."""
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
    """Gains of the log likelihood by group and term, of captures where the step has an amount that would be tried:
    how many there are, the median gain, the greatest, and how many are demanded."""
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
    """Trials by group and kind: misfit, share of residuals and loss after over before, and estimate over what a step
    promised, least to greatest, of the accepted and of the refused ones."""
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
    """Least to greatest of those that are known: some are not, of fits that cannot be judged and of older lines."""
    known = [value for value in values if math.isfinite(value)]
    return f"{min(known):.2f}–{max(known):.2f}" if known else ""


def _demanded(gains: Sequence[float]) -> int:
    return sum(gain > model_trial.SETTINGS.min_gain for gain in gains)


def _range(gains: Sequence[float]) -> tuple[float, float, float]:
    return float(np.median(gains)), float(np.quantile(gains, 0.9)), max(gains, default=math.nan)
