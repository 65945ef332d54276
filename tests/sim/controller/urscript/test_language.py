"""URScript as client libraries upload it: what programs compute, when they wait, and what they
are told.
"""

import time

import pytest

from sim.controller.urscript.compiler import MAX_VARIABLES, load
from sim.controller.urscript.library import library
from sim.controller.urscript.program import (
    DEEPEST_CALL,
    MAX_SLOTS,
    MAX_THREADS,
    PERIOD_STEPS,
    SLICE,
    Program,
)
from sim.controller.urscript.signature import (
    ANYTHING,
    JOINTS,
    NUMBER,
    POSE,
    Parameter,
    row,
    table,
    whole,
)
from sim.controller.urscript.splitter import LONGEST_PROGRAM, Splitter
from sim.controller.urscript.syntax import DEEPEST
from sim.controller.urscript.values import LONGEST_LIST, LONGEST_STRING, ScriptError


class Machine:
    """A controller that remembers what programs said, and waits a period in `sync`."""

    def __init__(self):
        self.said = []

        def sync():
            yield

        def later(value):
            yield
            return value

        value = Parameter("value", ANYTHING)
        self.functions = table(
            [
                *library(),
                row("say", self.said.append, value),
                row("sync", sync, waits=True),
                row("later", later, value, waits=True),
                row("add", lambda a, b: a + b, Parameter("a", NUMBER), Parameter("b", NUMBER, 5)),
                row("port", lambda i: i, Parameter("i", whole(0, 47))),
                row("joints", lambda q: q.tolist(), Parameter("q", JOINTS)),
                row("pose", lambda x: x, Parameter("x", POSE)),
            ]
        )

    def program(self, source):
        loading = load(source, self.functions)
        while True:
            try:
                next(loading)
            except StopIteration as done:
                return Program(done.value)

    def run(self, body, periods=100):
        """Run a program with this body; how many periods it took."""
        program = self.program(f"def main():\n{body}\nend")
        for taken in range(periods):
            if not program.running:
                return taken
            program.step()
        return periods


def said(body, periods=100):
    machine = Machine()
    machine.run(body, periods)
    return machine.said


