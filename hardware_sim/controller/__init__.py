"""A UR e-Series controller (PolyScope 5.11.1) in software: real sockets, the real library on the other side.

    sockets → rtde · dashboard · scripts · control_port      what clients speak
    syntax → compiler → program + functions                  the URScript that the library uploads
    arm · motion · profile · kinematics · poses              what moves
    controller                                               modes, safety, outputs, one tick of 2 ms
    server                                                   the loop that joins them

`serve` runs one and blocks; `process.ControllerProcess` runs one in a child; `control.ControlClient` reads the truth
and orders faults; `trace.read_trace` reads back every joint sample.

What the unmodified ur-rtde 1.6.5 does when this controller fails (each row is a test in `test_failures`):

    nobody listens                     constructors raise RuntimeError "Could not connect to"
    local control                      the control constructor raises RuntimeError "enable remote control"
    registers owned by another client  constructors raise RuntimeError "already in use"
    program stopped in a synchronous move       False at once; the arm brakes
    program stopped in an asynchronous move     the progress word says "running" until the next upload
    program stopped earlier            moves and setters False, getters RuntimeError, inverse kinematics []
    protective stop in a move          False at once; an upload during the stop says True and does nothing
    unlocking before 5 s               RuntimeError "Cannot unlock protective stop until 5s after occurrence"
    triggerProtectiveStop              False, although it worked
    emergency stop in a move           False; power and program are gone, power on and brake release bring back
    pose without solution              [], and the program is dead
    refused function (force, freedrive …)       False, and the program is dead; the log names the function
    watchdog and a synchronous move    False after the watchdog's period
    foreign program                    isProgramRunning stays True, the next move blocks until that program ends
    link cut                           isConnected False on the receive side; reconnect() works
    controller killed                  isConnected False, isProgramRunning True for ever; moves block
    client killed in a move            the move goes on, its inputs are free at once
    controller frozen for over 2.5 s   the library drops its link and uploads anew; the move returns False
"""

from hardware_sim.controller.server import serve

__all__ = ["serve"]
