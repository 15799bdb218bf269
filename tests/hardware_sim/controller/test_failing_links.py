"""What the unmodified ur-rtde returns, raises and leaves behind when the controller or the link to it fails.

The library may abort its process or block for minutes here, so that its clients are processes of their own.
"""

import signal
import time
from pathlib import Path

import pytest

from hardware_sim.controller.process import ControllerProcess
from tests.hardware_sim.controller.cells import Client, start, wait_until

ABORTED = -signal.SIGABRT


def run(code: str, address: str) -> list[str]:
    return Client(code, address).finish()


def test_constructor_without_listener_raises() -> None:
    """Failure: the port is closed."""
    import rtde_control
    import rtde_io
    import rtde_receive

    for interface in (rtde_control.RTDEControlInterface, rtde_receive.RTDEReceiveInterface, rtde_io.RTDEIOInterface):
        with pytest.raises(RuntimeError, match="Could not connect to"):
            interface("127.0.1.251")


def test_constructor_at_silent_port_waits_for_reply(controller: ControllerProcess) -> None:
    """Failure: the port is open and silent."""
    answer = run(
        """
        import rtde_receive
        from hardware_sim.controller.control import ControlClient
        with ControlClient(sys.argv[1]) as faults:
            faults.fault("stall", port=30004, seconds=3.0)
        began = time.monotonic()
        receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
        print(receive.isConnected(), time.monotonic() - began > 0.5, flush=True)
        os._exit(0)
        """,
        controller.address,
    )
    assert answer == ["True True"]


@pytest.mark.long
def test_controller_in_client_process_deadlocks() -> None:
    """Failure: both in one process; the library holds the interpreter's lock while it waits."""
    code = """
    import threading
    import rtde_receive
    from hardware_sim.controller import serve
    thread = threading.Thread(target=serve, args=[sys.argv[1]], kwargs={"home": [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]})
    thread.daemon = True
    thread.start()
    time.sleep(1.0)
    rtde_receive.RTDEReceiveInterface(sys.argv[1])
    """
    with start() as process:
        address = process.address
    client = Client(code, address)
    client.wait_for(f"ready {address}")
    assert client.hangs(5.0)


def test_constructor_in_local_control_raises(controller: ControllerProcess) -> None:
    """Failure: local control."""
    import rtde_control

    with controller.control() as faults:
        faults.fault("local_mode")
        with pytest.raises(RuntimeError, match="enable remote control"):
            rtde_control.RTDEControlInterface(controller.address)
        faults.fault("remote_mode")
        rtde_control.RTDEControlInterface(controller.address).disconnect()


def test_receive_client_after_cut_reports_disconnected(controller: ControllerProcess) -> None:
    """Failure: reconnect() of the receive client, with the controller there and gone."""
    client = Client(
        """
        import rtde_receive
        from hardware_sim.controller.control import ControlClient
        receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
        with ControlClient(sys.argv[1]) as control:
            control.fault("cut", port=30004)
        deadline = time.monotonic() + 90
        while receive.isConnected() and time.monotonic() < deadline:
            time.sleep(0.01)
        print("connected", receive.isConnected(), flush=True)
        print("again", receive.reconnect(), receive.getTimestamp() > 0, flush=True)
        sys.stdin.readline()
        while receive.isConnected() and time.monotonic() < deadline:
            time.sleep(0.01)
        try:
            receive.reconnect()
        except RuntimeError as error:
            print("Could not connect" in str(error), receive.isConnected(), flush=True)
        os._exit(0)
        """,
        controller.address,
    )
    client.wait_for("connected False")
    client.wait_for("again True True")
    controller.kill()
    assert client.finish() == ["True False"]


def test_client_after_controller_kill_reports_disconnected(controller: ControllerProcess) -> None:
    """Failure: the controller's process is killed."""
    client = Client(
        """
        import rtde_control, rtde_receive
        receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
        control = rtde_control.RTDEControlInterface(sys.argv[1])
        control.moveJ([2.0, -1.9, 1.9, -1.57, -1.57, 0.0], 0.4, 1.0, True)
        time.sleep(0.1)
        print("ready", flush=True)
        sys.stdin.readline()
        deadline = time.monotonic() + 90
        while (control.isConnected() or receive.isConnected()) and time.monotonic() < deadline:
            time.sleep(0.01)
        print(control.isConnected(), receive.isConnected(), control.isProgramRunning(), flush=True)
        first = receive.getTimestamp(), control.getAsyncOperationProgressEx().isAsyncOperationRunning()
        time.sleep(0.1)
        print(first == (receive.getTimestamp(), True), flush=True)
        os._exit(0)
        """,
        controller.address,
    )
    client.wait_for("ready")
    controller.kill()
    # Only isConnected and a time stamp that stands still tell: the program and the move are said to run for ever.
    assert client.finish()[-2:] == ["False False True", "True"]