def test_what_a_program_computes_and_when_it_waits():
    machine = Machine()
    body = """
  # a comment
  x = 1
  while x < 4:  # another
    x = x + 1
    sync()
    if x == 2:
      say("two # no comment")
    elif x == 3:
      say("three")
    else:
      say(x)
    end
  end
"""
    assert machine.run(body) == 4
    assert machine.said == ["two # no comment", "three", 4]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3 - 4 / 8", 6.5),
        ("-2 * -(3 - 5)", -4),
        ("-7 % 3", -1),  # the sign of the dividend, as in C
        ("7.5 % 2", 1.5),
        ("1 < 2 and not 2 < 1 or False", True),
        ("True xor 1 == 1", False),
        ("1 == True", False),
        ('"a" == "a"', True),
        ("[1, 2] == [1, 2.0]", True),
        ("[1, 2, 3] * 2", (2, 4, 6)),
        ("[1, 2] + [10, 20]", (11, 22)),
        ("[[1, 2], [3, 4]][1, 0]", 3),
        ("[[1, 2], [3, 4]][1][0]", 3),
        ("p[1, 2, 3, 4, 5, 6][5]", 6),
        ("p[0, 0, 0.1, 0, 0, 0]", (0, 0, 0.1, 0, 0, 0)),
        (".5e1", 5.0),
        ("2147483648 / 2", 2.0**30),
        ("!(1 == 2) and 3 != 4", True),
        ('"Hello" + ", " + "World!"', "Hello, World!"),
        ("None == None", True),
        # the examples of the manual's matrices and lists
        ("[1, 2, 3] * [10, 20, 30]", (10, 40, 90)),
        ("[10, 20, 30] / [1, 2, 3]", (10, 10, 10)),
        ("[10, 20, 30] % [3, 7, 8]", (1, 6, 6)),
        ("10 / [10, 20, 40]", (1, 0.5, 0.25)),
        ("[11, 22, 33] % 5", (1, 2, 3)),
        ("5 - [[10, 20], [30, 40]]", ((-5, -15), (-25, -35))),
        ("121 % [[10, 20], [30, 40]]", ((1, 1), (1, 1))),
        ("[[1, 2], [3, 4], [5, 6]] * [[10, 20, 30], [40, 50, 60]]",
         ((90, 120, 150), (190, 260, 330), (290, 400, 510))),
        ("[[1, 2], [3, 4], [5, 6]] * [10, 20]", (50, 110, 170)),
        ("inv([[0, 1, 0], [0, 0, 1], [1, 0, 0]])", ((0, 0, 1), (1, 0, 0), (0, 1, 0))),
        ("transpose([[1, 2], [3, 4], [5, 6]])", ((1, 3, 5), (2, 4, 6))),
        ("transpose([1, 2, 3])", ((1,), (2,), (3,))),
        ("transpose([[1], [2], [3]])", (1, 2, 3)),
        ("size([[1, 2], [3, 4], [5, 6]])", (3, 2)),
        ('size("hello") + length([1, 2]) + get_list_length([])', 7),
        # and of its strings
        ('str_at("Hello", 1)', "e"),
        ('str_cat("Integer ", 1)', "Integer 1"),
        ('str_cat("", p[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])', "p[1, 2, 3, 4, 5, 6]"),
        ("str_cat([True, False, True], [1, 0, 1])", "[True, False, True][1, 0, 1]"),
        ('str_empty("")', True),
        ('str_find("Hello World!", "o", 5)', 7),
        ('str_find("abc", "z")', -1),
        ('str_len("\u00e9")', 1),
        ('str_sub("0123456789abcdefghij", 5, 3)', "567"),
        ('str_sub("abcde", 2, 50)', "cde"),
        ('str_sub("0123456789abcdefghij", 10)', "abcdefghij"),
        ("to_str(2.123456123456)", "2.123456"),
        ('to_num(" -0X1f") + to_num("+5.") + to_num(".5e1")', -21.0),
        ('to_num("10") / 4', 2.5),
        # structs and lists with room
        ("struct(a=1, b=[1, 2]).b[1]", 2),
        ("struct(a=1, b=2)[1]", 2),
        ("struct(a=1, b=\"x\").to_string()", "{a: 1, b: x}"),
        ("make_list(3, 7, 20)", (7, 7, 7)),
        ("make_list(3, 7, 20).capacity() + make_list(3, 7, 20).excess_capacity()", 37),
        ("[1, 2, 3, 4].slice(1, 3)", (2, 3)),
        ("[[1, 2], [3, 4]].get_column(1)", (2, 4)),
        ("[[1, 2, 3], [4, 5, 6]].shape()", (2, 3)),
        ("later(1) + later(2)", 3),
        ("add(1)", 6),
        ("add(b=1, a=2)", 3),
        ("joints([1, 2, 3, 4, 5, 6])", [1, 2, 3, 4, 5, 6]),
    ],
)  # fmt: skip
def test_expressions(expression, value):
    assert said(f"say({expression})") == [value]


def test_a_right_side_is_left_alone_where_the_left_one_decides():
    body = """
  def heard():
    sync()
    say("heard")
    return True
  end
  say(False and heard())
  say(True or heard())
  say(True and heard())
"""
    assert said(body) == [False, True, "heard", True]


def test_operands_are_taken_from_left_to_right_also_around_a_call_that_waits():
    body = """
  global a = 1
  def change():
    a = 10
    sync()
    return 100
  end
  say(a + change())
  say([a, change(), a])
"""
    assert said(body) == [101, (10, 100, 10)]


