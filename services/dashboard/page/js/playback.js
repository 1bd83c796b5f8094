// Pause and history: the service stores what it sent.
import { emit, on, store } from "./store.js";

const $ = (id) => document.getElementById(id);
const slider = $("time"), pause = $("pause"), when = $("when");
let send = () => {};
let pausedAt = 0, asked = 0;

export function setSender(sender) { send = sender; }

export function setPaused(paused) {
  if (paused === store.paused) return;
  store.paused = paused;
  pausedAt = store.atMs;
  send({ type: paused ? "pause" : "live" });
  slider.value = 0;
  if (paused) ask(); // for all parts of one frame, which arrive at several rates
  show();
  emit("paused", paused);
}

function seek(seconds) {
  setPaused(true);
  slider.value = Math.max(-store.historyMs / 1000, Math.min(0, seconds));
  const now = performance.now();
  if (now - asked > 30) { asked = now; ask(); } else { clearTimeout(seek.timer); seek.timer = setTimeout(ask, 40); }
  show();
}

const ask = () => send({ type: "seek", at_ms: pausedAt + 1000 * Number(slider.value) });

function show() {
  const value = Number(slider.value);
  pause.textContent = store.paused ? "Live" : "Pause";
  pause.setAttribute("aria-pressed", store.paused);
  when.textContent = store.paused ? (value ? `${value.toFixed(1)} s` : "paused") : "live";
  slider.setAttribute("aria-valuetext", when.textContent);
}

export const step = (seconds) => seek(Number(slider.value) + seconds);
pause.addEventListener("click", () => setPaused(!store.paused));
slider.addEventListener("input", () => seek(Number(slider.value)));
$("back").addEventListener("click", () => step(-5));
$("forward").addEventListener("click", () => (store.paused && Number(slider.value) > -5 ? setPaused(false) : store.paused && step(5)));
on("about", () => { slider.min = -store.historyMs / 1000; });
// The service treats a new connection as live.
on("connected", () => { if (store.paused) { send({ type: "pause" }); ask(); } });
