"""When not to plan: where the two-ring pattern is taken instead, and why.

A plan is as good as the shape it was made from. Where the images show shadows that the shape cannot throw, there are
steps that its depth map does not have: pixels on them mix top and wall, grazing lights make that worse, and sets of
lights that lean to one side turn it into wrong normals. A glossy surface most of which mirrors the lamp at once tells
highlight from depth and lamp intensity by few lights only; what is left of the highlight pulls all its normals alike,
unless the lights stand evenly round it. Where a plan is expected to bring next to nothing, a pattern that leans on no
model at all is the better choice.
"""

from dataclasses import dataclass

STEPS_FROM = 0.005
"""Share of unexplained shadows above which the depth map is not to be trusted: 0–0.4 % on objects without steps, 0.6–6
% on a machined part. There eight planned lights are no better on the whole than steep rings (0.525° and 0.542° over 16
draws of the study, 0.60° and 0.54° over six through the arm), and single plans come out at 1.8 times two rings."""

MIRROR_FROM = 0.4
"""Share of pixels that mirror one lamp at once above which a plan is not taken: 5–17 % on curved glossy objects, 78 %
and more on flat ones, where twelve images with planned lights come out between 0.6 and 1.8 times the error of two
rings, and with rings completed steeply between 0.8 and 1.5 times."""

LEAST_GAIN = 0.02
"""Share by which a plan must be expected to lower the pattern's loss; of `capped`, a variance, that is 1 % of σ."""


@dataclass(frozen=True)
class Doubts:
    """What speaks against a plan: the share of shadows that the shape does not explain, the share of pixels that mirror
    one lamp at once, and the share by which the plan is expected to lower the pattern's objective."""

    unexplained: float
    mirrored: float
    gain: float

    @property
    def fallback(self) -> str | None:
        """Why the pattern is to be taken; none: the plan is."""
        if self.unexplained > STEPS_FROM:
            return (
                f"{self.unexplained:.1%} of what the shape found so far would light is dark in the images: the object "
                "has steps that its depth map does not show, and evenly placed lights suffer least from them"
            )
        if self.mirrored > MIRROR_FROM:
            return (
                f"the surface is glossy, and {self.mirrored:.0%} of it mirrors one lamp at once: what is left of such "
                "a highlight turns all normals the same way, least under evenly placed lights"
            )
        if self.gain < LEAST_GAIN:
            return (
                f"planned lights are expected to lower the recipe's objective by {max(self.gain, 0):.1%} only, "
                "less than a model is to be trusted"
            )
        return None
