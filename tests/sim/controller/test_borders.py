"""Nobody gets in: what programs and clients cannot do to the twin, or to the machine that it
runs on.
"""

import ast
import itertools
import json
import signal
import socket
import struct
import time
from contextlib import closing
from pathlib import Path

import pytest

import sim.controller
from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import DASHBOARD_PORT, RTDE_PORT
from sim.controller import clients
from sim.controller.clients import LONGEST_LINE, NOT_READING, Client
from sim.controller.fault_injection import CONTROL_PORT, TwinControl
from sim.controller.server import MAX_CLIENTS, READ_ONLY_PORTS, SCRIPT_PORTS
from tests.sim.controller.fuzz import fuzz, unpermitted
from tests.sim.controller.served import address, served
from tests.sim.controller.wire import Stream, Wire

HOST, OTHER_HOST = address(35), address(36)
ENDS_WITHIN = 2.0
"""Of SIGTERM [s]."""
MARK = "mark-of-a-program-that-got-out"

TRIES = [
    f'__import__("os").system("touch {MARK}")',
    f'open("{MARK}", "w")',
    f'exec("open(\\"{MARK}\\", \\"w\\")")',
    f"eval(\"open('{MARK}', 'w')\")",
    "exit()",
    "quit()",
    "raise SystemExit",
    "import os",
    f'x = ().__class__.__base__.__subclasses__()\nx[0]("{MARK}")',
    f'x = sync.__globals__["__builtins__"]["open"]("{MARK}", "w")',
    f"x = \"{{0.__class__}}\".format(1)\ny = f\"{{open('{MARK}', 'w')}}\"",
    f'x = getattr(sync, "__globals__")\nsetattr(x, "a", open("{MARK}", "w"))',
    f'def f(x=open("{MARK}", "w")):\nend\nf()',
    f'def f(x=__import__("os").system("touch {MARK}")):\nend',
    f'x = [open("{MARK}", "w") for x in [1]]',
    f'x = lambda: open("{MARK}", "w")\nx()',
    f'@open("{MARK}", "w")\ndef f():\nend',
    f'global x = breakpoint()\nprint("{MARK}", file=open("{MARK}", "w"))',
    f'x = run open("{MARK}", "w")',
    "kill __builtins__\njoin open",
    'x = __builtins__\ny = x["open"]',
    "__pose = 1\n__run = 2\n__kill = 3\nx = __run(sync)",
    f'def __init__(self):\nopen("{MARK}", "w")\nend\n__init__(1)',
    f'end\nopen("{MARK}", "w")\ndef g():',
    f'textmsg("a")\nend\nend\n__import__("os").system("touch {MARK}")\nif True:',
    f'x = "\\" + open("{MARK}", "w") + "',
    f"x = 1 # \r open('{MARK}', 'w')",
    f"x = 1;open('{MARK}', 'w')",
    f"x: open('{MARK}', 'w') = 1",
    f"p[1,2,3,4,5,open('{MARK}','w')]",
    'socket_open("10.0.0.1", 80)\nsocket_open("example.org", 80)',
    f'load_module("{MARK}")\nrpc_factory("xmlrpc", "http://127.0.0.1/")\nzzz()',
]
"""To leave the language, by the ways of Python, of the translation that once was, and of URScript
itself."""


@pytest.fixture(scope="module")
def effects(tmp_path_factory):
    return tmp_path_factory.mktemp("borders") / "effects"


@pytest.fixture(scope="module")
def process(effects):
    with served(
        HOST, clock="real-time", module=("tests.sim.controller.watched", str(effects))
    ) as process:
        yield process


@pytest.fixture
def twin(process):
    with closing(TwinControl(HOST)) as twin:
        yield twin


def upload(*programs, port=30003):
    with socket.create_connection((HOST, port), 10) as sock:
        sock.sendall("".join(f"{program}\n" for program in programs).encode())


def wait_for(condition, longest=10.0):
    """Until it holds; whether it does."""
    end = time.monotonic() + longest
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def test_nothing_in_the_controller_runs_text_or_looks_names_up():
    forbidden = {"exec", "eval", "compile", "getattr", "setattr", "__import__", "globals", "vars"}
    for path in Path(sim.controller.__path__[0]).rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert not {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} & forbidden, (
            path
        )


