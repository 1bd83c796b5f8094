// Processes, rates, drops, diagnostics, and the latency of every stage over time.
import { fitCanvas } from "./canvas.js";
import { STAGES, css } from "./colours.js";
import { emit, on } from "./store.js";

const $ = (id) => document.getElementById(id);
const SECONDS = 120;
const samples = []; // {at, stages: Map name -> ms, total}
const colours = new Map();

const td = (text, className = "") => {
  const cell = document.createElement("td");
  cell.textContent = text;
  cell.className = className;
  return cell;
};
const STATES = { ready: "good", degraded: "warn", starting: "warn", stalled: "bad", stopping: "warn" };

function processRow(process) {
  const row = document.createElement("tr"), name = document.createElement("th");
  name.scope = "row";
  name.textContent = process.instance;
  const state = td(`${{ good: "●", warn: "▲", bad: "■" }[STATES[process.state]] ?? "○"} ${process.state || "silent"}`, `state ${STATES[process.state] ?? ""}`);
  const reason = document.createElement("span");
  reason.className = "small";
  reason.textContent = process.reason ? ` ${process.reason}` : "";
  const rates = Object.entries(process.rates_hz).filter(([, hz]) => hz >= 0.05)
    .map(([topic, hz]) => `${topic.replace("received_", "← ").replace("sent_", "→ ")} ${hz.toFixed(1)}`).join("   ");
  const lost = Object.entries(process.losses).map(([cause, count]) => `${cause} ${count}`).join(", ");
  const messages = td(rates, "small");
  state.append(reason);
  row.append(name, state, messages, td(lost, "small"),
    td(process.cpu_percent === null ? "–" : `${process.cpu_percent.toFixed(0)} %`, "number"),
    td(process.memory_mb === null ? "–" : `${process.memory_mb.toFixed(0)} MiB`, "number"));
  return row;
}

on("message:health", (health) => {
  document.querySelector("#processes tbody").replaceChildren(...health.processes.map(processRow));
  const stages = new Map();
  for (const process of health.processes) {
    for (const stage of process.stages) {
      if (process.service === "dashboard" || stage.parallel) continue;
      const name = `${process.service} ${stage.stage}`;
      stages.set(name, Math.max(0, stage.p50_ms) + (stages.get(name) ?? 0));
    }
  }
  const total = health.end_to_end;
  samples.push({ at: health.at_ms, stages, total: total?.p50_ms ?? null });
  while (samples[0].at < health.at_ms - SECONDS * 1000 || samples.length > 2 * SECONDS) samples.shift();
  emit("latency", total);
  draw();
});

function draw() {
  const { context, width, height } = fitCanvas($("latency-canvas"));
  context.clearRect(0, 0, width, height);
  const last = samples.at(-1);
  if (!last) return;
  const largest = new Map();
  for (const { stages } of samples) for (const [name, ms] of stages) largest.set(name, Math.max(ms, largest.get(name) ?? 0));
  const names = [...largest].sort((p, q) => q[1] - p[1]).slice(0, STAGES.length - 1).map(([name]) => name);
  for (const name of colours.keys()) if (!names.includes(name)) colours.delete(name);
  for (const name of names) if (!colours.has(name)) colours.set(name, STAGES.find((colour) => ![...colours.values()].includes(colour)));
  const order = [...largest.keys()].filter((name) => names.includes(name));
  const sums = samples.map(({ stages }) => [...stages.values()].reduce((sum, ms) => sum + ms, 0));
  const top = Math.max(10, ...sums) * 1.1;
  const x = (at) => width - ((last.at - at) / (SECONDS * 1000)) * (width - 44), y = (ms) => height - 16 - (ms / top) * (height - 26);
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "middle";
  const step = [5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((ms) => top / ms < 5) ?? 10000;
  for (let ms = 0; ms <= top; ms += step) {
    context.strokeStyle = css("faint");
    context.beginPath();
    context.moveTo(40, y(ms));
    context.lineTo(width, y(ms));
    context.stroke();
    context.fillStyle = css("quiet");
    context.fillText(`${ms} ms`, 0, y(ms));
  }
  const below = samples.map(() => 0);
  const layers = [...order, "others"];
  for (const name of layers) {
    const above = samples.map(({ stages }, k) => below[k] + (name === "others"
      ? [...stages].filter(([stage]) => !order.includes(stage)).reduce((sum, [, ms]) => sum + ms, 0) : stages.get(name) ?? 0));
    context.fillStyle = name === "others" ? STAGES.at(-1) : colours.get(name);
    context.beginPath();
    samples.forEach(({ at }, k) => context[k ? "lineTo" : "moveTo"](Math.max(40, x(at)), y(above[k])));
    for (let k = samples.length - 1; k >= 0; k--) context.lineTo(Math.max(40, x(samples[k].at)), y(below[k]));
    context.closePath();
    context.fill();
    above.forEach((value, k) => { below[k] = value; });
  }
  context.fillStyle = css("quiet");
  context.fillText("2 min ago", 40, height - 6);
  context.textAlign = "right";
  context.fillText("now", width, height - 6);
  context.textAlign = "left";
  $("latency-legend").replaceChildren(...layers.map((name) => {
    const item = document.createElement("li"), dot = document.createElement("span");
    dot.className = "dot";
    dot.style.background = name === "others" ? STAGES.at(-1) : colours.get(name);
    const ms = name === "others" ? [...last.stages].filter(([stage]) => !order.includes(stage)).reduce((sum, [, value]) => sum + value, 0) : last.stages.get(name);
    item.append(dot, `${name} ${(ms ?? 0).toFixed(1)} ms`);
    return item;
  }));
}

const MARKS = { ok: ["●", "good"], warning: ["▲", "warn"], problem: ["■", "bad"] };
on("message:diagnosis", ({ diagnostics }) => {
  const bad = diagnostics.filter(({ level }) => level !== "ok");
  const shown = bad.length ? bad : [{ level: "ok", what: `All ${diagnostics.length} checks pass.`, hint: "", check: "" }];
  $("diagnostics").replaceChildren(...shown.map(({ level, check, what, hint }) => {
    const item = document.createElement("li"), mark = document.createElement("span"), more = document.createElement("span");
    const [sign, className] = MARKS[level] ?? MARKS.warning;
    mark.className = `state ${className}`;
    mark.textContent = `${sign} ${level}${check ? ` (${check})` : ""}: `;
    more.className = "small";
    more.textContent = hint;
    item.append(mark, what, more);
    return item;
  }));
});
on("theme", draw);
addEventListener("resize", draw);
