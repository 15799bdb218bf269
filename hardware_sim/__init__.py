"""Simulated cell: a UR controller on real sockets, and a rendered world with a lamp, an object and a camera.

Two processes: `controller` (sockets, script interpreter, motion, safety) and the world (`world`, `render`, `sensor`,
`camera`), so that a long render never delays the controller's 500-Hz tick. `cell` starts both. `grade` compares the
normals that `acquisition` estimates with the ground truth; no other module imports both sides.
"""