def test_no_program_leaves_the_language(twin, effects, process):
    for words in TRIES:
        for program in (words, f"def main():\n{words}\nend", f"sec main():\n{words}\nend"):
            upload(program)
            upload("def sound():\nsync()\nwrite_output_integer_register(20, 1)\nend")
            assert twin.do("status")["runtime"] in (1, 2)
    assert process.poll() is None
    assert effects.read_text() == ""
    assert not list(Path.cwd().rglob(MARK))


@pytest.mark.parametrize("port", [*SCRIPT_PORTS, READ_ONLY_PORTS[0]])
@pytest.mark.parametrize(
    "request_line",
    [
        b"POST / HTTP/1.1\r\n",
        b"GET /x HTTP/1.1\r\n",
        b"def / HTTP/1.1\r\n",
        b"FOO /" + b"a" * LONGEST_LINE + b" HTTP/1.1\r\n",
        b"PRI * HTTP/2.0\r\n",
        b"\x16\x03\x01\x02\x00\x01\n",  # TLS
    ],
    ids=["POST", "GET", "def", "long", "HTTP/2", "TLS"],
)
def test_a_browser_is_hung_up_on_and_what_it_brings_is_not_run(twin, port, request_line):
    body = b"def main():\nwrite_output_integer_register(21, 77)\nwhile True:\nsync()\nend\nend\n"
    for pieces in (
        [request_line + b"Host: x\r\n\r\n" + body],
        [request_line[:2], request_line[2:], b"\r\n" + body],
    ):
        with socket.create_connection((HOST, port), 10) as sock:
            try:
                for piece in pieces:
                    sock.sendall(piece)
                    time.sleep(0.02)
                while sock.recv(1000):
                    pass
            except ConnectionError:
                pass
    assert read(21) == 0


@pytest.mark.parametrize("port", [RTDE_PORT, DASHBOARD_PORT, CONTROL_PORT])
def test_a_browser_is_hung_up_on_at_the_other_ports(process, port):
    with socket.create_connection((HOST, port), 10) as sock:
        sock.sendall(b'POST / HTTP/1.1\r\nHost: x\r\n\r\n{"do": "emergency_stop"}\nstop\n')
        assert wait_for(lambda: is_closed(sock))
    with closing(TwinControl(HOST)) as twin:
        assert twin.do("status")["safety"] == 1


def test_what_begins_with_a_message_that_rtde_has_not_is_hung_up_on(process):
    for start in (b"\x16\x03\x01\x02\x00\x01", b"\x00\x03\x00"):
        with socket.create_connection((HOST, RTDE_PORT), 10) as sock:
            sock.sendall(start + b"\x00" * 0x1603)
            assert wait_for(lambda sock=sock: is_closed(sock))


def test_one_client_that_sends_much_leaves_the_others_their_turn(twin):
    with socket.create_connection((HOST, 30002), 10) as sock:
        for k in range(20):
            body = "x = [1, 2, 3]\n" * 9_000
            sock.sendall(f"def long{k}():\n{body}end\n".encode())
        upload("def short():\nwrite_output_integer_register(23, 5)\nend")
        assert wait_for(lambda: read(23) == 5)
    upload("stop program")


def is_closed(sock):
    try:
        return sock.recv(1000) == b""
    except ConnectionError:
        return True


def read(register):
    """An integer register of the controller."""
    with closing(Wire(HOST)) as wire:
        wire.outputs(500, [f"output_int_register_{register}"])
        wire.ask(b"S")
        kind, body = wire.read()
        while kind == b"M":  # the error of an earlier program may be told in between
            kind, body = wire.read()
        return struct.unpack(">xi", body)[0]


def test_the_error_of_a_program_is_told_with_its_line_to_all_who_listen(twin):
    listeners = [Stream(HOST, port) for port in (30001, 30011)]
    with closing(Wire(HOST)) as wire:
        wire.outputs(1, ["timestamp"])
        wire.ask(b"S")
        upload("def main():\n sync()\n x = 1 / 0\nend")
        for listener in listeners:
            body = listener.message(10)
            assert struct.unpack_from(">i", body) == (3,)
            assert body[8:] == b"division by zero"
            listener.close()
        messages = [wire.read() for _ in range(2)]
    assert any(kind == b"M" and b"line 3: division by zero" in body for kind, body in messages)
    assert twin.do("status")["program_error"] == "line 3: division by zero"


