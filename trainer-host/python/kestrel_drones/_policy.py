"""Trained policies."""

import os
from pathlib import Path

import numpy as np

from . import _native
from ._tasks import SHIPPED


class Policy:
    """A policy file, which acts with the very inference that firmware runs, bit for bit."""

    def __init__(self, native):
        self.native = native

    @classmethod
    def load(cls, path):
        """The policy of a file, of a run directory (fixed point), or one that is shipped: ``hover``, ``cross``."""
        path = Path(os.fspath(path))
        shipped = SHIPPED / "assets" / "pilots" / f"{path}.kestrel"
        if path.is_dir():
            path = path / "policy.kestrel"
        elif not path.exists() and shipped.exists():
            path = shipped
        return cls(_native.Policy.load(path))

    @property
    def name(self):
        """Name of the experiment that it was trained in."""
        return self.native.name

    @property
    def arithmetic(self):
        """``fixed16`` or ``float32``."""
        return self.native.arithmetic

    @property
    def control_secs(self):
        """Time from one action to the next [s]."""
        return self.native.control_secs

    def act(self, observation):
        """The action for an observation, or one for each row of many: an array, or a dictionary with the images."""
        images = None
        if isinstance(observation, dict):
            observation, images = observation["observation"], np.asarray(observation["image"], dtype=np.uint8)
        values = np.asarray(observation, dtype=np.float32)
        if values.ndim == 1:
            images = None if images is None else images[None]
            return self.native.act(values[None], images)[0]
        return self.native.act(values, images)

    def __repr__(self):
        return f"Policy({self.name}, {self.arithmetic})"
