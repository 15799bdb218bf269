"""What planning brings, measured: the paper's own figures, its errata, and errors against the number of images.

`scenes` gives objects, images and errors without an arm; the other modules each make one part of the page.
"""
