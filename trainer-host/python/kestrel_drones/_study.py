"""The flights of a study, for other programs' tables."""

import csv
import os
from pathlib import Path


class Study:
    """A directory that ``kestrel study run`` made. ``pandas.DataFrame(study.rows)``, ``polars.DataFrame(study.rows)``."""

    def __init__(self, directory):
        self.directory = Path(os.fspath(directory))
        if not (self.directory / "study.yaml").is_file():
            raise FileNotFoundError(f"{self.directory}: found no study.yaml, expected the directory of a study")

    @property
    def rows(self):
        """Every flight so far, a dictionary each: ``method``, ``order``, ``seed``, ``stage`` (0 before training), ``task``,
        ``episode``, ``success``, ``episode_return``, ``length_secs``."""
        return self._read("rows")

    @property
    def curves(self):
        """Every test in the midst of training: ``method``, ``order``, ``seed``, ``stage``, ``steps``, ``success_rate``,
        ``episode_return``."""
        return self._read("curves")

    def _read(self, folder):
        found = []
        for path in sorted(self.directory.glob(f"{folder}/*/*.csv")):
            with open(path, newline="", encoding="utf-8") as file:
                found += [{name: _value(text) for name, text in row.items()} for row in csv.DictReader(file)]
        return found

    def __repr__(self):
        return f"Study({str(self.directory)!r})"


def _value(text):
    """A number, a truth or a text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text