def test_a_program_that_is_refused_leaves_the_running_one_alone(twin):
    upload("def main():\nwhile True:\nwrite_output_integer_register(22, 5)\nsync()\nend\nend")
    assert wait_for(lambda: twin.do("status")["runtime"] == 2)
    upload("def other():\n x = = 1\nend", "nonsense()")
    assert wait_for(lambda: "nonsense" in twin.do("status")["program_error"])
    assert twin.do("status")["runtime"] == 2
    upload("stop program")
    assert wait_for(lambda: twin.do("status")["runtime"] == 1)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_numbers_that_are_none_are_refused_in_registers_and_sliders(twin, value):
    for name, mask in (
        ("input_double_register_30", b""),
        ("speed_slider_fraction", struct.pack(">I", 1)),
    ):
        with closing(Wire(HOST)) as wire:
            names = f"{name},speed_slider_mask" if mask else name
            assert wire.ask(b"I", names.encode())[0] == 1
            wire.outputs(500, ["input_double_register_30", "target_speed_fraction"])
            wire.ask(b"S")
            wire.send(b"U", b"\x01" + struct.pack(">d", 0.5) + mask)
            wire.send(b"U", b"\x01" + struct.pack(">d", value) + mask)
            packages = [wire.read() for _ in range(20)]
            wire.send(b"U", b"\x01" + struct.pack(">d", 1.0) + mask)
        told = [body for kind, body in packages if kind == b"M"]
        assert len(told) == 1
        assert f"{name} must be finite".encode() in told[0]
        assert all(
            0 <= x <= 1
            for kind, body in packages
            if kind == b"U"
            for x in struct.unpack(">xdd", body)
        )


def test_fields_that_no_mask_counts_may_hold_anything(twin):
    with closing(Wire(HOST)) as wire:
        assert (
            wire.ask(
                b"I",
                b"standard_analog_output_mask,standard_analog_output_0,standard_analog_output_1",
            )[0]
            == 1
        )
        wire.outputs(500, ["standard_analog_output0", "standard_analog_output1"])
        wire.ask(b"S")
        wire.send(b"U", b"\x01" + struct.pack(">Bdd", 1, 0.25, float("nan")))
        packages = [wire.read() for _ in range(20)]
    assert [kind for kind, _ in packages if kind != b"U"] == []
    assert struct.unpack(">xdd", packages[-1][1]) == (0.25, 0.0)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ('{"do": "nonsense"}', "known: protective_stop"),
        ('{"do": "status", "more": 1}', "known"),
        ('{"do": "silence", "seconds": NaN}', "NaN is no number"),
        ('{"do": "silence", "seconds": 1e999}', "known"),
        ('{"do": "silence", "seconds": "1"}', "known"),
        ('{"do": "silence"}', "known"),
        ('{"do": "nonsense", "": 1}', "known"),
        ('{"do": "silence", "seconds": 1' + "0" * 400 + "}", "known"),
        ('{"do": ["status"]}', "expected"),
        ("[]", "expected"),
        ("[" * 20_000, "no JSON"),
        ('{"a":' * 9_000, "no JSON"),
    ],
    ids=lambda text: text[:30],
)
def test_the_control_port_takes_known_words_only(process, line, why):
    with socket.create_connection((HOST, CONTROL_PORT), 10) as sock, sock.makefile("rb") as lines:
        sock.sendall(line.encode() + b"\n")
        answer = json.loads(lines.readline())
    assert not answer["ok"]
    assert why in answer["error"]


@pytest.mark.parametrize("port", [CONTROL_PORT, DASHBOARD_PORT])
def test_a_line_without_end_ends_its_connection(process, port):
    with socket.create_connection((HOST, port), 10) as sock:
        if port == DASHBOARD_PORT:
            assert sock.recv(100).startswith(b"Connected")
        with pytest.raises(ConnectionError):
            for _ in range(100):
                sock.sendall(b"x" * LONGEST_LINE)
                time.sleep(0.01)


def test_two_thousand_connections_leave_the_first_ones_served(twin):
    with closing(Wire(HOST)) as wire:
        wire.outputs(500, ["timestamp"])
        wire.ask(b"S")
        crowd = []
        ports = [RTDE_PORT, DASHBOARD_PORT, CONTROL_PORT, *SCRIPT_PORTS, *READ_ONLY_PORTS]
        for k in range(2000):
            sock = socket.socket()
            sock.setblocking(False)
            sock.connect_ex((HOST, ports[k % len(ports)]))
            crowd.append(sock)
        times = [struct.unpack(">xd", wire.read()[1])[0] for _ in range(500)]
        assert max(after - before for before, after in itertools.pairwise(times)) < 0.0021
        assert twin.do("status")["runtime"] in (1, 2)
        for sock in crowd:
            sock.close()
    assert wait_for(lambda: not is_full())


