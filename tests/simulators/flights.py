"""Flies a policy unchanged in simulators that others wrote.

    python flights.py LIBRARY POLICY STARTS SIMULATOR...

LIBRARY is pilot.c with the core's pilot as a shared library. Writes a row of a table per simulator: how many starts there
were, what share settled within 5 cm from 4 s to 8 s, the mean distance of those from the goal, the median of all, how far the
settled ones turned from the heading of their start, on average and at most, and the seconds that it took.
"""

import importlib
import sys
import time

import numpy

from pilot import Pilot
from starts import Starts, fly, summary


def row(library, policy, count, simulator):
    module = importlib.import_module(f"in_{simulator.split('-')[0]}")
    starts = Starts(count)
    begun = time.monotonic()
    drones = module.Drones(starts, simulator)
    found = summary(*fly(Pilot(library, policy, starts.headings), drones, starts))
    lengths = [f"{100 * found[name]:.2f}" for name in ("mean", "median")]
    angles = [f"{numpy.degrees(found[name]):.1f}" for name in ("turn", "most")]
    share = f"{100 * found['settled']:.1f}"
    return [simulator, module.WHAT[simulator], str(count), share, *lengths, *angles, f"{time.monotonic() - begun:.0f}"]


def main():
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    library, policy, count, *simulators = sys.argv[1:]
    for simulator in simulators:
        print("| " + " | ".join(row(library, policy, int(count), simulator)) + " |", flush=True)


if __name__ == "__main__":
    main()
