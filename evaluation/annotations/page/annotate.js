// Marks of people in the images of a recording; every change is saved at once.
import { arrow, fitCanvas, label } from "./js/canvas.js";
import { colourOf, inkOn } from "./js/colours.js";

const $ = (id) => document.getElementById(id);
const canvas = $("image"), HIDDEN = ["no", "partly", "mostly"];
const FACING = { w: 0, s: 180, a: 90, d: -90 }; // away, to the camera, left, right [deg]
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const ARROW_PX = 42;
let about = null, at = 0, chosen = null, bitmap = null;
let marks = [], base = null, distances = []; // people of this image, as stored before, distances
let last = new Map(); // newest mark of each person
let work = Promise.resolve(); // requests, one after the other

const frame = () => about.frames[at];
const own = () => marks.find(({ person }) => person === chosen);
const clamp = (value, end) => Math.max(0, Math.min(end - 1, value));

function show(text, kind) {
  $("saved").textContent = text;
  $("saved").className = `badge ${kind}`;
}

function queue(task) {
  work = work.then(task).catch(() => show("no connection to people4d annotate", "bad"));
  return work;
}

async function take(answer) {
  const { people, distances_m: metres } = await answer.json();
  [base, distances] = [people, metres];
}

function remember() {
  for (const mark of marks) {
    last.set(mark.person, mark);
    if (!about.people.includes(mark.person)) about.people.push(mark.person);
  }
}

async function load(index) {
  at = clamp(index, about.frames.length);
  const [answer, image] = await Promise.all([fetch(`frames/${frame()}`), fetch(`frames/${frame()}/image`)]);
  if (!answer.ok) return show((await answer.text()).trim(), "bad");
  bitmap?.close();
  bitmap = await createImageBitmap(await image.blob());
  await take(answer);
  marks = base ?? [];
  remember();
  $("problem").textContent = "";
  if (!own()) chosen = marks[0]?.person ?? null;
  show(base === null ? "not annotated" : "saved", base === null ? "" : "good");
  draw();
}

// Save the marks; of a change by another page, show that page's marks.
async function store() {
  show("saving", "");
  const asked = marks;
  const body = JSON.stringify({ base, people: asked });
  const answer = await fetch(`frames/${frame()}`, { method: "PUT", body });
  if (!answer.ok) {
    const problem = (await answer.text()).trim();
    await take(await fetch(`frames/${frame()}`));
    marks = base ?? [];
    remember();
    $("problem").textContent = problem;
    show("not saved", "bad");
  } else {
    await take(answer);
    if (!about.annotated.includes(frame())) about.annotated.push(frame());
    const bare = asked.filter((_, k) => distances[k] === null).map(({ person }) => person);
    $("problem").textContent = bare.length ? `No depth at the point of ${bare.join(", ")}: move it to another point of the torso.` : "";
    show("saved", "good");
  }
  draw();
}
function save() {
  show("saving", "");
  queue(store);
}

function change(person, values) {
  const old = marks.find((mark) => mark.person === person);
  const mark = { person, yaw_deg: null, ...old, ...values };
  marks = old ? marks.map((one) => (one === old ? mark : one)) : [...marks, mark];
  if (mark.hidden === "no") delete mark.hidden;
  chosen = person;
  remember();
  draw();
  save();
}

function choose(person) {
  chosen = person;
  if (own()) return draw();
  const { u_px = about.width / 2, v_px = about.height / 2, yaw_deg = null } = last.get(person) ?? {};
  change(person, { u_px, v_px, yaw_deg });
}

const go = (step) => queue(async () => {
  if (step > 0 && base === null && !marks.length) await store(); // seen: nobody is visible
  await load(at + step);
});

function copy() {
  queue(async () => {
    if (at === 0) return;
    const { people } = await (await fetch(`frames/${about.frames[at - 1]}`)).json();
    const absent = (people ?? []).filter(({ person }) => !marks.some((mark) => mark.person === person));
    marks = [...marks, ...absent];
    await store();
  });
}

const turned = (degrees) => ((degrees + 540) % 360) - 180 || 0;

function draw() {
  const { width: w, height: h } = about;
  const { context, width } = fitCanvas(canvas, canvas.clientWidth * h / w);
  canvas.style.height = `${canvas.clientWidth * h / w}px`;
  const scale = width / w, taken = [];
  if (bitmap) context.drawImage(bitmap, 0, 0, width, h * scale);
  for (const mark of marks) drawMark(context, mark, scale);
  for (const { person, u_px: u, v_px: v } of marks) {
    const colour = colourOf(about.people.indexOf(person) + 1);
    label(context, person, Math.min(u * scale + 8, width - 30), v * scale - 8, colour, inkOn(colour), taken);
  }
  drawPeople();
  const mark = own();
  for (const id of ["hidden", "certain", "facing", "delete"]) $(id).disabled = !mark;
  $("hidden").value = mark?.hidden ?? "no";
  $("certain").checked = mark ? mark.yaw_deg !== null : false;
  $("facing").value = mark?.yaw_deg ?? 0;
  $("degrees").textContent = !mark || mark.yaw_deg === null ? "–" : `${mark.yaw_deg}°`;
  $("mark-title").textContent = mark ? `Mark of ${mark.person}` : "Mark";
  $("time").max = about.frames.length - 1;
  $("time").value = at;
  $("progress").textContent = `image ${frame()}: ${at + 1} of ${about.frames.length}, ${about.annotated.length} annotated`;
  canvas.dataset.frame = frame();
}

