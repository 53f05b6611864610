"""`kestrel fly --ros2`: another maker's DDS, Eclipse Cyclone, flies it by ROS 2's messages and crazyswarm2's services.

    python ros2_test.py KESTREL RUN_OR_POLICY

KESTREL is the path of `kestrel`. No ROS is installed: messages are built from ROS 2 Jazzy's definitions, which rosbags brings,
and from those of crazyswarm2 below. The true state judges. Exit status 0 if every check passed.
"""

import dataclasses
import math
import os
import random
import sys
import tempfile
import time
import types

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from judge import CheckFailed, Simulated, checks_of, conclude, expect, run_checks
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CRAZYSWARM2 = {
    "msg/Hover": "std_msgs/Header header\nfloat32 vx\nfloat32 vy\nfloat32 yaw_rate\nfloat32 z_distance",
    "msg/Position": "std_msgs/Header header\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 yaw",
    "msg/VelocityWorld": "std_msgs/Header header\ngeometry_msgs/Vector3 vel\nfloat32 yaw_rate",
    "msg/Status": "std_msgs/Header header\nuint16 supervisor_info\nfloat32 battery_voltage\nuint8 pm_state\nuint8 rssi\n"
    "uint32 num_rx_broadcast\nuint32 num_tx_broadcast\nuint32 num_rx_unicast\nuint32 num_tx_unicast\nuint16 latency_unicast",
    "srv/Takeoff_Request": "uint8 group_mask\nfloat32 height\nbuiltin_interfaces/Duration duration",
    "srv/Land_Request": "uint8 group_mask\nfloat32 height\nbuiltin_interfaces/Duration duration",
    "srv/GoTo_Request": "uint8 group_mask\nbool relative\ngeometry_msgs/Point goal\nfloat32 yaw\n"
    "builtin_interfaces/Duration duration",
    "srv/Arm_Request": "bool arm",
    "srv/NotifySetpointsStop_Request": "uint8 group_mask\nuint32 remain_valid_millisecs",
}
"""What crazyflie_interfaces defines (July 2026), without its constants."""

NOTHING = "uint8 structure_needs_at_least_one_member"

SUPERVISOR = {"armed": 2, "flying": 16}
"""Bits of a status."""

ARRIVAL_RADIUS_M = 0.10

FINDING_SECS = 2.0
"""After it has been found, a node needs so long to find who found it, on a busy machine."""


class Interfaces:
    """Types of DDS, made from ROS 2's definitions."""

    def __init__(self):
        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in CRAZYSWARM2.items():
            self.store.register(get_types_from_msg(text, f"crazyflie_interfaces/{name.replace('srv/', 'msg/')}"))
        self.made = {}

    def type(self, name, header=False):
        """A message such as `geometry_msgs/msg/Twist`; of a service, `header` is what Cyclone's middleware puts before it."""
        if (name, header) not in self.made:
            fields = self.store.fielddefs[name.replace("/srv/", "/msg/")][1]
            annotations = {"client": idl.uint64, "sequence": idl.int64} if header else {}
            annotations |= {field: self.field(*kind) for field, kind in fields}
            self.made[name, header] = structure(name, annotations)
        return self.made[name, header]

    def nothing(self, service, part, header):
        """A request or an answer without fields."""
        annotations = {"client": idl.uint64, "sequence": idl.int64} if header else {}
        return structure(f"{service}_{part}", annotations | {"structure_needs_at_least_one_member": idl.uint8})

    def field(self, node, about):
        kind = node.name
        if kind == "NAME":
            return self.type(about)
        if kind == "BASE":
            return {"string": str, "bool": bool, "char": idl.uint8}.get(about[0]) or getattr(idl, about[0])
        inner = self.field(*about[0])
        return idl.array[inner, about[1]] if kind == "ARRAY" else idl.sequence[inner]


def structure(name, annotations):
    package, kind, last = name.split("/")
    made = types.new_class(
        last.replace("_", ""),
        (IdlStruct,),
        {"typename": f"{package}::{kind}::dds_::{last}_"},
        lambda namespace: namespace.update(__annotations__=annotations),
    )
    return dataclasses.dataclass(made)


