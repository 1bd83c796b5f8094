// Events, newest first. Text from messages is set as text only.
import { on, select } from "./store.js";

const list = document.getElementById("event-list"), empty = document.getElementById("no-events");
const MOST = 200;
const known = new Set();

const seconds = (value) => (value === null ? "" : ` after ${value.toFixed(1)} s`);
const TEXTS = {
  appeared: () => "appeared",
  returned: (e) => `came back${e.reason ? `: ${e.reason}` : ""}`,
  disappeared: () => "left the view",
  identity_uncertain: (e) => `identity uncertain${e.confidence === null ? "" : ` (${(100 * e.confidence).toFixed(0)} %)`}${e.reason ? `: ${e.reason}` : ""}`,
  entered: (e) => `entered ${e.zone} (${e.count} in it)`,
  left: (e) => `left ${e.zone}${seconds(e.dwell_s)}`,
  dwelled: (e) => `stays in ${e.zone} for more than ${e.dwell_s?.toFixed(1)} s`,
  count_reached: (e) => `${e.count} people in ${e.zone}`,
  faces_robot: () => "faces the robot",
  approaches: (e) => `approaches the robot, ${e.distance_m?.toFixed(1)} m away`,
  fell: (e) => `fell${e.reason ? `: ${e.reason}` : ""}`,
  got_up: () => "got up",
  sat_down: () => "sat down",
  stood_up: () => "stood up",
  lies: (e) => `lies for more than ${e.dwell_s?.toFixed(0)} s`,
  raised_hand: () => "raised a hand",
  waved: () => "waved",
  pointed: () => "pointed",
  robot_near: (e) => `is ${e.distance_m?.toFixed(2)} m from the robot`,
};

function add(event) {
  if (known.has(event.number)) return;
  known.add(event.number);
  const item = document.createElement("li"), time = document.createElement("time"), text = document.createElement("span");
  const date = new Date(event.at_ms);
  time.dateTime = date.toISOString();
  time.textContent = date.toLocaleTimeString();
  text.textContent = `${event.id === null ? "" : `#${event.id} `}${(TEXTS[event.kind] ?? (() => event.kind))(event)}`;
  item.append(time, text);
  if (event.id !== null) item.addEventListener("click", () => select(event.id));
  list.prepend(item);
  while (list.children.length > MOST) list.lastChild.remove();
  empty.hidden = true;
}

on("message:events", ({ events }) => events.forEach(add));
