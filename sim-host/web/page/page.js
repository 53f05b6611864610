// The page: what flies, what the mouse does, what is shown.
import init, { FreeFlight, Look, TaskFlight, WebPolicy, crazyflie_zip, version } from "./pkg/kestrel_web.js";
import { drawCurve, drawNetwork, drawOverlay, drawRotors } from "./charts.js";

const part = (id) => document.getElementById(id);

/** Sizes of the picture [px] and rays across a pixel, from the fastest; the rate chooses. */
const QUALITIES = [
  [480, 270, 1],
  [640, 360, 1],
  [800, 450, 1],
  [960, 540, 1],
  [640, 360, 2],
  [1280, 720, 1],
  [960, 540, 2],
];

/** A picture that takes longer than this is made smaller, a shorter one larger [ms]. */
const [SLOW_MS, FAST_MS] = [11, 4];

/** Control periods that a picture catches up with at most; a page in the background waits. */
const MOST_PERIODS = 8;

/** Time for which the end of an episode is shown [s]. */
const ENDING_SECS = 1.5;

const FREE_HINT = "Click or drag: the goal. On the drone: push it. On furniture: move it. Right button: look around. Wheel: zoom; with shift, or W and S: the goal's height.";
const TASK_HINT = "It flies the episodes by which it is judged, one after the other. Drag: look around. Wheel: zoom. N: the next episode.";

const state = {
  flights: null,
  policies: new Map(),
  tasks: new Map(),
  /** The policy that flies, the flight, and whether it is a free one. */
  policy: null,
  flight: null,
  free: true,
  look: null,
  quality: 1,
  paused: false,
  /** Since the last control period, and since an episode ended [s]. */
  behind: 0,
  ended: 0,
  /** What was learned last, and what is learned: a task and a seed. */
  trained: null,
  lesson: null,
  /** Means over pictures, for the rate [ms]. */
  drawMs: 8,
  pictureMs: 16,
  pictures: 0,
};

/** For tests and the curious. */
window.kestrel = state;