class Client:
    """A participant of the same domain, with ROS 2's names and qualities."""

    def __init__(self, domain, cyclone):
        self.interfaces, self.cyclone = Interfaces(), cyclone
        self.participant = DomainParticipant(domain)
        reliable = Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(100)
        self.quality, self.kept = Qos(*reliable), Qos(*reliable, Policy.Durability.TransientLocal)
        self.readers, self.writers, self.sequence = {}, {}, 0
        self.number = random.getrandbits(63)

    def listen(self, topic, kind, **quality):
        if topic not in self.readers:
            quality = quality.get("quality", self.quality)
            place = Topic(self.participant, topic, kind, qos=quality)
            self.readers[topic] = DataReader(self.participant, place, qos=quality)
        return self.readers[topic]

    def heard(self, topic, kind, within_secs=10.0):
        """The last message of a topic such as `cf1/odom`, waiting for one."""
        reader = self.listen(f"rt/{topic}", self.interfaces.type(kind))
        end = time.monotonic() + within_secs
        while not (messages := reader.take(100)):
            expect(time.monotonic() < end, f"nothing on {topic} for {within_secs} s")
            time.sleep(0.02)
        return messages[-1]

    def writer(self, topic, kind):
        """Somebody who is heard."""
        if topic not in self.writers:
            place = Topic(self.participant, topic, kind, qos=self.quality)
            self.writers[topic] = DataWriter(self.participant, place, qos=self.quality)
        writer = self.writers[topic]
        end = time.monotonic() + 20.0
        while not writer.get_publication_matched_status().current_count:
            expect(time.monotonic() < end, f"nobody hears {topic}")
            time.sleep(0.02)
        return writer

    def say(self, topic, kind, **fields):
        kind = self.interfaces.type(kind)
        self.writer(f"rt/{topic}", kind).write(self.built(kind, fields))

    def call(self, service, kind, **fields):
        """Calls a service such as `cf1/takeoff`, and waits for its answer."""
        package, name = kind.split("/")
        answers = self.interfaces.nothing(f"{package}/srv/{name}", "Response", self.cyclone)
        if fields or kind != "std_srvs/Empty":
            request = self.interfaces.type(f"{package}/srv/{name}_Request", self.cyclone)
        else:
            request, fields = self.interfaces.nothing(f"{package}/srv/{name}", "Request", self.cyclone), {NOTHING.split()[1]: 0}
        reader = self.listen(f"rr/{service}Reply", answers)
        self.sequence += 1
        head = {"client": self.number, "sequence": self.sequence} if self.cyclone else {}
        known = f"rq/{service}Request" in self.writers
        writer = self.writer(f"rq/{service}Request", request)
        end = time.monotonic() + 20.0
        while not reader.get_subscription_matched_status().current_count:
            expect(time.monotonic() < end, f"nobody answers {service}")
            time.sleep(0.02)
        if not known:
            # The other side finds this one at its own pace; what it is asked before is lost, as among ROS's nodes.
            time.sleep(FINDING_SECS)
        writer.write(self.built(request, head | fields))
        while not (found := reader.take(10)):
            expect(time.monotonic() < end, f"no answer from {service}")
            time.sleep(0.01)
        if self.cyclone:
            expect((found[-1].client, found[-1].sequence) == (self.number, self.sequence), f"the answer is another's: {found}")

    def built(self, kind, fields):
        """A message with these fields; others are zero."""
        return kind(**{field.name: fields.get(field.name, blank(field.type)) for field in dataclasses.fields(kind)})


def blank(kind):
    if dataclasses.is_dataclass(kind):
        return kind(**{field.name: blank(field.type) for field in dataclasses.fields(kind)})
    return "" if kind is str else 0


