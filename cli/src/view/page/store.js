// What arrives: the last minute of rows, column by column, and the stream that fills it.

const CAPACITY = 60000;

/** A ring of rows; a row has a count that never repeats. */
export class Store {
  constructor(scene) {
    this.width = scene.width;
    this.t = new Float64Array(CAPACITY);
    this.columns = Array.from({ length: scene.width }, () => new Float32Array(CAPACITY));
    this.end = 0; // count of the row after the newest
    this.lost = 0;
    this.jointSignals = scene.joint_signals;
    this.loopSignals = scene.loop_signals;
    this.joints = scene.joints.length;
  }
  get begin() { return Math.max(0, this.end - CAPACITY); }
  get newest() { return this.end ? this.t[(this.end - 1) % CAPACITY] : 0; }
  get oldest() { return this.end ? this.t[this.begin % CAPACITY] : 0; }

  append(times, rows) {
    for (let k = 0; k < times.length; ++k) {
      const place = this.end % CAPACITY;
      this.t[place] = times[k];
      const from = k * this.width;
      for (let c = 0; c < this.width; ++c) this.columns[c][place] = rows[from + c];
      this.end += 1;
    }
  }

  /** Column of a joint's signal, of the loop's, or of a sensor's wrench. */
  joint(joint, signal) {
    return this.columns[this.loopSignals.length + joint * this.jointSignals.length + this.jointSignals.indexOf(signal)];
  }
  loop(signal) { return this.columns[this.loopSignals.indexOf(signal)]; }
  wrench(sensor, axis) {
    return this.columns[this.loopSignals.length + this.joints * this.jointSignals.length + sensor * 6 + axis];
  }

  /** Count of the first row at or after a time. */
  at(time) {
    let [low, high] = [this.begin, this.end];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle % CAPACITY] < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  /** Place in the columns of the newest row at or before a time; -1 if there is none. */
  place(time) {
    const row = this.at(time);
    const exact = row < this.end && this.t[row % CAPACITY] === time;
    const before = exact ? row : row - 1;
    return before >= this.begin && before < this.end ? before % CAPACITY : -1;
  }

  /** Places of the rows to draw between two times: all of them, or the lowest and the highest of a column in
   *  each of `buckets` equal groups. Groups are counted from row 0, so that they stay while time goes on. */
  chosen(from, to, column, buckets) {
    const [first, last] = [this.at(from), this.at(to)];
    const size = Math.max(1, Math.ceil((last - first) / buckets));
    const places = [];
    if (size <= 2) {
      for (let row = first; row < last; ++row) places.push(row % CAPACITY);
      return places;
    }
    for (let begin = first - (first % size); begin < last; begin += size) {
      let [low, high, lowest, highest] = [-1, -1, Infinity, -Infinity];
      const stop = Math.min(begin + size, last);
      for (let row = Math.max(begin, first); row < stop; ++row) {
        const x = column[row % CAPACITY];
        if (x < lowest) { lowest = x; low = row; }
        if (x > highest) { highest = x; high = row; }
      }
      if (low < 0) places.push(Math.max(begin, first) % CAPACITY); // a gap
      else if (low === high) places.push(low % CAPACITY);
      else places.push(Math.min(low, high) % CAPACITY, Math.max(low, high) % CAPACITY);
    }
    return places;
  }
}

const KINDS = { 1: "scene", 2: "status", 3: "events", 4: "rows" };

/** Reads the stream until it ends; `take(kind, content)` gets each piece. */
export async function readStream(take) {
  const response = await fetch("stream", { cache: "no-store" });
  if (!response.ok) throw new Error(await response.text());
  const reader = response.body.getReader();
  const text = new TextDecoder();
  let bytes = new Uint8Array(0);
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const joined = new Uint8Array(bytes.length + value.length);
    joined.set(bytes);
    joined.set(value, bytes.length);
    bytes = joined;
    let begin = 0;
    while (bytes.length - begin >= 8) {
      const view = new DataView(bytes.buffer, bytes.byteOffset + begin);
      const length = view.getUint32(0, true);
      if (bytes.length - begin - 8 < length) break;
      const kind = KINDS[view.getUint32(4, true)];
      const piece = bytes.slice(begin + 8, begin + 8 + length); // aligned
      if (kind === "rows") take(kind, rows(piece));
      else if (kind) take(kind, JSON.parse(text.decode(piece)));
      begin += 8 + length;
    }
    bytes = bytes.subarray(begin);
  }
}

function rows(piece) {
  const view = new DataView(piece.buffer);
  const count = view.getUint32(0, true);
  return {
    lost: view.getUint32(4, true),
    times: new Float64Array(piece.buffer, 8, count),
    rows: new Float32Array(piece.buffer, 8 + 8 * count),
  };
}

/** Sends a wish; its answer in words. */
export async function ask(wish) {
  const response = await fetch("ask", { method: "POST", body: JSON.stringify(wish) });
  return { done: response.ok, words: await response.text() };
}
