"""Selection of the image model: tests of what the plain model leaves out, and trials of alternatives that tests demand.

`model_selection` is the entry point. It calls the final solve for every model on trial, so this package is above it.
"""
