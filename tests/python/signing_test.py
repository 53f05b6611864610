"""A vehicle with a key obeys its pymavlink client, and nobody else: 100,000 frames try.

    python signing_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of requirements.txt. Exit status 0 if every
check passed.
"""

import itertools
import math
import os
import signal
import socket
import sys
import tempfile
import time

from client import COMMAND, NAN, POSITION_ONLY, Client, with_speed
from judge import CheckFailed, Simulated, checks_of, conclude, expect, run_checks
from pymavlink import mavutil

UNSIGNED = WRONGLY_SIGNED = 30_000
REPLAYED_IN_FLIGHT, REPLAYED_LATER = 5_000, 35_000
"""The vehicle counts to 65,535."""

DATAGRAM_BYTES = 1400
FORCED = 21196
"""Disarms in flight: the drone would fall."""


COMMAND_IDS = (11, 75, 76)
"""Of the messages of which the link lets few through: SET_MODE, COMMAND_INT, COMMAND_LONG."""


class Recorder:
    """Keeps every frame that a client sends."""

    def __init__(self, link):
        self.commands, self.requests = [], []
        self.write = link.write
        link.write = self.keep

    def keep(self, frame):
        identifier = int.from_bytes(frame[7:10], "little")
        (self.commands if identifier in COMMAND_IDS else self.requests).append(bytes(frame))
        self.write(frame)


def commands(mav):
    """What would end the flight, if anybody obeyed."""
    arm = COMMAND.MAV_CMD_COMPONENT_ARM_DISARM
    return [
        mav.command_long_encode(1, 1, arm, 0, 0, FORCED, 0, 0, 0, 0, 0),
        mav.command_long_encode(1, 1, COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, 0, NAN, 0, 0, 0),
        mav.command_long_encode(1, 1, COMMAND.MAV_CMD_DO_FLIGHTTERMINATION, 0, 1, 0, 0, 0, 0, 0, 0),
    ]


def requests(mav):
    """What would move the drone, or change its next take-off, or its plans."""
    local = COMMAND.MAV_FRAME_LOCAL_NED
    return [
        mav.set_position_target_local_ned_encode(0, 1, 1, local, POSITION_ONLY, 3.0, 3.0, -3.0, 0, 0, 0, 0, 0, 0, 0, 0),
        mav.param_set_encode(1, 1, b"MIS_TAKEOFF_ALT", 5.0, COMMAND.MAV_PARAM_TYPE_REAL32),
        mav.mission_clear_all_encode(1, 1, COMMAND.MAV_MISSION_TYPE_ALL),
    ]


def packed(messages, mav, count):
    """So many frames of these messages in turn."""
    return [message.pack(mav) for message in repeated(messages, count)]


def repeated(frames, count):
    return list(itertools.islice(itertools.cycle(frames), count))


def refused(client):
    """How many frames the vehicle has refused."""
    client.drain()
    status = COMMAND.MAVLINK_MSG_ID_SYS_STATUS
    client.mav.command_long_send(1, 1, COMMAND.MAV_CMD_REQUEST_MESSAGE, 0, status, 0, 0, 0, 0, 0, 0)
    return client.receive("SYS_STATUS").errors_count1


def datagrams(frames):
    """Frames, as many to a datagram as go into one."""
    datagram = b""
    for frame in frames:
        if len(datagram) + len(frame) > DATAGRAM_BYTES:
            yield datagram
            datagram = b""
        datagram += frame
    if datagram:
        yield datagram


