"""A browser without a screen uses the page: it flies, is pushed, moves furniture, trains, and saves what it has learned.

    python web_test.py KESTREL FOLDER

KESTREL is the path of `kestrel`, FOLDER what `sim-host/web/build` made. Needs the packages of web-requirements.txt and Chromium.
Pictures of what it saw are left in FOLDER/seen. Exit status 0 if every check passed.
"""

import functools
import http.server
import io
import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import zipfile

from playwright.sync_api import Error, sync_playwright

SEED = 3

PATIENCE_SECS = 180


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A static server that keeps what it does to itself."""

    def log_message(self, *_):
        pass


class Page:
    """The page, and what a user does to it."""

    def __init__(self, browser, address):
        self.complaints = []
        self.page = browser.new_page(viewport={"width": 1280, "height": 900})
        self.page.set_default_timeout(1000 * PATIENCE_SECS)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", lambda said: said.type == "error" and self.complaints.append(said.text))
        begun = time.monotonic()
        self.page.goto(address)
        self.page.wait_for_function("window.kestrel && (kestrel.pictures > 0 || !document.getElementById('error').hidden)")
        self.loading_secs = time.monotonic() - begun

    def ask(self, what):
        return self.page.evaluate(what)

    def error(self):
        return self.page.locator("#error").text_content()

    def choose(self, pilot, world=None, flyer=None):
        """Another flight; it begins anew even where nothing changes."""
        self.ask("kestrel.flight && (kestrel.flight.mark = true)")
        for part, value in (("world", world), ("flyer", flyer)):
            if value:
                self.ask(f"document.getElementById('{part}').value = '{value}'")
        self.page.select_option("#pilot", pilot)
        self.page.wait_for_function("!kestrel.flight?.mark || !document.getElementById('error').hidden")

    def fly(self, secs):
        """So long in simulated time, at once."""
        self.ask(f"for (let at = 0; at < {secs}; at += kestrel.flight.control_secs) kestrel.flight.step()")

    def telemetry(self):
        x, y, z, speed, tilt, distance, *rotors = self.ask("[...kestrel.flight.telemetry()]")
        return {"place": (x, y, z), "speed": speed, "tilt": tilt, "distance": distance, "rotors": rotors}

    def shown(self):
        """Two pictures later, what was flown at once is on the screen."""
        self.page.wait_for_function(f"kestrel.pictures > {self.ask('kestrel.pictures') + 2}")

    def find(self, kind):
        """A point of the screen that shows a thing of a kind, or nothing."""
        self.shown()
        found = self.page.evaluate(
            """(kind) => {
              const { columns, rows } = kestrel.look;
              for (let row = 4; row < rows; row += 6) for (let column = 4; column < columns; column += 6) {
                const found = kestrel.flight.grab(column, row);
                kestrel.flight.release();
                if (found === kind) return [column / columns, row / rows];
              }
              return null;
            }""",
            kind,
        )
        box = self.page.locator("#overlay").bounding_box()
        return found and (box["x"] + found[0] * box["width"], box["y"] + found[1] * box["height"])


def hovers(page, within_m):
    seen = page.telemetry()
    return seen["distance"] < within_m and seen["speed"] < 0.2


def free_flight(page):
    """A drone that flies where the mouse points."""
    page.page.click("#pause")
    page.fly(5)
    yield "it takes off and hovers a metre above the floor", hovers(page, 0.1) and abs(page.telemetry()["place"][2] - 1) < 0.1
    yield "its rotors turn", all(0.3 < rotor < 1 for rotor in page.telemetry()["rotors"])
    widths, values = page.ask("[...kestrel.policy.widths]"), page.ask("[...kestrel.flight.activations()]")
    yield "the network shows what each layer reads, and the action", len(values) == sum(widths) and widths[-1] == 4
    yield "activations are shares of one", max(map(abs, values[widths[0] :])) <= 1 and any(values)

    before = page.ask("[...kestrel.flight.goal]")
    box = page.page.locator("#overlay").bounding_box()
    page.shown()
    page.page.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.55 * box["height"])
    after = page.ask("[...kestrel.flight.goal]")
    yield "a click sets the goal at its height", math.dist(before, after) > 0.2 and abs(before[2] - after[2]) < 1e-6
    page.fly(6)
    yield "and the drone goes there", hovers(page, 0.1)
    page.page.locator("#overlay").press("w")
    page.fly(3)
    yield "W raises it", abs(page.telemetry()["place"][2] - after[2] - 0.1) < 0.1

    drone = page.find("drone")
    yield "the mouse finds the drone", drone is not None
    page.page.mouse.click(*drone)
    page.fly(0.05)
    yield "a click pushes it", page.telemetry()["speed"] > 0.7
    page.fly(6)
    yield "and it comes back", hovers(page, 0.1)

    page.page.locator("#wind").fill("2")
    page.fly(6)
    yield "it holds its place in a wind of 2 m/s", hovers(page, 0.3)
    page.page.locator("#mass").fill("1.2")
    page.fly(6)
    yield "and with a fifth more mass", hovers(page, 0.4) and page.ask("kestrel.flight.mass") > 0.03
    page.page.click("#reset")
    yield "it starts again on the floor", page.telemetry()["place"][2] < 0.05
    page.page.locator("#wind").fill("0")
    page.page.locator("#mass").fill("1")
    page.page.click("#pause")


def furniture(page):
    """A room whose walls stop a drone, and whose furniture moves."""
    page.page.click("#pause")
    page.choose("free|hover", world="room-0")
    page.fly(4)
    for x, y in ((30, 0), (-30, 0), (0, 30), (0, -30)):
        page.ask(f"kestrel.flight.set_wind({x / 10}, {y / 10})")
        page.fly(6)
    x, y, z = page.telemetry()["place"]
    yield "walls stop what the wind drives against them", -1 < x < 7 and -1.5 < y < 1.5 and 0 < z < 1.5
    page.ask("kestrel.flight.set_wind(0, 0)")
    page.page.click("#reset")
    page.fly(3)
    page.ask("kestrel.look.zoom = 4")
    page.ask("kestrel.look.elevation = 0.7")
    page.page.click("#pause")
    grip = page.find("furniture")
    yield "the mouse finds furniture", grip is not None
    screen = page.page.locator("#picture")
    before = screen.screenshot()
    page.page.mouse.move(*grip)
    page.page.mouse.down()
    page.page.mouse.move(grip[0] + 60, grip[1] + 10, steps=4)
    page.page.mouse.up()
    page.shown()
    yield "and moves it", screen.screenshot() != before
    page.page.keyboard.press("r")
    page.page.wait_for_function("kestrel.flight.telemetry()[2] > 0.5")
    yield "the drone takes off again in real time", True


def tasks(page, names):
    """Whatever flies its task begins to."""
    for name in names:
        page.choose(f"task|{name}")
        page.shown()
        yield f"{name} flies", not page.error() and page.ask("kestrel.flight.drones") >= 1
    page.page.click("#pause")
    page.choose("task|room-1", flyer="policy")
    successes = 0
    for _ in range(8):
        page.fly(30)
        ending = page.ask("kestrel.flight.ending")
        successes += ending.startswith("success after ")
        page.ask("kestrel.flight.next()")
    yield f"room-1 is crossed in {successes} of 8 episodes, at least 7", successes >= 7
    page.choose("task|land", flyer="nothing")
    page.fly(20)
    yield "nobody lands by doing nothing", page.ask("kestrel.flight.ending").startswith("failure after ")
    page.choose("task|room-1-vision", flyer="policy")
    page.page.click("#pause")
    page.page.wait_for_function("!document.getElementById('eye').hidden")
    yield "what its camera sees is shown", len(set(page.ask("[...kestrel.flight.image()]"))) > 20


def training(page, kestrel, place):
    """What the page learns is what the program learns."""
    page.choose("free|hover", world="hover")
    page.page.fill("#seed", str(SEED))
    page.page.click("#train")
    page.page.wait_for_function("document.getElementById('progress').value > 0.05")
    pictures = page.ask("kestrel.pictures")
    page.page.wait_for_function("document.getElementById('progress').value > 0.1")
    yield "it flies on while it trains", page.ask("kestrel.pictures") > pictures
    page.page.wait_for_function("kestrel.trained || document.getElementById('train').textContent === 'Train'")
    said = page.page.locator("#trained").text_content()
    yield f"hover is learned: {said}", float(said.split(" ")[0]) >= 98
    saved, app = place / "page.kestrel", place / "app.zip"
    for button, path in (("#save-policy", saved), ("#save-app", app)):
        with page.page.expect_download() as download:
            page.page.click(button)
        download.value.save_as(path)

    def run(*arguments):
        return subprocess.run([kestrel, *map(str, arguments)], check=True, capture_output=True, text=True).stdout

    native = place / "native"
    run("train", "hover", "--seed", SEED, "--run", native, "--threads", 1)
    yield "the program comes to the same bits", saved.read_bytes() == (native / "policy.kestrel").read_bytes()
    run("export", native, "--target", "crazyflie")
    archive = zipfile.ZipFile(io.BytesIO(app.read_bytes()))
    found = {name.removeprefix("crazyflie/"): archive.read(name) for name in archive.namelist()}
    yield "the app for a Crazyflie is that of the program", found == {path.name: path.read_bytes() for path in (native / "crazyflie").iterdir()}

    page.page.click("#fly-trained")
    page.page.wait_for_function(f"kestrel.policy.name === 'hover' && document.getElementById('pilot').value === 'free|hover, trained with seed {SEED}'")
    page.fly(5)
    yield "it flies in the page", hovers(page, 0.1)
    page.page.set_input_files("#open", saved)
    page.page.wait_for_function("document.getElementById('pilot').value === 'free|page.kestrel'")
    yield "a file that was saved can be opened", not page.error()


def refusals(page, folder, place):
    """Wrong files are refused with a word, and the page flies on."""
    damaged = bytearray((folder / "pilots/hover.kestrel").read_bytes())
    damaged[3000] ^= 1
    (place / "damaged.kestrel").write_bytes(damaged)
    (place / "empty.kestrel").write_bytes(b"")
    shutil.copy(folder / "pilots/room-1.kestrel", place / "bound.kestrel")
    for name, words in (("damaged", "checksum"), ("empty", ""), ("bound", "sees what only its task has")):
        page.page.set_input_files("#open", place / f"{name}.kestrel")
        page.page.wait_for_function(f"document.getElementById('error').textContent.startsWith('{name}.kestrel: ')")
        yield f"a file that is {name} is refused: {page.error()}", words in page.error()
    pictures = page.ask("kestrel.pictures")
    page.page.wait_for_function(f"kestrel.pictures > {pictures + 5}")
    (folder / "tasks/maze.yaml").rename(place / "maze.yaml")
    try:
        page.choose("task|maze")
        page.ask("kestrel.tasks.delete('maze')")
        page.choose("task|maze")
        yield "a task that is not there is named", "tasks/maze.yaml: 404" in page.error()
    finally:
        (place / "maze.yaml").rename(folder / "tasks/maze.yaml")
    page.choose("free|hover")
    yield "and the page flies on", not page.error()


def checks(browser, address, kestrel, folder, place):
    page = Page(browser, address)
    print(f"loaded after {page.loading_secs:.2f} s", flush=True)
    yield f"the page loads {page.error()}", not page.error()
    time.sleep(3)
    print(f"{page.page.locator('#rate').text_content()}, headless", flush=True)
    yield from free_flight(page)
    seen(page, folder, "free")
    yield from furniture(page)
    seen(page, folder, "room")
    flights = json.loads((folder / "flights.json").read_text())
    yield from tasks(page, [task["name"] for task in flights["tasks"]])
    seen(page, folder, "task")
    yield from training(page, kestrel, place)
    seen(page, folder, "trained")
    expected = len(page.complaints)
    yield f"the browser has nothing to complain about: {page.complaints}", expected == 0
    yield from refusals(page, folder, place)


def seen(page, folder, name):
    (folder / "seen").mkdir(exist_ok=True)
    page.page.screenshot(path=folder / "seen" / f"{name}.png")


def main():
    kestrel, folder = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    passed = failed = 0
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as place:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-dev-shm-usage"])
        address = f"http://127.0.0.1:{server.server_port}/"
        try:
            for name, passes in checks(browser, address, kestrel, folder, pathlib.Path(place)):
                print(f"{'ok' if passes else 'FAILED'}: {name}", flush=True)
                passed, failed = passed + bool(passes), failed + (not passes)
        except Error as error:
            print(f"FAILED: the page did not do what was waited for: {error}", flush=True)
            failed += 1
        browser.close()
    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
