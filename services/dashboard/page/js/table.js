// Table of people, with a button for each.
import { colourOf } from "./colours.js";
import { on, select, store } from "./store.js";

const body = document.querySelector("#table tbody"), empty = document.getElementById("no-people");
const SOURCES = { new: "new", continued: "followed", reidentified: "recognised again" };
const rows = new Map();
let drawn = 0;

function rowOf(id) {
  if (!rows.has(id)) {
    const row = document.createElement("tr"), button = document.createElement("button"), dot = document.createElement("span");
    const cells = Array.from({ length: 7 }, () => document.createElement("td"));
    row.dataset.id = id;
    dot.className = "dot";
    dot.style.background = colourOf(id);
    button.type = "button";
    button.className = "person";
    button.append(dot, `#${id}`);
    cells[0].append(button);
    for (const k of [2, 3, 4, 5]) cells[k].className = "number";
    const source = document.createElement("span"), why = document.createElement("span");
    why.className = "small";
    cells[6].append(source, why);
    row.append(...cells);
    row.addEventListener("click", () => select(id));
    rows.set(id, { row, button, cells, source, why });
  }
  return rows.get(id);
}

function draw() {
  const people = [...store.people].sort((p, q) => p.id - q.id), ids = new Set(people.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  people.forEach((person, k) => {
    const { row, button, cells, source, why } = rowOf(person.id);
    if (body.children[k] !== row) body.insertBefore(row, body.children[k] ?? null);
    const chosen = person.id === store.selected;
    row.classList.toggle("chosen", chosen);
    row.classList.toggle("target", person.id === store.target);
    button.setAttribute("aria-pressed", chosen);
    cells[1].textContent = person.state === "lost" ? `lost ${person.unseen_s.toFixed(1)} s` : person.state;
    cells[1].className = person.state === "confirmed" ? "state good" : "state warn";
    cells[2].textContent = `${person.position_m[0].toFixed(2)}, ${person.position_m[1].toFixed(2)}`;
    cells[3].textContent = person.distance_m === null ? "–" : `${person.distance_m.toFixed(2)} m`;
    cells[4].textContent = `${Math.hypot(...person.velocity_mps).toFixed(2)} m/s`;
    cells[5].textContent = person.yaw_rad === null ? "–" : `${((person.yaw_rad * 180) / Math.PI).toFixed(0)}°`;
    const sure = person.confidence === null ? "" : ` ${(100 * person.confidence).toFixed(0)} %`;
    source.textContent = person.identity ? `${SOURCES[person.identity] ?? person.identity}${sure}` : "–";
    why.textContent = person.reason ? ` ${person.reason}` : "";
  });
  empty.hidden = people.length > 0;
}

on("scene", () => {
  if (performance.now() - drawn < 240 && rows.size === store.people.length) return; // slow enough to read
  drawn = performance.now();
  draw();
});
on("selected", draw);
on("target", draw);
