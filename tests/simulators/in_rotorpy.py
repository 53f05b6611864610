"""RotorPy's Crazyflie: rotor drag, first-order motors, Runge-Kutta 45 (Folk et al. 2023)."""

import numpy
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from rotors import order

WHAT = {"rotorpy": "Crazyflie, 30 g"}


class Drones:
    def __init__(self, starts, _what):
        self.vehicle = Multirotor(quad_params, control_abstraction="cmd_motor_thrusts")
        self.quarter_weight = 0.25 * self.vehicle.mass * self.vehicle.g
        self.order = order(self.vehicle.rotor_geometry, self.vehicle.rotor_dir)
        hover = numpy.sqrt(self.quarter_weight / self.vehicle.k_eta)
        each = zip(starts.positions, starts.velocities, starts.attitudes, starts.body_rates)
        self.states = [
            {"x": x, "v": v, "q": q[[1, 2, 3, 0]], "w": w, "wind": numpy.zeros(3), "rotor_speeds": numpy.full(4, hover)}
            for x, v, q, w in each
        ]

    def state(self):
        return numpy.stack([numpy.concatenate([s["x"], s["q"][[3, 0, 1, 2]], s["v"], s["w"]]) for s in self.states])

    def fly(self, thrusts, secs):
        commands = self.quarter_weight * thrusts[:, self.order]
        self.states = [
            self.vehicle.step(state, {"cmd_motor_thrusts": command}, secs)
            for state, command in zip(self.states, commands)
        ]
