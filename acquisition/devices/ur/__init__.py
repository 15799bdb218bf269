"""The UR arm and its lamp output: proxies in the service, and a driver process, which alone uses ur-rtde."""
