"""Uncertainty: noise from frames and residuals, goodness of fit, and the variance components of σ."""
