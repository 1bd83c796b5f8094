// Top view (x up, y left).
import { arrow, fitCanvas, label } from "./canvas.js";
import { colourOf, css, inkOn } from "./colours.js";
import { emit, on, select, store, trajectoryOf } from "./store.js";

const canvas = document.getElementById("map-canvas");
const view = { x: 2, y: 0, scale: 60, width: 1, height: 1, moved: false, refits: false };
export const drawing = { active: false, corners: [], cursor: null };

export const toScreen = ([x, y]) => [view.width / 2 - (y - view.y) * view.scale, view.height / 2 - (x - view.x) * view.scale];
export const toMetres = (u, v) => [view.x - (v - view.height / 2) / view.scale, view.y - (u - view.width / 2) / view.scale];

export function fit() {
  Object.assign(view, { moved: false, fitted: false, refits: true });
  requestDraw();
}

function autoFit() {
  if (!view.refits || view.moved || drawing.active) return;
  view.refits = false;
  const points = store.people.map((person) => person.position_m);
  for (const camera of Object.values(store.cameras)) points.push(...(camera.field_m ?? []));
  for (const zone of store.zones) points.push(...zone.corners_m);
  if (store.robot) points.push(store.robot);
  const good = points.filter(([x, y]) => Math.abs(x) < 200 && Math.abs(y) < 200);
  if (!good.length) return;
  const low = [0, 1].map((k) => Math.min(...good.map((p) => p[k])) - 0.6);
  const high = [0, 1].map((k) => Math.max(...good.map((p) => p[k])) + 0.6);
  const scale = Math.min(view.height / (high[0] - low[0]), view.width / (high[1] - low[1]), 160);
  // Smooth zoom and shift while people walk.
  const settled = view.fitted ? 0.12 : 1;
  view.fitted = true;
  view.x += settled * ((low[0] + high[0]) / 2 - view.x);
  view.y += settled * ((low[1] + high[1]) / 2 - view.y);
  view.scale += settled * (scale - view.scale);
}

let waiting = false;
export function requestDraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; draw(); });
}

function draw() {
  const { context, width, height } = fitCanvas(canvas);
  Object.assign(view, { width, height });
  autoFit();
  context.clearRect(0, 0, width, height);
  drawGrid(context);
  for (const [name, camera] of Object.entries(store.cameras)) drawField(context, name, camera);
  for (const zone of store.zones) drawZone(context, zone);
  for (const prediction of store.predictions) drawPrediction(context, prediction);
  for (const person of store.people) drawTrajectory(context, person);
  if (store.robot) drawRobot(context, store.robot);
  for (const person of store.people) drawPerson(context, person);
  drawLabels(context);
  if (drawing.active) drawSketch(context);
}

function path(context, points, close = false) {
  context.beginPath();
  points.forEach((point, k) => context[k ? "lineTo" : "moveTo"](...toScreen(point)));
  if (close) context.closePath();
}

function drawGrid(context) {
  const step = [0.5, 1, 2, 5, 10, 20, 50].find((metres) => metres * view.scale > 44) ?? 100;
  const [x1, y1] = toMetres(0, 0), [x0, y0] = toMetres(view.width, view.height);
  context.lineWidth = 1;
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "alphabetic";
  for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) {
    context.strokeStyle = css("faint");
    path(context, [[x, y0], [x, y1]]);
    context.stroke();
    context.fillStyle = css("quiet");
    context.fillText(`${+x.toFixed(1)} m`, 4, toScreen([x, 0])[1] - 3);
  }
  for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) {
    context.strokeStyle = css("faint");
    path(context, [[x0, y], [x1, y]]);
    context.stroke();
    context.fillStyle = css("quiet");
    const text = `${+y.toFixed(1)} m`, left = toScreen([0, y])[0] + 3;
    if (left + context.measureText(text).width < view.width) context.fillText(text, left, view.height - 5);
  }
}

