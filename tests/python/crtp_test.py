"""Bitcraze's cflib, as it is published, flies a policy as a Crazyflie and judges the true position.

    python crtp_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of crtp-requirements.txt; takes two minutes,
since cflib counts wall time. Exit status 0 if every check passed.
"""

import math
import os
import socket
import sys
import tempfile
import time
import warnings

import cflib.crtp
from cflib.crazyflie import Crazyflie
from cflib.crazyflie.log import LogConfig
from cflib.crazyflie.syncCrazyflie import SyncCrazyflie
from cflib.crazyflie.syncLogger import SyncLogger
from cflib.crtp.crtpstack import CRTPPort
from cflib.crtp.udpdriver import UdpDriver
from cflib.positioning.motion_commander import MotionCommander
from cflib.positioning.position_hl_commander import PositionHlCommander
from cflib.utils.reset_estimator import reset_estimator
from judge import REST_HEIGHT_M, CheckFailed, Simulated, checks_of, conclude, expect, free_port, rounded, run_checks

SCANNED_PORTS = range(19850, 19860)
"""Where cflib looks for simulated drones."""

ARRIVAL_RADIUS_M = 0.10


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, uri, folder):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._uri = uri
        self._cache = os.path.join(folder, "cache")
        self._console = []
        self._answers = []
        self._link = None

    @property
    def _client(self):
        return self._link.cf

    def _connect(self):
        client = Crazyflie(rw_cache=self._cache)
        client.console.receivedChar.add_callback(self._console.append)
        client.add_port_callback(CRTPPort.SETPOINT_HL, lambda packet: self._answers.append(packet.data[3]))
        self._link = SyncCrazyflie(self._uri, cf=client)
        self._link.open_link()
        self._link.wait_for_params()

    def _leave(self):
        if self._link is not None:
            self._link.close_link()

    def _heard(self, words):
        end = time.monotonic() + 2.0
        while words not in "".join(self._console):
            expect(time.monotonic() < end, f"the console said {''.join(self._console)!r}")
            time.sleep(0.02)

    def _expect_at(self, expected, radius_m=ARRIVAL_RADIUS_M):
        position = self._true.position()
        distance = math.dist(position, expected)
        expect(distance < radius_m, f"{distance:.3f} m from {rounded(expected)}, at {rounded(position)}")

    def _expect_on_the_floor(self):
        self._true.wait_for(
            lambda now: now["position"][2] < REST_HEIGHT_M and math.hypot(*now["velocity"]) < 0.01,
            "at rest on the floor", 5.0,
        )

    def says_how_to_connect(self):
        self._true.now()
        expect(self._uri in self._vehicle.said(), f"it said {self._vehicle.said()!r}")

    def is_found_by_a_scan(self):
        found = [uri for uri, _ in UdpDriver().scan_interface()]
        expect(self._uri in found, f"found {found}")

    def connects_and_tells_its_tables(self):
        self._connect()
        version = self._client.platform.get_protocol_version()
        expect(version == 12, f"version {version} of the protocol")
        for table, wanted in ((self._client.log.toc, "stateEstimate.x"), (self._client.param.toc, "stabilizer.controller")):
            expect(table.get_element_by_complete_name(wanted) is not None, f"no {wanted} in {table.toc}")
        self._heard("Kestrel")

    def is_left_and_met_again_at_once_with_the_tables_from_the_cache(self):
        before = (self._client.log.toc.toc.keys(), self._client.param.toc.toc.keys())
        self._link.close_link()
        begin = time.monotonic()
        self._connect()
        after = (self._client.log.toc.toc.keys(), self._client.param.toc.toc.keys())
        expect(before == after, f"{before} before, {after} after")
        expect(time.monotonic() - begin < 3.0, f"it took {time.monotonic() - begin:.1f} s")
        expect(len(os.listdir(self._cache)) == 2, f"the cache has {os.listdir(self._cache)}")

    def keeps_parameters(self):
        parameters = self._client.param
        parameters.set_value("stabilizer.controller", 2)
        parameters.set_value("hlCommander.vland", 0.25)
        time.sleep(0.3)
        values = (parameters.get_value("stabilizer.controller"), parameters.get_value("hlCommander.vland"))
        expect(values == ("2", "0.25"), f"values {values}")
        expect(parameters.get_value("deck.bcFlow2") == "1", "no Flow deck")
        for name, error in (("deck.bcFlow2", AttributeError), ("no.such", KeyError)):
            try:
                parameters.set_value(name, 0)
            except error:
                continue
            raise CheckFailed(f"{name} was written")

    def logs_the_true_state(self):
        names = ("stateEstimate.x", "stateEstimate.y", "stateEstimate.z")
        config = LogConfig("position", period_in_ms=50)
        for name in names:
            config.add_variable(name, "float")
        config.add_variable("pm.vbat", "FP16")
        config.add_variable("supervisor.info", "uint16_t")
        last = None
        with SyncLogger(self._client, config) as logger:
            for _, (timestamp_ms, values, _) in zip(range(20), logger):
                time.sleep(0.01)
                true = self._true.at(timestamp_ms / 1000)
                error = math.dist([values[name] for name in names], true["position"])
                expect(error < 0.01, f"told {error:.3f} m from the true position")
                expect(abs(values["pm.vbat"] - 4.2) < 0.01, f"a battery of {values['pm.vbat']} V")
                # A control period more or less.
                expect(last is None or abs(timestamp_ms - last - 50) <= 20, f"{timestamp_ms} ms after {last} ms")
                last = timestamp_ms

    def convinces_clients_that_wait_for_the_estimator(self):
        reset_estimator(self._client)
        print()

    def measures_the_latency(self):
        expect(0.0 < self._client.link_statistics.latency.latency < 100.0, "no echo")

    def is_armed_and_disarmed(self):
        supervisor = self._client.supervisor
        expect(supervisor.can_be_armed and supervisor.can_fly and not supervisor.is_flying, "it cannot be armed")
        for wish in (True, False):
            supervisor.send_arming_request(wish)
            time.sleep(0.2)
            expect(supervisor.is_armed == wish, f"armed is {supervisor.is_armed} after {wish} was asked for")
            expect(self._true.now()["armed"] == wish, "the truth is another one")

    def flies_motions_and_lands(self):
        start = self._true.position()
        with MotionCommander(self._client, default_height=0.5) as motions:
            time.sleep(2.0)
            self._expect_at([start[0], start[1], 0.5])
            motions.forward(0.6, velocity=0.3)
            time.sleep(2.0)
            self._expect_at([start[0] + 0.6, start[1], 0.5])
            motions.left(0.4)
            time.sleep(2.0)
            self._expect_at([start[0] + 0.6, start[1] + 0.4, 0.5])
            motions.up(0.3)
            motions.circle_right(0.3, velocity=0.3, angle_degrees=90.0)
            expect(self._client.supervisor.is_flying, "it says that it does not fly")
        begin = self._true.now()["position"][2]
        expect(begin < 0.15, f"motors stopped at a height of {begin:.3f} m")
        self._expect_on_the_floor()

    def flies_maneuvers_and_lands(self):
        commander = self._client.high_level_commander
        start = self._true.position()
        begin = self._true.now()["secs"]
        commander.takeoff(0.8, 2.0)
        time.sleep(1.0)
        expect(self._client.supervisor.hl_control_active, "the high-level commander says it does nothing")
        halfway = self._true.at(begin + 1.0)["position"][2]
        expect(0.15 < halfway < 0.65, f"at {halfway:.3f} m after half the time")
        time.sleep(2.5)
        self._expect_at([start[0], start[1], 0.8])
        commander.go_to(start[0] + 1.0, start[1] - 0.5, 1.2, 0.0, 4.0)
        time.sleep(5.5)
        self._expect_at([start[0] + 1.0, start[1] - 0.5, 1.2])
        expect(self._client.supervisor.hl_traj_finished, "the plan is not over")
        commander.go_to(-0.5, 0.5, -0.4, 0.0, 3.0, relative=True, linear=True)
        time.sleep(4.5)
        self._expect_at([start[0] + 0.5, start[1], 0.8])
        commander.land(0.0, 3.0)
        time.sleep(3.2)
        commander.stop()
        self._expect_on_the_floor()
        self._expect_at([start[0] + 0.5, start[1], 0.0125], 0.2)
        expect(set(self._answers) == {0}, f"answers {self._answers}")

    def flies_with_the_position_commander(self):
        x, y, _ = self._true.position()
        with PositionHlCommander(self._client, x=x, y=y, default_velocity=0.4, controller=1) as commander:
            commander.go_to(x - 0.5, y + 0.3, 0.7)
            time.sleep(2.0)
            self._expect_at([x - 0.5, y + 0.3, 0.7])
        self._expect_on_the_floor()

    def follows_set_points_until_they_stop_coming(self):
        commander = self._client.commander
        x, y, _ = self._true.position()
        for _ in range(40):
            commander.send_position_setpoint(x, y, 0.6, 0.0)
            time.sleep(0.1)
        self._expect_at([x, y, 0.6])
        for _ in range(20):
            commander.send_velocity_world_setpoint(0.0, -0.3, 0.1, 0.0)
            time.sleep(0.1)
        last = self._true.now()["secs"]
        self._true.wait_for(lambda now: now["mode"] == "landing", "landing", 5.0)
        moments = [moment for moment in self._true.read() if moment["secs"] > last]
        holding = next(moment["secs"] for moment in moments if moment["mode"] == "holding") - last
        landing = next(moment["secs"] for moment in moments if moment["mode"] == "landing") - last
        expect(0.3 < holding < 0.6 and 1.8 < landing < 2.1, f"held after {holding:.2f} s, landed after {landing:.2f} s")
        self._true.wait_for(lambda now: now["mode"] == "landed", "landed", 20.0)
        flown = self._true.position()[1] - y
        expect(-0.9 < flown < -0.5, f"flew {flown:.3f} m instead of 0.6 m to the right")

    def refuses_what_a_policy_cannot_fly(self):
        self._client.commander.send_setpoint(5.0, 0.0, 0.0, 30000)
        self._heard("chooses its attitude")
        self._answers.clear()
        self._client.high_level_commander.start_trajectory(1)
        self._client.high_level_commander.land(0.0, 1.0)
        self._client.high_level_commander.go_to(float("nan"), 0.0, 1.0, 0.0, 1.0)
        time.sleep(0.3)
        expect(self._answers == [8, 1, 22], f"answers {self._answers}")
        expect(not self._true.now()["mode"] == "guided", "it flies")

    def serves_its_client_through_garbage_and_knocks(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.settimeout(0.3)
            other.connect(("127.0.0.1", int(self._uri.split(":")[2])))
            for length in range(300):
                other.send(os.urandom(length))
            other.send(b"\xfd\x00")
            time.sleep(1.0)
            other.send(b"\xff")
            answers = []
            try:
                while True:
                    answers.append(other.recv(100))
            except TimeoutError:
                pass
        expect(answers and set(answers) == {b"\xff"}, f"a stranger heard {answers}")
        expect(not self._true.now()["mode"] == "guided", "it flies")
        self.keeps_parameters()

    def stops_in_an_emergency_and_flies_no_more(self):
        self._client.high_level_commander.takeoff(0.6, 2.0)
        time.sleep(3.0)
        expect(self._true.position()[2] > 0.5, "it did not take off")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self._client.supervisor.send_emergency_stop()
        time.sleep(0.2)
        expect(self._true.now()["rotor_targets"] == [0, 0, 0, 0], "motors turn")
        self._expect_on_the_floor()
        expect(self._client.supervisor.is_locked, "it is not locked")
        self._client.supervisor.send_arming_request(True)
        self._client.high_level_commander.takeoff(0.6, 2.0)
        time.sleep(0.5)
        expect(not self._true.now()["armed"], "it is armed again")
        self._heard("locked")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    cflib.crtp.init_drivers()
    port = free_port(SCANNED_PORTS)
    with tempfile.TemporaryDirectory() as folder:
        with Simulated(kestrel, [*arguments, "--crtp", f"127.0.0.1:{port}"], folder) as vehicle:
            flight = Flight(vehicle, f"udp://127.0.0.1:{port}", folder)
            status = conclude(run_checks(checks_of(flight)))
            flight._leave()
    sys.stdout.flush()
    # Threads of a client whose connection failed never end.
    os._exit(status)


if __name__ == "__main__":
    main()
