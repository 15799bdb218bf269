"""Selection of the image model: tests of what the plain model leaves out, and alternatives tried where a test demands.

`model_selection` is the entry. Above the final solve, which it calls for every model on trial.
"""
