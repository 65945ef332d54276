"""RTDE and the other streams by hand: clients of the tests' own."""

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


class Stream:
    """A port whose packages begin with their size."""

    def __init__(self, host, port):
        self.socket = socket.create_connection((host, port), 10)
        self._arrived = b""

    def read(self):
        """The next package, whole."""
        while len(self._arrived) < 4 or len(self._arrived) < self._size:
            data = self.socket.recv(65536)
            if not data:
                raise ConnectionError("the controller has hung up")
            self._arrived += data
        package, self._arrived = self._arrived[: self._size], self._arrived[self._size :]
        return package

    def message(self, number):
        """The body of the next message of a type."""
        while True:
            package = self.read()
            if package[4] == 20 and package[14] == number:
                return package[15:]

    def parts(self):
        """The bodies of the next state's parts, by type."""
        while (package := self.read())[4] != 16:
            pass
        found, package = {}, package[5:]
        while package:
            size, kind = struct.unpack_from(">iB", package)
            found[kind], package = package[5:size], package[size:]
        return found

    @property
    def _size(self):
        return struct.unpack_from(">i", self._arrived)[0]

    def close(self):
        self.socket.close()
