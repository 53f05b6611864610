"""MAVProxy, as it is published, flies a policy from its command line, and the true position is judged.

    python mavproxy_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of mavproxy-requirements.txt; takes a minute and
a half, since MAVProxy counts wall time. Exit status 0 if every check passed.

MAVProxy knows PX4, and takes everything else for ArduCopter. Of PX4 it reads parameters that are integers, but its
command `mode` sends nothing (1.8.75: "required argument is not a float"): the first flight changes modes by
`long DO_SET_MODE`. Of other autopilots it takes the numbers of AVAILABLE_MODES, which the second flight does. The third is
ArduCopter's, by the names of its modes.
"""

import math
import os
import pty
import re
import select
import signal
import subprocess
import sys
import tempfile
import time

from judge import CheckFailed, Simulated, conclude, expect, run_checks

WAIT_SECS = 30.0
TRIES = 3
MODULES = "signing,wp,fence,ftp,param,arm,mode,cmdlong,misc"
METRES_PER_DEGREE = 111_195
LATITUDE_DEG, LONGITUDE_DEG = 47.397742, 8.545594
"""Of the world's origin."""

HOLD, LAND, POLICY, PID = (4, 3), (4, 6), (4, 11), (4, 12)
"""Main and sub modes."""


def custom_mode(numbers):
    main, sub = numbers
    return sub << 24 | main << 16


def place(east_m, north_m):
    """Latitude and longitude [deg] of a point of the world."""
    east_per_degree = METRES_PER_DEGREE * math.cos(math.radians(LATITUDE_DEG))
    return LATITUDE_DEG + north_m / METRES_PER_DEGREE, LONGITUDE_DEG + east_m / east_per_degree


class Console:
    """MAVProxy in a terminal of its own, in a folder where it leaves its logs."""

    def __init__(self, ground_station, folder):
        self.master, terminal = pty.openpty()
        program = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        options = [f"--master=udpin:{ground_station}", "--state-basedir", folder, "--default-modules", MODULES]
        # It reads a start-up script at home, and shortens its lines to the terminal's width.
        environment = {**os.environ, "HOME": folder, "TERM": "dumb"}
        self.process = subprocess.Popen(
            [sys.executable, program, *options], cwd=folder, env=environment, start_new_session=True,
            stdin=terminal, stdout=terminal, stderr=terminal,
        )
        os.close(terminal)
        self.heard = ""

    def listen(self, secs):
        """Reads what comes within a time, or less."""
        if select.select([self.master], [], [], secs)[0]:
            try:
                self.heard += os.read(self.master, 65536).decode(errors="replace").replace("\r", "")
            except OSError as gone:
                raise CheckFailed(f"MAVProxy has ended; it said {self.heard!r}") from gone

    def hears(self, pattern, within_secs=WAIT_SECS):
        """What a pattern matches of what was said since the last command."""
        end = time.monotonic() + within_secs
        while not (found := re.search(pattern, self.heard)):
            expect(time.monotonic() < end, f"no {pattern!r} after {within_secs} s in {self.heard!r}")
            self.listen(0.1)
        return found

    def says(self, line, pattern):
        """Types a line and waits for the answer; types it again if none comes: a busy MAVProxy misses some."""
        for _ in range(TRIES - 1):
            try:
                return self.says_once(line, pattern)
            except CheckFailed:
                continue
        return self.says_once(line, pattern)

    def says_once(self, line, pattern):
        self.listen(0.0)
        self.heard = ""
        os.write(self.master, f"{line}\n".encode())
        return self.hears(pattern, WAIT_SECS / TRIES)

    def accepted(self, line, command):
        answer = self.says(line, rf"COMMAND_ACK: {command}: (\w+)").group(1)
        expect(answer == "ACCEPTED", f"{line!r} was answered {answer}")

    def refused(self, line, words):
        """A refusal comes with its reason, in either order; MAVProxy shows no words twice within two seconds."""
        time.sleep(2.1)
        self.says(line, r"ACK: \w+: (DENIED|TEMPORARILY_REJECTED|FAILED)")
        self.hears(words)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self.master)


