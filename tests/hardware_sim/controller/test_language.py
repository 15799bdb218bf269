"""Values, types and built-ins of URScript, and what keeps a bad program from harming the tick."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware_sim.controller import semantics
from hardware_sim.controller.controller import Controller
from hardware_sim.controller.functions import REFUSED
from hardware_sim.controller.kinematics import MODELS
from hardware_sim.controller.modes import RuntimeState
from hardware_sim.controller.semantics import ScriptError
from tests.hardware_sim.controller.programs import HOME


def outcome(lines: str, ticks: int = 200) -> tuple[list[float], str]:
    """The first output double registers and the runtime exception of a program, if there was one."""
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load(f"def f():\n{lines}\nend\n")
    assert controller.runtime_state is RuntimeState.PLAYING, list(controller.messages)
    for tick in range(ticks):
        controller.tick(tick * 0.002)
        if controller.runtime_state is RuntimeState.STOPPED:
            break
    values = [controller.registers.get(f"output_double_register_{i}")[0] for i in range(4)]
    return values, next((m for m in controller.messages if "exception" in m), "")


def value(expression: str) -> float:
    values, exception = outcome(f" write_output_float_register(0, {expression})")
    assert exception == ""
    return values[0]


def test_struct_members_are_values() -> None:
    lines = """ global tool = struct(mass=1.5, center=[1, 2, 3], inner=struct(deep=7))
 copy = tool
 copy.mass = 2.5
 copy.center[1] = 20
 copy.inner.deep = 70
 def heavier(s):
  s.mass = s.mass + 100
  return s.mass
 end
 write_output_float_register(0, tool.mass + tool.center[1] + tool.inner.deep)
 write_output_float_register(1, copy.mass + copy.center[1] + copy.inner.deep)
 write_output_float_register(2, heavier(tool))
 write_output_float_register(3, tool.mass)"""
    assert outcome(lines)[0] == [10.5, 92.5, 101.5, 1.5]


def test_nested_lists_are_values() -> None:
    lines = """ m = [[1, 2], [3, 4]]
 row = m[0]
 n = m
 n[1, 0] = 30
 n[0][1] = 20
 row[0] = 100
 outer = [row, m]
 row[1] = 500
 write_output_float_register(0, m[1, 0] + m[0, 1])
 write_output_float_register(1, n[1][0] + n[0, 1])
 write_output_float_register(2, outer[0][1])
 write_output_float_register(3, m[0, 0])"""
    assert outcome(lines)[0] == [5.0, 50.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("([1, 2] + [10, 20])[1]", 22),
        ("([1, 2] * 3)[1]", 6),
        ("(1 - [-1, -5])[1]", 6),
        ("sin(d2r(30))", 0.5),
        ("cos(0) + tan(0)", 1),
        ("asin(1) + acos(1) + atan(0)", math.pi / 2),
        ("atan2(1, -1)", 3 * math.pi / 4),
        ("sqrt(pow(3, 2) + pow(4, 2))", 5),
        ("floor(2.7) + ceil(2.1)", 5),
        ("floor(-2.5)", -3),
        ("r2d(3.141592653589793)", 180),
        ("norm(-3.5) + norm([3, 4])", 8.5),
        ("log(10, 1000)", 3),
        ("length([1, 2, 3]) + length(p[0,0,0,0,0,0]) + str_len('four')", 13),
        ("normalize([3, 4])[0]", 0.6),
        ("pose_dist(p[0,0,0,0,0,0], p[3,4,0,0,0,0])", 5),
        ("point_dist(p[0,0,0,0,0,0], p[0,0,2,1,0,0])", 2),
        ("pose_add(p[1,0,0,0,0,0], p[2,0,0,0,0,1])[0]", 3),
        ("pose_sub(p[5,0,0,0,0,0], p[2,0,0,0,0,0])[0]", 3),
        ("pose_trans(p[1,2,3,0,0,1], pose_inv(p[1,2,3,0,0,1]))[1]", 0),
        ("interpolate_pose(p[0,0,0,0,0,0], p[4,0,0,0,0,0], 0.25)[0]", 1),
        ("rpy2rotvec([0, 0, 1.5])[2]", 1.5),
        ("rotvec2rpy(rpy2rotvec([0.3, -0.4, 0.5]))[1]", -0.4),
        ("to_num('2.5') + to_num('-4')", -1.5),
        ("to_num(str_cat('1', to_str(2.5)))", 12.5),
        ("to_num(str_sub('a12b', 1, 2))", 12),
        ("str_find('hello', 'l') + str_find('hello', 'z')", 1),
        ("to_num(str_at('x7', 1))", 7),
        ("binary_list_to_integer([True, False, False, True])", 9),
        ("binary_list_to_integer(integer_to_binary_list(-12345))", -12345),
        ("7 % 4 + 0x10", 19),
        ("get_actual_joint_positions_history(499)[1]", -1.9),
        ("get_target_waypoint()[0] - get_actual_tcp_pose()[0]", 0),
    ],
)
def test_builtin_functions_return_documented_values(expression: str, expected: float) -> None:
    assert value(expression) == pytest.approx(expected, abs=1e-9)


def test_to_str_formats_like_controller() -> None:
    assert semantics.script_text(2.123456123456) == "2.12346"
    assert semantics.script_text(semantics.Pose([1.0, 2, 3, 4, 5, 6])) == "p[1, 2, 3, 4, 5, 6]"
    assert semantics.script_text([True, 1, "a"]) == "[True, 1, a]"


def test_random_repeats_in_every_run() -> None:
    lines = " i = 0\n while i < 3:\n  write_output_float_register(i, random())\n  i = i + 1\n end"
    first, _ = outcome(lines)
    assert first == outcome(lines)[0]
    assert len(set(first[:3])) == 3
    assert all(0 <= number < 1 for number in first)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("x = [1, 2][-1]", "index -1 is outside a list of 2"),
        ("x = [1, 2][1.5]", "an index must be an integer, not 1.5"),
        ("x = 5[0]", "5 has no elements"),
        ("x = [1]\n x[1] = 2", "index 1 is outside a list of 1"),
        ("x = p[1,2,3,4,5,True]", "a pose is made of numbers, not of True"),
        ("x = p[1,2,3,4,5,6]\n x[0] = False", "a pose is made of numbers"),
        ("x = True + 1", "True + 1: unsupported operand types"),
        ("x = 'a' * 2", "a * 2: unsupported operand types"),
        ("x = 'a' < 'b'", "a < b: unsupported operand types"),
        ("x = [1, 2] + [1]", "unsupported operand types"),
        ("x = p[1,2,3,4,5,6] + p[1,2,3,4,5,6]", "unsupported operand types"),
        ("x = -'a'", "unsupported operand types"),
        ("x = 7 % 0", "division by zero"),
        ("x = 1.5 / 0.0", "division by zero"),
        ("if 1:\n  x = 2\n end", "a condition must be True or False, not 1"),
        ("while 0:\n  x = 2\n end", "a condition must be True or False, not 0"),
        ("x = not 1", "a condition must be True or False"),
        ("x = True and 1", "a condition must be True or False"),
        ("x = struct(a=1)\n y = x.b", "no member 'b', only a"),
        ("x = struct(a=1)\n x.b = 2", "no member 'b', only a"),
        ("x = 1\n y = x.a", "it is not a struct"),
        ("x = 2000000000 + 2000000000", "does not fit 32 bits"),
        ("x = floor(3e9)", "does not fit 32 bits"),
        ("x = sqrt(-1)", "sqrt(-1) has no value"),
        ("x = asin(2)", "asin(2) has no value"),
        ("x = sin('a')", "sin: an argument must be a number, not a"),
        ("x = pow(10, 1000)", "pow(10, 1000) has no value"),
        ("x = log(-1, 2)", "log(-1, 2) has no value"),
        ("x = to_num('five')", "'five' is not a number"),
        ("x = str_at('a', 3)", "str_at: the index must be from 0 to 0, not 3"),
        ("x = length(3)", "neither a list nor a string"),
        ("x = 'ab'\n while True:\n  x = str_cat(x, x)\n end", "a string of more than"),
        ("x = [1, 2]\n while True:\n  x = [x, x]\n end", "a value of more than"),
        ("set_digital_out(18, True)", "from 0 to 17, not 18"),
        ("set_digital_out(0, 1)", "a condition must be True or False"),
        ("x = get_actual_joint_positions_history(500)", "steps must be an integer from 0 to 499"),
        ("x = get_forward_kin([1, 2, 3])", "q must be 6 numbers"),
        ("movej(5)", "the target must be 6 numbers, not 5"),
        ("movej()", "movej() missing 1 required positional argument: 'q'"),
        ("movel(p[0,0,0,0,0,0], speed=3)", "movel() got an unexpected keyword argument 'speed'"),
        ("movec(p[0,0,0,0,0,0], p[0,0,0,0,0,0], mode=2)", "movec: mode must be 0"),
        ("def g(a):\n  return a\n end\n x = g()", "g() missing 1 required positional argument: 'a'"),
    ],
)
def test_invalid_values_raise_script_error(line: str, message: str) -> None:
    _, exception = outcome(f" sync()\n {line}\n write_output_integer_register(5, 1)", 3000)
    assert message in exception
    assert "line " in exception


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_unsimulated_function_is_named(name: str) -> None:
    values, exception = outcome(f" x = {name}(1, 2)\n write_output_float_register(0, 1)")
    assert f"{name} is not simulated" in exception
    assert "line 2" in exception
    assert values[0] == 0.0


@pytest.mark.parametrize(
    "lines",
    [
        " while True:\n  x = get_inverse_kin(p[-0.4, 0.1, 0.3, 0, 3.1, 0])\n end",
        " x = 0\n while True:\n  x = x + 0.5\n end",
        " def fib(n):\n  if n < 2:\n   return n\n  end\n  return fib(n - 1) + fib(n - 2)\n end\n x = fib(40)",
        " def a(n):\n  return n + 1\n end\n while True:\n  x = a(a(a(a(1))))\n end",
    ],
)
def test_busy_loop_does_not_delay_tick(lines: str) -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    controller.load(f"def f():\n{lines}\nend\n")
    for tick in range(50):
        controller.tick(tick * 0.002)  # unguarded, none of these would come back from the first one
    assert controller.runtime_state is RuntimeState.PLAYING


def test_recursion_returns_result() -> None:
    lines = """ def fib(n):
  if n < 2:
   return n
  end
  return fib(n - 1) + fib(n - 2)
 end
 write_output_float_register(0, fib(12))"""
    assert outcome(lines)[0][0] == 144


def test_critical_section_is_not_interrupted() -> None:
    lines = """ global a = 0
 global torn = 0
 thread writer():
  while True:
   enter_critical
   a = 1
   k = 0
   while k < 3000:
    k = k + 1
   end
   a = 0
   exit_critical
   sync()
  end
 end
 h = run writer()
 i = 0
 while i < 50:
  if a != 0:
   torn = torn + 1
  end
  i = i + 1
  sync()
 end
 write_output_float_register(0, torn)
 write_output_float_register(1, i)"""
    assert outcome(lines)[0][:2] == [0.0, 50.0]


numbers = st.one_of(st.integers(-1000, 1000), st.floats(-1e3, 1e3, allow_nan=False))


@settings(max_examples=200, deadline=None)
@given(numbers, numbers, st.sampled_from(sorted(semantics.OPERATIONS)))
def test_operators_agree_with_python_arithmetic(a: float, b: float, sign: str) -> None:
    operation = semantics.OPERATIONS[sign]
    if sign in "/%" and b == 0:
        with pytest.raises(ScriptError, match="division by zero"):
            operation(a, b)
        return
    expected = {"+": lambda: a + b, "-": lambda: a - b, "*": lambda: a * b, "/": lambda: a / b, "%": lambda: a % b}.get(
        sign, lambda: {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[sign]
    )()
    assert operation(a, b) == expected
    if sign in "+-*":
        assert operation([a, a], b) == [expected, expected]
        assert operation([a], [b]) == [expected]


values = st.recursive(
    st.one_of(st.integers(), st.booleans(), st.text(max_size=3)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=3).map(semantics.Struct)
    ),
    max_leaves=12,
)


@settings(max_examples=50, deadline=None)
@given(values)
def test_copy_of_is_equal_and_independent(original: object) -> None:
    def containers(value: object) -> list[int]:
        inner = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
        own = [id(value)] if isinstance(value, list | dict) else []
        return own + [number for element in inner for number in containers(element)]

    copy = semantics.copy_of(original)
    assert copy == original
    assert type(copy) is type(original)
    assert not set(containers(copy)) & set(containers(original))


def test_polyscope_program_runs_as_it_is_saved() -> None:
    """The lines that PolyScope writes before each program, and a program of one waypoint."""
    lines = """ set_tcp(p[0.0,0.0,0.1,0.0,0.0,0.0])
 set_target_payload(1.0, [0.0, 0.0, 0.05], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
 set_payload_mass(1.5)
 set_payload_cog([0.0, 0.0, 0.06])
 set_gravity([0.0, 0.0, 9.82])
 set_safety_mode_transition_hardness(1)
 set_standard_analog_input_domain(0, 1)
 set_standard_analog_input_domain(1, 0)
 set_tool_analog_input_domain(0, 1)
 set_analog_outputdomain(0, 0)
 set_input_actions_to_default()
 set_tool_communication(False, 115200, 0, 1, 1.5, 3.5)
 set_tool_output_mode(0)
 set_tool_digital_output_mode(0, 1)
 set_tool_voltage(24)
 set_runstate_standard_digital_output_to_value(3, 1)
 zero_ftsensor()
 global count=0.0
 thread Step_Counter_Thread():
  while (True):
   count = count + 1.0
   sync()
  end
 end
 run Step_Counter_Thread()
 global Waypoint_1_p=get_forward_kin([0.1, -1.9, 1.9, -1.57, -1.57, 0.0])
 global Waypoint_1_q=[0.1, -1.9, 1.9, -1.57, -1.57, 0.0]
 $ 1 "Robot Program"
 $ 2 "MoveJ"
 $ 3 "Waypoint_1" "breakAfter"
 movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.4, v=1.05)
 q = get_joint_positions()
 v = get_target_joint_speeds()
 write_output_float_register(0, q[0])
 write_output_float_register(1, norm(v))
 write_output_float_register(2, count)
 write_output_float_register(3, get_target_payload())"""
    values, exception = outcome(lines, 1000)
    assert exception == ""
    assert values[:2] == pytest.approx([0.1, 0.0])
    assert values[2] > 100.0
    assert values[3] == 1.5


def test_inputs_and_analogue_outputs_reach_program_and_clients() -> None:
    controller = Controller(MODELS["ur5e"], HOME, now=0.0)
    for number in (1, 10, 17):
        controller.inputs.set_level(number, True)
    controller.inputs.analog[:] = [2.5, 0.0, 0.0, 0.016]
    controller.load(
        """def f():
 if get_standard_digital_in(1) and get_configurable_digital_in(2) and get_tool_digital_in(1) and get_digital_in(17):
  write_output_float_register(0, get_standard_analog_in(0) + 1000 * get_tool_analog_in(1))
 end
 set_standard_analog_out(0, 0.5)
 set_analog_outputdomain(1, 0)
 set_analog_out(1, 0.25)
 set_tool_voltage(12)
 set_flag(3, True)
 if get_flag(3) and not get_flag(4) and not get_digital_in(0):
  write_output_float_register(1, get_standard_analog_out(0))
 end
 sleep(1)
end
"""
    )
    controller.tick(0.0)
    read = controller.registers.get
    assert [read(f"output_double_register_{i}")[0] for i in range(2)] == [18.5, 5.0]
    assert read("actual_digital_input_bits")[0] == 1 << 1 | 1 << 10 | 1 << 17
    assert [read(name)[0] for name in ("standard_analog_input0", "tool_analog_input1")] == [2.5, 0.016]
    assert [read(f"standard_analog_output{i}")[0] for i in range(2)] == pytest.approx([5.0, 0.008])
    assert read("analog_io_types")[0] == 0b0111
    assert read("tool_output_voltage")[0] == 12
