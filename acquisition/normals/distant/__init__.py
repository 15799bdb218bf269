"""Normals from distant lights: from least squares for a few images to reflectance fits for many of a glossy object.

`solve(images, solver)` takes an ImageSet with DistantLights and gives a NormalMap.
"""
