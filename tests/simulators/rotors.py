"""The rotors of a drone in X configuration, by the place where they are."""

import numpy

PLACES = [(1, -1), (-1, -1), (-1, 1), (1, 1)]
"""Signs of x and y of our rotors: front right, back right, back left, front left."""

TURNS = [-1, 1, -1, 1]
"""Sign of the torque about z that each exerts on the drone."""


def order(positions, turns):
    """For each rotor of a simulator, which of ours it is."""
    ours = [PLACES.index((round(numpy.sign(x)), round(numpy.sign(y)))) for x, y, *_ in positions]
    assert sorted(ours) == [0, 1, 2, 3], positions
    assert [TURNS[rotor] for rotor in ours] == [round(numpy.sign(turn)) for turn in turns], turns
    return ours


class Substeps:
    """How many steps of a simulator's clock belong to each control period, so that both clocks agree on average."""

    def __init__(self, rate_hz):
        self.rate_hz, self.elapsed, self.steps = rate_hz, 0.0, 0

    def of(self, secs):
        self.elapsed += secs
        steps = round(self.elapsed * self.rate_hz) - self.steps
        self.steps += steps
        return steps
