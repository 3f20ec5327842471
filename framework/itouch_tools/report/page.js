// The page of a session: unpacks the curves, and puts charts, keyboard and print together.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const sessionCharts = new Group();
const contactGroups = [];
const everyChart = [];

// All curves travel as one deflated stream of whole numbers: for each row of a block the low bytes, then the high bytes, of
// the differences between neighbours (itouch_tools.report.session_page says how they are made).
async function inflated(text) {
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Return a row as numbers: its place in the stream, how many, its least value and its step; -32768 is not a number.
function numbers(stream, at, count, low, step) {
  const found = new Float64Array(count);
  let sum = 0;
  for (let i = 0; i < count; i++) {
    sum = (sum + stream[at + i] + 256 * stream[at + count + i]) & 0xffff;
    found[i] = sum === 0x8000 ? NaN : low + step * ((sum << 16 >> 16) + 32767);
  }
  return found;
}

// Curves are unpacked when they are first shown. A contact's times are counted from its begin.
function unpacked(block) {
  if (!block.signals) {
    const rows = block.rows.map(([low, step], row) => numbers(data.stream, block.at + 2 * row * block.count, block.count, low, step));
    block.seconds = rows[0];
    block.signals = rows.slice(1);
  }
  return block;
}

function rowOf(chart) {
  return data.charts.slice(0, chart).reduce((sum, one) => sum + one.signals.length, 0);
}

function rowsOf(chart, block) {
  const first = rowOf(chart);
  return block.signals.slice(first, first + data.charts[chart].signals.length);
}

function ends(seconds) {
  return seconds.length > 1 ? [seconds[0], seconds[seconds.length - 1]] : [0, 1];
}

function draw(chosen) {
  const block = unpacked(chosen < 0 ? data.whole : data.contacts[chosen]), begin = block.begin;
  const seconds = begin === 0 ? block.seconds : block.seconds.map(time => time + begin);
  const whole = unpacked(data.whole), last = whole.begin + ends(whole.seconds)[1];
  const spans = data.spans.map(span => [span[0], span[1] ?? last]);
  const near = chosen < 0 && spans.length ? spans.map(([from, to]) => [from - 0.5, to + 0.5]) : null;
  sessionCharts.charts.forEach((chart, index) => chart.set(seconds, rowsOf(index, block), spans, near));
  sessionCharts.show(ends(seconds));
  const slider = document.getElementById("cursor");
  [slider.min, slider.max, slider.step] = [...sessionCharts.home, (sessionCharts.home[1] - sessionCharts.home[0]) / 1000];
  slider.value = slider.min;
}

function choose(index) {
  document.querySelectorAll("tr.choice").forEach((row, i) => {
    row.classList.toggle("chosen", i === index);
    row.setAttribute("aria-pressed", String(i === index));
  });
  document.getElementById("which").value = String(index);
  document.getElementById("before").disabled = index < 0;
  document.getElementById("after").disabled = index >= data.contacts.length - 1;
  draw(index);
}

function drawContact(index) {
  if (contactGroups[index]) return;
  const block = unpacked(data.contacts[index]), span = data.spans[index], group = contactGroups[index] = new Group();
  const length = span[1] === null ? ends(block.seconds)[1] : span[1] - span[0];
  data.charts.forEach((chart, c) => {
    const drawn = new Chart(document.getElementById(`contact${index}-${c}`), chart, group,
                            { height: 200, axis: "time since the touch [s]", small: true });
    drawn.set(block.seconds, rowsOf(c, block), [[0, length]], null);
    everyChart.push(drawn);
  });
  group.show(ends(block.seconds));
}

// A bar from edge to edge, drawn as one outline: on a logarithmic axis bars of plain widths would not meet.
function drawHistogram(found, index) {
  const x = [], y = [], least = Math.log10(0.5);
  const put = (edge, count) => { x.push(Math.log10(edge)); y.push(count); };
  found.bins.forEach(([low, high, count], i) => {
    if (i === 0 || found.bins[i - 1][1] !== low) put(low, least);
    put(low, Math.log10(count)); put(high, Math.log10(count));
    if (i === found.bins.length - 1 || found.bins[i + 1][0] !== high) put(high, least);
  });
  const group = new Group(), place = document.getElementById(`histogram${index}`);
  const chart = new Chart(place, { title: found.title, unit: "ticks", signals: [{ label: "", wish: false }] }, group,
                          { height: 240, axis: "µs", log: true });
  chart.set(x, [y], [], null);
  everyChart.push(chart);
  group.show(ends(x));
}

function listen() {
  const which = document.getElementById("which");
  which.addEventListener("change", () => choose(Number(which.value)));
  document.getElementById("all").addEventListener("click", () => choose(-1));
  document.getElementById("before").addEventListener("click", () => choose(Math.max(-1, Number(which.value) - 1)));
  document.getElementById("after").addEventListener("click", () => choose(Math.min(data.contacts.length - 1, Number(which.value) + 1)));
  const slider = document.getElementById("cursor");
  slider.addEventListener("input", () => sessionCharts.point(Number(slider.value)));
  sessionCharts.moved = time => { if (time !== null) slider.value = time; };
  document.querySelectorAll("tr.choice").forEach((row, i) => {
    const take = () => {
      if (i >= data.contacts.length) return;
      choose(i);
      which.scrollIntoView({ block: "start" });
    };
    row.addEventListener("click", take);
    row.addEventListener("keydown", event => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); take(); }
    });
  });
  const seen = new IntersectionObserver(entries => entries.filter(e => e.isIntersecting).forEach(entry => {
    seen.unobserve(entry.target);
    drawContact(Number(entry.target.dataset.index));
  }), { rootMargin: "600px" });
  document.querySelectorAll("section.contact").forEach((section, i) => {
    section.dataset.index = String(i);
    seen.observe(section);
  });
}

// On paper: everything is drawn and unfolded, as wide as the paper.
const PAPER = 680;
const onPaper = place => place.classList.contains("small") ? PAPER / 3 - 12 : place.parentElement.classList.contains("grid") ? PAPER / 2 - 12 : PAPER;
window.addEventListener("beforeprint", () => {
  const drawn = data.stream ? Math.min(data.contacts.length, data.drawn) : 0;
  for (let index = 0; index < drawn; index++) drawContact(index);
  document.querySelectorAll("details:not([open])").forEach(d => { d.open = true; d.dataset.folded = "yes"; });
  everyChart.forEach(chart => chart.draw(onPaper(chart.place), chart.place.classList.contains("small") ? 190 : 230));
});
window.addEventListener("afterprint", () => {
  document.querySelectorAll("details[data-folded]").forEach(d => { d.open = false; delete d.dataset.folded; });
  everyChart.forEach(chart => chart.draw());
});
document.getElementById("print").addEventListener("click", () => window.print());

async function begin() {
  data.histograms.forEach(drawHistogram);
  if (!data.charts.length) return;
  data.stream = await inflated(data.packed);
  data.charts.forEach((chart, index) => everyChart.push(
    new Chart(document.getElementById(`chart${index}`), chart, sessionCharts, { height: 260, axis: "time [s]" })));
  listen();
  choose(-1);
}
begin();
