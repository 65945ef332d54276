"""The sockets of programs, with a server of the test's own at the other end."""

import socket
import struct
import threading
import time

import numpy as np
import pytest

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.sockets import KEPT, MAX_SOCKETS
from sim.controller.states import Runtime
from tests.sim.controller.programs import START_Q, refusal


@pytest.fixture
def server():
    """Listens at the loopback."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10)
        yield server


def serving(server, talk):
    """Let a thread talk to the first who connects."""

    def run():
        peer, _ = server.accept()
        with peer:
            peer.settimeout(10)
            talk(peer)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def run(controller, server, body, periods=2000, open_first=True):
    """Run a program until it ends, a period a millisecond; how many it took."""
    port = server.getsockname()[1]
    opening = f'ok = socket_open("localhost", {port})\n' if open_first else ""
    controller.run(f"def main():\n{opening}{body}\nend")
    for k in range(periods):
        controller.cycle()
        time.sleep(0.001)
        if k > 5 and controller.runtime is Runtime.STOPPED:
            assert not controller.program_error
            return k
    raise AssertionError("the program does not end")


READS = [
    ("socket_read_binary_integer(2)", struct.pack(">ii", 5, -2), (2, 5, -2)),
    ("socket_read_byte_list(3)", b"\x01\xff\x03", (3, 1, 255, 3)),
    ("socket_read_ascii_float(3)", b"( 1.5, -2, 3e2 )", (3, 1.5, -2.0, 300.0)),
    ("socket_read_line()", b"hello\r\n", "hello"),
    ('socket_read_string(prefix=">", suffix="<")', b"noise>hello<", "hello"),
    ('socket_read_string(suffix="\\n", interpret_escape=True)', b"hello\n", "hello"),
    ("socket_read_string()", b"all there is", "all there is"),
]


@pytest.mark.parametrize(("call", "sent", "read"), READS, ids=[call for call, _, _ in READS])
def test_what_the_server_sends_in_pieces_is_read(controller, server, call, sent, read):
    got = []
    note = controller.functions["textmsg"]
    controller.functions["textmsg"] = note.__class__(
        note.name, lambda a, b: got.append(a), note.parameters
    )
    whole = "string()" in call

    def talk(peer):
        for piece in [sent] if whole else [sent[:2], sent[2:]]:
            peer.sendall(piece)
            time.sleep(0.02)

    thread = serving(server, talk)
    run(controller, server, f"textmsg({call})")
    thread.join(10)
    assert got == [read]


def test_what_the_program_sends_arrives(controller, server):
    got = bytearray()

    def talk(peer):
        while data := peer.recv(100):
            got.extend(data)
            if got.endswith(b"GET X\n"):
                peer.sendall(b"X 42\n")

    thread = serving(server, talk)
    body = (
        'socket_send_string("a")\nsocket_send_string([1, 2])\nsocket_send_line("b")\n'
        'socket_send_int(-2)\nsocket_send_byte(65)\nsocket_set_var("Y", 3)\n'
        'write_output_integer_register(0, socket_get_var("X"))\nsocket_close()'
    )
    run(controller, server, body)
    thread.join(10)
    assert got == b"a[1, 2]b\n\xff\xff\xff\xfeASET Y 3\nGET X\n"
    assert controller.out_ints[0] == 42


@pytest.mark.parametrize(
    ("call", "failed"),
    [
        ("socket_read_binary_integer(2, timeout=0.1)", "[0, -1, -1]"),
        ("socket_read_string(timeout=0.1)", ""),
    ],
)
def test_a_read_gives_up_in_simulated_time(controller, server, call, failed):
    end = threading.Event()
    thread = serving(server, lambda peer: end.wait(10))
    taken = run(
        controller, server, f'x = {call}\nif to_str(x) == "{failed}":\nset_flag(0, True)\nend'
    )
    end.set()
    thread.join(10)
    assert controller.flags == 1
    assert taken == pytest.approx(0.1 / PERIOD, abs=15)


def test_a_read_ends_where_the_server_hangs_up(controller, server):
    thread = serving(server, lambda peer: None)
    run(controller, server, "x = socket_read_binary_integer(1, timeout=0)", periods=500)
    thread.join(10)


def test_nobody_listens(controller, server):
    server.close()
    body = 'if not socket_open("127.0.0.1", 1):\nset_flag(3, True)\nend'
    controller.run(f"def main():\n{body}\nend")
    for _ in range(50):
        controller.cycle()
    assert controller.flags == 8


@pytest.mark.parametrize(
    ("address", "sender"),
    [
        ("10.0.0.1", "127.0.0.1"),
        ("127.0.0.1", "10.0.0.7"),
        ("10.0.0.8", "10.0.0.7"),
        ("example.org", "127.0.0.1"),
        ("0.0.0.0", "127.0.0.1"),
        ("::1", "10.0.0.7"),
        ("", "127.0.0.1"),
    ],
)
def test_a_program_reaches_no_other_machine_than_the_one_that_sent_it(
    controller, monkeypatch, address, sender
):
    monkeypatch.setattr(socket.socket, "connect_ex", lambda *_: pytest.fail("it connects"))
    controller.run(f'def main():\nsocket_open("{address}", 80)\nend', None, sender)
    for _ in range(20):
        controller.cycle()
    assert "to no other" in controller.program_error


def test_sockets_have_bounds_and_end_with_their_program(controller, server):
    port = server.getsockname()[1]
    opening = "\n".join(
        f'x = socket_open("127.0.0.1", {port}, "{k}")' for k in range(MAX_SOCKETS + 1)
    )
    assert "sockets at most" in refusal(controller, opening)
    assert not controller.sockets._open


def test_what_is_not_read_stays_with_the_system(controller, server):
    thread = serving(server, lambda peer: peer.sendall(b"x" * 100_000))
    run(controller, server, "x = socket_read_byte_list(1)\nsleep(0.2)\nset_flag(0, True)", 500)
    thread.join(10)
    assert KEPT <= 4096


def test_targets_over_a_socket_are_followed_period_by_period(controller, server):
    """The way of the maker's own driver: integers, divided, into servoj."""
    steps = 300
    targets = START_Q + np.linspace(0, 0.05, steps)[:, None] * np.array([0, 0, 0, 0, 0, 1.0])

    def talk(peer):
        for q in targets:
            peer.sendall(struct.pack(">6i", *np.round(q * 1e6).astype(int)))

    thread = serving(server, talk)
    body = (
        "i = 0\nwhile True:\nx = socket_read_binary_integer(6, timeout=0.02)\nif x[0] == 0:\nhalt\n"
        "end\nservoj([x[1], x[2], x[3], x[4], x[5], x[6]] / 1000000, t=0.002)\ni = i + 1\n"
        "write_output_integer_register(0, i)\nend"
    )
    run(controller, server, body)
    thread.join(10)
    assert controller.out_ints[0] == steps
    assert controller.robot.commanded[0][5] == pytest.approx(0.05, abs=0.01)
