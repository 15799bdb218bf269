"""Photometric stereo with planned lights: the work itself, without the web and without the simulator.

pilot       where the first lights go
waypoints   joint paths that reach the lights safely
capture     move, settle, light, expose, check: one image per light
normals     images → normal map, albedo, depth and the uncertainty of each pixel
plan        which further lights would make the normals most certain; none: finished
A session loops over these in `runner`; `session` says what may happen when; `store` keeps the journal.
"""

import os

# Threads that wait for the next parallel loop sleep. OpenMP lets them spin, which takes the cores from the driver's
# kicks and from every other process: on two busy cores a plan took three times as long. Read when the first loop runs.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
