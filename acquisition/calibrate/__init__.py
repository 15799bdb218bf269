"""Calibration of the cell: camera and camera to arm from images of a ChArUco board, lamp from a mirror sphere.

Pure estimation: images and joints in, values with their covariance out. All corners of all views are adjusted together
(`bundle_adjustment`), because closed forms on poses (AX = XB) weight a distant view like one that fills the image, and
give no uncertainty.
"""
