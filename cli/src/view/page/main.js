// The page: what is shown of which time, keys and buttons. `store.js` has the records, `plots.js` the charts.

import { Store, ask, readStream } from "./store.js";
import { Charts, QUANTITIES, SIGNALS } from "./plots.js";
import * as panels from "./panels.js";
import { Drawing } from "./robot.js";

const $ = (id) => document.getElementById(id);
const theme = localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
document.documentElement.dataset.theme = theme;

const page = {
  scene: null, store: null, charts: null, drawing: null, status: { connected: false, why: "connecting" }, events: [],
  span: 10, end: null, playing: null, fps: 0, rest: 0, seen: new WeakMap(), dirty: true, error: "",
};
globalThis.page = page; // for tests, and for the curious

// Charts out of sight are not drawn.
const sight = new IntersectionObserver((entries) => {
  for (const entry of entries) page.seen.set(entry.target, entry.isIntersecting);
});
const watchCharts = () => page.charts.charts.forEach((chart) => sight.observe(chart.card));

function take(kind, content) {
  page.dirty = true;
  if (kind === "scene") begin(content);
  else if (kind === "status") page.status = content;
  else if (kind === "events") {
    page.events.push(...content);
    panels.addEvents(content, (t) => goTo(t + page.span / 2));
  } else if (kind === "rows") {
    page.store.lost += content.lost;
    page.store.append(content.times, content.rows);
  }
}

/** Of a first daemon, or of another torquectl view behind the same address. */
function begin(scene) {
  page.scene = scene;
  page.store = new Store(scene);
  page.events = [];
  $("events").replaceChildren();
  panels.showScene(scene);
  page.charts?.charts.forEach((chart) => chart.destroy());
  page.charts = new Charts($("charts"), scene, page.store, open);
  chooseQuantity("torque");
  if (scene.urdf && !page.drawing) {
    try {
      page.drawing = new Drawing($("drawing"), scene);
    } catch (error) {
      $("drawing").textContent = `The robot cannot be drawn: ${error.message}`;
    }
  }
  $("back").hidden = true;
  $("title").textContent = "All joints";
  if (!scene.live) $("pause").firstChild.data = "Play ";
}

function chooseQuantity(name) {
  page.charts.choose(name);
  $("quantity").value = name;
  const { signals } = QUANTITIES[name];
  const boxes = signals.map((signal) => {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = page.charts.shown.has(signal);
    box.addEventListener("change", () => {
      page.charts.shown[box.checked ? "add" : "delete"](signal);
      page.dirty = true;
    });
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.setProperty("--c", `var(${SIGNALS[signal].colour})`);
    label.append(box, swatch, SIGNALS[signal].label);
    return label;
  });
  $("series").replaceChildren($("series").firstElementChild, ...boxes);
  page.dirty = true;
  watchCharts();
}

function open(joint) {
  const before = page.charts.full;
  page.charts.open(joint);
  const full = joint !== null;
  $("back").hidden = !full;
  $("series").hidden = $("quantity").parentElement.hidden = full;
  $("title").textContent = full ? page.scene.joints[joint].name : "All joints";
  // Who came by the keyboard goes on from there.
  (full ? $("back") : page.charts.charts[before].card).focus();
  watchCharts();
  page.dirty = true;
}

/** The earliest end of a window: once records are dropped, the window stays in what is kept. */
function earliest() {
  const { store, span } = page;
  return store.oldest + (page.scene.live && store.begin > 0 ? Math.min(span, store.newest - store.oldest) : 0);
}

/** Shows the window that ends at a time; null: the present. */
function goTo(end) {
  const { store } = page;
  page.playing = null;
  page.end = end === null ? null : Math.min(Math.max(end, earliest()), store.newest);
  page.dirty = true;
}

function pause() {
  const { store, scene } = page;
  if (scene.live) goTo(page.end === null ? store.newest : null);
  else if (page.playing) page.playing = null;
  else {
    if (page.end === null || page.end >= store.newest) goTo(store.oldest);
    page.playing = { from: page.end, since: performance.now() };
  }
  page.dirty = true;
}

function advance(now) {
  if (page.playing) {
    page.end = page.playing.from + (now - page.playing.since) / 1000;
    page.dirty = true;
    if (page.end >= page.store.newest) goTo(page.store.newest);
  }
}

let [pictures, counted] = [0, performance.now()];
function picture(now) {
  requestAnimationFrame(picture);
  if (now - counted > 1000) {
    [page.fps, pictures, counted] = [Math.round((1000 * pictures) / (now - counted)), 0, now];
    page.dirty = true;
  }
  if (!page.store) {
    if (page.error) $("next").textContent = page.error;
    return;
  }
  advance(now);
  const cursor = page.charts.cursorTime();
  if (!page.dirty && cursor === page.cursor) return;
  // A slow machine draws less often, and still takes every record.
  if (now < page.rest) return;
  [page.dirty, page.cursor] = [false, cursor];
  const begun = performance.now();
  draw(now);
  pictures += 1;
  page.rest = now + 1.5 * (performance.now() - begun);
}

