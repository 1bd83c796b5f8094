// The image of every camera, with boxes, skeletons, identities, distances and headings.
import { arrow, fitCanvas, label } from "./canvas.js";
import { colourOf, css, inkOn } from "./colours.js";
import { on, select, store } from "./store.js";

const LIMBS = [[0, 1], [0, 2], [1, 3], [2, 4], [5, 6], [5, 7], [7, 9], [6, 8], [8, 10], [5, 11], [6, 12], [11, 12], [11, 13], [13, 15], [12, 14], [14, 16]];
const SCORE_MIN = 0.3;
const SCENES_MAX = 32; // maximum number of scenes that wait for their image
const IMAGE_MS = 1000; // maximum age of the image under newer boxes
const views = new Map();
const holder = document.getElementById("images");

function viewOf(camera) {
  if (!views.has(camera)) {
    holder.querySelector(".empty")?.remove();
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Camera ${camera}`); // until the first image tells the number of people
    figure.append(canvas, caption);
    holder.append(figure);
    const view = { canvas, caption, scene: null, bitmap: null, shown: 0, scenes: new Map(), next: null, decodes: false, labelled: -Infinity };
    canvas.addEventListener("click", (event) => pick(view, event));
    views.set(camera, view);
  }
  return views.get(camera);
}

// Images are decoded one by one, always the newest, so that a slow page skips images.
export async function takeImage(message) {
  const view = viewOf(message.camera);
  view.next = message;
  if (view.decodes) return;
  view.decodes = true;
  while (view.next) {
    const { jpeg, frame } = view.next;
    view.next = null;
    const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null);
    const scene = view.scenes.get(frame);
    if (bitmap && scene) show(view, scene, bitmap);
    else bitmap?.close();
  }
  view.decodes = false;
}

// Draw an image with the boxes of its own frame.
function show(view, scene, bitmap) {
  view.bitmap?.close();
  Object.assign(view, { scene, bitmap, shown: performance.now() });
  view.canvas.dataset.frame = scene.frame;
  draw(view);
}

function pick(view, event) {
  const { boxes = [] } = view.scene ?? {};
  const x = event.offsetX / view.scale, y = event.offsetY / view.scale;
  const inside = boxes.filter(({ id, box_px: [l, t, r, b] }) => id !== null && x >= l && x <= r && y >= t && y <= b);
  inside.sort((p, q) => (p.box_px[2] - p.box_px[0]) - (q.box_px[2] - q.box_px[0]));
  if (inside.length) select(inside[0].id);
}

function draw(view) {
  const { scene, canvas } = view;
  if (!scene) return;
  const { width: imageWidth, height: imageHeight } = scene.cameras[scene.camera] ?? { width: view.bitmap?.width ?? 4, height: view.bitmap?.height ?? 3 };
  const height = canvas.clientWidth * imageHeight / imageWidth;
  const { context, width } = fitCanvas(canvas, height);
  canvas.style.height = `${height}px`;
  view.scale = width / imageWidth;
  const labels = [], taken = []; // labels are drawn last, above all lines
  context.clearRect(0, 0, width, height);
  if (view.bitmap) context.drawImage(view.bitmap, 0, 0, width, height);
  else {
    context.fillStyle = css("quiet");
    context.font = "14px system-ui, sans-serif";
    context.fillText(store.privacy ? "Images stay on the robot (privacy)." : store.images ? "No image." : "This token shows no images.", 12, 24);
  }
  const people = new Map((scene.people ?? []).map((person) => [person.id, person]));
  for (const box of scene.boxes) drawBox(context, view, box, people.get(box.id), labels);
  for (const person of people.values()) drawPerson(context, view, person, labels);
  for (const [text, x, y, colour] of labels) label(context, text, x, y, colour, inkOn(colour), taken);
  view.caption.textContent = scene.camera;
  const now = performance.now();
  if (now - view.labelled > 2000) {
    view.labelled = now;
    canvas.setAttribute("aria-label", `Camera ${scene.camera}: ${scene.boxes.length} people`);
  }
}

function drawBox(context, view, box, person, labels) {
  const s = view.scale, colour = colourOf(box.id), chosen = box.id !== null && box.id === store.selected;
  const [left, top, right, bottom] = box.box_px.map((value) => value * s);
  context.lineWidth = chosen ? 4 : 2;
  context.strokeStyle = chosen ? "#ffffff" : colour;
  if (chosen) context.strokeRect(left - 2, top - 2, right - left + 4, bottom - top + 4);
  context.strokeStyle = colour;
  context.strokeRect(left, top, right - left, bottom - top);
  if (box.keypoints) drawSkeleton(context, box.keypoints, s, colour);
  const texts = person ? [`#${box.id}`] : [box.score.toFixed(2)];
  if (person?.distance_m !== null && person) texts.push(`${person.distance_m.toFixed(2)} m`);
  if (person) texts.push(`${Math.hypot(...person.velocity_mps).toFixed(1)} m/s`);
  if (person && store.postures[person.id]) texts.push(store.postures[person.id]);
  labels.push([texts.join("  "), Math.max(0, left - 1), Math.max(19, top), colour]);
}

function drawSkeleton(context, keypoints, scale, colour) {
  const point = (k) => [keypoints[3 * k] * scale, keypoints[3 * k + 1] * scale];
  const good = (k) => keypoints[3 * k + 2] >= SCORE_MIN;
  context.strokeStyle = colour;
  context.lineWidth = 2.5;
  context.lineCap = "round";
  context.beginPath();
  for (const [a, b] of LIMBS) {
    if (good(a) && good(b)) { context.moveTo(...point(a)); context.lineTo(...point(b)); }
  }
  context.stroke();
  context.fillStyle = "#ffffff";
  for (let k = 0; k < 17; k++) {
    if (!good(k) || (k > 0 && k < 5)) continue;
    context.beginPath();
    context.arc(...point(k), 2.5, 0, 7);
    context.fill();
  }
}

function drawPerson(context, view, person, labels) {
  const ends = view.scene.arrows[person.id], colour = colourOf(person.id);
  if (!ends) return;
  const [u, v, tipU, tipV] = ends.map((value) => value * view.scale);
  if (person.yaw_rad !== null) arrow(context, u, v, tipU, tipV, colour, 3);
  if (person.detection === null) {
    context.setLineDash([4, 3]);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.beginPath();
    context.arc(u, v, 12, 0, 7);
    context.stroke();
    context.setLineDash([]);
    labels.push([`#${person.id} ${person.state}`, u + 8, v - 8, colour]);
  }
}

on("scene", (scene) => {
  const view = viewOf(scene.camera);
  view.scenes.delete(scene.frame);
  view.scenes.set(scene.frame, scene);
  if (view.scenes.size > SCENES_MAX) view.scenes.delete(view.scenes.keys().next().value);
  const waits = scene.has_image || (!store.paused && performance.now() - view.shown < IMAGE_MS);
  if (!store.images || store.privacy || !view.bitmap || !waits) show(view, scene, null);
});
const redraw = () => views.forEach(draw);
on("selected", redraw);
on("theme", redraw);
addEventListener("resize", redraw);
