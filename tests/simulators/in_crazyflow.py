"""Crazyflow's Crazyflies: identified thrust and torque curves, motors, rotor inertia and drag, at 500 Hz."""

import numpy
from crazyflow.control import Control
from crazyflow.dynamics import Dynamics
from crazyflow.sim import Sim

from rotors import order

WHAT = {
    "crazyflow": "Crazyflie 2.x (cf2x_L250), 33 g",
    "crazyflow-P250": "Crazyflie 2.1+ (cf2x_P250), 32 g",
    "crazyflow-T350": "Crazyflie 2.1 with thrust upgrade (cf2x_T350), 38 g",
    "crazyflow-brushless": "Crazyflie 2.1 Brushless (cf21B_500), 43 g",
}

DRONES = {
    "crazyflow": "cf2x_L250",
    "crazyflow-P250": "cf2x_P250",
    "crazyflow-T350": "cf2x_T350",
    "crazyflow-brushless": "cf21B_500",
}

RATE_HZ = 500

HEIGHT = 10.0
"""Of the goal above the floor [m]."""


class Drones:
    def __init__(self, starts, what):
        self.sim = Sim(
            n_worlds=starts.count,
            n_drones=1,
            drone=DRONES[what],
            dynamics=Dynamics.first_principles,
            control=Control.rotor_vel,
            freq=RATE_HZ,
        )
        parameters = self.sim.data.params
        self.quarter_weight = 0.25 * 9.81 * float(numpy.ravel(parameters.mass)[0])
        self.curve = numpy.array(parameters.rpm2thrust, dtype=float).reshape(-1, 3)[0]
        roll, pitch, yaw = numpy.array(parameters.mixing_matrix, dtype=float).reshape(-1, 3, 4)[0]
        self.order = order(numpy.stack([-pitch, roll], axis=1), yaw)
        hover = numpy.full((starts.count, 1, 4), self.rpm(self.quarter_weight))
        each = {
            "pos": starts.positions + [0.0, 0.0, HEIGHT],
            "quat": starts.attitudes[:, [1, 2, 3, 0]],
            "vel": starts.velocities,
            "ang_vel": starts.body_rates,
        }
        states = {name: numpy.asarray(values[:, None], dtype=numpy.float32) for name, values in each.items()}
        states["rotor_vel"] = numpy.asarray(hover, dtype=numpy.float32)
        self.sim.data = self.sim.data.replace(states=self.sim.data.states.replace(**states))

    def rpm(self, newtons):
        """Rotor speed for a thrust, by the simulator's own curve."""
        constant, linear, square = self.curve
        return (-linear + numpy.sqrt(linear**2 - 4.0 * square * (constant - newtons).clip(max=0.0))) / (2.0 * square)

    def state(self):
        states = self.sim.data.states
        x, q, v, w = (numpy.array(values)[:, 0] for values in (states.pos, states.quat, states.vel, states.ang_vel))
        return numpy.hstack([x - [0.0, 0.0, HEIGHT], q[:, [3, 0, 1, 2]], v, w])

    def fly(self, thrusts, secs):
        speeds = self.rpm(self.quarter_weight * thrusts[:, self.order])
        self.sim.rotor_vel_control(numpy.asarray(speeds[:, None], dtype=numpy.float32))
        self.sim.step(round(secs * RATE_HZ))
