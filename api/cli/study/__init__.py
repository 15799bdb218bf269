"""What planning brings, measured: the paper's own figures, its errata, and errors against the number of images.

`scenes` gives objects, images and errors without an arm; `paper`, `three` and `curves` each measure one part; `whole`
runs them in two processes and `page` shows what they found.
"""
