"""Every output and register that the real library can write or read, and what it refuses itself."""

import itertools
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import Cell, send_script, start, wait_until
from tests.hardware_sim.controller.plain_client import PlainClient


@pytest.fixture(scope="module")
def controller() -> Iterator[ControllerProcess]:
    """One controller for clients that come and go."""
    with start() as process:
        yield process


BANKS = (("setStandardDigitalOut", 0, 8), ("setConfigurableDigitalOut", 8, 8), ("setToolDigitalOut", 16, 2))


def test_digital_outputs_each_read_back_alone(cell: Cell) -> None:
    """Check 12."""
    bits = 0
    for level in (True, False):
        for method, first, count in BANKS:
            for number in range(count):
                assert getattr(cell.io, method)(number, level)
                bits ^= 1 << first + number
                wait_until(lambda bits=bits: cell.receive.getActualDigitalOutputBits() == bits)
                assert cell.receive.getDigitalOutState(first + number) == level
    assert bits == 0
    # Outputs that do not exist are masked away.
    for method, _, count in BANKS:
        assert getattr(cell.io, method)(count, True)
    before = cell.receive.getTimestamp()
    wait_until(lambda: cell.receive.getTimestamp() > before + 0.02)
    assert cell.receive.getActualDigitalOutputBits() == 0


def test_io_two_writes_need_no_acknowledgement(cell: Cell) -> None:
    """The library loses its TCP_NODELAY: without quick acknowledgements the second write would come 40 ms late."""
    delays = []
    for level in (True, False) * 5:
        cell.io.setStandardDigitalOut(1, level)
        cell.io.setStandardDigitalOut(2, level)
        before = cell.receive.getTimestamp()
        wait_until(lambda level=level: cell.receive.getActualDigitalOutputBits() == (6 if level else 0))
        delays.append(cell.receive.getTimestamp() - before)
    assert min(delays) < 0.02


def test_analog_outputs_report_volts_and_amperes(cell: Cell) -> None:
    """Check 13."""
    assert cell.io.setAnalogOutputVoltage(0, 0.5)
    assert cell.io.setAnalogOutputCurrent(1, 0.25)
    wait_until(lambda: cell.receive.getStandardAnalogOutput1() == pytest.approx(0.008))
    assert cell.receive.getStandardAnalogOutput0() == pytest.approx(5.0)
    with PlainClient(cell.address) as plain:
        plain.outputs("analog_io_types")
        plain.request("S")
        assert plain.sample() == (0b0111,)  # inputs 0 and 1 and output 0 are voltages
    assert cell.io.setAnalogOutputCurrent(0, 1.0)
    assert cell.io.setAnalogOutputVoltage(1, 1.0)
    wait_until(lambda: cell.receive.getStandardAnalogOutput1() == pytest.approx(10.0))
    assert cell.receive.getStandardAnalogOutput0() == pytest.approx(0.020)
    # The library sends ratios that no output has; they change nothing.
    assert cell.io.setAnalogOutputVoltage(1, 1.5)
    assert cell.io.setAnalogOutputVoltage(0, 0.0)
    wait_until(lambda: cell.receive.getStandardAnalogOutput0() == 0.0)
    assert cell.receive.getStandardAnalogOutput1() == pytest.approx(10.0)
    assert cell.io.setAnalogOutputVoltage(1, 0.0)


def test_speed_slider_ignores_values_outside_fractions(cell: Cell) -> None:
    assert cell.io.setSpeedSlider(0.4)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == 0.4)
    for bad in (1.5, -0.1):
        assert cell.io.setSpeedSlider(bad)  # the library does not look
    assert cell.io.setStandardDigitalOut(4, True)
    wait_until(lambda: cell.receive.getActualDigitalOutputBits() == 1 << 4)
    assert cell.receive.getTargetSpeedFraction() == 0.4
    assert cell.io.setStandardDigitalOut(4, False)
    assert cell.io.setSpeedSlider(1.0)
    wait_until(lambda: cell.receive.getTargetSpeedFraction() == 1.0)


def test_inputs_undriven_are_low(cell: Cell) -> None:
    assert cell.receive.getActualDigitalInputBits() == 0
    assert not any(cell.receive.getDigitalInState(n) for n in range(18))
    assert cell.receive.getStandardAnalogInput0() == cell.receive.getStandardAnalogInput1() == 0.0


@pytest.mark.parametrize("first", [18, 42])
def test_io_client_input_registers_reach_program(controller: ControllerProcess, first: int) -> None:
    import rtde_io

    with ExitStack() as stack:
        io = rtde_io.RTDEIOInterface(controller.address, False, first == 42)
        stack.callback(io.disconnect)
        numbers = range(first, first + 5)
        for number in numbers:
            assert io.setInputIntRegister(number, -number)
            assert io.setInputDoubleRegister(number, number + 0.5)
        for bad in (first - 1, first + 5):
            with pytest.raises(ValueError, match="supported range"):
                io.setInputIntRegister(bad, 1)
            with pytest.raises(ValueError, match="supported range"):
                io.setInputDoubleRegister(bad, 1.0)
        plain = stack.enter_context(PlainClient(controller.address))
        plain.outputs(",".join(f"input_int_register_{n},input_double_register_{n}" for n in numbers))
        plain.request("S")
        wanted = tuple(itertools.chain.from_iterable((-n, n + 0.5) for n in numbers))
        wait_until(lambda: plain.sample() == wanted)


@pytest.mark.parametrize("upper", [False, True])
def test_receive_client_output_registers_read_program(controller: ControllerProcess, upper: bool) -> None:
    import rtde_receive

    numbers = range(36, 44) if upper else range(12, 20)
    lines = [f" write_output_integer_register({n}, {-n})\n write_output_float_register({n}, {n}.5)\n" for n in numbers]
    send_script(controller.address, "def f():\n" + "".join(lines) + "end\n")
    receive = rtde_receive.RTDEReceiveInterface(controller.address, 500.0, [], False, upper)
    wait_until(lambda: receive.getOutputDoubleRegister(numbers[-1]) == numbers[-1] + 0.5)
    assert [receive.getOutputIntRegister(n) for n in numbers] == [-n for n in numbers]
    assert [receive.getOutputDoubleRegister(n) for n in numbers] == [n + 0.5 for n in numbers]
    for bad in (numbers[0] - 1, numbers[-1] + 1):
        with pytest.raises(ValueError, match="supported range"):
            receive.getOutputIntRegister(bad)
    receive.disconnect()
