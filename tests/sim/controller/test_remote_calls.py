"""Calls by XML-RPC, with Python's own server at the other end, and one that answers anything."""

import re
import socket
import threading
import time
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from sim.controller.rpc_functions import LONGEST_ANSWER
from sim.controller.states import Runtime
from tests.sim.controller.programs import refusal
from tests.sim.controller.test_sockets import serving

POSE = {"x": 0.1, "y": 0.2, "z": 0.3, "rx": 0.0, "ry": 3.0, "rz": 0.0}
VALUES = ["1", "-2.5", "True", '"text"', "[1, 2.5]", "[[1, 2], [3, 4]]",
          "p[0.1, 0.2, 0.3, 0, 3, 0]", 'struct(a=1, b=[True, "x"])']  # fmt: skip


@pytest.fixture(scope="module")
def server():
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True) as server:
        server.seen = []
        server.register_function(lambda value: server.seen.append(value) or value, "same")
        server.register_function(lambda: POSE, "place")
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.shutdown()


def handle(server):
    port = getattr(server, "server_address", None) or server.getsockname()
    return f'server = rpc_factory("xmlrpc", "http://localhost:{port[1]}/RPC2")\n'


def run(controller, body, periods=5000):
    """Run a program to its end, a period a millisecond; why it failed."""
    controller.run(f"def main():\n{body}\nend")
    for k in range(periods):
        controller.cycle()
        time.sleep(0.001)
        if k > 5 and controller.runtime is Runtime.STOPPED:
            return controller.program_error
    raise AssertionError("the program does not end")


def test_values_go_to_the_server_and_back(controller, server):
    body = handle(server) + "ok = True\n"
    for value in VALUES:
        body += f"v = {value}\nw = server.same(v)\nok = ok and v == w\n"
    body += "place = server.place()\nok = ok and place == p[0.1, 0.2, 0.3, 0, 3, 0]\n"
    body += "server.closeXMLRPCClientConnection()\nif ok:\nset_flag(0, True)\nend"
    assert not run(controller, body)
    assert controller.flags == 1
    assert server.seen[-2:] == [POSE, {"a": 1, "b": [True, "x"]}]
    assert not controller.sockets._open


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("server.nobody(1)", '"nobody" is not supported'),
        ("server.same()", "argument"),
        ("server.same(server)", "same at .* takes no http://localhost"),
        ("x = [1]\nx.same()", r"\[1\] has no method \"same\""),
    ],
)
def test_what_the_server_has_not_stops_the_program(controller, server, body, why):
    error = run(controller, handle(server) + body)
    assert re.search(why, error), error


def test_a_server_that_is_not_there_stops_the_program(controller):
    call = 'x = rpc_factory("xmlrpc", "http://127.0.0.1:1/RPC2")'
    assert "no server answers at" in refusal(controller, call)
    assert "to no other" in refusal(controller, call.replace("127.0.0.1", "10.0.0.1"))
    assert "http://address:port/path" in refusal(controller, call.replace("http", "ftp"))


BODY = "<methodResponse><params><param><value>{}</value></param></params></methodResponse>"
ANSWERS = {
    "a declaration": '<!DOCTYPE x [<!ENTITY a "aaaa">]>' + BODY.format("&a;"),
    "no end": BODY.format("<array><data>"),
    "a nest": BODY.format("<array><data><value>" * 400 + "</value></data></array>" * 400),
    "large": BODY.format("<int>99999999999</int>"),
    "a long list": BODY.format("<array><data>" + "<value/>" * 1100 + "</data></array>"),
    "a long string": BODY.format("<string>" + "x" * 2000 + "</string>"),
    "a web page": "<html>404</html>",
    "too much": "x" * (LONGEST_ANSWER + 1),
}


@pytest.mark.parametrize("body", ANSWERS.values(), ids=ANSWERS)
def test_no_answer_does_more_than_end_the_program(controller, body):
    def talk(peer):
        peer.recv(65536)
        peer.sendall(f"HTTP/1.1 200 OK\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode())

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10)
        # the first connection only looks whether the server is there
        threads = [serving(server, lambda peer: peer.recv(1)), serving(server, talk)]
        assert "answer" in run(controller, handle(server) + "x = server.same(1)")
        for thread in threads:
            thread.join(10)