def test_functions_wait_inside_and_give_values_back():
    assert said("def twice(y):\n sync()\n return 2 * y\n end\n say(twice(twice(3)))") == [12]
    assert said("def half(y=4):\n return y / 2\n end\n say(half())\n say(half(3))") == [2, 1.5]


def test_threads_take_turns_and_can_be_killed():
    body = """
  global count = 0
  thread counting():
    while True:
      enter_critical
      count = count + 1
      exit_critical
      sync()
    end
  end
  t = run counting()
  sync()
  sync()
  kill t
  say(count)
  sync()
  say(count)
"""
    assert said(body) == [2, 2]


def test_join_waits_for_a_thread_and_a_thread_may_end_itself():
    body = """
  global me = 0
  thread working():
    sync()
    say("works")
    kill me
    say("never")
  end
  me = run working()
  join me
  say("joined")
"""
    assert said(body) == ["works", "joined"]
    assert said("t = 0\njoin t\nkill t\nsay(1)") == [1]


def test_a_thread_that_never_waits_goes_on_in_the_next_period_and_leaves_others_their_turn():
    body = """
  thread busy():
    while True:
      x = 1
    end
  end
  a = run busy()
  b = run busy()
  i = 0
  while i < 5:
    i = i + 1
    sync()
  end
  say(i)
"""
    machine = Machine()
    assert machine.run(body) == 6
    assert machine.said == [5]
    assert Machine().run("while True:\n x = 1\n end", periods=50) == 50


def test_a_thread_in_a_critical_section_is_alone_but_while_it_waits():
    """[UR-script, "Threads"]: a time-demanding command in it lets another thread run."""
    waits = "enter_critical\nsync()\nsay(1)\nexit_critical"
    other = 'thread other():\nsay("other")\nend\nt = run other()\n'
    assert said(f"{other}{waits}\nsync()") == ["other", 1]
    computes = f"i = 0\nwhile i < {PERIOD_STEPS}:\ni = i + 1\nend\nsay(1)"
    assert said(f"{other}enter_critical\n{computes}\nexit_critical\nsync()") == [1, "other"]


def test_a_thread_that_waits_in_a_critical_section_for_ever_does_not_starve_the_others():
    """As a driver's servo loop does: enter, wait for a period in a motion, exit."""
    body = "thread t():\nwhile True:\nenter_critical\nsync()\nexit_critical\nend\nend\n"
    body += "x = run t()\ni = 0\nwhile i < 5:\nsync()\ni = i + 1\nend\nsay(i)"
    assert said(body, periods=10) == [5]


@pytest.mark.parametrize(
    ("body", "values"),
    [
        # the examples of the manual's scoping rules
        ("global a = 0\ndef f():\nlocal a = 1\nsay(a)\nend\nf()\nsay(a)", [1, 0]),
        ("global a = 0\ndef f():\na = 1\nend\nf()\nsay(a)", [1]),
        ("a = 0\ndef f():\na = 1\nend\nf()\nsay(a)", [1]),
        (
            "global a = 0\ndef f():\nlocal a = 1\ndef g():\na = "
            "2\nend\ng()\nsay(a)\nend\nf()\nsay(a)",
            [1, 2],
        ),
        ("def f():\nglobal b = 7\nend\nf()\nsay(b)", [7]),
        # what is called local at the first level is global
        ("local a = 1\ndef f():\na = 2\nend\nf()\nsay(a)", [2]),
        ("a = 1\ndef f():\nif True:\nlocal a = 2\nend\nsay(a)\nend\nf()\nsay(a)", [2, 1]),
        ("a = [1, 2]\ndef f(a):\na[0] = 9\nsay(a)\nend\nf(a)\nsay(a)", [(9, 2), (1, 2)]),
        ("a = 1\nthread t():\nlocal a = 2\nend\nx = run t()\njoin x\nsay(a)", [1]),
        # functions are seen where they stand, and further in
        (
            "def f():\ndef h():\nreturn 1\nend\nreturn h()\nend\n"
            "def g():\ndef h():\nreturn 2\nend\nreturn h()\nend\nsay([f(), g()])",
            [(1, 2)],
        ),
        # a default is of the place where its function stands
        ("a = 1\ndef f(x=a + later(1)):\nreturn x\nend\ndef g():\nlocal a = 5\nsay(f())\nend\ng()",
         [2]),
    ],
)  # fmt: skip
def test_scopes(body, values):
    assert said(body) == values


