// Beside the charts: state, fault, events, times of the loop, and the line of time.

import { css, number } from "./plots.js";

const $ = (id) => document.getElementById(id);
const clock = (t) => `${t.toFixed(2)} s`;

export function showScene(scene) {
  document.title = `${scene.robot} – torqued`;
  $("robot").textContent = scene.live ? scene.robot : `${scene.robot}: ${scene.file}`;
  $("control").hidden = $("stop").hidden = !scene.control;
  $("mode").textContent = scene.live ? "" : scene.date;
  if (!scene.urdf) {
    const text = document.createElement("p");
    text.textContent = "Start torquectl view with --config to see the robot drawn from its URDF.";
    $("drawing").replaceChildren(text);
  }
}

/** The state's words; `past`: the state and mode of a moment in the past, or null. */
export function showStatus(status, scene, past) {
  const lost = !status.connected;
  const state = past ? past.state : lost ? "lost" : status.state;
  $("state").dataset.state = state;
  $("state").textContent = lost && !past ? "no daemon" : state;
  if (past || scene.live) $("mode").textContent = past ? `mode ${past.mode}` : lost ? "" : `mode ${status.mode}`;
  const commander = status.commander ? `commanded by process ${status.commander.pid}` : "no client commands";
  const why = status.commander?.not_followed ? `; not followed: ${status.commander.not_followed}` : "";
  const obstacles = (status.obstacles ?? []).map((o) => `joint ${o.name} ${o.obstacle}; `).join("");
  const live = lost ? status.why : `${obstacles}next: ${status.next} — ${commander}${why}`;
  const recorded = `${status.cycles} cycles${scene.every > 1 ? `, every ${scene.every}th shown` : ""}. ${scene.ending ?? ""}`;
  setText($("next"), scene.live ? live : recorded);
  showFault(status, scene);
}

function setText(element, text) {
  // Only what changes is read aloud.
  if (element.textContent !== text) element.textContent = text;
}

function showFault(status, scene) {
  const { fault, warning } = status;
  $("fault").hidden = !fault && !warning;
  $("acknowledge").hidden = !(fault && scene.control);
  if (!fault && !warning) return;
  const what = fault ?? warning;
  const subject = what.subject ? ` (${what.subject})` : "";
  setText($("fault-name"), `${fault ? "Fault" : "Warning"} ${what.number} ${what.name}${subject}`);
  const next = fault && scene.live ? ` Next: ${status.next}.` : "";
  const key = what.config_key ? ` Set by ${what.config_key}.` : "";
  setText($("fault-cause"), `${what.cause}${key}${next}`);
}

export function showRecords(store, status, page) {
  const lost = (status.records_lost ?? 0) + store.lost;
  $("records").textContent = `${store.end.toLocaleString("en")} records, ${lost} lost · ${page.fps} frames/s`;
}

/** Adds events to the list, the newest first. */
export function addEvents(events, goTo) {
  const list = $("events");
  for (const event of events) {
    const entry = document.createElement("li");
    entry.classList.toggle("latches", Boolean(event.latches));
    const time = document.createElement("button");
    time.textContent = clock(event.t);
    time.setAttribute("aria-label", `Show the time ${clock(event.t)}`);
    time.addEventListener("click", () => goTo(event.t));
    const words = document.createElement("span");
    const name = document.createElement("b");
    name.textContent = event.number ? `${event.number} ${event.name}` : event.name;
    const times = event.times > 1 ? ` ×${event.times}` : "";
    words.append(name, `${event.subject ? ` ${event.subject}` : ""}${times}${event.cause ? ` – ${event.cause}` : ""}`);
    entry.append(time, words);
    list.prepend(entry);
  }
  while (list.children.length > 500) list.lastChild.remove();
}

