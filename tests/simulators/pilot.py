"""A policy of Kestrel for many drones at once, through the core's C interface (pilot.c)."""

import ctypes
import pathlib

import numpy

GOAL = (0.0, 0.0, 1.0)
"""Where the drones shall be [m, world]; simulators count from here."""


class Pilot:
    """Pilots with one policy, one for each drone, which shall face its heading [rad, counter-clockwise from x]."""

    def __init__(self, library, policy, headings):
        drones = len(headings)
        self.library = ctypes.CDLL(str(library))
        self.library.simulators_begin.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t]
        self.library.simulators_begin.restype = ctypes.c_int32
        self.library.simulators_period.restype = ctypes.c_float
        self.library.simulators_tick.argtypes = [ctypes.c_void_p] * 3
        self.library.simulators_tick.restype = ctypes.c_size_t
        policy = pathlib.Path(policy)
        try:
            file = policy.read_bytes()
        except OSError as error:
            raise SystemExit(f"{policy}: found no file ({error.strerror}), expected a policy in fixed point") from None
        refusal = self.library.simulators_begin(file, len(file), drones)
        if refusal:
            raise SystemExit(f"{policy}: found a file that the pilot refuses (code {refusal}), expected a policy")
        self.period = float(self.library.simulators_period())
        self.goals = numpy.zeros((drones, 4), dtype=numpy.float32)
        self.goals[:, :3] = GOAL
        self.goals[:, 3] = headings
        self.thrusts = numpy.zeros((drones, 4), dtype=numpy.float32)

    def tick(self, state):
        """Thrusts of the rotors front right, back right, back left, front left, in quarters of the weight; `state` has
        the positions from the goal, attitudes (w, x, y, z), velocities (world) and body rates in 13 columns."""
        states = numpy.array(state, dtype=numpy.float32, order="C")
        states[:, :3] += self.goals[:, :3]
        self.library.simulators_tick(states.ctypes.data, self.goals.ctypes.data, self.thrusts.ctypes.data)
        return self.thrusts.astype(float)
