"""Capture: move, wait for rest, switch the lamp, expose, check. The only stage that commands devices.

Before: `waypoints`, whose collision-checked joint paths are all that is ever sent to the arm. After: `normals`.
`take` moves and exposes, `exposure` chooses exposure times, `check` judges a frame's quality.
"""
