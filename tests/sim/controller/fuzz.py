"""Programs and bytes that nobody wrote, for every port of a twin: `make fuzz`, and less of it in
the tests.

`python -m tests.sim.controller.fuzz [COUNT] [SEED]` starts a twin, and says what became of it.
"""

import json
import os
import random
import re
import signal
import socket
import struct
import sys
import tempfile
import time
from pathlib import Path

from sim.controller.fault_injection import CONTROL_PORT, TwinControl
from sim.controller.urscript.signature import REQUIRED
from sim.controller.variables import INPUTS, OUTPUTS
from sim.scene import Scene
from tests.sim.controller.programs import switched_on
from tests.sim.controller.served import address, served

BATCH = 20
"""Cases between two looks at whether the twin lives."""
ANSWERS_WITHIN = 2.5
"""[s]"""
KEYWORDS = (
    *(
        "def",
        "thread",
        "sec",
        "end",
        "global",
        "local",
        "if",
        "elif",
        "else",
        "while",
        "return",
        "break",
    ),
    *(
        "continue",
        "halt",
        "pass",
        "enter_critical",
        "exit_critical",
        "kill",
        "join",
        "run",
        "and",
        "or",
    ),
    *("xor", "not", "True", "False"),
)
PYTHON = (
    *(
        "__import__",
        "open",
        "exec",
        "eval",
        "compile",
        "exit",
        "quit",
        "input",
        "getattr",
        "setattr",
    ),
    *("globals", "locals", "vars", "dir", "type", "object", "print", "__builtins__", "__class__"),
    *(
        "__subclasses__",
        "__globals__",
        "os",
        "sys",
        "self",
        "None",
        "lambda",
        "import",
        "class",
        "yield",
    ),
    *("async", "nonlocal"),
)
NUMBERS = (
    "0",
    "1",
    "2",
    "-1",
    "47",
    "48",
    "0.002",
    "0.5",
    "3.14159",
    "1e-300",
    "1e308",
    "2147483647",
)
WRONG_NUMBERS = ("1e999", "99999999999", ".5", "5.", "1e")
OPERATORS = ("+", "-", "*", "/", "%", "==", "!=", "<", "<=", ">", ">=", "and", "or", "xor")
SYMBOLS = (*tuple("()[],:=.'\"#$\\\n\t;{}@\x00é\r"), "p[")
WORDS = (
    "robotmode",
    "play",
    "stop",
    "pause",
    "power",
    "on",
    "off",
    "brake",
    "release",
    "unlock",
    "load",
    "popup",
)


