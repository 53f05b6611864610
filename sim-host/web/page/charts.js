// What is drawn beside and over the picture of a flight.

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Makes the memory of a canvas as large as it is shown; its context, in CSS pixels, and its size. */
function fitted(canvas) {
  const scale = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** Trails, the shadow and the goal, over a picture of `columns` pixels. */
export function drawOverlay(canvas, columns, { trails, shadow }) {
  const { context, width } = fitted(canvas);
  const scale = width / columns;
  context.lineWidth = 2;
  context.lineJoin = "round";
  const colours = ["#f07f2e", "#1c8fd6", "#2ea043", "#d63384", "#a67c00", "#0099a8"];
  trails.forEach((trail, drone) => {
    context.strokeStyle = colours[drone % colours.length];
    context.beginPath();
    let visible = false;
    for (let index = 0; index < trail.length; index += 2) {
      const [x, y] = [trail[index] * scale, trail[index + 1] * scale];
      if (Number.isNaN(x)) {
        visible = false;
      } else if (visible) {
        context.lineTo(x, y);
      } else {
        context.moveTo(x, y);
        visible = true;
      }
    }
    context.stroke();
  });
  if (shadow && !Number.isNaN(shadow[0])) {
    context.fillStyle = "#1f293355";
    context.beginPath();
    context.ellipse(shadow[0] * scale, shadow[1] * scale, 9, 4, 0, 0, 2 * Math.PI);
    context.fill();
  }
}

/** Speeds of four rotors, as shares of the greatest. */
export function drawRotors(canvas, rotors) {
  const { context, width } = fitted(canvas);
  const [ink, line, accent] = [style("--ink"), style("--line"), style("--accent")];
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "middle";
  ["front right", "rear right", "rear left", "front left"].forEach((name, index) => {
    const y = 16 * index + 2;
    context.fillStyle = ink;
    context.fillText(name, 0, y + 6);
    const [left, room] = [66, width - 66 - 40];
    context.fillStyle = line;
    context.fillRect(left, y, room, 11);
    context.fillStyle = accent;
    context.fillRect(left, y, room * Math.min(1, Math.max(0, rotors[index])), 11);
    context.fillStyle = ink;
    context.fillText(`${Math.round(100 * rotors[index])} %`, left + room + 6, y + 6);
  });
}

/** Colour of a value in [-1, 1]: blue below zero, orange above. */
function shade(value) {
  const share = Math.min(1, Math.abs(value));
  const end = value < 0 ? [28, 111, 181] : [240, 127, 46];
  return `rgb(${end.map((channel) => Math.round(245 + (channel - 245) * share)).join(" ")})`;
}

/** What each layer of a network reads, and the action: a block of cells each. */
export function drawNetwork(canvas, widths, values) {
  const { context, width } = fitted(canvas);
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "top";
  context.fillStyle = style("--muted");
  if (values.length === 0) {
    context.fillText("This network remembers or looks at images:", 0, 4);
    context.fillText("its activations are not shown.", 0, 20);
    return;
  }
  const names = widths.map((_, layer) => (layer === 0 ? "observation" : layer === widths.length - 1 ? "action" : `hidden layer ${layer}`));
  let [from, y] = [0, 0];
  widths.forEach((count, layer) => {
    const across = Math.min(32, count);
    const [cell, rows] = [Math.min(14, (width - 2) / across), Math.ceil(count / across)];
    context.fillStyle = style("--muted");
    context.fillText(`${names[layer]}, ${count}`, 0, y);
    y += 15;
    for (let index = 0; index < count; index += 1) {
      context.fillStyle = shade(values[from + index]);
      context.fillRect((index % across) * cell, y + Math.floor(index / across) * 11, cell - 1, 10);
    }
    from += count;
    y += rows * 11 + 6;
  });
}

/** Success in tests against steps; points are { steps, success }. */
export function drawCurve(canvas, points, total) {
  const { context, width, height } = fitted(canvas);
  const [left, bottom] = [34, height - 16];
  const [muted, line] = [style("--muted"), style("--line")];
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = muted;
  context.strokeStyle = line;
  context.textBaseline = "middle";
  [0, 0.5, 1].forEach((share) => {
    const y = 8 + (1 - share) * (bottom - 8);
    context.beginPath();
    context.moveTo(left, y);
    context.lineTo(width, y);
    context.stroke();
    context.fillText(`${100 * share} %`, 0, y);
  });
  context.textBaseline = "alphabetic";
  context.fillText("success in tests", left, height - 3);
  context.textAlign = "right";
  context.fillText(`${(total / 1e6).toFixed(1)} M steps`, width, height - 3);
  context.textAlign = "left";
  context.strokeStyle = style("--accent");
  context.lineWidth = 2;
  context.beginPath();
  points.forEach(({ steps, success }, index) => {
    const x = left + (steps / total) * (width - left);
    const y = 8 + (1 - success) * (bottom - 8);
    if (index === 0) context.moveTo(x, y);
    else context.lineTo(x, y);
  });
  context.stroke();
}