async function fetched(path, as) {
  const answer = await fetch(path, { cache: "no-cache" }); // a page may have been built anew
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${answer.statusText}`);
  return answer[as]();
}

async function task(name) {
  if (!state.tasks.has(name)) state.tasks.set(name, await fetched(`tasks/${name}.yaml`, "text"));
  return state.tasks.get(name);
}

async function policy(name) {
  if (!state.policies.has(name)) {
    const bytes = new Uint8Array(await fetched(`pilots/${name}.kestrel`, "arrayBuffer"));
    state.policies.set(name, { policy: new WebPolicy(bytes), task: name });
  }
  return state.policies.get(name);
}

function say(error) {
  part("error").hidden = !error;
  part("error").textContent = error ? String(error.message ?? error) : "";
}

/** Flies what the two lists say. */
async function begin() {
  try {
    const [kind, name] = part("pilot").value.split("|");
    const chosen = await policy(name);
    const free = kind === "free";
    const world = part("world").value;
    const flight = free
      ? new FreeFlight(chosen.policy, await task(chosen.task), await task(world))
      : new TaskFlight(chosen.policy, await task(chosen.task), part("flyer").value);
    state.flight?.free();
    Object.assign(state, { flight, free, policy: chosen.policy, behind: 0, ended: 0 });
    state.look.zoom = free || flight.drones === 1 ? 2 : 5;
    for (const id of ["world-row", "world-controls"]) part(id).hidden = !free;
    part("flyer-row").hidden = free;
    part("hint").textContent = free ? FREE_HINT : TASK_HINT;
    setWorld();
    say();
  } catch (error) {
    say(error);
  }
}

/** Wind and mass as the sliders say. */
function setWorld() {
  const [speed, from, mass] = ["wind", "wind-from", "mass"].map((id) => Number(part(id).value));
  part("wind-value").textContent = `${speed.toFixed(1)} m/s`;
  part("wind-from-value").textContent = `${from}°`;
  if (!state.free) return;
  const towards = ((from + 180) * Math.PI) / 180;
  state.flight.set_wind(speed * Math.cos(towards), speed * Math.sin(towards));
  state.flight.set_mass(mass);
  part("mass-value").textContent = `${(1000 * state.flight.mass).toFixed(1)} g`;
}

function restart() {
  if (state.free) state.flight.reset();
  else state.flight.next();
  [state.behind, state.ended] = [0, 0];
}

// ---- time

function advance(secs) {
  const { flight } = state;
  const period = flight.control_secs;
  state.behind = Math.min(state.behind + secs, MOST_PERIODS * period);
  while (state.behind >= period) {
    flight.step();
    state.behind -= period;
  }
  if (state.free) return;
  const ending = flight.ending;
  if (ending) {
    state.ended += secs;
    if (state.ended > ENDING_SECS) restart();
  }
}

function draw() {
  const { flight, look } = state;
  const [columns, rows, samples] = QUALITIES[state.quality];
  Object.assign(look, { columns, rows, samples });
  const picture = part("picture");
  if (picture.width !== columns || picture.height !== rows) Object.assign(picture, { width: columns, height: rows });
  const pixels = flight.draw(state.behind / flight.control_secs, look);
  picture.getContext("2d").putImageData(new ImageData(pixels, columns, rows), 0, 0);
  const drones = state.free ? 1 : flight.drones;
  const trails = Array.from({ length: drones }, (_, drone) => (state.free ? flight.trail() : flight.trail(drone)));
  drawOverlay(part("overlay"), columns, { trails, shadow: state.free ? flight.shadow() : null });
}

function report() {
  const { flight } = state;
  const [x, y, z, speed, tilt, distance, ...rotors] = flight.telemetry();
  drawRotors(part("rotors"), rotors);
  drawNetwork(part("network"), [...state.policy.widths], flight.activations());
  const place = [x, y, z].map((value) => value.toFixed(2)).join(", ");
  part("numbers").textContent = `at ${place} m, ${speed.toFixed(2)} m/s, tilted by ${((tilt * 180) / Math.PI).toFixed(0)}°, ${distance.toFixed(2)} m to the goal`;
  part("rate").textContent = `${(1000 / state.pictureMs).toFixed(0)} pictures/s, ${state.drawMs.toFixed(1)} ms each, ${QUALITIES[state.quality].slice(0, 2).join(" × ")}`;
  showImage();
  const ending = state.free ? null : flight.ending;
  const banner = part("banner");
  banner.hidden = !ending;
  if (ending) {
    banner.textContent = ending;
    banner.className = ending.startsWith("success") ? "good" : "bad";
  }
}

/** What the drone's camera sees, where it has one. */
function showImage() {
  const eye = part("eye");
  const shape = state.free ? [] : state.flight.image_shape;
  eye.hidden = shape.length === 0;
  if (eye.hidden) return;
  const [columns, rows, channels] = shape;
  const image = state.flight.image();
  const pixels = new Uint8ClampedArray(4 * columns * rows).fill(255);
  for (let pixel = 0; pixel < columns * rows; pixel += 1) {
    for (let channel = 0; channel < 3; channel += 1) {
      pixels[4 * pixel + channel] = image[channels * pixel + (channels >= 3 ? channel : 0)];
    }
  }
  Object.assign(eye, { width: columns, height: rows });
  eye.getContext("2d").putImageData(new ImageData(pixels, columns, rows), 0, 0);
}

let then = performance.now();

function show(now) {
  requestAnimationFrame(show);
  const passed = now - then;
  then = now;
  if (!state.flight) return;
  try {
    const begun = performance.now();
    if (!state.paused) advance(passed / 1000);
    draw();
    const spent = performance.now() - begun;
    state.drawMs += 0.05 * (spent - state.drawMs);
    if (passed < 1000) state.pictureMs += 0.05 * (passed - state.pictureMs);
    state.pictures += 1;
    if (state.pictures % 6 === 0) report();
    if (state.pictures % 45 === 0) adapt();
  } catch (error) {
    state.flight = null; // a panic of the simulator leaves nothing to go on with
    say(`The simulator stopped: ${error.message ?? error}. Load the page again.`);
  }
}

/** Chooses the size of the picture by the time that it takes. */
function adapt() {
  if (state.drawMs > SLOW_MS && state.quality > 0) {
    state.quality -= 1;
    state.drawMs = (SLOW_MS + FAST_MS) / 2;
  } else if (state.drawMs < FAST_MS && state.quality < QUALITIES.length - 1) {
    state.quality += 1;
    state.drawMs = (SLOW_MS + FAST_MS) / 2;
  }
}

// ---- mouse and keys

/** What the pointer holds: `goal`, `furniture`, `camera` or nothing. */
let held = null;
let last = [0, 0];

function pixel(event) {
  const box = part("overlay").getBoundingClientRect();
  const [columns, rows] = QUALITIES[state.quality];
  return [((event.clientX - box.left) / box.width) * columns, ((event.clientY - box.top) / box.height) * rows];
}

function press(event) {
  if (!state.flight) return;
  part("overlay").setPointerCapture(event.pointerId);
  part("overlay").focus();
  last = [event.clientX, event.clientY];
  const at = pixel(event);
  if (!state.free || event.button !== 0 || event.ctrlKey) {
    held = "camera";
    return;
  }
  const found = state.flight.grab(Math.max(0, Math.floor(at[0])), Math.max(0, Math.floor(at[1])));
  if (found === "drone") {
    state.flight.push(...at);
    return;
  }
  held = found === "furniture" ? "furniture" : "goal";
  if (held === "goal") state.flight.point_at(...at);
}

function move(event) {
  if (!held || !state.flight) return;
  const [right, down] = [event.clientX - last[0], event.clientY - last[1]];
  last = [event.clientX, event.clientY];
  if (held === "camera") {
    state.look.heading -= 0.008 * right;
    state.look.elevation = Math.min(1.5, Math.max(-0.3, state.look.elevation + 0.008 * down));
  } else if (held === "furniture") {
    state.flight.drag(...pixel(event));
  } else {
    state.flight.point_at(...pixel(event));
  }
}

function release() {
  if (held === "furniture") state.flight?.release();
  held = null;
}

function zoom(event) {
  event.preventDefault();
  const notches = Math.sign(event.deltaY || event.deltaX);
  if (event.shiftKey && state.free) state.flight?.raise(-0.1 * notches);
  else state.look.zoom = Math.min(30, Math.max(0.6, state.look.zoom * 1.12 ** notches));
}

const KEYS = {
  w: () => state.free && state.flight.raise(0.1),
  s: () => state.free && state.flight.raise(-0.1),
  r: restart,
  n: () => !state.free && restart(),
  " ": () => part("pause").click(),
};

function key(event) {
  const action = KEYS[event.key.toLowerCase()];
  if (action && state.flight && !(event.target instanceof HTMLInputElement) && !(event.target instanceof HTMLButtonElement)) {
    event.preventDefault();
    action();
  }
}

// ---- training

let worker = null;
let points = [];

async function train() {
  if (worker?.busy) {
    worker.postMessage({ stop: true });
    return;
  }
  worker ??= new Worker("trainer.js", { type: "module" });
  worker.busy = true;
  worker.onmessage = heard;
  worker.onerror = (event) => heard({ data: { error: event.message } });
  points = [];
  part("train").textContent = "Stop";
  part("products").hidden = true;
  part("trained").textContent = "";
  for (const id of ["progress", "curve"]) part(id).hidden = false;
  const seed = Math.min(4294967295, Math.max(0, Math.trunc(Number(part("seed").value)) || 0));
  state.lesson = { name: part("lesson").value, seed };
  worker.postMessage({ begin: { task: await task(state.lesson.name), seed } });
}

function heard({ data }) {
  if (data.progress) {
    const { steps, total, success, secs } = data.progress;
    part("progress").value = steps / total;
    if (!Number.isNaN(success)) points.push({ steps, success });
    drawCurve(part("curve"), points, total);
    const left = (secs * (total - steps)) / steps;
    part("trained").textContent = `${(steps / 1e6).toFixed(2)} M steps, ${((steps / secs) / 1e3).toFixed(0)} k/s, ${left.toFixed(0)} s left`;
    return;
  }
  worker.busy = false;
  part("train").textContent = "Train";
  if (data.error) {
    part("trained").textContent = data.error;
    return;
  }
  state.trained = data.finished;
  const { success, secs, policy: bytes } = data.finished;
  part("trained").textContent = `${(100 * success).toFixed(1)} % of the starts that judge the task, after ${secs.toFixed(1)} s; ${bytes.length} bytes`;
  part("products").hidden = false;
}

/** Puts a policy of the user's on the list, and flies it. */
function offer(name, bytes, of) {
  const flown = { policy: new WebPolicy(bytes), task: of };
  if (!flown.policy.is_free) throw new Error("it sees what only its task has; such policies fly by name only");
  state.policies.set(name, flown);
  const group = part("pilot").querySelector("optgroup");
  const value = `free|${name}`;
  if (![...group.children].some((option) => option.value === value)) group.append(new Option(name, value));
  part("pilot").value = value;
  return begin();
}

function flyTrained() {
  const { name, seed } = state.lesson;
  offer(`${name}, trained with seed ${seed}`, state.trained.policy.slice(), name).catch(say);
}

function save(name, bytes) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([bytes], { type: "application/octet-stream" }));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

async function open(event) {
  const [file] = event.target.files;
  event.target.value = "";
  if (!file) return;
  try {
    await offer(file.name, new Uint8Array(await file.arrayBuffer()), "hover");
  } catch (error) {
    say(`${file.name}: ${error.message ?? error}`);
  }
}

// ---- beginning

function list(select, groups) {
  for (const [label, kind, entries] of groups) {
    const group = document.createElement("optgroup");
    group.label = label;
    for (const { name, title } of entries) group.append(new Option(title, kind ? `${kind}|${name}` : name));
    select.append(group);
  }
}

async function start() {
  try {
    const [flights] = await Promise.all([fetched("flights.json", "json"), init(), task("hover"), fetched("pilots/hover.kestrel", "arrayBuffer")]);
    state.flights = flights;
  } catch (error) {
    const old = error instanceof WebAssembly.CompileError;
    say(old ? "This browser has no relaxed SIMD in WebAssembly, which the page needs: try a newer one." : error);
    return;
  }
  document.title = `Kestrel ${version()}: fly and train a Crazyflie in the browser`;
  state.look = new Look(0.6, 0.35, 2);
  list(part("pilot"), [
    ["flies where you point", "free", state.flights.free],
    ["flies its task", "task", state.flights.tasks],
  ]);
  list(part("world"), [["worlds", "", state.flights.worlds]]);
  list(part("lesson"), [["hover", "", state.flights.free]]);
  for (const id of ["pilot", "world", "flyer"]) part(id).addEventListener("change", begin);
  for (const id of ["wind", "wind-from", "mass"]) part(id).addEventListener("input", setWorld);
  part("reset").addEventListener("click", restart);
  part("pause").addEventListener("click", () => {
    state.paused = !state.paused;
    part("pause").textContent = state.paused ? "Go on" : "Pause";
  });
  part("open").addEventListener("change", open);
  part("train").addEventListener("click", train);
  part("fly-trained").addEventListener("click", flyTrained);
  part("save-policy").addEventListener("click", () => save("policy.kestrel", state.trained.policy));
  part("save-app").addEventListener("click", () => save("crazyflie.zip", crazyflie_zip(state.trained.policy)));
  const overlay = part("overlay");
  overlay.addEventListener("pointerdown", press);
  overlay.addEventListener("pointermove", move);
  overlay.addEventListener("pointerup", release);
  overlay.addEventListener("pointercancel", release);
  overlay.addEventListener("contextmenu", (event) => event.preventDefault());
  overlay.addEventListener("wheel", zoom, { passive: false });
  document.addEventListener("keydown", key);
  await begin();
  requestAnimationFrame(show);
}

start();
