"""What firmware computes around a policy."""

import numpy as np

from . import _native, _tasks
from ._native import KestrelError
from ._policy import Policy

COLUMNS = ["position_m", "attitude_wxyz", "velocity_m_per_s", "body_rates_rad_per_s", "goal_m"]


class Controller:
    """What firmware computes around a policy: what to observe of a drone, and which rotor speeds an action asks for. Between
    them any network may act, so that an ONNX file flies a drone in any simulator.

    ``pilot`` is a ``Policy``, or a task as of ``DroneVectorEnv``, whose observation and action it has. It is the core's own
    code: bit for bit what the firmware computes. Past actions and integrals are kept for each of the ``drones``.
    """

    def __init__(self, pilot, drones=1, **set):
        native = pilot.native if isinstance(pilot, Policy) else _tasks.load(pilot, set)
        self.drones = drones
        self.native = _native.Controller(native, drones)

    @property
    def control_secs(self):
        """Time from one action to the next [s]."""
        return self.native.control_secs

    def observe(self, states, yaw_rad=0.0, measurements=None):
        """The observations ``[drones, values]``, once every control period.

        ``states`` has ``position_m``, ``attitude_wxyz``, ``velocity_m_per_s``, ``body_rates_rad_per_s`` and ``goal_m``, a row
        for each drone, as ``DroneVectorEnv.states`` has them. ``yaw_rad`` is where the nose should point, and
        ``measurements [drones, values]`` what the task's sensors say, in their order and scales (zeros where there are none).
        """
        for name in COLUMNS:
            if name not in states:
                raise KestrelError(f"states: found no {name}, expected {', '.join(COLUMNS)}")
        told = {name: _rows(states[name]) for name in COLUMNS}
        headings = np.reshape(np.asarray(yaw_rad, dtype=np.float32), (-1, 1))
        told["yaw_rad"] = headings.repeat(self.drones, axis=0) if len(headings) == 1 else headings
        told["measurements"] = _rows(np.zeros((self.drones, 0)) if measurements is None else measurements)
        return self.native.observe(told)

    def rotor_speeds(self, actions):
        """Rotor targets ``[drones, 4]`` [rad/s] of an action ``[drones, values]``, in the order of the airframe: mixed, and
        within the rotors' limits, at the states that were observed last."""
        return self.native.rotor_speeds(_rows(actions))

    def follow_rates(self, body_rates_rad_per_s):
        """The last actions' rotor targets at the body rates ``[drones, 3]`` of this moment, between two actions, which
        policies with a rate loop were trained with; ``None`` for others, whose targets are held."""
        return self.native.follow_rates(_rows(body_rates_rad_per_s))

    def clear(self, ended=None):
        """Begins new flights, of those drones for which ``ended`` is true: ``clear(terminated | truncated)``."""
        self.native.clear([True] * self.drones if ended is None else list(map(bool, ended)))


def _rows(values):
    """As an array of rows; the values of one drone are one row."""
    return np.atleast_2d(np.asarray(values, dtype=np.float32))
