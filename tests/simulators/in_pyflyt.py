"""PyFlyt's Crazyflie (cf2x): Bullet at 240 Hz, first-order motors of 10 ms with noise, drag."""

import numpy
from PyFlyt.core import Aviary

from rotors import Substeps, order
from starts import rotated

WHAT = {"pyflyt": "cf2x, 27 g"}

RATE_HZ = 240
GRAVITY = 9.81

APART = 3.0
"""Between the goals of two drones [m], which share a world."""

HEIGHT = 10.0
"""Of the goals above the floor [m]."""


class Drones:
    def __init__(self, starts, _what):
        across = int(numpy.ceil(numpy.sqrt(starts.count)))
        index = numpy.arange(starts.count)
        columns = [APART * (index % across), APART * (index // across), numpy.full_like(index, HEIGHT)]
        self.goals = numpy.stack(columns, axis=1)
        positions = starts.positions + self.goals
        self.aviary = Aviary(
            start_pos=positions,
            start_orn=numpy.zeros((starts.count, 3)),
            drone_type="quadx",
            drone_options={"drone_model": "cf2x", "control_hz": RATE_HZ},
            physics_hz=RATE_HZ,
            seed=0,
        )
        self.aviary.set_mode(-1)
        self.drones = self.aviary.drones
        motors = self.drones[0].motors
        links = [self.aviary.getLinkState(self.drones[0].Id, link)[0] for link in motors.motor_ids]
        centre = self.aviary.getBasePositionAndOrientation(self.drones[0].Id)[0]
        self.order = order(numpy.array(links) - centre, motors.torque_coef[:, 0])
        mass = self.aviary.getDynamicsInfo(self.drones[0].Id, -1)[0]
        self.gain = self.gain_of(motors)
        greatest = float(motors.thrust_coef[0, 0] * motors.max_rpm[0] ** 2)
        self.quarter_weight = 0.25 * mass * GRAVITY / greatest
        turning = rotated(starts.attitudes, starts.body_rates)
        for each, x, q, v, w in zip(self.drones, positions, starts.attitudes, starts.velocities, turning):
            self.aviary.resetBasePositionAndOrientation(each.Id, list(x), list(q[[1, 2, 3, 0]]))
            self.aviary.resetBaseVelocity(each.Id, list(v), list(w))
            each.motors.throttle = numpy.full(4, numpy.sqrt(self.quarter_weight))
            each.update_state()
        self.substeps = Substeps(RATE_HZ)

    def gain_of(self, motors):
        """Throttle of the motors per throttle that is asked for: their noise, 2 % of a normal variable with the mean of
        4 that PyFlyt 0.29 gives it, makes them faster by a fifth."""
        motors.reset()
        reached = []
        for _ in range(2 * RATE_HZ):
            motors.physics_update(numpy.full(4, 0.5))
            reached.append(motors.throttle.mean())
        self.aviary.stepSimulation()
        return numpy.mean(reached[RATE_HZ // 2 :]) / 0.5

    def state(self):
        places = [self.aviary.getBasePositionAndOrientation(each.Id) for each in self.drones]
        moves = [self.aviary.getBaseVelocity(each.Id) for each in self.drones]
        attitudes = numpy.array([q for _, q in places])[:, [3, 0, 1, 2]]
        rates = rotated(attitudes * [1, -1, -1, -1], numpy.array([w for _, w in moves]))
        positions = numpy.array([x for x, _ in places]) - self.goals
        return numpy.hstack([positions, attitudes, numpy.array([v for v, _ in moves]), rates])

    def fly(self, thrusts, secs):
        throttles = (numpy.sqrt(self.quarter_weight * thrusts[:, self.order]) / self.gain).clip(0.0, 1.0)
        self.aviary.set_all_setpoints(throttles)
        for _ in range(self.substeps.of(secs)):
            self.aviary.step()
