"""URScript as client libraries upload it, translated and run."""

from itertools import islice

import pytest
from sim.controller.program import Program

from sim.controller.urscript import ScriptError, Splitter, translate


class Machine:
    """A controller that remembers what programs wrote, and waits a period in `sync` and `sleep`."""

    def __init__(self):
        self.said = []

    def run(self, source, periods=100):
        def sync():
            yield

        functions = {"say": self.said.append, "sync": sync, "__pose": lambda values: ("pose", *values)}
        program = Program(source, functions, frozenset({"sync"}))
        for taken in range(periods):
            if not program.running:
                return taken
            program.step()
        return periods


def test_what_a_program_computes_and_when_it_waits():
    machine = Machine()
    source = """
def main():
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
end
"""
    assert machine.run(source) == 4
    assert machine.said == ["two # no comment", "three", 4]


def test_functions_wait_inside_and_give_values_back():
    machine = Machine()
    machine.run("def main():\n def twice(y):\n  sync()\n  return 2 * y\n end\n say(twice(twice(3)))\nend\n")
    assert machine.said == [12]


def test_threads_take_turns_and_can_be_killed():
    machine = Machine()
    source = """
def main():
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
end
"""
    machine.run(source)
    assert machine.said == [2, 2]


def test_a_global_is_one_in_every_function():
    machine = Machine()
    machine.run("def main():\n global g = 1\n def set():\n  g = 5\n end\n set()\n say(g)\nend\n")
    assert machine.said == [5]


def test_a_value_that_stands_on_the_next_line_belongs_to_the_assignment():
    machine = Machine()
    machine.run("def main():\n global offset = # note\n0    global other = 3\n say(offset + other)\nend\n")
    assert machine.said == [3]


def test_poses_indices_and_names_that_python_keeps():
    machine = Machine()
    machine.run("def main():\n async = 7\n p = p[0, 1, 2, 3, 4, async]\n say(p[6])\n q = [1, 2]\n say(q[1])\nend\n")
    assert machine.said == [7, 2]


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("say(1)", "begins with"),
        ("def main():\n say(1)\n", "no `end`"),
        ("def main():\n x = = 2\nend", "not understood"),
    ],
)
def test_what_is_no_program_is_refused_with_the_reason(source, why):
    with pytest.raises(ScriptError, match=why):
        translate(source, frozenset())


@pytest.mark.parametrize("line", ["say(1 / 0)", "say(nothing)", "unknown()", "say([1][3])"])
def test_an_error_in_a_program_ends_it(line):
    with pytest.raises(ScriptError, match="main"):
        Machine().run(f"def main():\n {line}\nend")


def test_programs_arrive_whole_however_the_packets_are_cut():
    text = b"set unlock protective stop\ndef a():\n if True:\n  x = 1\n end\nend\nsec b():\n y = 1\nend\n"
    for size in (1, 7, len(text)):
        splitter = Splitter()
        pieces = [text[i : i + size] for i in range(0, len(text), size)]
        programs = [program for piece in pieces for program in splitter.feed(piece)]
        assert [program.split("\n")[0] for program in programs] == [
            "set unlock protective stop",
            "def a():",
            "sec b():",
        ]


def test_the_same_text_is_translated_once():
    source = "def main():\n x = 1\nend"
    first, second = islice((translate(source, frozenset()) for _ in range(2)), 2)
    assert first is second
