"""The UR arm and its lamp output: proxies in the service, a driver process that alone speaks ur-rtde."""
