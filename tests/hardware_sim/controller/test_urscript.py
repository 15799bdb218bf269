"""URScript: syntax and semantics of programs, without sockets."""

from collections.abc import Callable
from typing import Any

import pytest

from hardware_sim.controller.compiler import compile_program
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.functions import VOCABULARY
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.messages import MessageType
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.syntax import ScriptSyntaxError, depth_change, parse

HOME = [0.0, -1.9, 1.9, -1.57, -1.57, 0.0]
Run = Callable[[str], Controller]


@pytest.fixture
def run() -> Run:
    """Runs a program for up to 500 ticks in a controller of its own and returns the controller."""

    def run_program(text: str) -> Controller:
        controller = Controller(MODELS["ur5e"], HOME, now=0.0)
        controller.load(text)
        for tick in range(500):
            controller.tick(tick * 0.002)
            if controller.runtime_state is RuntimeState.STOPPED:
                break
        return controller

    return run_program


def floats(controller: Controller, count: int = 4) -> list[float]:
    return [controller.registers.get(f"output_double_register_{i}")[0] for i in range(count)]


def integer(controller: Controller, number: int = 0) -> float:
    return controller.registers.get(f"output_int_register_{number}")[0]


def last_message(controller: Controller) -> str:
    return next(m for m in reversed(controller.messages) if "finished" not in m and "started" not in m)


def test_newlines_and_comments_have_no_meaning(run: Run) -> None:
    text = """def f():
    global offset = # a comment with if and end in it
2    global other = 3
    def g(x):
        return x + offset # end
    end
    write_output_integer_register(0, g(other) * 10)
end
"""
    assert integer(run(text)) == 50


def test_p_is_pose_or_variable_by_item_count(run: Run) -> None:
    text = """def f():
    p = p[1, 2, 3, 4, 5, 6]
    write_output_float_register(0, p[1])
    q = [7, 8, 9]
    write_output_float_register(1, q[2])
end
"""
    assert floats(run(text), 2) == [2.0, 9.0]


def test_lists_are_copied_and_elements_assigned(run: Run) -> None:
    text = """def f():
    global shared = [1, 2, 3]
    def change(list):
        list[0] = 100
        shared[1] = 50
    end
    mine = shared
    mine[2] = 30
    change(shared)
    write_output_float_register(0, shared[0])
    write_output_float_register(1, shared[1])
    write_output_float_register(2, shared[2])
    write_output_float_register(3, mine[2])
end
"""
    assert floats(run(text)) == [1.0, 50.0, 3.0, 30.0]


def test_assignment_unless_local_changes_visible_variable(run: Run) -> None:
    text = """def f():
    global seen = 0
    value = 1
    count = 1
    own = 1
    def g():
        seen = 5
        count = count + 1
        value = 7
        local own = 20
        fresh = 3
        def inner():
            own = own + fresh
            value = value + own
        end
        inner()
        return own
    end
    h = g()
    write_output_float_register(0, seen)
    write_output_float_register(1, value)
    write_output_float_register(2, h)
    write_output_float_register(3, count)
    write_output_float_register(4, own)
end
"""
    assert floats(run(text), 5) == [5.0, 30.0, 23.0, 2.0, 1.0]


def test_local_variable_hides_global_of_same_name(run: Run) -> None:
    text = """def f():
        local a = 1
        def g():
            global a = 2
            global b = 10
        end
        def h():
            return a + b
        end
        g()
        write_output_float_register(0, a)
        write_output_float_register(1, h())
    end
    """
    assert floats(run(text), 2) == [1.0, 11.0]


def test_function_skipped_argument_takes_default(run: Run) -> None:
    text = """def f():
        global base = 100
        def g(a, b=2, c=[base, 5]):
            c[1] = c[1] + 1
            return a + 10 * b + c[0] + c[1]
        end
        write_output_float_register(0, g(1))
        write_output_float_register(1, g(1, 3))
        write_output_float_register(2, g(c=[0, 0], a=1))
        write_output_float_register(3, g(1))
    end
    """
    assert floats(run(text), 4) == [127.0, 137.0, 22.0, 127.0]


def test_critical_section_join_and_sync_let_others_run(run: Run) -> None:
    text = """def f():
        global steps = 0
        thread other():
            while steps < 3:
                enter_critical
                steps = steps + 1
                sync()
                exit_critical
            end
        end
        enter_critical
        h = run other()
        join h
        sync()
        exit_critical
        write_output_float_register(0, steps)
    end
    """
    assert floats(run(text), 1) == [3.0]


