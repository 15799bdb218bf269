"""A UR e-Series controller (PolyScope 5.11.1) in software, on real sockets, driven by the real client library.

    sockets · delay → rtde (registers · publication · dynamics) · dashboard · robot_api · control_port     protocols
    streams · scripts · interpreter_port (interpreter)                                         the same, 30001–30020
    syntax · syntax_tree → compiler → program + …_functions (semantics · script_values · script_links) ← program_loader
    kinematics · calibration · poses → profile · curves → moves · blend · process_path · steering · limits → arm
    surroundings · contact → collisions · safety · watchdogs · signals                         causes of stops
    freedrive · force                                                                          hand guiding, force mode
    robot · messages                                                                           their state and messages
    controller                                                                                 one tick of 2 ms
    faults · disturbances · trace · program_store                                              used on demand
    server · options                                                                           the event loop

`serve` runs one and blocks; `process.ControllerProcess` runs one in a child; `control.ControlClient` reads the true
state and orders faults; `trace.read_trace` reads back every tick.

`docs/reference/ur-rtde-failures.md` lists what the unmodified ur-rtde 1.6.5 does when something fails here, each row
with the test that shows it.
"""

from hardware_sim.controller.server import serve

__all__ = ["serve"]