def heading(orientation):
    x, y, z, w = (getattr(orientation, name) for name in "xyzw")
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, client):
        self._true, self._client = vehicle.true, client

    def _secs(self, seconds):
        return self._client.built(self._client.interfaces.type("builtin_interfaces/msg/Duration"), {"sec": seconds})

    def _triple(self, kind, x=0.0, y=0.0, z=0.0):
        return self._client.interfaces.type(f"geometry_msgs/msg/{kind}")(x=x, y=y, z=z)

    def tells_where_it_is(self):
        odometry = self._client.heard("cf1/odom", "nav_msgs/msg/Odometry")
        expect((odometry.header.frame_id, odometry.child_frame_id) == ("world", "cf1"), f"frames: {odometry}")
        pose = self._client.heard("cf1/pose", "geometry_msgs/msg/PoseStamped").pose
        expect(abs(pose.position.z - self._true.position()[2]) < 0.01, f"another height: {pose}")
        tree = self._client.heard("tf", "tf2_msgs/msg/TFMessage").transforms
        expect([transform.child_frame_id for transform in tree] == ["cf1"], f"frames of the tree: {tree}")
        clock = self._client.heard("clock", "rosgraph_msgs/msg/Clock").clock
        expect(abs(clock.sec + 1e-9 * clock.nanosec - self._true.now()["secs"]) < 2.0, f"another time: {clock}")

    def tells_how_it_is(self):
        imu = self._client.heard("cf1/imu", "sensor_msgs/msg/Imu")
        up = imu.linear_acceleration.z
        expect(abs(imu.orientation.w) > 0.99 and abs(up - 9.8) < 0.1, f"{imu}")
        battery = self._client.heard("cf1/battery", "sensor_msgs/msg/BatteryState")
        expect(battery.present and 3.0 < battery.voltage < 4.5 and battery.percentage > 0.9, f"{battery}")
        expect(self._supervisor("armed") == 0, "armed")

    def _supervisor(self, bit):
        return self._client.heard("cf1/status", "crazyflie_interfaces/msg/Status").supervisor_info & SUPERVISOR[bit]

    def is_in_the_graph(self):
        """`ros2 node list` reads it there."""
        kind = self._client.interfaces.type("rmw_dds_common/msg/ParticipantEntitiesInfo")
        reader = self._client.listen("ros_discovery_info", kind, quality=self._client.kept)
        end, names = time.monotonic() + 10.0, set()
        while "cf1" not in names:
            expect(time.monotonic() < end, f"nodes: {names}")
            names |= {node.node_name for message in reader.take(100) for node in message.node_entities_info_seq}
            time.sleep(0.05)

    def takes_off(self):
        self._client.call("cf1/takeoff", "crazyflie_interfaces/Takeoff", height=0.6, duration=self._secs(2))
        self._true.wait_near([*self._true.position()[:2], 0.6], ARRIVAL_RADIUS_M, 15.0)
        self._wait_until(lambda: self._supervisor("armed") and self._supervisor("flying"), "a status that says so")

    def _wait_until(self, condition, what, within_secs=10.0):
        end = time.monotonic() + within_secs
        while not condition():
            expect(time.monotonic() < end, f"no {what} within {within_secs} s")

    def goes_to_a_point_with_a_heading(self):
        goal = self._triple("Point", 1.0, 0.5, 0.8)
        self._client.call("cf1/go_to", "crazyflie_interfaces/GoTo", goal=goal, yaw=1.0, duration=self._secs(4))
        self._true.wait_near([1.0, 0.5, 0.8], ARRIVAL_RADIUS_M, 20.0)
        turned = lambda: abs(heading(self._client.heard("cf1/pose", "geometry_msgs/msg/PoseStamped").pose.orientation) - 1.0)  # noqa: E731
        self._wait_until(lambda: turned() < 0.15, "heading of 1 rad")

    def goes_on_from_there(self):
        goal = self._triple("Point", -0.5, 0.0, 0.2)
        self._client.call(
            "all/go_to", "crazyflie_interfaces/GoTo", relative=True, goal=goal, yaw=0.0, duration=self._secs(2)
        )
        self._true.wait_near([0.5, 0.5, 1.0], 2 * ARRIVAL_RADIUS_M, 20.0)

    def _streams(self, topic, kind, secs, **fields):
        """Says the same 20 times a second; where it went, once it has been heard, per second of its own time."""
        self._says_for(FINDING_SECS, topic, kind, fields)
        before = self._true.now()
        self._says_for(secs, topic, kind, fields)
        after = self._true.now()
        moved = [new - old for new, old in zip(after["position"], before["position"])]
        return [part / (after["secs"] - before["secs"]) for part in moved]

    def _says_for(self, secs, topic, kind, fields):
        end = time.monotonic() + secs
        while time.monotonic() < end:
            self._client.say(f"cf1/{topic}", kind, **fields)
            time.sleep(0.05)

    def follows_velocities_in_the_world(self):
        vel = self._triple("Vector3", y=-0.4)
        velocity = self._streams("cmd_velocity_world", "crazyflie_interfaces/msg/VelocityWorld", 2.0, vel=vel)
        expect(math.dist(velocity, [0.0, -0.4, 0.0]) < 0.15, f"it flew at {velocity} m/s")

    def follows_velocities_of_its_own(self):
        twist = {"linear": self._triple("Vector3", x=0.4), "angular": self._triple("Vector3")}
        yaw = heading(self._client.heard("cf1/pose", "geometry_msgs/msg/PoseStamped").pose.orientation)
        velocity = self._streams("cmd_vel", "geometry_msgs/msg/Twist", 2.0, **twist)
        wanted = [0.4 * math.cos(yaw), 0.4 * math.sin(yaw), 0.0]
        expect(math.dist(velocity, wanted) < 0.15, f"it flew at {velocity} m/s, not at {wanted}")

    def hovers_at_a_height(self):
        self._streams("cmd_hover", "crazyflie_interfaces/msg/Hover", 4.0, z_distance=0.5)
        height = self._true.position()[2]
        expect(abs(height - 0.5) < 0.1, f"{height} m high")

    def follows_points(self):
        point = {"x": 0.3, "y": 0.2, "z": 0.7, "yaw": 0.0}
        self._streams("cmd_position", "crazyflie_interfaces/msg/Position", 4.0, **point)
        expect(math.dist(self._true.position(), [0.3, 0.2, 0.7]) < 2 * ARRIVAL_RADIUS_M, f"{self._true.position()}")

    def holds_when_set_points_stop(self):
        self._client.call("cf1/notify_setpoints_stop", "crazyflie_interfaces/NotifySetpointsStop")
        place = self._true.position()
        time.sleep(2.0)
        expect(math.dist(self._true.position(), place) < 0.3, f"from {place} to {self._true.position()}")

    def lands(self):
        self._client.call("cf1/land", "crazyflie_interfaces/Land", duration=self._secs(2))
        self._true.wait_for(lambda moment: not moment["armed"], "disarmed", 20.0)
        self._true.expect_rest()

    def says_so(self):
        """What the vehicle says is in ROS's log."""
        reader = self._client.listen("rt/rosout", self._client.interfaces.type("rcl_interfaces/msg/Log"), quality=self._client.kept)
        end, words = time.monotonic() + 10.0, set()
        while not words >= {"take-off complete", "landed", "disarmed"}:
            expect(time.monotonic() < end, f"words: {words}")
            words |= {message.msg for message in reader.take(100)}
            time.sleep(0.05)

    def arms_and_stops(self):
        self._client.call("cf1/arm", "crazyflie_interfaces/Arm", arm=True)
        self._true.wait_for(lambda moment: moment["armed"], "armed", 5.0)
        self._client.call("all/emergency", "std_srvs/Empty")
        self._true.wait_for(lambda moment: not moment["armed"], "disarmed", 5.0)


def flown(kestrel, pilot, middleware, names=None):
    """Passed and failed checks of a flight by the services of a middleware; all of them, or those of these names."""
    domain = random.randrange(1, 100)
    os.environ |= {"ROS_DOMAIN_ID": str(domain), "RMW_IMPLEMENTATION": middleware}
    with tempfile.TemporaryDirectory() as folder, Simulated(kestrel, [pilot, "--ros2"], folder) as vehicle:
        client = Client(domain, middleware == "rmw_cyclonedds_cpp")
        result = run_checks([check for check in checks_of(Flight(vehicle, client)) if names is None or check[0] in names])
        try:
            vehicle.expect_alive()
        except CheckFailed as failure:
            print(f"FAILED  {failure}")
        return result


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    kestrel, pilot = sys.argv[1:]
    cyclone = flown(kestrel, pilot, "rmw_cyclonedds_cpp")
    # Its requests have no header; what they are answered with cannot be told from here.
    sys.exit(conclude(cyclone, flown(kestrel, pilot, "rmw_fastrtps_cpp", ["takes off", "lands"])))


if __name__ == "__main__":
    main()
