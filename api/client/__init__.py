"""The Python clients of the REST service."""