class Programs:
    """Grammar-aware programs, drawn from a seed: most are valid, so that they run; the wild ones
    need not be.
    """

    def __init__(self, draw: random.Random, functions: dict) -> None:
        self._draw, self._functions = draw, functions
        self._wild = draw.random() < 0.2
        self._names = [*"abcpq", *draw.sample([word for word in PYTHON if word not in KEYWORDS], 3)]
        self._loops = 0

    def program(self) -> str:
        """One."""
        draw = self._draw
        kind = draw.choice(("def", "sec", "thread")) if self._wild else "def"
        values = "\n".join(f"{name} = {self._value()}" for name in self._names)
        routines = f"def f(x, y=1):\n{self._block(2)}\nend\nthread t():\n{self._block(2)}\nend"
        return f"{kind} main():\n{values}\n{routines}\n{self._block(3)}\nsync()\nend\n"

    def _value(self) -> str:
        numbers = ", ".join(f"{self._draw.uniform(-2, 2):.3g}" for _ in range(6))
        return self._draw.choice(
            [
                f"[{numbers}]",
                f"p[{numbers}]",
                self._draw.choice(NUMBERS),
                self._draw.choice(['"x"', "True", "None", "struct(a=1, b=[1, 2])"]),
                self._draw.choice(["[[1, 2], [3, 4]]", "make_list(2, 1.5, 9)"]),
            ]
        )

    def _block(self, depth: int) -> str:
        return "\n".join(self._statement(depth) for _ in range(self._draw.randint(1, 5)))

    def _statement(self, depth: int) -> str:
        draw, name = self._draw, self._draw.choice(self._names)
        if depth == 0:
            return f"{name} = {self._expression(1)}"
        choices = [
            lambda: f"{draw.choice(['', 'global '])}{name} = {self._expression(depth)}",
            lambda: f"{name}[{draw.randrange(6)}] = {self._expression(depth)}",
            lambda: self._call(depth),
            lambda: self._call(depth),
            lambda: "sync()",
            lambda: f"if {self._truth()}:\n{self._block(depth - 1)}\nelse:\n{self._block(0)}\nend",
            lambda: self._loop(depth),
            lambda: f"{name} = run t()",
            lambda: f"kill {name}",
            lambda: draw.choice([f"{name}.append(1)", f"{name}.a = {self._expression(1)}"]),
            lambda: draw.choice(["halt", "enter_critical", "exit_critical", "return 1"]),
            lambda: draw.choice(["break", "continue"]) if self._loops else "pass",
        ]
        wild = [
            lambda: f"{name}.{draw.choice(self._names)} = {self._expression(1)}",
            lambda: (
                f"def {name}({draw.choice(['', 'x', 'x=1, y'])}):\n{self._block(depth - 1)}\nend"
            ),
            lambda: f"thread {name}():\n{self._block(depth - 1)}\nend",
            lambda: f"{name} = run {draw.choice(self._names)}()",
            lambda: draw.choice(["break", "continue", f"join {name}"]),
        ]
        return draw.choice(choices + wild * self._wild)()

    def _loop(self, depth: int) -> str:
        self._loops += 1
        body = self._block(depth - 1)
        self._loops -= 1
        return f"while {self._truth()}:\n{body}\nend"

    def _truth(self) -> str:
        return self._draw.choice(
            ["True", "False", "is_steady()", "not True", "1 < 2 or 1 / 0 == 1", "length([1]) == 1"]
        )

    def _expression(self, depth: int) -> str:
        draw = self._draw
        if depth <= 0:
            return draw.choice(
                [draw.choice(NUMBERS + WRONG_NUMBERS * self._wild), draw.choice(self._names)]
            )
        inner = [self._expression(depth - 1) for _ in range(6)]
        return draw.choice(
            [
                f"{inner[0]} {draw.choice(OPERATORS)} {inner[1]}",
                f"({inner[0]})",
                f"[{', '.join(inner[: draw.randint(0, 6)])}]",
                self._value(),
                f"{draw.choice(self._names)}[{draw.randrange(6)}]",
                f"{draw.choice(self._names)}.{draw.choice(['b', 'pop()', 'to_string()'])}",
                f"f({inner[0]}, y={inner[1]})",
                f"-{inner[0]}",
                self._call(depth - 1),
            ]
        )

    def _call(self, depth: int) -> str:
        draw = self._draw
        if self._wild and draw.random() < 0.2:
            return f"{draw.choice([*PYTHON, *self._names])}({self._expression(0)})"
        function = self._functions[draw.choice(list(self._functions))]
        given = [p for p in function.parameters if p.default is REQUIRED or draw.random() < 0.3]
        arguments = (f"{p.name}={self._argument(p.kind.name, depth)}" for p in given)
        return f"{function.name}({', '.join(arguments)})"

    def _argument(self, kind: str, depth: int) -> str:
        draw = self._draw
        if draw.random() < 0.05:
            return self._expression(depth)
        size = draw.choice([0.01, 1.0, 1.0, 3.0, 1e3, 1e6])
        numbers = [f"{draw.uniform(-size, size):.3g}" for _ in range(6)]
        if "six" in kind or kind == "a pose":
            return f"{draw.choice(['', 'p'])}[{', '.join(numbers)}]"
        by_kind = {
            "three numbers": f"[{', '.join(numbers[:3])}]",
            "a number": draw.choice([numbers[0], *NUMBERS]),
            "a positive number": draw.choice([numbers[0].strip("-"), "1e-300", "1e308", "0.002"]),
            "True or False": draw.choice(["True", "False", "0"]),
            "a list": f"[{numbers[0]}]",
            "a string": '"text"',
            "the name of an input": f'"input_int_register_{draw.randrange(48)}"',
        }
        return by_kind.get(kind, str(draw.randrange(4)))


def mutated(draw: random.Random, text: str) -> str:
    """A text with a few words exchanged, cut or doubled."""
    for _ in range(draw.randint(1, 6)):
        at, length = draw.randrange(len(text) + 1), draw.randrange(12)
        new = draw.choice(
            [
                draw.choice(SYMBOLS),
                draw.choice(KEYWORDS),
                draw.choice(PYTHON),
                text[at : at + length],
            ]
        )
        text = text[:at] + new * draw.choice([1, 1, 1, 50]) + text[at + length :]
    return text