def test_values_are_never_shared():
    assert said(
        "a = [1, 2]\nb = a\nb[0] = 9\nsay(a)\nsay(b)\nc = [a, b]\nc[0, 1] = 5\nsay(c)\nsay(a)"
    ) == [
        (1, 2),
        (9, 2),
        ((1, 5), (9, 2)),
        (1, 2),
    ]


@pytest.mark.parametrize(
    ("body", "values"),
    [
        ("s = struct(a=1, b=struct(c=[1, 2]))\ns.b.c[1] = 5\ns.a = 2.5\nsay(s.b.c)\nsay(s.a)",
         [(1, 5), 2.5]),
        ("s = struct(a=1)\nt = s\nt.a = 2\nsay([s.a, t.a])\nsay(s == t)", [(1, 2), False]),
        ("a = make_list(2, struct(x=1), 4)\na[1].x = 3\nsay(a[0].x + a[1].x)\nsay(a.length())",
         [4, 2]),
        ("a = make_list(0, 0, 3)\na.append(1)\na.extend([2, 3])\nsay(a)\nsay(a.pop())\nsay(a)",
         [(1, 2, 3), 3, (1, 2)]),
        ("a = [1, 2, 3]\na.remove(0)\na.insert(1, 9)\nsay(a)\na.clear()\nsay(a.length())",
         [(2, 9, 3), 0]),
        ("s = struct(a=make_list(0, 0, 2))\ns.a.append(4)\nsay(s.a)", [(4,)]),
        # a variable's list keeps its room
        ("a = [1, 2, 3]\na = make_list(1, 5, 9)\nsay(a)\nsay(a.capacity())", [(5,), 3]),
        ("a = [0, 0]\na = struct(x=1, y=2)\nsay(a)", [(1, 2)]),
        ("a = [[1, 2], [3, 4]]\na[1][0] = 7\na[0, 1] = 8\nsay(a)", [((1, 8), (7, 4))]),
        ("x = 0\nx = run_it()\nsay(x)\ndef run_it():\nreturn None\nend", [None]),
    ],
)  # fmt: skip
def test_parts_of_values_change_where_they_stand_and_nowhere_else(body, values):
    assert said(body) == values


def test_killing_a_thread_kills_those_that_it_has_started():
    child = "thread child():\nsync()\nsync()\nsay(1)\nend\n"
    body = (
        f"{child}thread parent():\nx = run child()\nsync()\nsync()\nend\nt = run parent()\nsync()\n"
    )
    assert said(f"{body}kill t\nsync()\nsync()\nsync()") == []
    assert said(f"{body}join t\nsync()\nsync()") == [1]


def test_a_secondary_program_may_take_no_time():
    machine = Machine()
    assert machine.program("sec s():\nsay(1)\nend").running
    for waits in ("sync()", "say(later(1))", "x = 0\njoin x", "thread t():\nend\nx = run t()"):
        with pytest.raises(ScriptError, match="secondary program"):
            machine.program(f"sec s():\n{waits}\nend")


def test_statements_outside_of_a_program_are_one():
    machine = Machine()
    machine.program("def f(x):\n return 2 * x\nend\nsay(f(4))  say(1)").step()
    assert machine.said == [8, 1]


