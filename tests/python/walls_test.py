"""pymavlink sends drones to a point behind a wall, and the true positions are judged: none of them gets there through it.

    python walls_test.py KESTREL POLICY

KESTREL is the path of `kestrel`, beside which `kestrel-shim` lies. The same flight is made by `kestrel fly` in a room with a
wall, by `kestrel-shim` in that room, and in `kestrel bridge`, where `kestrel-shim` is the autopilot behind PX4's
lockstep; and once more without the wall, where the point is reached. Exit status 0 if every check passed.
"""

import contextlib
import os
import sys
import tempfile
import time

from bridged import Bridged
from client import COMMAND, NAN, Client
from judge import Simulated, checks_of, conclude, expect, free_port, rounded, run_checks

TASK = """version: 1
name: wall
import: {hover}
scenario:
  aviary: {{ floor: true, solids: [{solids}] }}
  start: {{ position: {{ around_goal: {{ nearest_m: 0.0, farthest_m: 0.3 }} }} }}
"""
WALL = "{ name: wall, low_m: [1, -4, 0], high_m: [1.1, 4, 4] }"
FACE_M = 1.0
HULL_M = (0.0125, 0.06)
"""From the middle of a Crazyflie to its lid and to its side."""

BEHIND = (2.0, 0.0, 1.0)
FLIGHT_SECS = 6.0
"""Simulated."""

PX4_OFFBOARD = 6


class Autopilot:
    """`kestrel-shim` as what flies in another simulator: the vehicle that clients speak to, without a simulator of its own."""

    def __init__(self, bridged, ground_station):
        self.true, self.expect_alive, self.ground_station = bridged.true, bridged.expect_alive, ground_station


class Walls:
    """The checks, in the order in which they are flown."""

    def __init__(self, kestrel, policy, folder):
        self._kestrel, self._policy, self._folder = os.path.abspath(kestrel), os.path.abspath(policy), folder
        self._shim = os.path.join(os.path.dirname(self._kestrel), "kestrel-shim")
        self._wall, self._air = self._task("wall", WALL), self._task("air", "")

    def _task(self, name, solids):
        path = os.path.join(self._folder, f"{name}.yaml")
        hover = os.path.abspath("configs/hover.yaml")
        with open(path, "w", encoding="utf-8") as file:
            file.write(TASK.format(hover=hover, solids=solids))
        return path

    def kestrel_fly_is_stopped(self):
        self._expect_stopped(self._fly(self._kestrel, self._wall))

    def kestrel_shim_is_stopped(self):
        self._expect_stopped(self._fly(self._shim, self._wall))

    def a_bridge_stops_the_autopilot_behind_it(self):
        self._expect_stopped(self._bridge(self._wall))

    def without_the_wall_each_gets_there(self):
        for moments in (self._fly(self._kestrel, self._air), self._fly(self._shim, self._air), self._bridge(self._air)):
            nearest = min(abs(moment["position"][0] - BEHIND[0]) for moment in moments)
            expect(nearest < 0.15, f"{nearest:.2f} m from it at best")

    def _fly(self, program, task):
        with (
            tempfile.TemporaryDirectory(dir=self._folder) as folder,
            Simulated(program, [self._policy, "--aviary", task, "--speed", "4"], folder) as vehicle,
            Client(vehicle) as client,
        ):
            return self._go_behind(client)

    def _bridge(self, task):
        with tempfile.TemporaryDirectory(dir=self._folder) as folder, contextlib.ExitStack() as stack:
            port = free_port(kind=1)
            bridged = stack.enter_context(
                Bridged(self._kestrel, [task, "--peer", "px4", "--listen", f"127.0.0.1:{port}"], folder)
            )
            ground_station = f"127.0.0.1:{free_port()}"
            addresses = ["--listen", f"127.0.0.1:{free_port()}", "--ground-station", ground_station]
            flown = [self._shim, self._policy, "--simulator", f"127.0.0.1:{port}", *addresses]
            bridged.start("autopilot", flown)
            client = stack.enter_context(Client(Autopilot(bridged, ground_station)))
            return self._go_behind(client)

    def _go_behind(self, client):
        """Takes off and goes to the point for some time; where the drone was."""
        client.receive("HEARTBEAT", within_secs=20.0)
        client.receive("LOCAL_POSITION_NED", within_secs=20.0)
        end = time.monotonic() + 20.0
        while client.command(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1) != COMMAND.MAV_RESULT_ACCEPTED:
            expect(time.monotonic() < end, "it does not arm")  # an autopilot that does not know its state yet
        client.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, *[NAN] * 6, 1.0)
        client.wait_until(lambda moments: moments[-1]["position"][2] > 0.8, "a metre high", 20.0)
        self._stream(client, 0.5)
        client.accepted(COMMAND.MAV_CMD_DO_SET_MODE, COMMAND.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, PX4_OFFBOARD)
        self._stream(client, FLIGHT_SECS)
        return client.true.read()

    def _stream(self, client, secs):
        end = client.true.now()["secs"] + secs
        while client.true.now()["secs"] < end:
            client.go_to(BEHIND)
            client.drain()
            time.sleep(0.02)

    def _expect_stopped(self, moments):
        deepest = max(moments, key=lambda moment: moment["position"][0])["position"]
        print(f"        {FACE_M - deepest[0]:.3f} m before it at the nearest, in {len(moments)} moments", flush=True)
        expect(deepest[0] < FACE_M - HULL_M[0] + 0.01, f"at {rounded(deepest)}, in the wall")
        expect(deepest[0] > FACE_M - HULL_M[1] - 0.05, f"it was never at the wall: {rounded(deepest)}")


def main(kestrel, policy):
    with tempfile.TemporaryDirectory() as folder:
        return conclude(run_checks(checks_of(Walls(kestrel, policy, folder))))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