def noise(draw: random.Random) -> tuple[int, bytes]:
    """Bytes for a port that is no script's."""
    names = ",".join(
        draw.choices([*INPUTS, *OUTPUTS, "nonsense", ""], k=draw.randint(1, 30))
    ).encode()
    rtde = [
        (b"V", struct.pack(">H", draw.randrange(4))),
        (b"v", b""),
        (
            b"O",
            struct.pack(">d", draw.choice([500.0, 1.0, 0.0, -1.0, float("nan"), float("inf")]))
            + names,
        ),
        (b"I", names),
        (b"S", b""),
        (b"P", b""),
        (b"U", bytes([draw.randrange(4)]) + draw.randbytes(draw.randrange(200))),
        (bytes([draw.randrange(256)]), b"x"),
    ]
    packages = b"".join(
        struct.pack(">HB", 3 + len(body), kind[0]) + body
        for kind, body in draw.choices(rtde, k=draw.randint(1, 12))
    )
    request = json.dumps(
        {
            "do": draw.choice(["status", "silence", "freeze_sensor", "reset", "release", "x"]),
            **draw.choice([{}, {"seconds": 0.01}, {"on": True}, {"seconds": "x"}]),
        }
    ).encode()
    dashboard = " ".join(draw.choices(WORDS, k=draw.randint(1, 3))).encode()
    port, data = draw.choice(
        [(30004, packages), (29999, dashboard + b"\n"), (CONTROL_PORT, request + b"\n")]
    )
    for _ in range(draw.choice([0, 1, 5])):
        at = draw.randrange(len(data))
        data = data[:at] + draw.randbytes(draw.randint(1, 3)) + data[at + draw.randrange(3) :]
    return port, draw.choice([data, data, data * 20, data[: len(data) // 2], draw.randbytes(300)])


def cases(count: int, seed: int):
    """So many of (port, bytes)."""
    draw = random.Random(seed)
    scene = Scene()
    functions = switched_on(scene).functions
    for _ in range(count):
        programs, kind = Programs(draw, functions), draw.random()
        text = programs.program()
        if kind < 0.3:
            yield noise(draw)
        elif kind < 0.6:
            yield (
                draw.choice((30001, 30002, 30003, 30011, 30013)),
                mutated(draw, text).encode("utf-8", "replace") + b"\nend\n",
            )
        else:
            yield 30003, text.encode()


def send(host: str, port: int, data: bytes) -> None:
    """To a port that may hang up in the middle of it."""
    with socket.create_connection((host, port), 10) as sock:
        try:
            sock.sendall(data)
            sock.setblocking(False)
            sock.recv(65536)
        except OSError:
            pass


def resident_mb(process_id: int) -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{process_id}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE") / 1e6


PERMITTED = re.compile(r"socket\.connect .*\('127\.[\d.]+', \d+\)\)\"")
"""A program's own, to the machine that sent it."""


def unpermitted(effects):
    """What the twin did outside of itself that no program may bring about."""
    return [line for line in effects.read_text().splitlines() if not PERMITTED.fullmatch(line)]


def fuzz(host: str, process, count: int, seed: int) -> dict[str, float]:
    """Send so many; fails as soon as the twin is gone or slow. What was seen."""
    longest, memory = 0.0, []
    control = TwinControl(host)
    for k, (port, data) in enumerate(cases(count, seed)):
        send(host, port, data)
        time.sleep(0.004)
        if k % BATCH == BATCH - 1:
            start = time.monotonic()
            control.do("release")
            send(host, 29999, b"restart safety\npower on\nbrake release\n")
            state = control.do("status")
            longest = max(longest, time.monotonic() - start)
            assert process.poll() is None, f"the twin is gone after case {k} of seed {seed}"
            assert longest < ANSWERS_WITHIN, f"the twin hangs at case {k} of seed {seed}"
            assert all(abs(q) < 100 for q in state["q"]), (
                f"the arm is lost after case {k} of seed {seed}"
            )
            memory.append(resident_mb(process.pid))
    control.close()
    return {
        "slowest answer [s]": longest,
        "memory after half [MB]": memory[len(memory) // 2],
        "memory at the end [MB]": memory[-1],
    }


def main(count: int = 10_000, seed: int = 0) -> None:
    """Start a twin and fuzz it."""
    host = address(37)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "effects"
        with served(
            host, clock="real-time", module=("tests.sim.controller.watched", str(log))
        ) as process:
            for what, value in fuzz(host, process, count, seed).items():
                print(f"{what}: {value:.3f}")
            start = time.monotonic()
            process.send_signal(signal.SIGTERM)
            process.wait(10)
            print(f"from SIGTERM to the end [s]: {time.monotonic() - start:.2f}")
        effects = unpermitted(log)
    print(
        f"{count} programs and byte strings: the twin lives; effects outside of it: {len(effects)}"
    )
    sys.exit("\n".join(effects[:20]) if effects else 0)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
