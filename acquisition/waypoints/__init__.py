"""Reachability of lights, and certified collision-free joint paths through the planned ones.

Before: `pilot` or `plan`, which choose from `reach.reach`. After: `capture`, which follows `routing.route`. Everything
in here is in the arm's base frame; lights come in and go out in the view frame.
"""
