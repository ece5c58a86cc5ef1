// Charts: small multiples of all joints, and one joint in full.

const DEGREES = 180 / Math.PI;
const plain = () => 1;
const angle = (joint) => (joint.prismatic ? 1000 : DEGREES);

/** Signals with the words, colours and units of the page. */
export const SIGNALS = {
  tau: { label: "torque", colour: "--tau", unit: (j) => (j.prismatic ? "N" : "N·m"), scale: plain },
  tau_d: { label: "desired", colour: "--desired", dash: [5, 3] },
  tau_encoder: { label: "encoders", colour: "--encoder" },
  tau_whole_body: { label: "F/T and IMU", colour: "--whole" },
  tau_current: { label: "motor current", colour: "--current" },
  tau_ext: { label: "external", colour: "--ext" },
  tau_residual: { label: "encoders − F/T and IMU", colour: "--encoder" },
  contact_ratio: { label: "over contact threshold", colour: "--warn" },
  q: { label: "position", colour: "--tau", unit: (j) => (j.prismatic ? "mm" : "°"), scale: angle },
  q_c: { label: "commanded", colour: "--desired", dash: [5, 3], scale: angle },
  dq: { label: "velocity", colour: "--tau", unit: (j) => (j.prismatic ? "mm/s" : "°/s"), scale: angle },
  torsion: { label: "torsion", colour: "--encoder", unit: (j) => (j.prismatic ? "µm" : "mrad"), scale: (j) => (j.prismatic ? 1e6 : 1e3) },
  following_error: { label: "following error", colour: "--limit", unit: () => "drive units" },
  current: { label: "current", colour: "--current", unit: () => "A" },
  current_c: { label: "commanded", colour: "--desired", dash: [5, 3] },
};

/** What a chart can show: its first signal gives unit and extremes. */
export const QUANTITIES = {
  torque: { title: "Torque", signals: ["tau", "tau_d", "tau_encoder", "tau_whole_body", "tau_current", "tau_ext"], shown: ["tau", "tau_d"], band: true },
  position: { title: "Position", signals: ["q", "q_c"], shown: ["q", "q_c"] },
  velocity: { title: "Velocity", signals: ["dq"], shown: ["dq"] },
  current: { title: "Motor current", signals: ["current", "current_c"], shown: ["current", "current_c"] },
  torsion: { title: "Torsion", signals: ["torsion"], shown: ["torsion"] },
};

/** Charts of one joint in full. */
const FULL = [
  { title: "Torque and its sources", signals: ["tau", "tau_d", "tau_encoder", "tau_whole_body", "tau_current"], band: true, limits: "torque" },
  { title: "External torque and residual", signals: ["tau_ext", "tau_residual"], unit: (j) => (j.prismatic ? "N" : "N·m") },
  { title: "Position", signals: ["q", "q_c"], limits: "position" },
  { title: "Velocity", signals: ["dq"] },
  { title: "Torsion", signals: ["torsion"] },
  { title: "Motor current", signals: ["current", "current_c"] },
];

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const sync = uPlot.sync("time");

/** A number in the page's words; `-0.00` reads as 0. */
export const number = (x, digits = 3) => {
  if (!Number.isFinite(x)) return "–";
  const whole = Math.max(1, Math.ceil(Math.log10(Math.abs(x) + 1e-9)));
  const text = x.toFixed(Math.max(0, Math.min(3, digits - whole)));
  return Number(text) === 0 ? text.replace("-", "") : text;
};

/** One chart with its heading. */
class Chart {
  constructor(parent, store, joint, index, what, small, onOpen) {
    Object.assign(this, { store, joint, index, what, small });
    this.signals = what.signals;
    const first = SIGNALS[this.signals[0]];
    this.unit = (what.unit ?? first.unit)(joint);
    this.scale = this.signals.map((name) => (SIGNALS[name].scale ?? plain)(joint));
    this.columns = this.signals.map((name) => store.joint(index, name));
    this.sigma = what.band ? store.joint(index, "sigma") : null;
    this.card = document.createElement(small ? "button" : "div");
    this.card.className = "card";
    this.card.innerHTML = `<div class="top"><span class="name"></span><span class="value"></span></div>
      <div class="use"><i></i></div><div class="keys"></div><div class="plot"></div><div class="remark"></div>`;
    const part = (name) => this.card.querySelector(name);
    [this.value, this.use, this.remark, this.keys] = [".value", ".use i", ".remark", ".keys"].map(part);
    part(".name").textContent = part(".name").title = small ? joint.name : what.title;
    part(".use").hidden = !(joint.torque_limit && what.band);
    part(".remark").hidden = !small;
    this.keys.hidden = small;
    if (small) {
      this.card.addEventListener("click", () => onOpen(index));
      this.card.setAttribute("aria-label", `${joint.name}: show in full`);
    }
    parent.append(this.card);
    this.plot = new uPlot(this.options(), this.empty(), part(".plot"));
  }