function drawField(context, name, { field_m: field }) {
  if (!field) return;
  context.fillStyle = "rgb(120 150 190 / 14%)";
  context.strokeStyle = "rgb(120 150 190 / 55%)";
  context.lineWidth = 1;
  const [u, v] = toScreen(field[0]), [a, b] = [field[1], field[2]].map(toScreen);
  const angles = [Math.atan2(a[1] - v, a[0] - u), Math.atan2(b[1] - v, b[0] - u)];
  const radius = Math.hypot(a[0] - u, a[1] - v);
  context.beginPath();
  context.moveTo(u, v);
  context.arc(u, v, radius, angles[0], angles[1]);
  context.closePath();
  context.fill();
  context.stroke();
  context.fillStyle = css("quiet");
  context.font = "11px system-ui, sans-serif";
  context.fillText(name, u + 8, v + 14);
}

function drawZone(context, zone) {
  context.fillStyle = "rgb(138 111 209 / 16%)";
  context.strokeStyle = "#8a6fd1";
  context.lineWidth = 2;
  path(context, zone.corners_m, true);
  context.fill();
  context.stroke();
  const [u, v] = toScreen(zone.corners_m.reduce(([x, y], [p, q]) => [x + p / zone.corners_m.length, y + q / zone.corners_m.length], [0, 0]));
  const inside = store.people.filter(({ position_m: [x, y] }) => contains(zone.corners_m, x, y)).length;
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillStyle = css("ink");
  context.fillText(`${zone.name}: ${inside}`, u, v);
  context.textAlign = "left";
}

function contains(corners, x, y) {
  let inside = false;
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    const [[xi, yi], [xj, yj]] = [corners[i], corners[j]];
    if ((yi > y) !== (yj > y) && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) inside = !inside;
  }
  return inside;
}

function drawPrediction(context, { id, path_m: points, sigma_m: sigmas }) {
  const colour = colourOf(id);
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.setLineDash([5, 4]);
  path(context, points);
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 1;
  context.globalAlpha = 0.35;
  points.forEach((point, k) => {
    if (k % 2) return;
    context.beginPath();
    context.arc(...toScreen(point), Math.min(sigmas[k] * view.scale, 400), 0, 7);
    context.stroke();
  });
  context.globalAlpha = 1;
}

function drawTrajectory(context, { id }) {
  const trajectory = trajectoryOf(id);
  if (trajectory.length < 2) return;
  context.strokeStyle = colourOf(id);
  context.lineWidth = 2;
  context.lineJoin = "round";
  context.globalAlpha = 0.6;
  path(context, trajectory.map(([, x, y]) => [x, y]));
  context.stroke();
  context.globalAlpha = 1;
}

function drawRobot(context, [x, y, yaw]) {
  const corners = [[0.3, 0], [-0.2, 0.2], [-0.1, 0], [-0.2, -0.2]];
  path(context, corners.map(([a, b]) => [x + a * Math.cos(yaw) - b * Math.sin(yaw), y + a * Math.sin(yaw) + b * Math.cos(yaw)]), true);
  context.fillStyle = css("ink");
  context.fill();
}

function drawPerson(context, person) {
  const colour = colourOf(person.id), [u, v] = toScreen(person.position_m), [xx, xy, yy] = person.covariance_m2;
  const lost = person.state === "lost", chosen = person.id === store.selected;
  // Ellipse of two standard deviations.
  const mean = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy);
  const turn = Math.atan2(2 * xy, xx - yy) / 2;
  const axes = [mean + apart, mean - apart].map((value) => Math.min(2 * Math.sqrt(Math.max(value, 0)) * view.scale, 2000));
  context.beginPath();
  context.ellipse(u, v, axes[0], axes[1], -turn - Math.PI / 2, 0, 7);
  context.globalAlpha = 0.18;
  context.fillStyle = colour;
  context.fill();
  context.globalAlpha = 1;
  if (chosen) {
    context.beginPath();
    context.arc(u, v, 16, 0, 7);
    context.strokeStyle = css("ink");
    context.lineWidth = 3;
    context.stroke();
  }
  if (person.yaw_rad !== null) {
    const tip = toScreen([person.position_m[0] + 0.5 * Math.cos(person.yaw_rad), person.position_m[1] + 0.5 * Math.sin(person.yaw_rad)]);
    arrow(context, u, v, ...tip, colour, 3);
  }
  context.beginPath();
  context.arc(u, v, 8, 0, 7);
  context.fillStyle = lost ? css("stage") : colour;
  context.fill();
  context.lineWidth = 2;
  context.setLineDash(lost ? [3, 2] : []);
  context.strokeStyle = lost ? colour : "#ffffff";
  context.stroke();
  context.setLineDash([]);
}

