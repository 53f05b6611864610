"""PyBullet with the Crazyflie of gym-pybullet-drones (cf2x): mass, inertia, rotors without lag, at 240 Hz."""

import tempfile

import numpy
import pybullet

from rotors import PLACES, TURNS, Substeps
from starts import rotated

WHAT = {"pybullet": "gym-pybullet-drones' cf2x, 27 g"}

RATE_HZ = 240
GRAVITY = 9.8
MASS = 0.027
ARM_ALONG_AXES = 0.028
TORQUE_PER_THRUST = 7.94e-12 / 3.16e-10
GREATEST_THRUST = 2.25
"""In units of the weight."""

URDF = f"""<robot name="cf2x"><link name="base"><inertial><mass value="{MASS}"/>
<inertia ixx="1.4e-5" ixy="0" ixz="0" iyy="1.4e-5" iyz="0" izz="2.17e-5"/></inertial></link></robot>"""


class Drones:
    def __init__(self, starts, _what):
        pybullet.connect(pybullet.DIRECT)
        pybullet.setGravity(0.0, 0.0, -GRAVITY)
        pybullet.setTimeStep(1.0 / RATE_HZ)
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(URDF)
            file.flush()
            self.bodies = [
                pybullet.loadURDF(file.name, list(x), list(q[[1, 2, 3, 0]]), flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
                for x, q in zip(starts.positions, starts.attitudes)
            ]
        turning = rotated(starts.attitudes, starts.body_rates)
        for body, velocity, rates in zip(self.bodies, starts.velocities, turning):
            pybullet.resetBaseVelocity(body, list(velocity), list(rates))
        self.substeps = Substeps(RATE_HZ)

    def state(self):
        places = [pybullet.getBasePositionAndOrientation(body) for body in self.bodies]
        moves = [pybullet.getBaseVelocity(body) for body in self.bodies]
        attitudes = numpy.array([q for _, q in places])[:, [3, 0, 1, 2]]
        rates = rotated(attitudes * [1, -1, -1, -1], numpy.array([w for _, w in moves]))
        return numpy.hstack([numpy.array([x for x, _ in places]), attitudes, numpy.array([v for v, _ in moves]), rates])

    def fly(self, thrusts, secs):
        newtons = 0.25 * MASS * GRAVITY * thrusts.clip(0.0, GREATEST_THRUST)
        arms = ARM_ALONG_AXES * numpy.array(PLACES)
        wrenches = [
            ([0.0, 0.0, each.sum()], [each @ arms[:, 1], -each @ arms[:, 0], TORQUE_PER_THRUST * (each @ TURNS)])
            for each in newtons
        ]
        for _ in range(self.substeps.of(secs)):
            for body, (force, torque) in zip(self.bodies, wrenches):
                pybullet.applyExternalForce(body, -1, force, [0.0, 0.0, 0.0], pybullet.LINK_FRAME)
                pybullet.applyExternalTorque(body, -1, torque, pybullet.LINK_FRAME)
            pybullet.stepSimulation()
