"""pymavlink flies ten vehicles of one program, at 250 Hz and in real time, and the true positions are judged: above an endless
floor, and in one aviary, where they can collide.

    python swarm_test.py KESTREL_SHIM POLICY

KESTREL_SHIM is the path of the binary. The policy is flown with a control period of 4 ms instead of its own. Exit status 0 if
every check passed.
"""

import math
import os
import resource
import socket
import struct
import sys
import tempfile
import time
import zlib

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil  # noqa: E402  (reads MAVLINK20 when imported)

from judge import CheckFailed, Simulated, checks_of, conclude, expect, run_checks  # noqa: E402

COMMAND = mavutil.mavlink
COUNT = 10
CONTROL_SECS = 0.004
WATCH_SECS = 20.0
DRIFT_LIMIT = 0.02
"""A machine that stalls the program once, for a few tenths of a second, is no failure."""

AVIARY = "room-0"

NAN = float("nan")


def with_period(policy, folder):
    """A copy of a policy file with another control period: the only float of 10 or 20 ms in its header."""
    with open(policy, "rb") as file:
        content = bytearray(file.read())
    periods = [struct.pack("<f", secs) for secs in (0.01, 0.02)]
    places = [content.find(period, 0, 512) for period in periods]
    (place,) = [place for place in places if place >= 0]
    content[place : place + 4] = struct.pack("<f", CONTROL_SECS)
    content[-4:] = struct.pack("<I", zlib.crc32(content[:-4]))
    path = os.path.join(folder, "fast.kestrel")
    with open(path, "wb") as file:
        file.write(content)
    return path


