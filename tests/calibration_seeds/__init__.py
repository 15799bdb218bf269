"""The whole demonstration of a cell that calibrates itself, over seeds: `python -m tests.calibration_seeds`."""