def test_speedj_streamed_with_tiny_acceleration_runs(run: Run) -> None:
    text = """def f():
        speedj([0.1, 0, 0, 0, 0, 0], 1.4e-14, 0.01)
        speedl([0.1, 0, 0, 0, 0, 0], 0, 0.01)
        write_output_float_register(0, 1)
    end
    """
    assert floats(run(text), 1) == [1.0]


def test_label_of_polyscope_is_announced(run: Run) -> None:
    text = """def f():
        $ 1 "Robot Program"
        x = 2
        $ 2 "MoveJ if end" "noBreak"
        write_output_float_register(0, x)
    end
    """
    controller = run(text)
    assert floats(controller, 1) == [2.0]
    labels = [(m.number, m.text) for m in controller.announcements if m.type is MessageType.PROGRAM_LABEL]
    assert labels == [(1, "Robot Program"), (2, "MoveJ if end")]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("-2 - -3", 1),
        ("7 % 4", 3),
        ("9 / 2", 4.5),
        ("norm([3, 4])", 5),
        ("get_steptime()", 0.002),
        ("pose_trans(p[1,0,0,0,0,1.5707963267948966], p[1,0,0,0,0,0])[1]", 1),
        ("pose_inv(p[1,2,3,0,0,0])[2]", -3),
        ("get_inverse_kin(get_forward_kin())[1]", -1.9),
    ],
)
def test_expressions_have_urscript_values(run: Run, expression: str, value: float) -> None:
    controller = run(f"def f():\n write_output_float_register(0, {expression})\nend\n")
    assert floats(controller, 1)[0] == pytest.approx(value)


@pytest.mark.parametrize(
    ("condition", "true"),
    [
        ("True and not False", True),
        ("True xor True", False),
        ("1 < 2 and 2 >= 3 or 4 != 5", True),
        ("not 1 == 2", True),
        ("is_within_safety_limits([0,0,0,0,0,7])", False),
        ("is_within_safety_limits(p[9,0,0,0,0,0])", False),
        ("is_within_safety_limits([6,0,0,0,0,0])", True),
    ],
)
def test_conditions_choose_branches(run: Run, condition: str, true: bool) -> None:
    text = f"""def f():
    if {condition}:
        write_output_integer_register(0, 1)
    else:
        write_output_integer_register(0, 2)
    end
end
"""
    assert integer(run(text)) == (1 if true else 2)


def test_threads_run_in_parallel_and_can_be_killed(run: Run) -> None:
    text = """def f():
    global count = 0
    global stopped = 0
    thread counter():
        while True:
            enter_critical
            count = count + 1
            exit_critical
            sync()
        end
    end
    handle = run counter()
    sleep(0.02)
    kill handle
    kill handle
    kill 0
    stopped = count
    sleep(0.02)
    write_output_integer_register(0, stopped)
    write_output_integer_register(1, count)
end
"""
    controller = run(text)
    assert integer(controller, 0) == pytest.approx(10, abs=1)
    assert integer(controller, 0) == integer(controller, 1)


def test_join_waits_and_break_leaves_loop(run: Run) -> None:
    text = """def f():
    global done = 0
    thread work():
        i = 0
        while True:
            i = i + 1
            if i == 3:
                continue
            elif i > 5:
                break
            end
            sync()
        end
        done = i
    end
    h = run work()
    join h
    write_output_integer_register(0, done)
end
"""
    assert integer(run(text)) == 6


def test_loop_without_wait_yields_its_slot(run: Run) -> None:
    controller = run("def f():\n x = 0\n while True:\n  x = x + 1\n end\nend\n")
    assert controller.runtime_state is RuntimeState.PLAYING
    assert controller.ticks == 500


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("movej([0, 0, 0])", "6 numbers"),
        ("x = nothing + 1", "'nothing' has no value yet"),
        ("x = [1, 2][5]", "index 5 is outside a list of 2"),
        ("x = 1 / 0", "division by zero"),
        ("x = get_inverse_kin(p[9,0,0,0,0,0])", "no solution"),
        ("set_payload(99)", "outside 0 to 5.0"),
        ("force_mode(p[0,0,0,0,0,0], [0,0,0,0,0,0], [0,0,0,0,0,0], 1, [0,0,0,0,0,0])", "type 1 is not simulated"),
        ("movej([0,0,0,0,0,0], a=-1)", "a must be above zero"),
        ("movej([0,0,0,0,0,0], t=-1)", "t must be zero or above"),
        ("movej([0,0,0,0,0,7])", "outside the joint limits"),
        ("write_output_integer_register(0, 3000000000)", "does not fit"),
        ("x = read_input_float_register(48)", "from 0 to 47, not 48"),
    ],
)
def test_runtime_exception_stops_program_and_names_line(run: Run, body: str, message: str) -> None:
    controller = run(f"def f():\n  sync()\n  {body}\n  write_output_integer_register(5, 1)\nend\n")
    assert controller.runtime_state is RuntimeState.STOPPED
    assert message in last_message(controller)
    assert "line 3" in last_message(controller)
    assert integer(controller, 5) == 0


