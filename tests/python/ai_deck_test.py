"""`kestrel fly --ai-deck`: cflib's CPX, as it is published, receives the pictures of an AI-deck.

    python ai_deck_test.py KESTREL RUN_OR_POLICY

KESTREL is the path of `kestrel`. The pictures are taken apart as the viewer of Bitcraze's example `wifi-img-streamer` does.
Exit status 0 if every check passed.
"""

import socket
import struct
import sys
import tempfile
import time

import numpy as np
from cflib.cpx import CPX, CPXFunction, CPXTarget
from cflib.cpx.transports import SocketTransport
from judge import Simulated, checks_of, conclude, expect, free_port, run_checks

PATIENCE_SECS = 20


class Receiving:
    """The checks, in the order in which they are made."""

    def __init__(self, port):
        self._deck = CPX(SocketTransport("127.0.0.1", port))
        self._picture = None

    def _packet(self):
        return self._deck.receivePacket(CPXFunction.APP, timeout=PATIENCE_SECS)

    def _next(self):
        """The next whole picture."""
        head = self._packet()
        while len(head.data) != 11 or head.data[0] != 0xBC:
            head = self._packet()
        _, columns, rows, depth, kind, size = struct.unpack("<BHHBBI", head.data)
        expect((head.source, head.destination) == (CPXTarget.GAP8, CPXTarget.HOST), f"{head}")
        expect((columns, rows, depth, kind) == (324, 244, 1, 0), f"{columns}x{rows}, {depth}, {kind}")
        pixels = bytearray()
        while len(pixels) < size:
            pixels.extend(self._packet().data)
        expect(len(pixels) == size == columns * rows, f"{len(pixels)} of {size} bytes")
        return np.frombuffer(pixels, dtype=np.uint8).reshape(rows, columns)

    def check_pictures_come_in_packets_of_cpx(self):
        for _ in range(5):
            self._picture = self._next()

    def check_they_show_the_floor_below_the_horizon(self):
        above, below = self._picture[:100], self._picture[150:]
        expect(below.std() > 10, "the floor has no pattern")
        expect(above.std() < below.std(), "the sky is no calmer than the floor")


def wait_for(port):
    """Until somebody listens."""
    end = time.monotonic() + PATIENCE_SECS
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        expect(time.monotonic() < end, f"nobody listens at port {port}")
        time.sleep(0.05)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    kestrel, policy = sys.argv[1:]
    port = free_port(range(15000, 15100), socket.SOCK_STREAM)
    with tempfile.TemporaryDirectory() as folder:
        with Simulated(kestrel, [policy, "--ai-deck", f"127.0.0.1:{port}"], folder):
            wait_for(port)
            return conclude(run_checks(checks_of(Receiving(port))))


if __name__ == "__main__":
    sys.exit(main())
