"""MAVSDK 4, as it is published, flies a policy start to end, and the true position is judged.

    python mavsdk4_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the package of mavsdk4-requirements.txt; takes a minute,
since MAVSDK counts wall time. Exit status 0 if every check passed.
"""

import math
import os
import sys
import tempfile
import time

from judge import Simulated, checks_of, conclude, expect, run_checks
from mavsdk import ComponentType, Configuration, Mavsdk, Vehicle
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.component_metadata import ComponentMetadata, ComponentMetadataError, MetadataType
from mavsdk.plugins.ftp import Ftp, FtpResult
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.offboard import Offboard, OffboardError, PositionNedYaw, VelocityNedYaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry

WAIT_SECS = 30.0
METRES_PER_DEGREE = 111_195
NAN = float("nan")


def wait_for(question, condition, within_secs=WAIT_SECS):
    """Asks until an answer fulfils a condition."""
    end = time.monotonic() + within_secs
    while not condition(answer := question()):
        expect(time.monotonic() < end, f"after {within_secs} s it still answers {answer}")
        time.sleep(0.02)


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, mavsdk):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._mavsdk = mavsdk
        self._start = None

    def connects(self):
        port = self._vehicle.ground_station.split(":")[1]
        result = self._mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        expect(result.name == "SUCCESS", f"connection: {result.name}")
        system = self._mavsdk.first_autopilot(WAIT_SECS)
        expect(system is not None, "no autopilot")
        self._action, self._param, self._telemetry = Action(system), Param(system), Telemetry(system)
        self._mission, self._offboard, self._info = Mission(system), Offboard(system), Info(system)
        self._ftp, self._metadata = Ftp(system), ComponentMetadata(system)
        kind = system.vehicle_type()
        expect(system.is_connected() and kind == Vehicle.MULTICOPTER, f"a vehicle of type {kind}")
        self._start = self._true.position()

    def tells_its_version(self):
        version = self._info.get_version()
        expect((version.flight_sw_major, version.flight_sw_minor) == (0, 1), f"version {version}")

    def is_healthy(self):
        wait_for(self._telemetry.health_all_ok, bool)
        health = self._telemetry.health()
        expect(health.is_global_position_ok and health.is_home_position_ok and health.is_armable, f"{health}")

    def lists_and_sets_parameters(self):
        parameters = self._param.get_all_params()
        names = [parameter.name for parameter in parameters.float_params + parameters.int_params]
        expect("MIS_TAKEOFF_ALT" in names and "GF_ACTION" in names, f"parameters {names}")
        self._param.set_param_float("MIS_TAKEOFF_ALT", 1.25)
        value = self._param.get_param_float("MIS_TAKEOFF_ALT")
        expect(value == 1.25, f"the height of take-off is {value}")

    def lists_files_and_compares_one(self):
        listed = [entry.name for entry in self._ftp.list_directory("/").entries]
        expect(listed == ["events.json", "general.json", "parameters.json"], f"it lists {listed}")
        with tempfile.TemporaryDirectory() as folder:
            results = []
            self._ftp.download_async("/parameters.json", folder, True, lambda result, *_: results.append(result))
            wait_for(lambda: results[-1:], lambda last: last and last[0] != FtpResult.NEXT)
            expect(results[-1] == FtpResult.SUCCESS, f"download: {results[-1].name}")
            same = self._ftp.are_files_identical(os.path.join(folder, "parameters.json"), "/parameters.json")
        expect(same, "what was downloaded differs")

    def finds_the_metadata_by_itself(self):
        self._metadata.request_autopilot_component()

        def found():
            try:
                return self._metadata.get_metadata(1, MetadataType.PARAMETER).json_metadata
            except ComponentMetadataError as error:
                return str(error)

        wait_for(found, lambda text: "MIS_TAKEOFF_ALT" in str(text))

    def arms(self):
        self._action.arm()
        wait_for(self._telemetry.armed, bool)

    def takes_off(self):
        self._action.set_takeoff_altitude(1.25)
        self._action.takeoff()
        wait_for(self._telemetry.landed_state, lambda state: state == LandedState.IN_AIR)
        self._true.wait_for(lambda moment: moment["mode"] == "holding", "holding", WAIT_SECS)
        height = self._true.position()[2]
        expect(abs(height - 1.25) < 0.25, f"in the air at {height:.3f} m instead of 1.25 m")

    def refuses_to_disarm_in_the_air(self):
        try:
            self._action.disarm()
        except ActionError:
            return
        expect(False, "it disarmed")

    def tells_the_truth(self):
        for _ in range(10):
            told = self._telemetry.position_velocity_ned().position
            error = math.dist([told.east_m, told.north_m, -told.down_m], self._true.position())
            expect(error < 0.1, f"told {error:.3f} m from the true position")
            time.sleep(0.05)

    def refuses_offboard_without_set_points(self):
        try:
            self._offboard.start()
        except OffboardError:
            return
        expect(False, "it started")

    def flies_offboard_to_a_position(self):
        self._offboard.set_position_ned(PositionNedYaw(0.5, 0.8, -1.0, 0.0))
        self._offboard.start()
        self._true.wait_for(lambda moment: moment["mode"] == "offboard", "in the offboard mode", 5.0)
        self._true.wait_near([0.8, 0.5, 1.0], 0.15, WAIT_SECS)

    def flies_offboard_at_a_velocity(self):
        before = self._true.position()
        self._offboard.set_velocity_ned(VelocityNedYaw(0.0, -0.3, 0.0, 0.0))
        time.sleep(3.0)
        self._offboard.stop()
        moved = [after - was for after, was in zip(self._true.position(), before)]
        expect(-1.1 < moved[0] < -0.5 and abs(moved[1]) < 0.2, f"it moved by {moved}")
        self._true.wait_for(lambda moment: moment["mode"] == "holding", "holding", 5.0)

    def goes_to_a_place_on_earth(self):
        home = self._telemetry.home()
        east_m = 0.5 / (METRES_PER_DEGREE * math.cos(math.radians(home.latitude_deg)))
        height_m = home.absolute_altitude_m + 1.2
        self._action.goto_location(home.latitude_deg, home.longitude_deg + east_m, height_m, NAN)
        self._true.wait_near([self._start[0] + 0.5, self._start[1], 1.2], 0.15, WAIT_SECS)

    def flies_a_mission(self):
        home = self._telemetry.home()

        def item(metres_north, metres_east, height_m):
            east = METRES_PER_DEGREE * math.cos(math.radians(home.latitude_deg))
            return MissionItem(
                latitude_deg=home.latitude_deg + metres_north / METRES_PER_DEGREE,
                longitude_deg=home.longitude_deg + metres_east / east,
                relative_altitude_m=height_m, speed_m_s=0.4, loiter_time_s=0.5, acceptance_radius_m=0.15,
            )

        self._mission.set_return_to_launch_after_mission(False)
        self._mission.upload_mission(MissionPlan([item(0.5, 0.0, 1.0), item(0.5, 0.6, 1.3), item(0.0, 0.6, 1.0)]))
        loaded = self._mission.download_mission()
        expect(len(loaded.mission_items) == 3, f"{len(loaded.mission_items)} items came back")
        self._mission.start_mission()
        wait_for(self._telemetry.flight_mode, lambda mode: mode == FlightMode.MISSION)
        wait_for(self._mission.mission_progress, lambda progress: progress.current == progress.total > 0)
        self._true.wait_near([self._start[0] + 0.6, self._start[1], 1.0], 0.2, WAIT_SECS)

    def returns_home_and_lands(self):
        self._action.return_to_launch()
        self._true.wait_for(lambda moment: moment["mode"] == "landed", "landed", WAIT_SECS)
        aside = math.dist(self._true.position()[:2], self._start[:2])
        expect(aside < 0.3, f"landed {aside:.3f} m from home")

    def disarms_and_rests(self):
        wait_for(self._telemetry.armed, lambda armed: not armed)
        self._true.expect_rest()
        self._vehicle.expect_alive()


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    with tempfile.TemporaryDirectory() as folder, Simulated(kestrel, arguments, folder) as vehicle:
        with Mavsdk(configuration) as mavsdk:
            status = conclude(run_checks(checks_of(Flight(vehicle, mavsdk))))
    sys.exit(status)


if __name__ == "__main__":
    main()
