// Connects the parts of the page.
import "./events.js";
import "./health.js";
import { takeImage } from "./images.js";
import "./map.js";
import { setPaused, setSender, step } from "./playback.js";
import { emit, on, select, store, takeScene, takeSkeletons, takeTrajectories } from "./store.js";
import { Stream } from "./stream.js";
import "./table.js";
import "./target.js";
import "./zones.js";

const $ = (id) => document.getElementById(id);

const takers = {
  about({ robot, privacy, history_s: seconds, role }) {
    Object.assign(store, { privacy, historyMs: seconds * 1000, images: role !== "planner" });
    $("robot").textContent = robot === "robot" ? "" : robot;
    document.title = `people4d ${robot}`;
    $("draw").hidden = role === "planner";
    emit("about");
  },
  scene: takeScene,
  image: takeImage,
  skeletons: takeSkeletons,
  trajectories: ({ positions }) => takeTrajectories(positions),
  predictions({ people }) { store.predictions = people; emit("predictions"); },
};

const stream = new Stream(
  (message) => (takers[message.type] ?? ((other) => emit(`message:${other.type}`, other)))(message),
  (connected, reason) => {
    const badge = $("connection");
    badge.textContent = connected ? "connected" : reason || "no connection, trying again …";
    badge.className = `badge ${connected ? "good" : "bad"}`;
    document.body.classList.toggle("offline", !connected);
    if (connected) { watch(); emit("connected"); }
  },
);
setSender((request) => stream.send(request));

on("scene", () => { $("count").textContent = `${store.people.length} ${store.people.length === 1 ? "person" : "people"}`; });
on("latency", (total) => { $("latency").textContent = total ? `${total.p50_ms.toFixed(0)} ms from image to people` : ""; });

// 3D and its cloud are loaded when they come into view.
let space = null, spaceVisible = false;
const watch = () => stream.send({ type: "watch", images: true, cloud: spaceVisible && space !== null && $("cloud").checked && !document.hidden });
new IntersectionObserver(async ([entry]) => {
  spaceVisible = entry.isIntersecting;
  if (spaceVisible && !space) {
    try {
      space = (await import("./space.js")).openSpace($("space-canvas"));
    } catch {
      $("space-hint").hidden = false;
      $("space-hint").textContent = "3D needs WebGL, which this browser does not offer.";
      return;
    }
  }
  watch();
}).observe($("space-canvas"));
$("cloud").addEventListener("change", () => { space?.showCloud($("cloud").checked); watch(); });
$("reset").addEventListener("click", () => space?.reset());
document.addEventListener("visibilitychange", watch);

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => emit("theme"));

// A clicked button loses the focus, since Space would press it; the keyboard keeps the focus.
document.addEventListener("click", (event) => { if (event.detail) event.target.closest?.("button, [type='checkbox']")?.blur(); });

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input:not([type='range'], [type='checkbox'])") || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === " " && !event.target.matches("button, [type='checkbox']")) setPaused(!store.paused);
  else if (event.key === ",") step(-1);
  else if (event.key === ".") step(1);
  else if (event.key === "Escape" && store.selected !== null) select(store.selected);
  else if (event.key === "n" && store.people.length) {
    const ids = store.people.map(({ id }) => id).sort((p, q) => p - q);
    select(ids[(ids.indexOf(store.selected) + 1) % ids.length]);
  } else return;
  event.preventDefault();
});
