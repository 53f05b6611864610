"""MAVSDK 3, as it is published, flies a policy start to end, and the true position is judged.

    python mavsdk3_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of mavsdk3-requirements.txt; takes a minute,
since MAVSDK counts wall time. Exit status 0 if every check passed.
"""

import asyncio
import json
import math
import os
import socket
import sys
import tempfile
import warnings

from judge import Simulated, checks_of, conclude, expect, free_port, run_checks

warnings.simplefilter("ignore", FutureWarning)

from mavsdk import System  # noqa: E402  (warns when imported)
from mavsdk.action import ActionError  # noqa: E402
from mavsdk.component_metadata import MetadataType  # noqa: E402
from mavsdk.mission import MissionItem, MissionPlan  # noqa: E402
from mavsdk.offboard import OffboardError, PositionNedYaw, VelocityNedYaw  # noqa: E402
from mavsdk.telemetry import FlightMode, LandedState  # noqa: E402

WAIT_SECS = 30.0
NAN = float("nan")


async def first(stream, condition=lambda value: True, within_secs=WAIT_SECS):
    """The first value of a stream that fulfils a condition."""

    async def search():
        async for value in stream:
            if condition(value):
                return value

    return await asyncio.wait_for(search(), within_secs)


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, loop):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._loop = loop
        self._drone = System(port=free_port(kind=socket.SOCK_STREAM))
        self._start = None

    def _run(self, coroutine):
        return self._loop.run_until_complete(asyncio.wait_for(coroutine, 2 * WAIT_SECS))

    def _leave(self):
        self._drone._stop_mavsdk_server()

    def connects(self):
        port = self._vehicle.ground_station.split(":")[1]
        self._run(self._drone.connect(system_address=f"udpin://127.0.0.1:{port}"))
        self._run(first(self._drone.core.connection_state(), lambda state: state.is_connected))
        self._start = self._true.position()

    def tells_its_version(self):
        version = self._run(self._drone.info.get_version())
        expect((version.flight_sw_major, version.flight_sw_minor) == (0, 1), f"version {version}")

    def is_healthy(self):
        healthy = lambda health: health.is_global_position_ok and health.is_home_position_ok and health.is_armable  # noqa: E731
        self._run(first(self._drone.telemetry.health(), healthy))

    def lists_and_sets_parameters(self):
        parameters = self._run(self._drone.param.get_all_params())
        names = [parameter.name for parameter in parameters.float_params + parameters.int_params]
        expect("MIS_TAKEOFF_ALT" in names and "GF_ACTION" in names, f"parameters {names}")
        self._run(self._drone.param.set_param_float("MIS_TAKEOFF_ALT", 1.25))
        value = self._run(self._drone.param.get_param_float("MIS_TAKEOFF_ALT"))
        expect(value == 1.25, f"the height of take-off is {value}")

    def downloads_the_description_of_the_parameters(self):
        async def download(folder, burst):
            async for _ in self._drone.ftp.download("/parameters.json", folder, burst):
                pass
            with open(os.path.join(folder, "parameters.json"), "rb") as file:
                return file.read()

        async def compare():
            listed = (await self._drone.ftp.list_directory("/")).files
            expect(listed == ["events.json", "general.json", "parameters.json"], f"it lists {listed}")
            with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
                by_burst, by_packet = await download(one, True), await download(other, False)
                local = os.path.join(one, "parameters.json")
                same = await self._drone.ftp.are_files_identical(local, "/parameters.json")
            expect(by_burst == by_packet and same, f"{by_burst} differs")
            names = [parameter["name"] for parameter in json.loads(by_burst)["parameters"]]
            expect("MIS_TAKEOFF_ALT" in names, f"parameters {names}")

        self._run(compare())

    def finds_the_metadata_by_itself(self):
        async def find():
            metadata = self._drone.component_metadata
            await metadata.request_autopilot_component()
            return await first(metadata.metadata_available(), lambda found: found.type == MetadataType.PARAMETER)

        found = self._run(find())
        expect("MIS_TAKEOFF_ALT" in found.json_metadata, f"metadata {found}")

    def arms(self):
        self._run(self._drone.action.arm())
        self._run(first(self._drone.telemetry.armed(), lambda armed: armed))

    def takes_off(self):
        self._run(self._drone.action.set_takeoff_altitude(1.25))
        self._run(self._drone.action.takeoff())
        self._run(first(self._drone.telemetry.landed_state(), lambda state: state == LandedState.IN_AIR))
        self._true.wait_for(lambda moment: moment["mode"] == "holding", "holding", WAIT_SECS)
        height = self._true.position()[2]
        expect(abs(height - 1.25) < 0.25, f"in the air at {height:.3f} m instead of 1.25 m")

    def refuses_to_disarm_in_the_air(self):
        try:
            self._run(self._drone.action.disarm())
        except ActionError:
            return
        expect(False, "it disarmed")

    def tells_the_truth(self):
        async def compare():
            count = 0
            async for told in self._drone.telemetry.position_velocity_ned():
                position = told.position
                true = self._true.now()["position"]
                error = math.dist([position.east_m, position.north_m, -position.down_m], true)
                expect(error < 0.1, f"told {error:.3f} m from the true position")
                count += 1
                if count == 10:
                    return

        self._run(compare())

    def refuses_offboard_without_set_points(self):
        try:
            self._run(self._drone.offboard.start())
        except OffboardError:
            return
        expect(False, "it started")

    def flies_offboard_to_a_position(self):
        async def fly():
            point = PositionNedYaw(0.5, 0.8, -1.0, 0.0)
            await self._drone.offboard.set_position_ned(point)
            await self._drone.offboard.start()

        self._run(fly())
        self._true.wait_for(lambda moment: moment["mode"] == "offboard", "in the offboard mode", 5.0)
        self._true.wait_near([0.8, 0.5, 1.0], 0.15, WAIT_SECS)

    def flies_offboard_at_a_velocity(self):
        before = self._true.position()

        async def fly():
            await self._drone.offboard.set_velocity_ned(VelocityNedYaw(0.0, -0.3, 0.0, 0.0))
            await asyncio.sleep(3.0)
            await self._drone.offboard.stop()

        self._run(fly())
        moved = [after - was for after, was in zip(self._true.position(), before)]
        expect(-1.1 < moved[0] < -0.5 and abs(moved[1]) < 0.2, f"it moved by {moved}")
        self._true.wait_for(lambda moment: moment["mode"] == "holding", "holding", 5.0)

    def goes_to_a_place_on_earth(self):
        async def go():
            home = await first(self._drone.telemetry.home())
            east = home.longitude_deg + 0.5 / (111_320 * math.cos(math.radians(home.latitude_deg)))
            await self._drone.action.goto_location(home.latitude_deg, east, home.absolute_altitude_m + 1.2, NAN)

        self._run(go())
        self._true.wait_near([self._start[0] + 0.5, self._start[1], 1.2], 0.15, WAIT_SECS)

    def flies_a_mission(self):
        async def fly():
            home = await first(self._drone.telemetry.home())
            north = 1 / 111_195
            east = north / math.cos(math.radians(home.latitude_deg))

            def item(metres_north, metres_east, height):
                return MissionItem(
                    home.latitude_deg + metres_north * north, home.longitude_deg + metres_east * east, height,
                    0.4, False, NAN, NAN, MissionItem.CameraAction.NONE, 0.5, NAN, 0.15, NAN, NAN,
                    MissionItem.VehicleAction.NONE,
                )

            plan = MissionPlan([item(0.5, 0.0, 1.0), item(0.5, 0.6, 1.3), item(0.0, 0.6, 1.0)])
            await self._drone.mission.set_return_to_launch_after_mission(False)
            await self._drone.mission.upload_mission(plan)
            loaded = await self._drone.mission.download_mission()
            expect(len(loaded.mission_items) == 3, f"{len(loaded.mission_items)} items came back")
            await self._drone.mission.start_mission()
            mode = await first(self._drone.telemetry.flight_mode(), lambda mode: mode == FlightMode.MISSION)
            expect(mode == FlightMode.MISSION, f"in mode {mode}")
            await first(
                self._drone.mission.mission_progress(),
                lambda progress: progress.total > 0 and progress.current == progress.total,
            )

        self._run(fly())
        self._true.wait_near([0.6, 0.0, 1.0], 0.2, WAIT_SECS)

    def returns_home_and_lands(self):
        self._run(self._drone.action.return_to_launch())
        self._true.wait_for(lambda moment: moment["mode"] == "landed", "landed", WAIT_SECS)
        aside = math.dist(self._true.position()[:2], self._start[:2])
        expect(aside < 0.3, f"landed {aside:.3f} m from home")

    def disarms_and_rests(self):
        self._run(first(self._drone.telemetry.armed(), lambda armed: not armed))
        self._true.expect_rest()
        self._vehicle.expect_alive()


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    with tempfile.TemporaryDirectory() as folder, Simulated(kestrel, arguments, folder) as vehicle:
        flight = Flight(vehicle, loop)
        status = conclude(run_checks(checks_of(flight)))
        flight._leave()
    # MAVSDK's threads wait for its server, which would end with the last reference to the drone, after them.
    os._exit(status)


if __name__ == "__main__":
    main()
