"""RTDE by hand: a client of the tests' own."""

import socket
import struct


class Wire:
    """RTDE by hand."""

    def __init__(self, host):
        self.socket = socket.create_connection((host, 30004), 10)
        assert self.ask(b"V", struct.pack(">H", 2)) == b"\x01"

    def send(self, kind, payload=b""):
        self.socket.sendall(struct.pack(">HB", 3 + len(payload), kind[0]) + payload)

    def read(self):
        size, kind = struct.unpack(">HB", self._exactly(3))
        return bytes([kind]), self._exactly(size - 3)

    def ask(self, kind, payload=b""):
        self.send(kind, payload)
        answered, body = self.read()
        assert answered == kind
        return body

    def outputs(self, frequency, names):
        return self.ask(b"O", struct.pack(">d", frequency) + ",".join(names).encode())

    def _exactly(self, count):
        data = b""
        while len(data) < count:
            data += self.socket.recv(count - len(data))
        return data

    def close(self):
        self.socket.close()