@pytest.mark.long
def test_moves_after_controller_kill_block() -> None:
    """Failure: the controller's process is killed; a move in progress and a later one, also when it is back."""
    with start() as process:
        code = """
        import rtde_control
        control = rtde_control.RTDEControlInterface(sys.argv[1])
        print("ready", flush=True)
        if {later}:
            sys.stdin.readline()
            time.sleep(0.5)
        control.moveJ([2.0, -1.9, 1.9, -1.57, -1.57, 0.0], 0.4, 1.0)
        """
        during = Client(code.format(later=False), process.address)
        during.wait_for("ready")
        time.sleep(0.3)
        process.kill()
        assert during.hangs(9.0)
    with start() as process:
        later = Client(code.format(later=True), process.address)
        later.wait_for("ready")
        process.kill()
        assert later.hangs(9.0)


def test_io_client_after_controller_kill_succeeds_once(controller: ControllerProcess) -> None:
    """Failure: the IO client after the controller's death."""
    client = Client(
        """
        import rtde_io
        io = rtde_io.RTDEIOInterface(sys.argv[1])
        print("ready", flush=True)
        sys.stdin.readline()
        print(io.isConnected(), io.setStandardDigitalOut(1, True), flush=True)
        time.sleep(0.1)
        for _ in range(2):
            try:
                io.setStandardDigitalOut(1, True)
            except RuntimeError as error:
                print(error, flush=True)
        print(io.isConnected(), flush=True)
        io = None
        print("not reached", flush=True)
        """,
        controller.address,
    )
    client.wait_for("ready")
    controller.kill()
    answers = [line for line in client.finish() if "Lost connection" not in line]
    assert answers == ["True True", "write: Broken pipe", "write: Broken pipe", "True"]
    # Its destructor takes the whole process along.
    assert client.process.returncode == ABORTED


def test_custom_script_that_cannot_start_blocks_sender(controller: ControllerProcess) -> None:
    """The library waits for a word that only the script itself would write."""
    for script, logged in (
        ("x = = 1", "unexpected '='"),
        ("get_joint_torques()", "get_joint_torques is not simulated"),
    ):
        client = Client(
            f"""
            import rtde_control
            control = rtde_control.RTDEControlInterface(sys.argv[1])
            print("ready", flush=True)
            control.sendCustomScriptFunction("lines", "{script}\\n")
            """,
            controller.address,
        )
        client.wait_for("ready")
        with controller.control() as truth:
            wait_until(lambda truth=truth, logged=logged: any(logged in line for line in truth.log()))
            assert client.hangs(0.5)


@pytest.mark.long
def test_register_ranges_used_in_turn_replace_or_hang() -> None:
    """Failure: the last program listens in the other range of registers."""
    code = """
    import rtde_control
    began = time.monotonic()
    kind = rtde_control.RTDEControlInterface
    flags = kind.FLAG_UPLOAD_SCRIPT | ({upper} and kind.FLAG_UPPER_RANGE_REGISTERS)
    control = kind(sys.argv[1], 500.0, flags)
    print(time.monotonic() - began > 3.0, flush=True)
    os._exit(0)
    """
    with start() as process:
        assert run(code.format(upper=False), process.address) == ["False"]
        # It waits four seconds for a word in the upper range, then stops the program by the dashboard.
        assert run(code.format(upper=True), process.address)[-1] == "True"
        # The lower range still says "ready" from the first program: its stop command reaches nobody.
        assert Client(code.format(upper=False), process.address).hangs(15.0)


@pytest.mark.long
def test_frozen_controller_makes_library_reconnect(controller: ControllerProcess) -> None:
    """Failure: the controller is frozen for 4 s in a synchronous move.

    The control client reconnects to the program that still runs. Its move says either, by chance; the arm goes on.
    """
    client = Client(
        """
        import rtde_control, rtde_receive
        receive = rtde_receive.RTDEReceiveInterface(sys.argv[1])
        control = rtde_control.RTDEControlInterface(sys.argv[1])
        print("ready", flush=True)
        moved = control.moveJ([2.0, -1.9, 1.9, -1.57, -1.57, 0.0], 0.8, 1.0)
        print(moved in (True, False), receive.isConnected(), control.isConnected(), flush=True)
        os._exit(0)
        """,
        controller.address,
    )
    client.wait_for("ready")
    with controller.control() as truth:
        wait_until(lambda: truth.state()["joint_speeds"][0] > 0.1)
    controller.process.send_signal(signal.SIGSTOP)
    time.sleep(4.0)
    controller.process.send_signal(signal.SIGCONT)
    assert client.finish()[-1] == "True False True"
    with controller.control() as truth:
        wait_until(lambda: truth.state()["joints"][0] == 2.0)
        assert truth.state()["moves_started"] == 1


def test_controller_after_parent_death_ends() -> None:
    (number,) = run(
        """
        from tests.hardware_sim.controller.cells import start
        process = start()
        print(process.process.pid, flush=True)
        os._exit(1)
        """,
        "",
    )
    wait_until(lambda: not Path(f"/proc/{number}").exists() or is_zombie(int(number)))


def is_zombie(number: int) -> bool:
    return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