class Flight:
    """What both flights do."""

    def __init__(self, vehicle, console, folder):
        self.vehicle = vehicle
        self.true = vehicle.true
        self.console = console
        self.folder = folder
        self.start = None

    def connects(self):
        self.console.hears("online system 1")
        self.start = self.true.position()

    def arms(self):
        self.console.accepted("arm throttle", "COMPONENT_ARM_DISARM")
        self.console.hears("ARMED")
        self.true.wait_for(lambda moment: moment["armed"], "armed", 2.0)

    def takes_off(self):
        self.console.accepted("takeoff 1", "NAV_TAKEOFF")
        self.wait_for_mode("holding")
        height = self.true.position()[2]
        expect(abs(height - 1.0) < 0.25, f"in the air at {height:.3f} m instead of 1 m")

    def wait_for_mode(self, mode):
        self.true.wait_for(lambda moment: moment["mode"] == mode, mode, WAIT_SECS)

    def expect_mode(self, numbers):
        """The vehicle says so, too."""
        end = time.monotonic() + 5.0
        while True:
            told = int(self.console.says("status HEARTBEAT", r"HEARTBEAT \{.*?custom_mode : (\d+)").group(1))
            if told == custom_mode(numbers):
                return
            expect(time.monotonic() < end, f"custom mode {told} instead of {custom_mode(numbers)}")

    def expect_steady(self):
        """For two seconds within a hand of where it is."""
        point, begin = self.true.position(), self.true.now()["secs"]
        self.true.wait_for(lambda moment: moment["secs"] > begin + 2.0, "later", WAIT_SECS)
        strayed = max(math.dist(moment["position"], point) for moment in self.true.read() if moment["secs"] > begin)
        expect(strayed < 0.2, f"it strayed by {strayed:.3f} m")

    def disarms_and_rests(self):
        self.wait_for_mode("landed")
        self.console.accepted("disarm", "COMPONENT_ARM_DISARM")
        self.console.hears("DISARMED")
        self.true.wait_for(lambda moment: not moment["armed"], "disarmed", 2.0)
        self.true.expect_rest()
        self.vehicle.expect_alive()

    def keeps_armed_after_landing(self):
        """So that it is MAVProxy that disarms."""
        self.console.says("param set COM_DISARM_LAND 60", ">")
        self.sees("COM_DISARM_LAND", "60.0")

    def sees(self, name, value, within_secs=5.0):
        """Until a parameter has a value: MAVProxy shows the one that it was told last."""
        end = time.monotonic() + within_secs
        while True:
            told = self.console.says(f"param show {name}", rf"{name} +([\d.e-]+)").group(1)
            if told == value:
                return
            expect(time.monotonic() < end, f"{name} is {told} instead of {value}")
            time.sleep(0.1)


