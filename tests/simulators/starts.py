"""Starts as those of the evaluation in configs/hover.yaml, and what becomes of them."""

import numpy

DISTANCE = 0.5
"""From the goal [m]."""

TILT = 0.5 * numpy.pi
SPEED = 1.0
BODY_RATES = 3.0

SECS = 8.0
SETTLED_AFTER_SECS = 4.0
SETTLED_RADIUS = 0.05
"""[m]."""


class Starts:
    """Positions from the goal [m], attitudes (w, x, y, z), velocities [m/s, world], body rates and headings."""

    def __init__(self, count, seed=0):
        random = numpy.random.default_rng(seed)

        def directions():
            vectors = random.normal(size=(count, 3))
            return vectors / numpy.linalg.norm(vectors, axis=1, keepdims=True)

        self.count = count
        self.positions = DISTANCE * directions()
        self.headings = random.uniform(-numpy.pi, numpy.pi, count)
        azimuths = random.uniform(-numpy.pi, numpy.pi, count)
        self.attitudes = tilted(TILT * random.uniform(size=count), azimuths, self.headings)
        self.velocities = SPEED * random.uniform(size=(count, 1)) * directions()
        self.body_rates = BODY_RATES * random.uniform(size=(count, 1)) * directions()


def tilted(tilt, azimuth, heading):
    """A heading, then a tilt about a horizontal axis of the world."""
    w = numpy.cos(0.5 * tilt)
    x, y = numpy.sin(0.5 * tilt) * [numpy.cos(azimuth), numpy.sin(azimuth)]
    cosine, sine = numpy.cos(0.5 * heading), numpy.sin(0.5 * heading)
    return numpy.stack([w * cosine, x * cosine + y * sine, y * cosine - x * sine, w * sine], axis=1)


def rotated(attitudes, vectors):
    """Vectors of bodies in the world; with attitudes (w, -x, -y, -z), the other way round."""
    w, axis = attitudes[:, :1], attitudes[:, 1:]
    twice = 2.0 * numpy.cross(axis, vectors)
    return vectors + w * twice + numpy.cross(axis, twice)


def headings(attitudes):
    """[rad], counter-clockwise from x."""
    w, x, y, z = attitudes.T
    return numpy.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def fly(pilot, drones, starts):
    """Flies all starts: distances from the goal [m] and heading errors [rad] of each tick once they have to be settled."""
    distances, turns = [], []
    for tick in range(round(SECS / pilot.period)):
        state = drones.state()
        if tick * pilot.period >= SETTLED_AFTER_SECS:
            distances.append(numpy.linalg.norm(state[:, :3], axis=1))
            turn = headings(state[:, 3:7]) - starts.headings
            turns.append(numpy.abs((turn + numpy.pi) % (2.0 * numpy.pi) - numpy.pi))
        drones.fly(pilot.tick(state), pilot.period)
    return numpy.nan_to_num(distances, nan=numpy.inf), numpy.nan_to_num(turns, nan=numpy.pi)


def summary(distances, turns):
    """Share of settled drones, and the median over all drones of their mean distance from the goal [m]; of the settled,
    the mean distance, and how far they turned at worst [rad], on average and the one that turned most."""
    settled = distances.max(axis=0) <= SETTLED_RADIUS
    worst = turns[:, settled].max(axis=0, initial=0.0)
    nothing = numpy.full(1, numpy.nan)
    return {
        "settled": float(settled.mean()),
        "median": float(numpy.median(distances.mean(axis=0))),
        "mean": float((distances[:, settled] if settled.any() else nothing).mean()),
        "turn": float((worst if settled.any() else nothing).mean()),
        "most": float((worst if settled.any() else nothing).max()),
    }
