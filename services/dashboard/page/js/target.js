// The followed person: chosen by a click; hidden until the service of the chosen person sends its state.
import { emit, on, store } from "./store.js";

const $ = (id) => document.getElementById(id);
const state = $("target-state"), follow = $("follow"), unfollow = $("unfollow"), problem = $("target-problem");
const SILENT_MS = 3000; // time without a state after which it is unknown
const GRADES = { locked: "good", occluded: "", searching: "", lost: "bad", none: "quiet" };
let silence = null, target = null;

function draw() {
  const name = target?.state === "none" ? "no person is followed" : `${target?.id ? `follows #${target.id}: ` : "followed person: "}${target?.state}`;
  const text = target ? name : "state of the followed person unknown";
  if (state.textContent !== text) state.textContent = text; // for readers of the screen, changes only
  state.className = `badge ${target ? GRADES[target.state] : "bad"}`;
  $("target-reason").textContent = target && target.state !== "none" ? target.reason : "";
  follow.textContent = store.selected === null ? "Select a person to follow" : `Follow #${store.selected}`;
  follow.disabled = !target || store.selected === null || store.selected === target.id;
  unfollow.hidden = !target || target.state === "none";
  const id = target?.id ?? null;
  if (store.target !== id) { store.target = id; emit("target"); }
}

async function choose(id) {
  problem.textContent = "";
  const answer = await fetch("target", {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ id }),
  }).catch(() => null);
  if (!answer?.ok) problem.textContent = answer ? (await answer.text()).trim() : "No connection to the service.";
}

follow.addEventListener("click", () => choose(store.selected));
unfollow.addEventListener("click", () => choose(null));
on("selected", draw);
on("message:target", (message) => {
  target = message;
  $("target").hidden = false;
  clearTimeout(silence);
  silence = setTimeout(() => { target = null; draw(); }, SILENT_MS);
  draw();
});