function drawMark(context, { person, u_px, v_px, yaw_deg: yaw }, scale) {
  const colour = colourOf(about.people.indexOf(person) + 1), [x, y] = [u_px * scale, v_px * scale];
  if (yaw !== null) { // as from above: away from the camera is up
    const rad = (yaw * Math.PI) / 180;
    arrow(context, x, y, x - ARROW_PX * Math.sin(rad), y - ARROW_PX * Math.cos(rad), colour, 3);
  }
  for (const [stroke, line] of [["#ffffff", 5], [colour, 3]]) {
    context.strokeStyle = stroke;
    context.lineWidth = line;
    context.beginPath();
    context.arc(x, y, person === chosen ? 9 : 5, 0, 7);
    context.stroke();
  }
}

function drawPeople() {
  $("people").replaceChildren(...about.people.map((person, k) => {
    const item = document.createElement("li"), button = document.createElement("button");
    const dot = document.createElement("span"), note = document.createElement("span");
    const index = marks.findIndex((mark) => mark.person === person), mark = marks[index];
    const far = distances[index], here = base?.[index]?.person === person;
    dot.className = "dot";
    dot.style.background = colourOf(k + 1);
    note.className = "small";
    note.textContent = !mark ? "absent" : [here && typeof far === "number" ? `${far.toFixed(2)} m` : "no depth", mark.hidden ?? ""].filter(Boolean).join(", ");
    button.type = "button";
    button.className = `person ${mark ? "" : "absent"}`;
    button.setAttribute("aria-pressed", person === chosen);
    button.append(dot, `${k < 9 ? k + 1 : ""} ${person}`, note);
    button.addEventListener("click", () => choose(person));
    item.append(button);
    return item;
  }));
}

canvas.addEventListener("click", (event) => {
  const scale = about.width / canvas.clientWidth;
  if (chosen === null) { $("problem").textContent = "Choose a person first, or add one."; return; }
  change(chosen, { u_px: Math.round(clamp(event.offsetX * scale, about.width)), v_px: Math.round(clamp(event.offsetY * scale, about.height)) });
});

$("new").addEventListener("submit", (event) => {
  event.preventDefault();
  const name = $("name").value.trim();
  if (!name) return;
  if (!about.people.includes(name)) about.people.push(name);
  $("name").value = "";
  $("name").blur();
  choose(name);
});
$("back").addEventListener("click", () => go(-1));
$("next").addEventListener("click", () => go(1));
$("time").addEventListener("change", () => queue(() => load(Number($("time").value))));
$("hidden").addEventListener("change", () => change(chosen, { hidden: $("hidden").value }));
$("facing").addEventListener("input", () => change(chosen, { yaw_deg: Number($("facing").value) }));
$("certain").addEventListener("change", () => change(chosen, { yaw_deg: $("certain").checked ? Number($("facing").value) : null }));
$("delete").addEventListener("click", () => remove());

function remove() {
  marks = marks.filter(({ person }) => person !== chosen);
  draw();
  save();
}

function press(key, shift) {
  const mark = own();
  if (key === "." || key === "Enter") go(1);
  else if (key === ",") go(-1);
  else if (key === "n") $("name").focus();
  else if (key === "c") copy();
  else if (about.people[Number(key) - 1]) choose(about.people[Number(key) - 1]);
  else if (!mark) return false;
  else if (key in STEPS) {
    const [du, dv] = STEPS[key].map((value) => value * (shift ? 10 : 1));
    change(chosen, { u_px: clamp(mark.u_px + du, about.width), v_px: clamp(mark.v_px + dv, about.height) });
  } else if (key in FACING) change(chosen, { yaw_deg: FACING[key] });
  else if (key === "q" || key === "e") change(chosen, { yaw_deg: turned((mark.yaw_deg ?? 0) + (key === "q" ? 15 : -15)) });
  else if (key === "f") change(chosen, { yaw_deg: null });
  else if (key === "h") change(chosen, { hidden: HIDDEN[(HIDDEN.indexOf(mark.hidden ?? "no") + 1) % 3] });
  else if (key === "Delete" || key === "Backspace") remove();
  else return false;
  return true;
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !about) return;
  if (event.target.matches("input:not([type='checkbox']), select")) return;
  if (event.target.matches("button, [type='checkbox']") && [" ", "Enter"].includes(event.key)) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (press(key, event.shiftKey)) event.preventDefault();
});
// A clicked button loses the focus, since Enter would press it; the keyboard keeps the focus.
document.addEventListener("click", (event) => { if (event.detail) event.target.closest?.("button, [type='checkbox'], [type='range']")?.blur(); });
document.addEventListener("change", (event) => event.target.matches("select, [type='range']") && event.target.blur());
addEventListener("resize", () => about && draw());

queue(async () => {
  about = await (await fetch("frames")).json();
  $("recording").textContent = about.recording;
  document.title = `annotate ${about.recording}`;
  if (about.unreadable) $("unreadable").textContent = `${about.unreadable} images cannot be read and are left out.`;
  const open = about.frames.findIndex((one) => !about.annotated.includes(one));
  const begin = open < 0 ? about.frames.length - 1 : open;
  if (begin > 0) { // for the last points of the people
    const { people } = await (await fetch(`frames/${about.frames[begin - 1]}`)).json();
    for (const mark of people ?? []) last.set(mark.person, mark);
  }
  await load(begin);
});