@pytest.mark.parametrize(
    ("source", "place", "told"),
    [
        ("def f():\n  there_is_none()\nend", (2, 3), "compile_error_name_not_found:there_is_none:"),
        ("def f():\n  x = 1 + nothing\nend", (2, 11), "compile_error_name_not_found:nothing:"),
        ("def f():\n  say(1\nend", (3, 1), "syntax_error_on_line:3:end:"),
        ("def f():\n  say(1, a=)\nend", (2, 12), "syntax_error_on_line:2:  say(1, a=):"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_as_a_controller_tells_it(source, place, told):
    """The first as the maker's own tests of its client library have it from a controller."""
    with pytest.raises(ScriptError) as refused:
        Machine().program(source)
    assert (refused.value.line, refused.value.column) == place
    assert refused.value.told == told


def test_a_value_that_stands_on_the_next_line_belongs_to_the_assignment():
    assert said("global offset = # note\n0    global other = 3\nsay(offset + other)") == [3]
    assert said("x = [1,\n 2]\nsay(x)\ny = 1 +\n 2\nsay(y)") == [(1, 2), 3]


def test_names_that_python_keeps_and_a_variable_named_as_poses_are():
    assert said("async = 7\nlambda = 8\np = p[0, 1, 2, 3, 4, async]\nsay(p[5] + lambda)") == [15]


@pytest.mark.parametrize(
    ("source", "line", "why"),
    [
        ("def main():\nend\nend", 3, "syntax error"),
        ("def main():\nend garbage", 2, "not defined"),
        ("def main():\n say(1)\n", 2, "no `end`"),
        ("def main():\n x = = 2\nend", 2, "syntax error"),
        ("def main():\n\n say(\u00e9)\nend", 3, "syntax error"),
        ("def main(a):\nend", 1, "no parameters"),
        ("thread main():\nend", 1, "begins with"),
        ("def main():\n x.append()\nend", 2, "takes 1 arguments"),
        ("def main():\n sec f():\nend\nend", 2, "stands by itself"),
        ("def main():\n struct(1)\nend", 2, "with names"),
        ("def main():\n 1 = 2\nend", 2, "assigned to"),
        ("def main():\n break\nend", 2, "outside of a loop"),
        ("def main():\n say(nothing)\nend", 2, "not defined"),
        ("def main():\n unknown()\nend", 2, "no function"),
        ("def main():\n t = run say(1)\nend", 2, "no thread"),
        ("def main():\n say()\nend", 2, "lacks"),
        ("def main():\n say(1, 2)\nend", 2, "takes 1 arguments"),
        ("def main():\n say(1, value=2)\nend", 2, "takes 1 arguments"),
        ("def main():\n say(valu=2)\nend", 2, "no parameter"),
        ("def main():\n add(a=1, 2)\nend", 2, "come before"),
        ("def main():\n port(48)\nend", 2, "integer from 0 to 47"),
        ("def main():\n x = " + "9" * 301 + "\nend", 2, "too long a number"),
        (
            "def main():\n x = " + "(" * 5000 + "1" + ")" * 5000 + "\nend",
            2,
            f"deeper than {DEEPEST}",
        ),
        ("def main():\n x = " + "[" * 200_000, 2, f"deeper than {DEEPEST}"),
        ("def main():\n x = " + "not " * 1000 + "True\nend", 2, f"deeper than {DEEPEST}"),
        ("def main():\n x = y" + " + y" * 1000 + "\nend", 2, f"deeper than {DEEPEST}"),
        ("def main():\n x = [" + "0, " * 5000 + "0]\nend", 2, "words at most"),
        ("def main():\n x = True" + " or True" * 5000 + "\nend", 2, "words at most"),
        (
            "def main():\n" + "if True:\n" * 5000 + "end\n" * 5001,
            DEEPEST + 3,
            f"deeper than {DEEPEST}",
        ),
        (
            "def main():\n" + "".join(f"a{k} = 1\n" for k in range(MAX_VARIABLES + 1)) + "end",
            1,
            f"{MAX_VARIABLES} global variables",
        ),
        ('def main():\n x = "' + "a" * (LONGEST_STRING + 1) + '"\nend', 2, "characters at most"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_what_is_no_program_is_refused_with_line_and_reason(source, line, why):
    with pytest.raises(ScriptError, match=why) as refused:
        Machine().program(source)
    assert refused.value.line == line


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("say(1 / 0)", "division"),
        ("say([1][3])", "index 3"),
        ("say([1][-1])", "index -1"),
        ("say([1][0.0])", "index is an integer"),
        ("say(later(1)[0])", "only lists"),
        ("say(2147483647 + 1)", "integer overflow"),
        ("x = 3\nwhile True:\nx = x * x\nend", "integer overflow"),
        ("x = [1]\nwhile True:\nx = [x, x]\nend", "nest"),
        (f"x = [{'0, ' * 500}0]\ny = [x, x]", f"{LONGEST_LIST} elements"),
        ("say(True + 1)", "not defined"),
        ('say("a" * 2)', "not defined"),
        ('say("a" + 2)', "not defined"),
        ("say([1, 2] + [1, 2, 3])", "not defined"),
        ("say([1, 2] * [[1, 2], [3, 4]])", "not defined"),
        ("say([[1, 2]] / [[1, 2]])", "not defined"),
        ("say([[65536], [1]] * [[65536, 1]])", "integer overflow"),
        ("a = [" + "0, " * 100 + "0]\nsay(transpose([a]) * [a])", "elements at most"),
        ("say(-p[1, 2, 3, 4, 5, 6])", "not defined"),
        ("say(inv([[1, 2], [2, 4]]))", "singular"),
        ("assert(1 == 2)", "does not hold"),
        ("a = [1, 2]\na.append(3)", "room for 2"),
        ("a = [1, 2]\na = [1, 2, 3]", "room for 2"),
        ("a = struct(x=1)\na.x = \"b\"", "stays one"),
        ("a = struct(x=1)\nsay(a.y)", "no member y"),
        ("a = struct(x=1)\nsay(a[\"x\"])", "index is an integer"),
        ("a = 1\na.initialize(2)", "no method"),
        ('say(str_at("", 0))', "index 0"),
        ('say(to_num("123abc"))', "no number"),
        ('say(to_num("4294967296"))', "out of range"),
        ("x = make_list(5, [1, 2, 3], 9)\nsay(x.slice(2, 9))", "slice"),
        ('say("a" < "b")', "order"),
        ("say(True < 2)", "order"),
        ('if "a":\nend', "condition"),
        ("y = p[1, 2, 3, 4, 5, True]", "six numbers"),
        ("y = p[1, 2, 3, 4, 5, 6]\ny[0] = True", "six numbers"),
        ("def f():\nsay(a)\nlocal a = 1\nend\nf()", "before it has a value"),
        ("def f(x):\nreturn f(x + 1)\nend\nf(1)", f"{DEEPEST_CALL} deep"),
        (f"thread t():\nwhile True:\nsync()\nend\nend\ni = 0\nwhile i < {MAX_THREADS}:\nx = run "
         "t()\ni = i + 1\nend",
         f"{MAX_THREADS} threads"),
        ('x = "' + "a" * 1000 + '"\ny = [' + "x, " * 20 + "x]", f"{LONGEST_LIST} elements"),
        (
            "def f(x):\n" + "".join(f"local a{k} = 1\n" for k in range(200)) + "f(x)\nend\nf(1)",
            f"{MAX_SLOTS} variables",
        ),
        ("joints([1, 2, 3, 4, 5, 1e308 * 10])", "six numbers"),
        ("add(1e308 * 10)", "a is a number"),
        ("add(later(0))\nport(1 / 2)", "integer from 0"),
    ],
    ids=lambda value: str(value)[:30],
)  # fmt: skip
def test_an_error_in_a_program_is_told_with_its_line(line, why):
    with pytest.raises(ScriptError, match=why) as ended:
        Machine().run(f"\n{line}")
    assert ended.value.line >= 3


def test_the_line_of_an_error_is_that_of_the_statement():
    with pytest.raises(ScriptError) as ended:
        Machine().run("def f(x):\n sync()\n return 1 / x\nend\nsay(1)\nsay(f(0))")
    assert ended.value.line == 4


def test_halt_ends_a_program_from_wherever_it_stands():
    assert said("thread t():\nsync()\nhalt\nend\nx = run t()\nwhile True:\nsync()\nend") == []
    assert Machine().run("def f():\nhalt\nend\nf()\nsay(1)") == 1


def test_calls_that_double_at_every_level_take_many_periods_and_none_of_them_long():
    functions = "".join(f"def f{k}():\nf{k + 1}()\nf{k + 1}()\nend\n" for k in range(40))
    assert Machine().run(f"{functions}def f40():\nend\nf0()", periods=50) == 50


def test_a_costly_function_ends_a_turn_whose_time_is_up():
    machine = Machine()

    def long(x):
        until = time.thread_time() + 2 * SLICE
        while time.thread_time() < until:
            pass
        return x

    machine.functions["long"] = row("long", long, Parameter("x", NUMBER), costly=True)
    machine.run("i = 0\nwhile i < 3:\ni = i + long(0) + long(1)\nsay(i)\nend")
    assert machine.said == [1, 2, 3]
    assert machine.run("x = [long(1), long(2), long(3)]\nsay(x)") == 4


def test_threads_that_had_no_turn_begin_the_next_period():
    machine = Machine()

    def long():
        until = time.thread_time() + 2 * SLICE
        while time.thread_time() < until:
            pass

    machine.functions["long"] = row("long", long, costly=True)
    machine.run(
        "thread a():\nwhile True:\nlong()\nsay(1)\nend\nend\nthread b():\nwhile "
        "True:\nlong()\nsay(2)\nend\nend\nx = run a()\ny = run b()\nwhile "
        "True:\nlong()\nsay(0)\nend",
        periods=9,
    )
    assert set(machine.said[-3:]) == {0, 1, 2}


def test_a_program_that_runs_again_has_forgotten_what_it_knew():
    machine = Machine()
    loading = load("def main():\nif later(False):\na = 1\nend\nsay(a)\nend", machine.functions)
    with pytest.raises(StopIteration) as done:
        while True:
            next(loading)
    for _ in range(2):
        program = Program(done.value.value)
        done.value.value.variables[0] = 5
        program.step()
        program.end()
    program = Program(done.value.value)
    program.step()
    with pytest.raises(ScriptError, match="before it has a value"):
        program.step()


def test_programs_arrive_whole_however_the_packets_are_cut():
    text = b"set unlock protective stop\ndef a():\n if True:\n  x = 1 #end\n end\nend\n"
    text += b"# if\n\nsec b():\r\n y = 'end' if y == 1: y = 2 end\r\n $ 1 \"end\"\r\nend\r\n"
    text += b"def c(): return 1 end\na()\n"
    for size in (1, 7, len(text)):
        splitter = Splitter()
        pieces = [text[i : i + size] for i in range(0, len(text), size)]
        programs = [program for piece in pieces for program in splitter.feed(piece)]
        assert [program.split("\n")[0] for program in programs] == [
            "set unlock protective stop",
            "def a():",
            "sec b():\r",
            "def c(): return 1 end",
            "a()",
        ]


@pytest.mark.parametrize("line", [b"x = 1\n", b"x"])
def test_a_program_without_end_is_not_kept_for_ever(line):
    splitter = Splitter()
    splitter.feed(b"def a():\n")
    with pytest.raises(ScriptError, match="characters at most"):
        for _ in range(LONGEST_PROGRAM // 1000):
            splitter.feed(line * 1000)
