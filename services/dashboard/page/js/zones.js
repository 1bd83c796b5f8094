// Zones: drawn on the map by mouse, touch or keyboard, saved by the service.
import { drawing, requestDraw, toScreen } from "./map.js";
import { emit, on, store } from "./store.js";

const $ = (id) => document.getElementById(id);
const form = $("zone-form"), hint = $("map-hint"), problem = $("zone-problem"), button = $("draw"), canvas = $("map-canvas");
const CLOSE_PX = 14;
let waiting = false;

function begin() {
  Object.assign(drawing, { active: true, corners: [], cursor: null });
  button.setAttribute("aria-pressed", "true");
  button.textContent = "Finish";
  canvas.classList.add("drawing");
  form.hidden = true;
  problem.textContent = "";
  showHint();
  requestDraw();
}

function end() {
  drawing.active = false;
  button.setAttribute("aria-pressed", "false");
  button.textContent = "Draw a zone";
  canvas.classList.remove("drawing");
  hint.hidden = true;
  requestDraw();
}

function showHint() {
  hint.hidden = false;
  hint.textContent = drawing.corners.length < 3
    ? `Corner ${drawing.corners.length + 1}: tap the map, or arrow keys and Space. Esc stops.`
    : "Tap the first corner, press Enter or Finish to close the zone.";
}

function corner(point) {
  const [first] = drawing.corners;
  if (first && drawing.corners.length > 2) {
    const [[u, v], [p, q]] = [toScreen(first), toScreen(point)];
    if (Math.hypot(u - p, v - q) < CLOSE_PX) { finish(); return; }
  }
  drawing.corners.push(point.map((value) => Math.round(value * 100) / 100));
  showHint();
  requestDraw();
}

function finish() {
  if (drawing.corners.length < 3) { problem.textContent = "A zone needs three corners."; return; }
  end();
  form.hidden = false;
  $("zone-name").value = `zone ${store.zones.length + 1}`;
  $("zone-name").select();
  $("zone-name").focus();
}

async function save(zones) {
  problem.textContent = "";
  const answer = await fetch("zones", {
    method: "PUT", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ base: store.zonesBase, zones }),
  }).catch(() => null);
  if (!answer?.ok) problem.textContent = answer ? (await answer.text()).trim() : "The service does not answer.";
  else {
    waiting = true;
    setTimeout(() => { if (waiting) problem.textContent = "Nothing took the zones: does the service events run?"; }, 4000);
  }
  return answer?.ok;
}

const number = (id) => ($(id).value === "" ? null : Number($(id).value));
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const zone = { name: $("zone-name").value.trim(), corners_m: drawing.corners, dwell_s: number("zone-dwell"), count: number("zone-count") };
  if (await save([...store.zones, zone])) { form.hidden = true; form.reset(); canvas.focus(); }
});
$("zone-cancel").addEventListener("click", () => { form.hidden = true; form.reset(); problem.textContent = ""; });
button.addEventListener("click", () => {
  if (drawing.active) drawing.corners.length ? finish() : end();
  else { begin(); canvas.focus(); }
});
on("corner", corner);
on("finish", finish);
on("abandon", end);

on("message:zones", ({ zones, base, problem: refused }) => {
  waiting = false;
  Object.assign(store, { zones, zonesBase: base });
  problem.textContent = refused;
  const list = $("zone-list");
  list.replaceChildren(...zones.map((zone) => {
    const item = document.createElement("li"), remove = document.createElement("button");
    const about = [zone.dwell_s && `longer than ${zone.dwell_s} s`, zone.count && `${zone.count} people`].filter(Boolean).join(", ");
    item.textContent = about ? `${zone.name} (${about})` : zone.name;
    remove.type = "button";
    remove.textContent = "✕";
    remove.setAttribute("aria-label", `Delete zone ${zone.name}`);
    remove.addEventListener("click", () => save(store.zones.filter((one) => one.name !== zone.name)));
    item.append(remove);
    return item;
  }));
  emit("zones");
});
