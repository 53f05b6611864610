"""PX4's neural control module, as a program that flies: speaks the processor-in-the-loop protocol of kestrel-core
(core-nostd/src/processor_in_the_loop.rs) on its standard input and output.

    px4.py FOLDER

FOLDER is what `kestrel export --target px4` wrote. Of every control period it makes what PX4's estimator would publish
(north, east, down; forward, right, down), from that the module's fifteen inputs, lets TFLite Micro compute the model in the
module's ten kilobytes, makes motor commands of the outputs with the exported parameters as the module does, takes their curve
back as PX4's output stage does, and turns the motors of an X500 as PX4's Gazebo does. Needs numpy and tflite_micro.
"""

import math
import pathlib
import struct
import sys
import zlib

import numpy
from tflite_micro.python.tflite_micro import runtime

START = 0x4B
POLICY, RESET, TICK, CODE, TARGETS, TEST = range(1, 7)
NO_POLICY, DAMAGED, LENGTH = 100, 102, 103

ARENA_BYTES = 10 * 1024
"""Memory that the module gives to the interpreter."""

CURVE = numpy.float32(0.8)
"""Share of the square in the module's curve from the share of a motor's range to its command."""

IDLE_SPEED, FULL_SPEED = 150.0, 1000.0
"""Rotor speeds [rad/s] of an X500 at no and at full output: SIM_GZ_EC_MIN and SIM_GZ_EC_MAX of PX4's airframe 4001_gz_x500."""

ROTORS = (0, 2, 3, 1)
"""Our rotor, clockwise from the front right, of each of PX4's motors: front right, rear left, front left, rear right."""

NORTH_EAST_DOWN = numpy.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From east, north, up; its own inverse."""

FORWARD_RIGHT_DOWN = numpy.diag([1.0, -1.0, -1.0])
"""From forward, left, up; its own inverse."""


def parameters(path):
    """Names and values of a file of QGroundControl's."""
    rows = [line.split("\t") for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return {name: float(value) for _, _, name, value, _ in rows}


def rotation(w, x, y, z):
    """The matrix of a quaternion."""
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Estimator:
    """What PX4 publishes of a drone: single precision, its own axes."""

    def __init__(self, numbers):
        position, attitude, velocity, rates, goal = (numpy.array(part) for part in (
            numbers[0:3], numbers[3:7], numbers[7:10], numbers[10:13], numbers[13:16]))
        single = numpy.float32
        self.position = (NORTH_EAST_DOWN @ position).astype(single)
        self.velocity = (NORTH_EAST_DOWN @ velocity).astype(single)
        self.setpoint = (NORTH_EAST_DOWN @ goal).astype(single)
        self.attitude = (NORTH_EAST_DOWN @ rotation(*attitude) @ FORWARD_RIGHT_DOWN).astype(single)
        self.rates = (FORWARD_RIGHT_DOWN @ rates).astype(single)


def inputs(estimator):
    """The module's: set-point minus position, two rows of the attitude, velocity, all with east, north and up; body rates
    with forward, left and up."""
    world, body = NORTH_EAST_DOWN.astype(numpy.float32), FORWARD_RIGHT_DOWN.astype(numpy.float32)
    attitude = world @ estimator.attitude @ body
    return numpy.concatenate([
        world @ estimator.setpoint - world @ estimator.position,
        attitude[0], attitude[1],
        world @ estimator.velocity,
        body @ estimator.rates,
    ])


class Motors:
    """From outputs of the model to rotor speeds."""

    def __init__(self, values):
        single = numpy.float32
        self.coefficient = single(values["MC_NN_THRST_COEF"]) / single(1e5)
        self.low, self.high = single(values["MC_NN_MIN_RPM"]), single(values["MC_NN_MAX_RPM"])
        self.factor = values["THR_MDL_FAC"]

    def commands(self, outputs):
        """As the module's first version computes them, without any limit but that of the outputs."""
        limited = numpy.clip(outputs, numpy.float32(-1.0), numpy.float32(1.0))
        rpm = numpy.float32(60.0) * numpy.sqrt((limited + numpy.float32(1.0)) / self.coefficient)
        share = (rpm - self.low) / (self.high - self.low)
        return CURVE * share * share + (numpy.float32(1.0) - CURVE) * share

    def rotor_speeds(self, commands):
        """Of PX4's output stage and Gazebo's motors; a negative command disarms a motor."""
        speeds = [0.0] * 4
        for rotor, command in zip(ROTORS, commands):
            if not math.isfinite(command) or command < -numpy.finfo(numpy.float32).eps:
                continue
            half = (1.0 - self.factor) / (2.0 * self.factor)
            share = min(math.sqrt(half * half + max(command, 0.0) / self.factor) - half, 1.0)
            speeds[rotor] = IDLE_SPEED + share * (FULL_SPEED - IDLE_SPEED)
        return speeds


class Module:
    """The model and the motors of a folder."""

    def __init__(self, folder):
        model = (folder / "control_net.tflite").read_bytes()
        self.interpreter = runtime.Interpreter.from_bytes(model, arena_size=ARENA_BYTES)
        self.motors = Motors(parameters(folder / "kestrel.params"))

    def rotor_speeds(self, numbers):
        observation = inputs(Estimator(numbers)).astype(numpy.float32)
        self.interpreter.set_input(observation[None], 0)
        self.interpreter.invoke()
        return self.motors.rotor_speeds(self.motors.commands(self.interpreter.get_output(0)[0]))


class Line:
    """Frames on standard input and output."""

    def __init__(self):
        self.incoming, self.outgoing = sys.stdin.buffer, sys.stdout.buffer

    def send(self, kind, payload):
        head = bytes([kind]) + struct.pack("<H", len(payload))
        self.outgoing.write(bytes([START]) + head + payload + struct.pack("<I", zlib.crc32(head + payload)))
        self.outgoing.flush()

    def receive(self):
        """Kind and payload of the next frame, the payload nothing if it is damaged; nothing when the line is gone."""
        while (byte := self.incoming.read(1)) != bytes([START]):
            if not byte:
                return None
        head = self.incoming.read(3)
        payload = self.incoming.read(struct.unpack("<H", head[1:])[0]) if len(head) == 3 else b""
        checksum = self.incoming.read(4)
        if len(checksum) < 4:
            return None
        whole = struct.unpack("<I", checksum)[0] == zlib.crc32(head + payload)
        return head[0], payload if whole else None

    def answer(self, code):
        self.send(CODE, struct.pack("<i", code))


def serve(module):
    """Flies for whoever asks; of a policy that is sent only that one is there counts, because the folder holds it."""
    line, has_policy = Line(), False
    line.answer(NO_POLICY)
    while (frame := line.receive()) is not None:
        kind, payload = frame
        has_policy = has_policy or (kind == POLICY and payload is not None)
        if payload is None:
            line.answer(DAMAGED)
        elif not has_policy:
            line.answer(NO_POLICY)
        elif kind == TICK and len(payload) == 4 * 17:
            line.send(TARGETS, struct.pack("<4f", *module.rotor_speeds(struct.unpack("<17f", payload))))
        elif kind == TICK:
            line.answer(LENGTH)
        else:
            line.answer(0 if kind in (POLICY, RESET, TEST) else DAMAGED)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    serve(Module(pathlib.Path(sys.argv[1])))


if __name__ == "__main__":
    main()
