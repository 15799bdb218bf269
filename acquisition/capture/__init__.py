"""Move, settle, light, expose, check: the only stage with hands.

Before: `waypoints`, whose checked joint paths are all that is ever sent to the arm. After: `normals`.
`take` moves and exposes, `exposure` chooses exposure times, `check` says whether a frame is good.
"""
