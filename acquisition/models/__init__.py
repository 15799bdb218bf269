"""The values that the stages hand to one another, by noun: recipe, plan, route, calibration, shots, results, errors."""
