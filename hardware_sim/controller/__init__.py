"""A UR e-Series controller (PolyScope 5.11.1) in software: real sockets, the real library on the other side.

    sockets → rtde · dashboard · scripts · control_port      what clients speak
    syntax → compiler → program + functions                  the URScript that the library uploads
    arm · motion · profile · kinematics · poses              what moves
    controller                                               modes, safety, outputs, one tick of 2 ms
    server                                                   the loop that joins them

`serve` runs one and blocks; `process.ControllerProcess` runs one in a child; `control.ControlClient` reads the truth
and orders faults; `trace.read_trace` reads back every joint sample.
"""

from hardware_sim.controller.server import serve

__all__ = ["serve"]
