"use strict";
// Charts of a page. They are SVG: paper and a dark screen need no second drawing, only other colours.
const SVG = "http://www.w3.org/2000/svg";
const EDGE = { left: 54, right: 10, top: 6, bottom: 34 };

function added(parent, name, attributes = {}, text = "") {
  const node = document.createElementNS(name === "svg" || parent.namespaceURI === SVG ? SVG : parent.namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text) node.textContent = text;
  return parent.appendChild(node);
}

// Places of grid lines, about `count` of them, at 1, 2 or 5 times a power of ten.
function ticksOf(low, high, count) {
  const rough = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find(factor => factor * power >= rough) ?? 10);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) found.push(n * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function decades(low, high) {
  const found = [];
  for (let n = Math.ceil(low - 1e-9); n <= high + 1e-9; n++) found.push(n);
  return { found, digits: 0 };
}

const told = value => Number.isFinite(value) ? String(Number(value.toPrecision(4))) : "–";

// The first sample that is not before a time; `seconds` rise.
function placeOf(seconds, time) {
  let low = 0, high = seconds.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (seconds[middle] < time) low = middle + 1; else high = middle;
  }
  return low;
}

// Charts that share their axis of time: a range that is chosen in one holds in all, and so does the cursor.
class Group {
  constructor() { this.charts = []; this.home = [0, 1]; this.range = [0, 1]; this.cursor = null; this.moved = () => {}; }

  show(home) { this.home = home; this.zoom(home); }

  zoom(range) {
    this.range = range[1] - range[0] > 1e-4 ? range : this.home;
    this.charts.forEach(chart => chart.draw());
  }

  point(time) {
    this.cursor = time;
    this.charts.forEach(chart => chart.point(time));
    this.moved(time);
  }
}

class Chart {
  // `place`: an element; `chart`: title, unit and signals; `look`: height, axis (words under it), log (both axes), small.
  constructor(place, chart, group, look) {
    Object.assign(this, { place, chart, group, look, seconds: [], values: [], shaded: [], scaled: null, hidden: new Set() });
    const head = added(place, "div", { class: "charthead" });
    added(head, "b", {}, chart.unit ? `${chart.title} [${chart.unit}]` : chart.title);
    this.beyond = added(head, "span", { class: "soft beyond" });
    const names = added(head, "span", { class: "names" });
    this.told = chart.signals.map((signal, index) => {
      const several = chart.signals.length > 1, chosen = several && !look.small;
      const name = added(names, chosen ? "button" : "span", { class: "name", title: signal.doc || signal.label });
      if (several) added(name, "i", { class: `swatch c${index % 7}${signal.wish ? " wish" : ""}` });
      added(name, "span", {}, several ? signal.label : "");
      if (chosen) {
        name.type = "button";
        name.setAttribute("aria-pressed", "true");
        name.addEventListener("click", () => this.toggle(index, name));
      }
      return added(name, "span", { class: "value" });
    });
    this.svg = added(place, "svg", { role: "img", "aria-label": chart.title, height: look.height });
    place.chart = this;
    group.charts.push(this);
    if (!look.log) this.listen();
    new ResizeObserver(() => { if (this.place.clientWidth !== this.width) this.draw(); }).observe(place);
  }

  // `scaled`: the times [from, to] whose samples set the vertical axis; null: all of them.
  set(seconds, values, shaded, scaled) {
    Object.assign(this, { seconds, values, shaded, scaled });
  }

  toggle(index, name) {
    if (!this.hidden.delete(index)) this.hidden.add(index);
    name.setAttribute("aria-pressed", String(!this.hidden.has(index)));
    this.draw();
  }

  get shown() { return this.values.map((_, i) => i).filter(i => !this.hidden.has(i)); }

  // Least and greatest value of what is shown, and of what sets the axis.
  extents() {
    const all = [Infinity, -Infinity], set = [Infinity, -Infinity];
    const taken = this.scaled === null ? null : time => this.scaled.some(([from, to]) => time >= from && time <= to);
    for (const index of this.shown) {
      const row = this.values[index];
      for (let i = 0; i < row.length; i++) {
        const value = row[i];
        if (!Number.isFinite(value)) continue;
        if (value < all[0]) all[0] = value;
        if (value > all[1]) all[1] = value;
        if (taken === null || taken(this.seconds[i])) {
          if (value < set[0]) set[0] = value;
          if (value > set[1]) set[1] = value;
        }
      }
    }
    return { all, set: set[0] <= set[1] ? set : all };
  }

