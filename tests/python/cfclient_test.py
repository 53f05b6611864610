"""Bitcraze's cfclient, as it is published, flies a policy: its window is used without a screen, and the true position judged.

    python cfclient_test.py KESTREL RUN_OR_POLICY [PICTURE]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of cfclient-requirements.txt. Buttons are pressed
as a user would: Scan, Connect, Arm, Take off, up, forward, Land. PICTURE is where the window goes as PNG, if anywhere. Exit
status 0 if every check passed.
"""

import os
import sys
import tempfile
import time

os.environ["QT_QPA_PLATFORM"] = "offscreen"
FOLDER = tempfile.mkdtemp()
os.environ["XDG_CONFIG_HOME"] = FOLDER  # cfclient remembers what it did, of which this must know nothing

from cfclient.ui.main import MainUI, UIState
from cfclient.ui.tabs.FlightTab import FlightTab
from PyQt6.QtWidgets import QApplication
from judge import REST_HEIGHT_M, Simulated, checks_of, conclude, expect, free_port, run_checks

SCANNED_PORTS = range(19850, 19860)
"""Where cflib looks for simulated drones."""

MOVE_M = 0.5
"""How far a press of an arrow goes."""

ARRIVAL_RADIUS_M = 0.10


class Window:
    """cfclient's window, whose events happen while somebody waits."""

    def __init__(self):
        self.application = QApplication(sys.argv[:1])
        self.main = MainUI()
        self.main.show()
        self.connectivity = self.main._connectivity_manager
        self.interfaces = self.connectivity._ui_elements[0].interface_combo

    def wait(self, condition, what, within_secs):
        """Lets things happen until they are as they should be."""
        until = time.monotonic() + within_secs
        while not condition():
            expect(time.monotonic() < until, f"{what}: not within {within_secs} s")
            self.application.processEvents()
            time.sleep(0.02)

    def tab(self):
        return next(tab for tab in self.main.loaded_tab_toolboxes.values() if isinstance(tab, FlightTab))


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, window, uri, picture):
        self._true, self._window, self._uri, self._picture = vehicle.true, window, uri, picture

    def _at(self, point, what):
        def near():
            return max(abs(a - b) for a, b in zip(self._true.position(), point)) < ARRIVAL_RADIUS_M

        self._window.wait(near, what, 15.0)

    def scan_finds_it(self):
        window = self._window
        window.main._scan_from_button(window.connectivity.get_address())

        def found():
            return window.interfaces.findText(self._uri) >= 0

        window.wait(found, f"{self._uri} is offered", 30.0)
        window.interfaces.setCurrentIndex(window.interfaces.findText(self._uri))

    def connects_and_reads_all_tables(self):
        window = self._window
        window.connectivity._ui_elements[0].connect_button.click()
        window.wait(lambda: window.main.uiState == UIState.CONNECTED, "it is connected", 30.0)
        window.wait(lambda: window.main.cf.param.is_updated, "all parameters are there", 30.0)

    def shows_height_and_battery(self):
        window = self._window
        window.wait(lambda: window.main._aff_volts.text() == "4.200", "the battery is full", 10.0)
        window.wait(lambda: abs(float(window.tab().estimateZ.text() or "9")) < 0.1, "the height is shown", 10.0)

    def arms(self):
        window = self._window
        window.wait(window.tab().armButton.isEnabled, "it can be armed", 10.0)
        window.tab().armButton.click()
        window.wait(lambda: self._true.now()["armed"], "it is armed", 10.0)

    def takes_off(self):
        window = self._window
        window.wait(window.tab().commanderTakeOffButton.isEnabled, "it can take off", 10.0)
        window.tab().commanderTakeOffButton.click()
        self._at((0.0, 0.0, MOVE_M), "it is half a metre up")

    def goes_up_and_forward(self):
        window = self._window
        window.tab().commanderUpButton.click()
        self._at((0.0, 0.0, 2 * MOVE_M), "it is a metre up")
        window.tab().commanderForwardButton.click()
        self._at((MOVE_M, 0.0, 2 * MOVE_M), "it is half a metre ahead")
        if self._picture:
            window.main.grab().save(self._picture)

    def lands(self):
        window = self._window
        window.tab().commanderLandButton.click()
        window.wait(lambda: self._true.position()[2] < REST_HEIGHT_M, "it is on the floor", 20.0)


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    kestrel, policy, *picture = sys.argv[1:]
    port = free_port(SCANNED_PORTS)
    with Simulated(kestrel, [policy, "--crtp", f"127.0.0.1:{port}"], FOLDER) as vehicle:
        flight = Flight(vehicle, Window(), f"udp://127.0.0.1:{port}", picture[0] if picture else None)
        status = conclude(run_checks(checks_of(flight)))
    sys.stdout.flush()
    # Threads of a client whose connection failed never end.
    os._exit(status)


if __name__ == "__main__":
    main()
