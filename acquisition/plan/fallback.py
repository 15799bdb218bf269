"""Fallback rule: diagnostics of the plan's model, and when the two-ring pattern replaces the plan.

A plan is only as good as the shape it was made from. Shadows in the images that the reconstructed shape cannot cast
indicate depth discontinuities that its depth map lacks: pixels there mix top and wall, grazing light aggravates that,
and one-sided sets of lights turn it into biased normals. On a glossy surface of which most mirrors one lamp at once,
few lights separate the highlight from depth and lamp intensity; the residual biases all normals alike, unless the
lights surround the object evenly. Where the predicted gain is negligible, a pattern that depends on no model is
preferred. Decision 0029.
"""

from dataclasses import dataclass

MAX_UNEXPLAINED_SHADOWS = 0.005
"""Share of unexplained shadows above which the depth map is not trusted: 0–0.4 % on objects without steps, 0.6–6
% on a machined part. There eight planned lights are no better on average than steep rings (0.525° and 0.542° over 16
draws of the study, 0.60° and 0.54° over six through the arm), and single plans reach 1.8 times the error of two
rings."""

MAX_MIRRORED_SHARE = 0.4
"""Share of pixels that mirror one lamp at once above which a plan is rejected: 5–17 % on curved glossy objects, 78 %
and more on flat ones, where twelve images with planned lights have between 0.6 and 1.8 times the error of two rings,
and with steeper completed rings between 0.8 and 1.5 times."""

MIN_GAIN = 0.02
"""Fraction by which a plan must lower the predicted loss of two rings; of `capped`, a variance, that is 1 % of σ."""


@dataclass(frozen=True)
class PlanDiagnostics:
    """Checks of a plan: the share of shadows that the shape does not explain, the share of pixels that mirror one lamp
    at once, and the fraction by which the plan lowers the predicted loss of two rings; all in 0–1."""

    unexplained_shadows: float
    mirrored_share: float
    gain: float

    @property
    def fallback_reason(self) -> str | None:
        """Reason why two rings replace the plan; none: the plan is kept."""
        if self.unexplained_shadows > MAX_UNEXPLAINED_SHADOWS:
            return (
                f"{self.unexplained_shadows:.1%} of the measurements that the shape so far predicts as lit are dark: "
                "the object has steps that its depth map lacks, and evenly placed lights suffer least from them"
            )
        if self.mirrored_share > MAX_MIRRORED_SHARE:
            return (
                f"the surface is glossy, and {self.mirrored_share:.0%} of it mirrors one lamp at once: the residual "
                "highlight biases all normals the same way, least under evenly placed lights"
            )
        if self.gain < MIN_GAIN:
            return (
                f"planned lights are expected to lower the recipe's objective by {max(self.gain, 0):.1%} only, "
                "less than the accuracy of the model"
            )
        return None