  draw(width = this.place.clientWidth, height = this.look.height) {
    this.width = this.place.clientWidth;
    this.svg.replaceChildren();
    if (width < 80) return;
    this.svg.setAttribute("width", width);
    this.svg.setAttribute("height", height);
    this.box = { x: EDGE.left, y: EDGE.top, w: width - EDGE.left - EDGE.right, h: height - EDGE.top - EDGE.bottom };
    const { all, set } = this.extents(), range = this.group.range;
    let [low, high] = set[0] <= set[1] ? set : [0, 1];
    // where all values are the same, the axis is as high as in the window: the numbers at a finer one would be cut
    const gap = this.look.log ? 0 : 0.06 * (high - low) || Math.max(0.05 * Math.abs(high), 0.5 * this.chart.least || 0.5);
    low -= gap; high += gap;
    this.x = value => this.box.x + (value - range[0]) / (range[1] - range[0]) * this.box.w;
    this.y = value => this.box.y + (high - value) / (high - low) * this.box.h;
    const far = [...(all[0] < low ? [`down to ${told(all[0])}`] : []), ...(all[1] > high ? [`up to ${told(all[1])}`] : [])];
    this.beyond.textContent = far.length ? `outside the touches ${far.join(", ")}` : "";
    this.axes(range, low, high);
    const id = `clip-${this.place.id}`, clip = added(added(this.svg, "defs"), "clipPath", { id });
    added(clip, "rect", { x: this.box.x, y: this.box.y, width: this.box.w, height: this.box.h });
    const inside = added(this.svg, "g", { "clip-path": `url(#${id})` });
    for (const [from, to] of this.shaded) {
      const a = this.x(from), b = this.x(to);
      added(inside, "rect", { class: "touch", x: a, y: this.box.y, width: Math.max(1, b - a), height: this.box.h });
    }
    const order = [...this.shown].sort((a, b) => Number(this.chart.signals[a].wish) - Number(this.chart.signals[b].wish));
    for (const index of order) {  // wishes on top
      const wish = this.chart.signals[index].wish;
      added(inside, "path", { class: `curve c${index % 7}${wish ? " wish" : ""}${this.look.log ? " filled" : ""}`,
                              d: this.path(this.values[index], range) });
    }
    this.line = added(this.svg, "line", { class: "cursor", y1: this.box.y, y2: this.box.y + this.box.h, visibility: "hidden" });
    this.point(this.group.cursor);
  }

  path(row, range) {
    const first = Math.max(0, placeOf(this.seconds, range[0]) - 1);
    let text = "", pen = "M";
    for (let i = first; i < row.length; i++) {
      if (Number.isFinite(row[i])) {
        text += `${pen}${this.x(this.seconds[i]).toFixed(1)} ${this.y(row[i]).toFixed(1)}`;
        pen = "L";
      } else pen = "M";
      if (this.seconds[i] > range[1]) break;
    }
    return text || "M0 0";
  }

  axes(range, low, high) {
    const { x, y, w, h } = this.box, log = this.look.log;
    const across = log ? decades(...range) : ticksOf(...range, w / 90), up = log ? decades(low, high) : ticksOf(low, high, h / 42);
    const words = (value, digits) => log ? told(10 ** value) : value.toFixed(digits);
    for (const value of across.found) {
      added(this.svg, "line", { class: "grid", x1: this.x(value), x2: this.x(value), y1: y, y2: y + h });
      added(this.svg, "text", { class: "tick", x: this.x(value), y: y + h + 14, "text-anchor": "middle" }, words(value, across.digits));
    }
    for (const value of up.found) {
      added(this.svg, "line", { class: value === 0 && !log ? "zero" : "grid", x1: x, x2: x + w, y1: this.y(value), y2: this.y(value) });
      added(this.svg, "text", { class: "tick", x: x - 6, y: this.y(value) + 4, "text-anchor": "end" }, words(value, up.digits));
    }
    added(this.svg, "text", { class: "tick", x: x + w / 2, y: y + h + 29, "text-anchor": "middle" }, this.look.axis);
  }

  // Put the cursor to a time, and say the values there; null takes it away.
  point(time) {
    const there = time !== null && time >= this.group.range[0] && time <= this.group.range[1] && this.seconds.length > 0;
    if (this.line) {
      this.line.setAttribute("visibility", there ? "visible" : "hidden");
      if (there) { this.line.setAttribute("x1", this.x(time)); this.line.setAttribute("x2", this.x(time)); }
    }
    if (this.look.log) return;
    const place = there ? Math.min(this.seconds.length - 1, placeOf(this.seconds, time)) : -1;
    this.told.forEach((value, i) => { value.textContent = place < 0 || !this.values[i] ? "" : ` ${told(this.values[i][place])}`; });
  }

  listen() {
    const time = event => {
      const at = event.clientX - this.svg.getBoundingClientRect().left;
      return this.group.range[0] + (at - this.box.x) / this.box.w * (this.group.range[1] - this.group.range[0]);
    };
    let begin = null, marked = null;
    this.svg.addEventListener("pointerdown", event => {
      if (event.pointerType !== "mouse" || event.button !== 0) return;
      begin = time(event);
      this.svg.setPointerCapture(event.pointerId);
      marked = added(this.svg, "rect", { class: "marked", y: this.box.y, height: this.box.h, x: 0, width: 0 });
    });
    this.svg.addEventListener("pointermove", event => {
      const now = time(event);
      this.group.point(now);
      if (begin !== null) {
        marked.setAttribute("x", this.x(Math.min(begin, now)));
        marked.setAttribute("width", Math.abs(this.x(now) - this.x(begin)));
      }
    });
    this.svg.addEventListener("pointerup", event => {
      if (begin === null) return;
      const from = Math.max(this.group.range[0], Math.min(begin, time(event)));
      const to = Math.min(this.group.range[1], Math.max(begin, time(event)));
      begin = null;
      marked.remove();
      if (this.x(to) - this.x(from) > 4) this.group.zoom([from, to]);
    });
    this.svg.addEventListener("pointerleave", () => { if (begin === null) this.group.point(null); });
    this.svg.addEventListener("dblclick", () => this.group.zoom(this.group.home));
  }
}