def is_full():
    """Whether a new client is hung up on."""
    try:
        with closing(TwinControl(HOST)) as twin:
            twin.do("status")
    except RobotError:
        return True
    return False


def test_there_is_room_for_so_many_and_no_more(twin):
    wires = [Wire(HOST) for _ in range(MAX_CLIENTS)]
    with socket.create_connection((HOST, RTDE_PORT), 10) as sock:
        assert wait_for(lambda: is_closed(sock))
    assert wires[0].ask(b"v")
    for wire in wires:
        wire.close()


def test_a_client_that_reads_nothing_is_dropped_after_ten_seconds(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(clients.time, "monotonic", lambda: now[0])
    ours, theirs = socket.socketpair(socket.AF_UNIX)
    monkeypatch.setattr(socket.socket, "setsockopt", lambda *_: None)
    gone = []
    client = Client(ours, gone.append)
    client.send(b"x" * 10_000_000)
    now[0] += NOT_READING - 0.1
    assert not client.is_stuck
    theirs.recv(1_000_000)
    now[0] += 0.05
    client.flush()
    now[0] += NOT_READING - 0.1
    assert not client.is_stuck  # it has read in between
    now[0] += 0.2
    assert client.waits
    assert client.is_stuck
    client.close()
    assert gone == [client]
    theirs.close()


def test_recipes_have_bounds(process):
    with closing(Wire(HOST)) as wire:
        many = ",".join(["timestamp"] * 401)
        assert wire.outputs(500, many.split(","))[0] == 0
        assert wire.outputs(500, ["timestamp"] * 400)[0] == 1
        numbers = [wire.ask(b"I", b"input_int_register_33")[0] for _ in range(256)]
    assert numbers == [*range(1, 256), 0]


def test_programs_and_bytes_that_nobody_wrote(process, effects, twin):
    seen = fuzz(HOST, process, 1000, seed=7)
    assert process.poll() is None
    assert unpermitted(effects) == []
    assert seen["memory at the end [MB]"] - seen["memory after half [MB]"] < 10


BUSY = "def main():\nwhile True:\nx = 1\nend\nend"
MANY = (
    "def main():\nthread t():\nwhile True:\nx = "
    "get_inverse_kin_has_solution(p[.4,.1,.4,0,3,0])\nend\nend\ni = 0\nwhile i < 40:\ny = run "
    "t()\ni = i + 1\nend\nwhile True:\nx = 1\nend\nend"
)
LONG = "def main():\n" + "x = [1, 2, 3]\n" * 60_000 + "end"
ALONE = "def main():\nenter_critical\nwhile True:\nx = 1\nend\nend"


@pytest.mark.parametrize(
    ("programs", "number"),
    [
        ((BUSY,), signal.SIGTERM),
        ((MANY, LONG), signal.SIGTERM),
        ((ALONE, LONG, LONG), signal.SIGINT),
    ],
    ids=["a loop without sync", "busy threads and a long program", "Ctrl-C in a critical section"],
)
def test_the_end_comes_at_once_whatever_runs(programs, number):
    with served(OTHER_HOST, clock="real-time") as process, closing(TwinControl(OTHER_HOST)) as twin:
        with socket.create_connection((OTHER_HOST, 30003)) as sock:
            sock.sendall("".join(f"{program}\n" for program in programs).encode())
        assert wait_for(lambda: twin.do("status")["runtime"] == 2)
        time.sleep(0.2)
        start = time.monotonic()
        process.send_signal(number)
        assert process.wait(20) == 0
        assert time.monotonic() - start < ENDS_WITHIN


def test_the_end_comes_at_once_while_a_period_waits_for_its_client():
    stream = "x = read_input_float_register(0)\nservoj(get_target_joint_positions())"
    program = f"def main():\nwhile True:\n{stream}\nend\nend"
    with served(OTHER_HOST, clock="lockstep") as process, closing(Wire(OTHER_HOST)) as wire:
        wire.ask(b"I", b"input_double_register_0")
        wire.outputs(500, ["timestamp"])
        wire.ask(b"S")
        with socket.create_connection((OTHER_HOST, 30003)) as sock:
            sock.sendall(f"{program}\n".encode())
        time.sleep(0.5)
        wire.send(b"U", b"\x01" + struct.pack(">d", 0.0))
        start = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
        assert time.monotonic() - start < ENDS_WITHIN / 2
