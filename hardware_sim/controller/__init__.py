"""A UR e-Series controller (PolyScope 5.11.1) in software: real sockets, the real library on the other side.

    sockets · delay → rtde (registers · publication · dynamics) · dashboard · robot_api · control_port the protocols
    streams · scripts · interpreter_port (interpreter)                                         the same, 30001–30020
    syntax · syntax_tree → compiler → program + …_functions (semantics · script_values · script_links) ← program_loader
    kinematics · calibration · poses → profile · curves → moves · blend · process_path · steering · limits → arm
    surroundings · contact → collisions · safety · watchdogs · signals                         causes of stops
    freedrive · force                                                                          pushed, and pushing
    robot · messages                                                                           what these see, and say
    controller                                                                                 one tick of 2 ms
    faults · disturbances · trace · program_store                                              on demand
    server · options                                                                           the event loop

`serve` runs one and blocks; `process.ControllerProcess` runs one in a child; `control.ControlClient` reads the true
state and orders faults; `trace.read_trace` reads back every tick.

What the unmodified ur-rtde 1.6.5 does when something fails here, row by row, each with the test that shows it:
`docs/reference/ur-rtde-failures.md`.
"""

from hardware_sim.controller.server import serve

__all__ = ["serve"]
