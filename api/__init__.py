"""HTTP, the command line and the Python client; no photometry and no motion of its own."""
