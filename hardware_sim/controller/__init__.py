"""A UR e-Series controller (PolyScope 5.11.1) in software: real sockets, the real library on the other side.

    sockets · delay → rtde (registers · publication · dynamics) · dashboard · robot_api · control_port the protocols
    streams · scripts · interpreter_port (interpreter)                                         the same, 30001–30020
    syntax · syntax_tree → compiler → program + …_functions (semantics · script_values · script_links) ← program_loader
    kinematics · calibration · poses → profile · curves → moves · blend · process_path · steering · limits → arm
    surroundings · contact → collisions · safety · watchdogs · inputs · outputs                causes of stops
    freedrive · hand_guiding · force                                                           pushed, and pushing
    robot · messages                                                                           what these see, and say
    controller                                                                                 one tick of 2 ms
    faults · disturbances · trace · program_store                                              on demand
    server · options                                                                           the event loop

`serve` runs one and blocks; `process.ControllerProcess` runs one in a child; `control.ControlClient` reads the true
state and orders faults; `trace.read_trace` reads back every tick.

What the unmodified ur-rtde 1.6.5 does when something fails here, and the test that shows it. `failures`, `links`, … are
`tests/hardware_sim/controller/test_failures.py` and so on; (long) is run by `make test-long` alone.

Constructing
    nobody listens                      RuntimeError "Could not connect to"                         failing_links
    the port is open and silent         waits for ever, the interpreter's lock held                 failing_links
    controller in the client's process  deadlock                                                    failing_links (long)
    local control                       RuntimeError "enable remote control"                        failing_links
      the same, check switched off      RuntimeError "Failed to start control script" after 5 s     links (long)
    registers owned by another client   RuntimeError "already in use"; free once that hangs up      links
    unknown output variable             RuntimeError naming it                                      links
    an old control program still runs   stopped and replaced                                        links
      it listens in the lower range,
      the client in the upper           4 s, then as above                                          failing_links (long)
      the other way round               hangs                                                       failing_links (long)

The program
    stopped in a synchronous move       False at once; the arm brakes                               failures
    stopped in an asynchronous move     the progress register says "running" until the next upload  failures
    stopped earlier                     moves and setters False, getters RuntimeError, stops None,
                                        inverse kinematics []                                       failures
    paused at the pendant               False at once; after `play` the arm goes on with the move   ordered_faults
    uploaded anew                       True before it runs: a move right after it is False         failures
    replaced by a foreign one           isProgramRunning stays True; a move blocks until that ends,
                                        then False; the arm brakes                                  failures
    a foreign one that is refused       nothing: what runs goes on; a text to RTDE clients          failures
    pose without solution               [] or False, and the program is dead                        failures
    function that is not simulated      False, and the program is dead; log and text name function
                                        and line. What the library does not wait for (servoC)
                                        says True, and must be asked for no more before an
                                        upload helps: any call that says False takes it back        failures
    custom script, good                 True, the control script runs again                         conformance
    custom script, bad                  blocks (300 s): it waits for the script's reply             failing_links
    watchdog and a synchronous move     False after the watchdog's period                           failures
    watchdog kicked                     the move lives; dies one period after the last kick         conformance
    values out of range                 ValueError, nothing is sent; outputs and slider are not
                                        checked, and stay what they were                            failures, io
    forward kinematics of given joints  wrong: the tool offset is not sent (give 1e-12)             conformance
    stopL, stopJ                        the first asynchronous stop makes all later ones stopl      failures

Safety
    protective stop in a move           False at once, or progress "running" for ever               failures
      upload during it                  True, and nothing starts                                    failures
      unlocking before 5 s              RuntimeError "until 5s after occurrence"                    failures
      after unlocking                   False until the next upload                                 failures
    triggerProtectiveStop               False, although it worked                                   failures
    unreachable straight move           protective stop                                             failures
    safeguard stop in a move            False; after release and `play` the arm goes on with it     ordered_faults
    emergency stop in a move            False; power and program are gone                           failures
    system emergency stop               the same with bits of its own                               ordered_faults
    violation, fault                    False until safety is restarted, power on, brakes released  dashboard_client
    power off                           False until power on, brakes released, uploaded             ordered_faults
    pushed by hand                      protective stop                                             ordered_faults
    collision in a move                 False at once; `ControlClient.collisions` says what touched  collisions
      unlocking while it still touches  stops again at once; moved away by hand, it stays unlocked  collisions
    speed slider at 10 % or 0           moves take ten times as long, or stand until it is up       ordered_faults
    arm not where it reports            nothing: only `control.ControlClient.state` shows it        failures
    output stuck                        True, and the read-back stays as it was                     failures
    lamp dead, frame or object amiss    nothing: outputs read back as ordered, only images tell     test_cell

Links
    RTDE cut, or half a packet          control reconnects within seconds; its move says either, by
                                        chance, and the arm goes on. receive stays disconnected
                                        until reconnect(). io says connected and loses one write,
                                        then RuntimeError "Broken pipe"            ordered_faults, failing_links
    frozen for over 2.5 s               control and receive do as after a cut                       failing_links (long)
    slow link                           calls are slow                                              ordered_faults
    script port cut                     moves go on; the next upload says True and is lost          ordered_faults
    dashboard cut                       RuntimeError "End of file", then "Broken pipe"              ordered_faults
    dashboard opened in local control   RuntimeError "reconnect to port 29999", also when remote    safety
    dashboard shutdown                  as killed, until somebody switches it on (fault `restart`)  safety
    time stamps jump                    nothing                                                     ordered_faults
    controller restarted                False; no client comes back by itself                       ordered_faults
    controller killed                   isConnected False, isProgramRunning True and progress
                                        frozen for ever                                             failing_links
      moves, then and later             block (300 s), also when it is back                         failing_links (long)
      reconnect() of receive            RuntimeError                                                failing_links
      io                                says True once, then RuntimeError "Broken pipe"; destroying
                                        it aborts the process                                       failing_links
    client killed, or disconnected      program and move go on, inputs are free at once             links
"""

from hardware_sim.controller.server import serve

__all__ = ["serve"]