class AsPx4(Flight):
    """Everything, of a vehicle that says it is PX4."""

    def has_parameters_soon_though_there_is_no_file_of_them(self):
        # It asks for a file of them first; when that is refused, for the list. Without an answer it would ask ten times.
        count = int(self.console.hears(r"Received (\d+) parameters").group(1))
        expect(count >= 30 and "timed out" not in self.console.heard, self.console.heard)

    def shows_and_sets_parameters(self):
        self.sees("MIS_TAKEOFF_ALT", "1.0")
        self.console.says("param set MIS_TAKEOFF_ALT 1.5", ">")
        self.sees("MIS_TAKEOFF_ALT", "1.5")
        self.sees("GF_ACTION", "2")
        self.console.says("param set GF_ACTION 3", ">")
        self.sees("GF_ACTION", "3")
        self.keeps_armed_after_landing()

    def is_told_when_a_parameter_is_refused(self):
        failed = r"Failed to set MIS_TAKEOFF_ALT to 50 \(invalid returned value 1\.5\)"
        self.console.says("param set MIS_TAKEOFF_ALT 50", failed)

    def refuses_to_take_off_unarmed(self):
        self.console.refused("takeoff 1", "refused: not armed")

    def change_mode(self, numbers):
        main, sub = numbers
        self.console.accepted(f"long DO_SET_MODE 1 {main} {sub}", "DO_SET_MODE")

    def hands_over_to_the_pid_and_back(self):
        for mode, told in ((PID, PID), (POLICY, HOLD)):
            self.change_mode(mode)
            self.expect_mode(told)
            self.expect_steady()

    def guide(self, east_m, north_m):
        latitude, longitude = place(self.start[0] + east_m, self.start[1] + north_m)
        return f"guided {latitude:.7f} {longitude:.7f} 1.2"

    def goes_where_it_is_guided(self):
        self.console.accepted(self.guide(0.8, -0.5), "DO_REPOSITION")
        self.true.wait_near([self.start[0] + 0.8, self.start[1] - 0.5, 1.2], 0.15, WAIT_SECS)

    def holds_on_the_way(self):
        # So slowly that no delay of this program lets it arrive.
        self.console.says("param set MPC_XY_CRUISE 0.125", ">")
        self.sees("MPC_XY_CRUISE", "0.125")
        self.console.accepted(self.guide(-0.8, -0.5), "DO_REPOSITION")
        on_the_way = lambda moment: moment["position"][0] < self.start[0] + 0.6  # noqa: E731
        self.true.wait_for(on_the_way, "on the way", WAIT_SECS)
        self.change_mode(HOLD)
        self.wait_for_mode("holding")
        self.expect_steady()
        expect(self.true.position()[0] > self.start[0] - 0.6, f"it went on to {self.true.position()}")
        self.console.says("param set MPC_XY_CRUISE 0.5", ">")
        self.sees("MPC_XY_CRUISE", "0.5")

    def stays_within_the_fence_of_parameters(self):
        self.console.says("param set GF_MAX_HOR_DIST 1.5", ">")
        self.sees("GF_MAX_HOR_DIST", "1.5")
        self.console.refused(self.guide(2.0, 0.0), "outside the fence")
        self.console.says("param set GF_MAX_HOR_DIST 0", ">")
        self.sees("GF_MAX_HOR_DIST", "0.0")
        self.console.accepted(self.guide(0.5, 0.0), "DO_REPOSITION")

    def loads_a_fence(self):
        """Two metres to every side of the start."""
        lines = ["QGC WPL 110"]
        for index, (east_m, north_m) in enumerate([(2, 2), (2, -2), (-2, -2), (-2, 2)]):
            latitude, longitude = place(self.start[0] + east_m, self.start[1] + north_m)
            lines.append(f"{index}\t0\t3\t5001\t4\t0\t0\t0\t{latitude:.8f}\t{longitude:.8f}\t0\t1")
        path = os.path.join(self.folder, "fence.txt")
        with open(path, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
        self.console.says("fence list", "Requesting 0 fence items")
        self.console.says(f"fence load {path}", "ACK: TYPE_FENCE: ACCEPTED")
        self.console.says("fence list", "Saved 4 fence items")

    def stays_within_the_fence_while_it_is_enabled(self):
        self.console.refused(self.guide(3.0, 0.0), "outside the fence")
        self.console.accepted("fence disable", "DO_FENCE_ENABLE")
        self.console.accepted(self.guide(3.0, 0.0), "DO_REPOSITION")
        self.console.accepted(self.guide(0.5, 0.5), "DO_REPOSITION")
        self.true.wait_near([self.start[0] + 0.5, self.start[1] + 0.5, 1.2], 0.15, WAIT_SECS)
        self.console.accepted("fence enable", "DO_FENCE_ENABLE")
        self.console.refused(self.guide(3.0, 0.0), "outside the fence")
        self.console.says("fence clear", "ACK: TYPE_FENCE: ACCEPTED")
        self.console.says("fence list", "Requesting 0 fence items")

    def returns_home(self):
        self.console.accepted("long NAV_RETURN_TO_LAUNCH", "NAV_RETURN_TO_LAUNCH")
        self.wait_for_mode("landed")
        aside = math.dist(self.true.position()[:2], self.start[:2])
        expect(aside < 0.3, f"landed {aside:.3f} m from home")

    def takes_off_again_and_lands(self):
        self.takes_off()
        self.console.accepted("long NAV_LAND", "NAV_LAND")
        self.wait_for_mode("landed")


class AsGeneric(Flight):
    """Modes, of a vehicle that says it is none that MAVProxy knows."""

    def has_parameters(self):
        self.console.hears(r"Received (\d+) parameters")
        self.keeps_armed_after_landing()

    def changes_modes_by_their_numbers(self):
        for mode in (PID, POLICY):
            self.console.accepted(f"mode {custom_mode(mode)}", "DO_SET_MODE")
            self.expect_mode(mode)

    def takes_numbers_for_those_of_px4(self):
        """ArduCopter's number of returning is PX4's of the offboard mode."""
        self.console.refused("mode LOITER", "see AVAILABLE_MODES")
        self.console.refused("mode RTL", "no set-points arrive")
        self.expect_mode(POLICY)
        expect(self.true.now()["mode"] == "holding", f"it is {self.true.now()['mode']}")

    def lands_by_number(self):
        self.console.accepted(f"mode {custom_mode(LAND)}", "DO_SET_MODE")
        self.wait_for_mode("landed")


class AsArducopter(Flight):
    """By the names that MAVProxy has for ArduCopter's modes."""

    def has_parameters(self):
        self.console.hears(r"Received (\d+) parameters")
        self.keeps_armed_after_landing()

    def is_guided(self):
        self.console.accepted("mode GUIDED", "DO_SET_MODE")
        self.console.says("status HEARTBEAT", r"custom_mode : 4\b")

    def loiters(self):
        self.console.accepted("mode LOITER", "DO_SET_MODE")
        self.console.says("status HEARTBEAT", r"custom_mode : 5\b")
        expect(self.true.now()["mode"] == "holding", f"it is {self.true.now()['mode']}")

    def returns_to_launch(self):
        self.console.accepted("mode RTL", "DO_SET_MODE")
        self.wait_for_mode("landed")


AS_PX4 = [
    AsPx4.connects,
    AsPx4.has_parameters_soon_though_there_is_no_file_of_them,
    AsPx4.shows_and_sets_parameters,
    AsPx4.is_told_when_a_parameter_is_refused,
    AsPx4.refuses_to_take_off_unarmed,
    AsPx4.arms,
    AsPx4.takes_off,
    AsPx4.hands_over_to_the_pid_and_back,
    AsPx4.goes_where_it_is_guided,
    AsPx4.holds_on_the_way,
    AsPx4.stays_within_the_fence_of_parameters,
    AsPx4.loads_a_fence,
    AsPx4.stays_within_the_fence_while_it_is_enabled,
    AsPx4.returns_home,
    AsPx4.takes_off_again_and_lands,
    AsPx4.disarms_and_rests,
]

AS_GENERIC = [
    AsGeneric.connects,
    AsGeneric.has_parameters,
    AsGeneric.arms,
    AsGeneric.takes_off,
    AsGeneric.changes_modes_by_their_numbers,
    AsGeneric.takes_numbers_for_those_of_px4,
    AsGeneric.lands_by_number,
    AsGeneric.disarms_and_rests,
]


AS_ARDUCOPTER = [
    AsArducopter.connects,
    AsArducopter.has_parameters,
    AsArducopter.is_guided,
    AsArducopter.arms,
    AsArducopter.takes_off,
    AsArducopter.loiters,
    AsArducopter.is_guided,
    AsArducopter.returns_to_launch,
    AsArducopter.disarms_and_rests,
]


def fly(kestrel, arguments, personality, kind, checks):
    """A flight of its own vehicle and its own MAVProxy."""
    with tempfile.TemporaryDirectory() as folder:
        with Simulated(kestrel, [*arguments, "--personality", personality], folder) as vehicle:
            with Console(vehicle.ground_station, folder) as console:
                flight = kind(vehicle, console, folder)
                names = [f"as {personality}: {check.__name__.replace('_', ' ')}" for check in checks]
                return run_checks([(name, check.__get__(flight)) for name, check in zip(names, checks)])


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    first = fly(kestrel, arguments, "px4", AsPx4, AS_PX4)
    second = fly(kestrel, arguments, "generic", AsGeneric, AS_GENERIC)
    third = fly(kestrel, arguments, "ardupilot", AsArducopter, AS_ARDUCOPTER)
    sys.exit(conclude(first, second, third))


if __name__ == "__main__":
    main()