class Attacker:
    """Somebody without the key, at an address of his own and with the system number of the ground station."""

    def __init__(self, vehicle):
        host, port = vehicle.listen.split(":")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((host, int(port)))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send(self, frames, refused):
        """Sends frames until so many more are refused; what gets lost on the way to a busy vehicle is sent again."""
        begin, end = refused(), time.monotonic() + 60.0
        while (missing := begin + len(frames) - refused()) > 0:
            expect(time.monotonic() < end, f"{missing} of {len(frames)} frames were not refused")
            for number, datagram in enumerate(datagrams(frames[:missing])):
                self.socket.send(datagram)
                if number % 8 == 7:
                    time.sleep(0.005)

    def expect_silence(self):
        self.socket.setblocking(False)
        try:
            heard = self.socket.recv(4096)
        except BlockingIOError:
            return
        raise CheckFailed(f"the attacker heard {heard}")


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, client, recorder, key):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._client = client
        self._recorder = recorder
        self._key = key
        self._point = None

    def signs_all_that_it_says(self):
        self._client.receive("HEARTBEAT", within_secs=20.0)
        for _ in range(100):
            told = self._client.link.recv_match(blocking=True, timeout=5.0)
            expect(told is not None and told.get_signed(), f"{told} is not signed")
        bad = self._client.mav.signing.badsig_count
        expect(bad == 0, f"{bad} signatures are wrong")

    def obeys_signed_frames(self):
        client = self._client
        # It tells its status when asked: one that comes by itself could be from before a flood.
        client.accepted(COMMAND.MAV_CMD_SET_MESSAGE_INTERVAL, COMMAND.MAVLINK_MSG_ID_SYS_STATUS, -1)
        told = client.set_parameter("MIS_TAKEOFF_ALT", 0.75)
        expect(told == 0.75, f"the height of take-off is {told}")
        client.may_pause()
        client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        client.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        client.wait_for_mode("holding")
        x, y, _ = self._true.position()
        client.go_to([x - 0.5, y, 1.0])
        client.wait_near([x - 0.5, y, 1.0])
        self._point = [x, y, 1.0]
        client.go_to(self._point)
        client.wait_near(self._point)
        client.pass_time(2.0)

    def _survive(self, frames, commands):
        """A flood of frames, with single commands in between, as many as the link lets through; nothing happens."""
        begin = self._true.now()["secs"]
        with Attacker(self._vehicle) as attacker:
            for command in commands:
                attacker.socket.send(command)
            attacker.send(frames, lambda: refused(self._client))
            for command in commands:
                attacker.socket.send(command)
            self._client.pass_time(0.5)
            attacker.expect_silence()
        moments = [moment for moment in self._true.read() if moment["secs"] > begin]
        strayed = max(math.dist(moment["position"], self._point) for moment in moments)
        modes = {moment["mode"] for moment in moments}
        expect(strayed < 0.15 and modes == {"guided"}, f"it strayed by {strayed:.3f} m and was {modes}")
        expect(all(min(moment["rotor_targets"]) > 0 for moment in moments), "a motor stood still")
        self._client.drain()
        self._client.mav.param_request_read_send(1, 1, b"MIS_TAKEOFF_ALT", -1)
        told = self._client.receive("PARAM_VALUE").param_value
        expect(told == 0.75, f"the height of take-off has become {told}")

    def refuses_unsigned_frames(self):
        mav = mavutil.mavlink.MAVLink(None, srcSystem=255, srcComponent=0)
        old = [message.pack(mav, force_mavlink1=True) for message in commands(mav)]
        self._survive(packed(requests(mav), mav, UNSIGNED), packed(commands(mav), mav, 20) + old)

    def refuses_wrongly_signed_frames(self):
        mav = self._signing_with(os.urandom(32))
        self._survive(packed(requests(mav), mav, WRONGLY_SIGNED), packed(commands(mav), mav, 40))

    def refuses_frames_whose_signature_is_of_another_frame(self):
        mine = self._signing_with(self._key)
        genuine = self._recorder.requests[0][-13:]
        forged = [[message.pack(mine)[:-13] + genuine for message in of(mine)] for of in (requests, commands)]
        self._survive(*forged)

    def _signing_with(self, key):
        mav = mavutil.mavlink.MAVLink(None, srcSystem=255, srcComponent=0)
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        # pymavlink's times are tens of microseconds since 2015.
        mav.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
        return mav

    def refuses_frames_that_it_has_obeyed_before(self):
        self._survive(repeated(self._recorder.requests, REPLAYED_IN_FLIGHT), self._recorder.commands[:40])

    def still_obeys_its_client(self):
        self._client.accepted(COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, NAN)
        self._client.wait_for_mode("landed")
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        self._client.pass_time(1.0)
        self._true.expect_rest()

    def keeps_its_times_when_it_ends(self):
        self._vehicle.process.send_signal(signal.SIGINT)
        status = self._vehicle.process.wait(timeout=10)
        expect(status == 0, f"exit status {status}: {self._vehicle.said()}")


class FlightAfterRestart:
    """The same key in another flight; all of the first one is replayed."""

    def __init__(self, vehicle, client, recorder):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._client = client
        self._recorder = recorder

    def refuses_the_whole_flight_before(self):
        self._client.receive("HEARTBEAT", within_secs=20.0)
        self._client.accepted(COMMAND.MAV_CMD_SET_MESSAGE_INTERVAL, COMMAND.MAVLINK_MSG_ID_SYS_STATUS, -1)
        with Attacker(self._vehicle) as attacker:
            for command in self._recorder.commands[:40]:
                attacker.socket.send(command)
            attacker.send(repeated(self._recorder.requests, REPLAYED_LATER), lambda: refused(self._client))
            attacker.expect_silence()
        armed = [moment for moment in self._true.read() if moment["armed"]]
        expect(not armed, f"it was armed: {armed[:1]}")

    def still_obeys_its_client(self):
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        self._vehicle.expect_alive()


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    key = os.urandom(32)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "key")
        with open(path, "w", encoding="utf-8") as file:
            file.write(key.hex())
        arguments = [*with_speed(arguments), "--signing-key", path]
        with Simulated(kestrel, arguments, folder) as vehicle, Client(vehicle, key) as client:
            recorder = Recorder(client.link)
            first = run_checks(checks_of(Flight(vehicle, client, recorder, key)))
        with Simulated(kestrel, arguments, folder) as vehicle, Client(vehicle, key) as client:
            second = run_checks(checks_of(FlightAfterRestart(vehicle, client, recorder)))
    sys.exit(conclude(first, second))


if __name__ == "__main__":
    main()
