"""Simulated cell: a UR controller on real sockets, and a rendered world with a lamp, an object and a camera.

It has two processes, so that a long render never delays the controller's 500-Hz tick: `controller` (sockets, script
interpreter, motion, safety) and the world (`world`, `render`, `sensor`, `camera`). `cell` starts both. `grade` and
`grade_calibration` compare the results of `acquisition` with the ground truth; no other module imports both sides.
"""