def free_ports():
    """The first of as many free UDP ports in a row as there are vehicles."""
    for first in range(24_600, 32_000, COUNT):
        probes = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(COUNT)]
        try:
            for number, probe in enumerate(probes):
                probe.bind(("127.0.0.1", first + number))
            return first
        except OSError:
            continue
        finally:
            for probe in probes:
                probe.close()
    raise CheckFailed("no ports are free")


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, swarm, first_port):
        self._swarm = swarm
        port = swarm.ground_station.split(":")[1]
        self._all = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
        self._each = [mavutil.mavlink_connection(f"udpout:127.0.0.1:{first_port + number}") for number in range(COUNT)]

    def _hear(self, secs):
        """What the ground station hears for some time: messages by system and name."""
        heard = {}
        end = time.monotonic() + secs
        while time.monotonic() < end:
            message = self._all.recv_match(blocking=True, timeout=0.1)
            if message is not None:
                heard.setdefault(message.get_srcSystem(), {}).setdefault(message.get_type(), []).append(message)
        return heard

    def _now(self):
        """The last moment of each vehicle; they write one after the other."""
        moments = self._swarm.true.read()
        whole = len(moments) // COUNT * COUNT
        return moments[whole - COUNT : whole]

    def _clocks(self):
        """Wall time and simulated time [s]; what is read of a long log is read after the wall clock."""
        self._now()
        return time.monotonic(), self._now()[0]["secs"]

    def _command(self, number, system, command, *parameters):
        parameters = [*parameters, *[0] * (7 - len(parameters))]
        self._each[number].mav.command_long_send(system, 1, command, 0, *parameters)

    def _wait_for(self, condition, what, within_secs):
        end = time.monotonic() + within_secs
        while not all(condition(number, moment) for number, moment in enumerate(self._now())):
            expect(time.monotonic() < end, f"not all {what} after {within_secs} s: {self._now()}")
            self._hear(0.1)

    def ten_heartbeats_come_from_ten_systems(self):
        self._swarm.true.now()
        self._hear(1.0)
        heard = self._hear(5.0)
        expect(sorted(heard) == list(range(1, COUNT + 1)), f"systems {sorted(heard)}")
        counts = {system: len(messages.get("HEARTBEAT", [])) for system, messages in heard.items()}
        expect(all(4 <= count <= 6 for count in counts.values()), f"heartbeats in 5 s: {counts}")

    def each_tells_its_own_place(self):
        heard = self._hear(1.0)
        places = set()
        for number, moment in enumerate(self._now()):
            told = heard[number + 1]["LOCAL_POSITION_NED"][-1]
            error = math.dist([told.y, told.x, -told.z], moment["position"])
            expect(error < 0.05, f"vehicle {number + 1} tells a place {error:.3f} m from its own")
            places.add((round(told.x, 1), round(told.y, 1)))
        expect(len(places) == COUNT, f"{len(places)} different places")

    def nobody_obeys_what_is_for_somebody_else(self):
        for number in range(COUNT):
            other = (number + 1) % COUNT + 1
            self._command(number, other, COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        heard = self._hear(1.5)
        expect(not any(moment["armed"] for moment in self._now()), "one is armed")
        acknowledged = [system for system, messages in heard.items() if "COMMAND_ACK" in messages]
        expect(not acknowledged, f"systems {acknowledged} answered")

    def one_obeys_what_all_hear(self):
        for number in range(COUNT):
            self._command(number, 4, COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        heard = self._hear(1.5)
        armed = [number + 1 for number, moment in enumerate(self._now()) if moment["armed"]]
        expect(armed == [4], f"armed are {armed}")
        flag = COMMAND.MAV_MODE_FLAG_SAFETY_ARMED
        told = [system for system, messages in heard.items() if messages["HEARTBEAT"][-1].base_mode & flag]
        expect(told == [4], f"systems {told} say that they are armed")

    def all_take_off_to_their_own_heights(self):
        for number in range(COUNT):
            self._command(number, number + 1, COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self._hear(0.05)
            height = 0.8 + 0.05 * number
            self._command(number, number + 1, COMMAND.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, height)
        self._wait_for(lambda _, moment: moment["mode"] == "holding", "holding", 20.0)
        self._hear(3.0)
        for number, moment in enumerate(self._now()):
            error = abs(moment["position"][2] - 0.8 - 0.05 * number)
            expect(error < 0.1, f"vehicle {number + 1} is {error:.3f} m from its height")

    def all_fly_aside_in_real_time(self):
        before = self._now()
        for number, moment in enumerate(before):
            east, north, up = moment["position"]
            target = (north + 0.3, east - 0.2, -up)
            self._each[number].mav.set_position_target_local_ned_send(
                0, number + 1, 1, COMMAND.MAV_FRAME_LOCAL_NED, 0b110111111000, *target, *[0] * 8
            )
        (start, start_secs), (end, end_secs) = self._clocks(), (0, 0)
        while end - start < WATCH_SECS:
            self._hear(0.5)
            end, end_secs = self._clocks()
        simulated_secs, wall_secs = end_secs - start_secs, end - start
        factor = simulated_secs / wall_secs
        print(f"  {COUNT} vehicles for {wall_secs:.3f} s: {simulated_secs:.3f} s simulated", flush=True)
        expect(abs(factor - 1) < DRIFT_LIMIT, f"{factor:.4f} simulated seconds a second")
        for number, (was, moment) in enumerate(zip(before, self._now())):
            expected = [was["position"][0] - 0.2, was["position"][1] + 0.3, was["position"][2]]
            error = math.dist(moment["position"], expected)
            expect(error < 0.15, f"vehicle {number + 1} is {error:.3f} m from where it was sent")

    def every_period_is_there(self):
        secs = [moment["secs"] for moment in self._swarm.true.read()[::COUNT]]
        steps = [after - before for before, after in zip(secs, secs[1:])]
        expect(max(abs(step - CONTROL_SECS) for step in steps) < 1e-6, "a control period is missing")

    def all_land(self):
        for number in range(COUNT):
            self._command(number, number + 1, COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN)
        # On furniture, too.
        is_down = lambda moment: math.dist(moment["velocity"], [0, 0, 0]) < 0.05  # noqa: E731
        self._wait_for(lambda _, moment: not moment["armed"] and is_down(moment), "landed", 20.0)
        self._swarm.expect_alive()


def run(kestrel, policy, place):
    """Flies all checks in a place."""
    print(f"  {' '.join(place) or 'above a floor'}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        first_port = free_ports()
        arguments = [with_period(policy, folder), "--vehicles", str(COUNT), *place]
        with Simulated(kestrel, arguments, folder, listen=f"127.0.0.1:{first_port}") as swarm:
            return run_checks(checks_of(Flight(swarm, first_port)))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    kestrel, policy = sys.argv[1:]
    start = time.monotonic()
    flown = [run(kestrel, policy, place) for place in ([], ["--aviary", AVIARY])]
    status = conclude(*flown)
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    share = (usage.ru_utime + usage.ru_stime) / (time.monotonic() - start)
    print(f"The program took {share:.1%} of a core.", flush=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