/** Histograms of a window: how long the cycles computed, and how late they began. */
export function showLoop(store, from, to, status, scene) {
  const canvas = $("histogram"), draw = sized(canvas);
  const period = 1e6 / scene.rate_hz / (scene.every ?? 1);
  const [first, last] = [store.at(from), store.at(to)];
  const half = canvas.clientHeight / 2;
  const words = ["compute_us", "wake_late_us"].map((name, k) => {
    const column = store.loop(name), counts = new Array(60).fill(0), values = [];
    for (let row = first; row < last; ++row) {
      const x = column[row % store.t.length];
      values.push(x);
      counts[Math.min(59, Math.floor((x / period) * 60))] += 1;
    }
    values.sort((a, b) => a - b);
    const most = Math.max(1, ...counts), step = canvas.clientWidth / 60;
    draw.fillStyle = css(k ? "--encoder" : "--tau");
    counts.forEach((count, i) => {
      // By logarithm: a single late cycle is seen.
      const height = count ? Math.max(2, ((half - 16) * Math.log(1 + count)) / Math.log(1 + most)) : 0;
      draw.fillRect(i * step, (k + 1) * half - height, step - 1, height);
    });
    draw.fillStyle = css("--quiet");
    draw.font = "11px system-ui, sans-serif";
    draw.fillText(`${k ? "wake-up late" : "computing"}, 0 to ${period.toFixed(0)} µs, logarithmic`, 0, k * half + 10);
    const at = (share) => values[Math.min(values.length - 1, Math.floor(share * values.length))];
    return `${k ? "late" : "computing"} p50 ${number(at(0.5))}, p99 ${number(at(0.99))}, max ${number(at(1))} µs`;
  });
  const late = status.late_cycles === undefined ? "" : `; late cycles ${status.late_cycles}, left out ${status.skipped_cycles}`;
  setText($("loop"), `${words.join("; ")}${late}`);
}

/** The line of time: states as colours, events as marks, the window as a frame. */
export function showLine(store, scene, events, [from, to], window) {
  const canvas = $("line"), draw = sized(canvas);
  const { clientWidth: width, clientHeight: height } = canvas;
  const x = (t) => ((t - from) / Math.max(1e-9, to - from)) * width;
  const states = store.loop("state");
  const colours = { boot: "--edge", ready: "--edge", enabling: "--warn", holding: "--holding", active: "--active", stopping: "--warn", fault: "--fault" };
  for (let pixel = 0; pixel < width; pixel += 3) {
    const place = store.place(from + ((to - from) * pixel) / width);
    if (place < 0) continue;
    draw.fillStyle = css(colours[scene.states[states[place]]] ?? "--edge");
    draw.fillRect(pixel, 5, 3, height - 9);
  }
  for (const event of events) {
    if (event.t < from) continue;
    draw.fillStyle = css(event.latches ? "--limit" : "--ink");
    draw.fillRect(x(event.t) - 1, 0, event.latches ? 3 : 1.5, height);
  }
  draw.strokeStyle = css("--ink");
  draw.lineWidth = 2;
  draw.strokeRect(x(window[0]) + 1, 2, Math.max(3, x(window[1]) - x(window[0]) - 2), height - 3);
}

export function showWrenches(store, scene, place) {
  if (place < 0) return;
  const words = scene.sensors.map((name, sensor) => {
    const [x, y, z, a, b, c] = [0, 1, 2, 3, 4, 5].map((axis) => store.wrench(sensor, axis)[place]);
    return `${name} ${number(Math.hypot(x, y, z))} N, ${number(Math.hypot(a, b, c))} N·m`;
  });
  setText($("wrenches"), words.length ? `Contact: ${words.join("; ")}` : "");
}

function sized(canvas) {
  const pixels = devicePixelRatio;
  const [width, height] = [Math.round(canvas.clientWidth * pixels), Math.round(canvas.clientHeight * pixels)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const draw = canvas.getContext("2d");
  draw.setTransform(pixels, 0, 0, pixels, 0, 0);
  draw.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  return draw;
}