let slow = 0;
function draw(now) {
  const { store, scene, status } = page;
  // What is shown in a pause becomes the oldest that is kept, and moves on with it.
  if (page.end !== null) page.end = Math.max(page.end, earliest());
  const end = page.end ?? store.newest;
  const width = scene.live ? page.span : Math.min(page.span, store.newest - store.oldest || page.span);
  const window = [end - width, end];
  const isPast = page.end !== null || !scene.live;
  const remarks = isPast ? null : status.remarks;
  page.charts.draw(...window, remarks, (card) => page.seen.get(card) !== false);
  const place = store.place(page.cursor ?? end);
  page.drawing?.show(store, place);
  if (now - slow < 100) return;
  slow = now;
  const name = (names, signal) => (place < 0 ? "" : names[store.loop(signal)[place]] ?? "?");
  const past = isPast ? { state: name(scene.states, "state"), mode: name(scene.modes, "mode") } : null;
  panels.showStatus(page.error ? { ...status, connected: false, why: page.error } : status, scene, past);
  panels.showRecords(store, status, page);
  panels.showWrenches(store, scene, place);
  panels.showLoop(store, ...window, status, scene);
  const all = scene.live ? [Math.max(store.newest - 60, 0), store.newest] : [0, store.newest];
  panels.showLine(store, scene, page.events, all, window);
  const scroll = $("scroll");
  [scroll.min, scroll.max] = all;
  if (document.activeElement !== scroll || page.end === null || page.playing) scroll.value = end;
  const ago = end - store.newest;
  $("clock").textContent = scene.live && page.end !== null ? `${ago.toFixed(2)} s` : `${(page.cursor ?? end).toFixed(2)} s`;
  const running = scene.live ? page.end === null : Boolean(page.playing);
  $("pause").setAttribute("aria-pressed", String(scene.live && !running));
  $("pause").firstChild.data = running ? "Pause " : scene.live ? "Live " : "Play ";
}

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function wish(what, words) {
  const answer = $("answer");
  answer.textContent = words;
  answer.classList.remove("refused");
  try {
    const { done, words: reply } = await ask(what);
    answer.textContent = reply;
    answer.classList.toggle("refused", !done);
  } catch (error) {
    answer.textContent = `torquectl view does not answer: ${error.message}`;
    answer.classList.add("refused");
  }
}

const stop = () => wish({ do: "stop" }, "stopping …");

function listen() {
  for (const [name, { title }] of Object.entries(QUANTITIES)) $("quantity").append(new Option(title, name));
  $("quantity").addEventListener("change", (e) => chooseQuantity(e.target.value));
  $("span").addEventListener("change", (e) => { page.span = Number(e.target.value); page.dirty = true; });
  $("pause").addEventListener("click", pause);
  $("back").addEventListener("click", () => open(null));
  $("scroll").addEventListener("input", (e) => goTo(Number(e.target.value)));
  $("png").addEventListener("click", () => page.charts.picture().toBlob((blob) => save(`${page.scene.robot}.png`, blob)));
  $("csv").addEventListener("click", () => {
    const end = page.end ?? page.store.newest;
    save(`${page.scene.robot}.csv`, new Blob([page.charts.csv(end - page.span, end)], { type: "text/csv" }));
  });
  $("theme").addEventListener("click", () => {
    const root = document.documentElement;
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("theme", root.dataset.theme);
    page.charts?.build();
    page.drawing?.useColours();
    watchCharts();
    page.dirty = true;
  });
  $("stop").addEventListener("click", stop);
  $("acknowledge").addEventListener("click", () => wish({ do: "acknowledge", fault: page.status.fault.number }, "acknowledging …"));
  for (const button of document.querySelectorAll("[data-do]")) {
    button.addEventListener("click", () => wish({ do: button.dataset.do }, `${button.textContent} …`));
  }
  $("move").addEventListener("submit", (e) => {
    e.preventDefault();
    const speed = $("speed").value.trim();
    wish({ do: "move", targets: $("targets").value, speed: speed ? Number(speed.replace(",", ".")) : null }, "moving …");
  });
  addEventListener("keydown", key);
  addEventListener("resize", () => { page.charts?.resize(); page.dirty = true; });
}

function key(event) {
  const inField = event.target.matches("input:not([type=checkbox]):not([type=range]), select");
  if (!page.scene || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "Escape" && page.charts.full !== null) return open(null);
  if (inField) return;
  const end = page.end ?? page.store.newest;
  const full = page.charts.full, count = page.scene.joints.length;
  const actions = {
    " ": () => (event.target.matches("button:not(#pause)") ? false : pause()),
    s: () => (page.scene.control ? stop() : false),
    ",": () => goTo(end - page.span / 10),
    ".": () => goTo(end + page.span / 10),
    Home: () => goTo(page.store.oldest),
    End: () => goTo(page.scene.live ? null : page.store.newest),
    n: () => (full === null ? false : open((full + 1) % count)),
    p: () => (full === null ? false : open((full + count - 1) % count)),
  };
  const action = actions[event.key];
  if (action && action() !== false) event.preventDefault();
}

listen();
requestAnimationFrame(picture);
for (;;) {
  try {
    page.error = "";
    await readStream(take);
    page.error = "torquectl view has ended; start it again to go on";
  } catch (error) {
    page.error = `torquectl view cannot be reached (${error.message}); start it again and open the address that it prints`;
  }
  page.dirty = true;
  await new Promise((resolve) => setTimeout(resolve, 1000));
}