function drawLabels(context) {
  const taken = [];
  for (const { id, position_m: position } of store.people) {
    const [u, v] = toScreen(position), colour = colourOf(id);
    label(context, `#${id}`, u + 11, v - 5, colour, inkOn(colour), taken, 11);
  }
}

function drawSketch(context) {
  context.strokeStyle = context.fillStyle = css("accent");
  context.lineWidth = 2;
  path(context, drawing.cursor ? [...drawing.corners, drawing.cursor] : drawing.corners);
  context.stroke();
  for (const corner of drawing.corners) {
    context.beginPath();
    context.arc(...toScreen(corner), 5, 0, 7);
    context.fill();
  }
  if (drawing.cursor) {
    const [u, v] = toScreen(drawing.cursor);
    context.strokeRect(u - 5, v - 5, 10, 10);
  }
}

// Mouse and touch: drag moves, wheel or two fingers zoom, a tap selects or sets a corner.
const pointers = new Map();
let dragged = 0;
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  dragged = 0;
});
canvas.addEventListener("pointermove", (event) => {
  if (drawing.active && event.pointerType === "mouse") { drawing.cursor = toMetres(event.offsetX, event.offsetY); requestDraw(); }
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const now = [event.offsetX, event.offsetY];
  const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
  if (other) {
    zoom(Math.hypot(now[0] - other[0], now[1] - other[1]) / Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1])), ...other);
    dragged = 99;
  } else {
    dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (dragged > 5) move(now[0] - before[0], now[1] - before[1]);
  }
  pointers.set(event.pointerId, now);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, (event) => {
    const single = pointers.size === 1;
    pointers.delete(event.pointerId);
    if (name === "pointerup" && single && dragged <= 5) tap(event.offsetX, event.offsetY);
  });
}
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY / 500), event.offsetX, event.offsetY);
}, { passive: false });

function move(du, dv) {
  view.moved = true;
  view.x += dv / view.scale;
  view.y += du / view.scale;
  requestDraw();
}

function zoom(factor, u, v) {
  const [x, y] = toMetres(u, v);
  view.moved = true;
  view.scale = Math.min(1000, Math.max(2, view.scale * factor));
  view.x = x + (v - view.height / 2) / view.scale;
  view.y = y + (u - view.width / 2) / view.scale;
  requestDraw();
}

function tap(u, v) {
  if (drawing.active) { emit("corner", toMetres(u, v)); return; }
  const near = store.people.map((person) => [Math.hypot(toScreen(person.position_m)[0] - u, toScreen(person.position_m)[1] - v), person.id]).sort((p, q) => p[0] - q[0])[0];
  if (near && near[0] < 26) select(near[1]);
}

canvas.addEventListener("keydown", (event) => {
  const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [1, 0], ArrowRight: [-1, 0] }[event.key];
  if (drawing.active && (step || event.key === " " || event.key === "Enter" || event.key === "Escape")) {
    drawing.cursor ??= [view.x, view.y];
    if (step) drawing.cursor = [drawing.cursor[0] + 0.1 * step[1], drawing.cursor[1] + 0.1 * step[0]];
    else emit(event.key === " " ? "corner" : event.key === "Enter" ? "finish" : "abandon", drawing.cursor);
  } else if (step) move(40 * step[0], 40 * step[1]);
  else if (event.key === "+" || event.key === "=") zoom(1.2, view.width / 2, view.height / 2);
  else if (event.key === "-") zoom(1 / 1.2, view.width / 2, view.height / 2);
  else return;
  event.preventDefault();
  event.stopPropagation();
  requestDraw();
});

export const screenOf = (id) => {
  const person = store.people.find((one) => one.id === id);
  return person ? toScreen(person.position_m) : null;
};
let labelled = 0;
on("scene", () => {
  view.refits = true; // other draws, such as of a selection, keep the map still
  requestDraw();
  if (performance.now() - labelled > 2000) {
    labelled = performance.now();
    canvas.setAttribute("aria-label", `Map from above: ${store.people.length} people, ${store.zones.length} zones. Arrow keys move it, plus and minus zoom.`);
  }
});
for (const name of ["selected", "theme", "zones", "predictions"]) on(name, requestDraw);
addEventListener("resize", requestDraw);
document.getElementById("fit").addEventListener("click", fit);