def test_endless_recursion_raises_script_error(run: Run) -> None:
    controller = run("def f():\n def g(x):\n  return g(x + 1)\n end\n g(0)\nend\n")
    assert "nested too deeply" in last_message(controller)


@pytest.mark.parametrize(
    "text",
    [
        "def f():\n x = \nend\n",
        "def f():\n x = 1\n",
        "def f():\n unknown_function()\nend\n",
        "def f():\n x = run nobody()\nend\n",
        "def f():\n break\nend\n",
        "def f():\n if True:\n  x = 1\n else:\n  x = 2\n elif True:\n end\nend\n",
        "def f():\n x = $1\nend\n",
        "def f():\n " + "(" * 5000 + "\nend\n",
        "end\n",
        "def f():\nend\nend\n",
        "def f(a):\nend\n",
        "def f():\n def g(a, a):\n end\nend\n",
    ],
)
def test_invalid_programs_are_refused(run: Run, text: str) -> None:
    with pytest.raises(ScriptSyntaxError):
        compile_program(text, VOCABULARY)
    controller = run(text)
    assert controller.runtime_state is RuntimeState.STOPPED
    assert "refused" in last_message(controller)


def test_python_names_are_out_of_reach(run: Run) -> None:
    for body in ("x = __import__(1)", "x = open(1)", "x = program()", "x = eval(1)"):
        with pytest.raises(ScriptSyntaxError, match="no function"):
            compile_program(f"def f():\n {body}\nend\n", VOCABULARY)
    controller = run("def f():\n x = __builtins__\nend\n")
    assert "has no value yet" in last_message(controller)


def test_secondary_program_must_not_move(run: Run) -> None:
    controller = run("sec s():\n movej([0,0,0,0,0,0])\nend\n")
    for tick in range(5):
        controller.tick(tick * 0.002)
    assert "must not move" in last_message(controller)
    assert controller.arm.joints == HOME


def test_bare_line_is_a_program(run: Run) -> None:
    controller = run("set_digital_out(4, True)\n")
    assert controller.outputs.levels == 1 << 4


def test_depth_change_ignores_comments_and_strings() -> None:
    assert depth_change("def f():  # if while end") == 1
    assert depth_change('textmsg("end if")') == 0
    assert depth_change("if x: y = 1 end end") == -1
    assert depth_change("  send = ending") == 0


def test_parse_nested_functions_returns_tree() -> None:
    program: Any = parse("def f():\n def g():\n  thread h():\n  end\n end\nend\n")
    assert program.functions[0].functions[0].name == "h"


def test_outputs_as_lists_are_set(run: Run) -> None:
    controller = run("digital_out[3]=True\n")
    assert controller.outputs.levels == 1 << 3
    assert run("def f():\n digital_out = [False, False]\n digital_out[1] = True\nend\n").outputs.levels == 0


def test_script_control_line_follows_the_first_thread() -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load(
        "def f():\n  sync()\n  def g():\n    sleep(0.01)\n  end\n  g()\n  movej([0.1,-1.9,1.9,-1.57,-1.57,0])\nend"
    )
    seen = [0.0]
    for tick in range(700):
        controller.tick(tick * 0.002)
        line = controller.registers.get("script_control_line")[0]
        seen += [line] if line != seen[-1] else []
    assert seen == [0, 2, 4, 7, 0]


def test_wrong_number_of_arguments_is_said_by_the_functions_name() -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load("def f():\n  x = get_target_payload(1)\nend")
    controller.tick(0.002)
    assert "line 2: get_target_payload() takes 1 positional argument but 2 were given" in controller.messages[-1]
