"""Bench of planned exposures against automatic ones: `python -m tests.exposures`."""
