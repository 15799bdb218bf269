"""Watchdogs of programs count what their clients leave out, not what the simulator's own machine takes."""

import signal
import time

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import send_script, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient

PLAYING, STOPPED = 2, 1
PERIOD_S = 1.0


def test_watchdog_of_frozen_controller_waits_for_its_client(controller: ControllerProcess) -> None:
    """While every process waits for a core, no kick can be sent: a real controller's clock would not count that."""
    program = """
    def guarded():
      rtde_set_watchdog("input_int_register_24", 1.0, "stop")
      while True:
        sync()
      end
    end
    """
    with PlainClient(controller.address) as client:
        client.outputs("timestamp,runtime_state")
        kicked, _ = client.inputs("input_int_register_24")
        client.request("S")
        send_script(controller.address, program)
        wait_until(lambda: client.sample()[1] == PLAYING)
        client.write(kicked, 1)
        begun, _ = client.sample()
        wait_until(lambda: client.sample()[0] > begun + 0.1)  # the kick has been read
        controller.process.send_signal(signal.SIGSTOP)
        time.sleep(1.5 * PERIOD_S)
        controller.process.send_signal(signal.SIGCONT)
        time.sleep(0.1 * PERIOD_S)
        client.write(kicked, 2)
        ended, state = client.sample()
        while state != STOPPED:
            ended, state = client.sample()
    assert ended - begun > PERIOD_S  # by the controller's clock, which stood still
