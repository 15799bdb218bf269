"""A reflectance of its own for each pixel, under many distant lights, where no model of the whole object fits."""