  size() {
    return { width: Math.max(120, this.card.clientWidth - 16), height: this.small ? this.smallHeight() : 190 };
  }

  /** Few joints have taller charts, so that the page is used. */
  smallHeight() {
    const grid = this.card.parentElement;
    const columns = Math.max(1, getComputedStyle(grid).gridTemplateColumns.split(" ").length);
    const rows = Math.ceil(grid.children.length / columns);
    return Math.round(Math.min(220, Math.max(90, (innerHeight - 240) / rows - 62)));
  }

  empty() {
    return [[], ...this.series().map(() => [])];
  }

  series() {
    const drawn = this.signals.map((name) => ({ name, ...SIGNALS[name] }));
    return this.sigma ? [{ name: "low", edge: true }, { name: "high", edge: true }, ...drawn] : drawn;
  }

  options() {
    const ink = css("--quiet"), grid = { stroke: css("--grid"), width: 1 };
    const axis = { stroke: ink, grid, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    return {
      ...this.size(),
      legend: { show: false },
      cursor: { sync: { key: sync.key }, drag: { x: false, y: false }, points: { show: !this.small } },
      scales: { x: { time: false }, y: { range: (_, low, high) => this.range(low, high) } },
      axes: [
        { ...axis, size: this.small ? 0 : 26, show: !this.small, values: (_, ticks) => ticks.map((t) => `${+t.toFixed(3)} s`) },
        { ...axis, size: this.small ? 40 : 52, gap: 3, space: this.small ? 26 : 30 },
      ],
      series: [{}, ...this.series().map(({ edge, colour, dash }) => ({
        stroke: css(edge ? "--band" : colour), width: edge ? 1 : 1.5, dash, points: { show: false }, spanGaps: false,
      }))],
      bands: this.sigma ? [{ series: [2, 1], fill: css("--band") }] : [],
      hooks: { draw: [(plot) => this.drawLimits(plot)] },
      padding: [8, 4, this.small ? 6 : 0, 0],
    };
  }

  range(low, high) {
    if (low == null) return [-1, 1];
    const least = Math.abs(this.scale[0]) > 1 ? 0.05 : 0.2;
    const margin = Math.max(0.08 * (high - low), least);
    return [low - margin, high + margin];
  }

  limits() {
    const { joint } = this;
    const kind = this.what.limits ?? (this.what.band ? "torque" : this.signals[0] === "q" ? "position" : "");
    if (kind === "torque" && joint.torque_limit) return [-joint.torque_limit, joint.torque_limit];
    if (kind === "position" && joint.position_min != null) return [joint.position_min, joint.position_max].map((x) => x * this.scale[0]);
    return [];
  }

  drawLimits(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = css("--limit");
    ctx.setLineDash([6, 4]);
    for (const limit of this.limits()) {
      if (limit < plot.scales.y.min || limit > plot.scales.y.max) continue;
      const y = plot.valToPos(limit, "y", true);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  /** Draws a window of time; `shown`: names of the signals that are chosen. */
  draw(from, to, shown, dots) {
    const places = this.store.chosen(from, to, this.columns[0], Math.max(60, dots));
    const times = places.map((place) => this.store.t[place]);
    const value = (column, scale) => (place) => {
      const x = column[place];
      return x === x ? x * scale : null;
    };
    const series = this.columns.map((column, k) => {
      const on = !this.small || shown.has(this.signals[k]);
      return on ? places.map(value(column, this.scale[k])) : places.map(() => null);
    });
    if (this.sigma) {
      const edge = (sign) => (place) => {
        const [tau, sigma] = [this.columns[0][place], this.sigma[place]];
        return tau === tau && sigma === sigma ? (tau + sign * sigma) : null;
      };
      const on = !this.small || shown.has("tau");
      series.unshift(...[-1, 1].map((sign) => places.map(on ? edge(sign) : () => null)));
    }
    this.plot.batch(() => {
      this.plot.setData([times, ...series], false);
      this.plot.setScale("x", { min: from, max: to });
      this.plot.setScale("y", { min: null, max: null });
    });
  }

  /** Shows the values at a place in the columns. */
  show(place, remark) {
    const at = (k) => (place < 0 ? NaN : this.columns[k][place] * this.scale[k]);
    const sigma = this.sigma && place >= 0 ? ` ± ${number(this.sigma[place])}` : "";
    this.value.textContent = `${number(at(0))}${sigma} ${this.unit}`;
    if (this.joint.torque_limit && this.what.band) {
      const use = Math.abs(at(0)) / this.joint.torque_limit || 0;
      this.use.style.width = `${Math.min(100, 100 * use)}%`;
      this.use.style.background = css(use > 0.9 ? "--limit" : use > 0.7 ? "--warn" : "--tau");
    }
    if (this.small) {
      // A joint that is driven is no news.
      const notable = (remark ?? "").split(", ").filter((word) => word !== "engaged").join(", ");
      this.remark.textContent = this.remark.title = notable;
      this.card.classList.toggle("warn", Boolean(notable));
    } else {
      this.keys.replaceChildren(...this.signals.map((name, k) => {
        const key = document.createElement("span");
        key.innerHTML = `<b style="--c:var(${SIGNALS[name].colour})">—</b> `;
        key.append(`${SIGNALS[name].label} ${number(at(k))}`);
        return key;
      }));
    }
  }

  destroy() { this.plot.destroy(); this.card.remove(); }
}

/** All charts of the present view. */
export class Charts {
  constructor(element, scene, store, onOpen) {
    Object.assign(this, { element, scene, store, onOpen, quantity: "torque", full: null, charts: [], shown: new Set(QUANTITIES.torque.shown) });
    this.build();
    new ResizeObserver(() => this.resize()).observe(element);
  }

  build() {
    for (const chart of this.charts) chart.destroy();
    this.element.classList.toggle("full", this.full !== null);
    const make = (joint, index, what, small) => new Chart(this.element, this.store, joint, index, what, small, this.onOpen);
    this.charts = this.full === null
      ? this.scene.joints.map((joint, j) => make(joint, j, QUANTITIES[this.quantity], true))
      : FULL.map((what) => make(this.scene.joints[this.full], this.full, what, false));
    this.resize();
  }

  resize() {
    for (const chart of this.charts) {
      const size = chart.size();
      if (size.width !== chart.plot.width || size.height !== chart.plot.height) chart.plot.setSize(size);
    }
  }

  choose(quantity) {
    this.quantity = quantity;
    this.shown = new Set(QUANTITIES[quantity].shown);
    this.build();
  }

  open(joint) {
    this.full = joint;
    this.build();
  }

  /** Time under the cursor, or null. */
  cursorTime() {
    for (const { plot } of this.charts) {
      const { left } = plot.cursor;
      if (left != null && left >= 0) return plot.posToVal(left, "x");
    }
    return null;
  }

  draw(from, to, remarks, visible) {
    const cursor = this.cursorTime();
    const place = this.store.place(cursor ?? to);
    this.charts.forEach((chart, k) => {
      if (!visible(chart.card)) return;
      chart.draw(from, to, this.shown, chart.plot.width / 2);
      chart.show(place, this.full === null ? remarks?.[k] : "");
    });
    return cursor;
  }

  /** A picture of all charts, as they are. */
  picture() {
    const pixels = devicePixelRatio, [gap, head] = [12 * pixels, 22 * pixels];
    const boxes = this.charts.map((c) => c.plot.ctx.canvas);
    const columns = this.full === null ? Math.ceil(Math.sqrt(boxes.length * 0.8)) : 2;
    const [w, h] = [boxes[0].width + gap, boxes[0].height + head + gap];
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [columns * w + gap, Math.ceil(boxes.length / columns) * h + gap];
    const draw = canvas.getContext("2d");
    draw.fillStyle = css("--card");
    draw.fillRect(0, 0, canvas.width, canvas.height);
    draw.fillStyle = css("--ink");
    draw.font = `${13 * pixels}px system-ui, sans-serif`;
    boxes.forEach((box, k) => {
      const [x, y] = [gap + (k % columns) * w, gap + Math.floor(k / columns) * h];
      const chart = this.charts[k];
      const name = this.full === null ? chart.joint.name : `${chart.joint.name}: ${chart.what.title}`;
      draw.fillText(`${name}, ${chart.unit}`, x, y + 14 * pixels);
      draw.drawImage(box, x, y + head);
    });
    return canvas;
  }

  /** Every row of a window, as text. */
  csv(from, to) {
    const columns = this.charts.flatMap((chart) => {
      const one = (name, column) => ({ title: `${chart.joint.name}.${name}`, column });
      const own = chart.signals.map((name, k) => one(name, chart.columns[k]));
      return chart.sigma ? [...own, one("sigma", chart.sigma)] : own;
    });
    const lines = [["t", ...columns.map((c) => c.title)].join(",")];
    const { store } = this;
    for (let row = store.at(from); row < store.end; ++row) {
      const place = row % store.t.length;
      if (store.t[place] > to) break;
      lines.push([store.t[place].toFixed(6), ...columns.map((c) => {
        const x = c.column[place];
        return x === x ? x : "";
      })].join(","));
    }
    return `${lines.join("\n")}\n`;
  }
}
