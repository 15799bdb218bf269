"""Where the arm must go: which lights it can take, and certified joint paths through the ones that are wanted.

Before: `pilot` or `plan`, which choose from `reach.reach`. After: `capture`, which follows `route.route`. Everything in
here is in the arm's base frame; lights come in and go out in the view frame.
"""
