"""Reachability of lights, and certified collision-free joint paths through the planned ones.

Before: `pilot` or `plan`, which choose from `reach.reach`. After: `capture`, which follows `routing.route`. Internally
all coordinates are in the arm's base frame; lights are passed in and returned in the view frame.
"""
