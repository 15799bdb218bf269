"""Solve of single pixels: albedo × normal by iteratively reweighted least squares, under Lambert's law and beyond.

`pixel_solve` is the entry. What pixels share (lamps, terms, indirect light, noise) is given.
"""
