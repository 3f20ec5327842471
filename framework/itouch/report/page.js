"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const INK = "#1c2530", GRID = "#e3e7eb";
const settings = { responsive: true, displaylogo: false, displayModeBar: window.innerWidth > 700 ? "hover" : false,
                   modeBarButtonsToRemove: ["lasso2d", "select2d"] };
const still = { staticPlot: true, responsive: true };

function numbers(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// Curves are unpacked when they are first shown. A contact's times are counted from its begin.
function unpacked(block) {
  if (!block.signals) {
    block.seconds = numbers(block.times);
    block.signals = block.values.map(numbers);
  }
  return block;
}

function rowOf(chart) {
  return data.charts.slice(0, chart).reduce((sum, c) => sum + c.signals.length, 0);
}

function traces(index, block, origin) {
  const { seconds, signals } = unpacked(block), first = rowOf(index);
  const times = origin === 0 ? seconds : Float64Array.from(seconds, t => t + origin);
  const made = data.charts[index].signals.map((signal, i) => ({
    x: times, y: signals[first + i], name: signal.label, mode: "lines", type: "scatter", connectgaps: false,
    line: { color: signal.colour, width: 1.4, dash: signal.wish ? "dash" : "solid" },
  }));
  return [...made.filter(t => t.line.dash === "solid"), ...made.filter(t => t.line.dash !== "solid")]; // wishes on top
}

function look(title, height, small) {
  return {
    title: { text: title, font: { size: small ? 12 : 14 }, x: 0, xanchor: "left", y: 0.98, yanchor: "top" },
    margin: { l: small ? 44 : 56, r: 12, t: small ? 24 : 58, b: small ? 34 : 40 }, height: height,
    font: { family: "system-ui, sans-serif", color: INK, size: small ? 10 : 12 }, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    xaxis: { zeroline: false, gridcolor: GRID }, yaxis: { zeroline: true, zerolinecolor: "#aab2bb", gridcolor: GRID, automargin: true },
  };
}

function spans(from, offset) {
  return data.spans.map(span => ({
    type: "rect", xref: "x", yref: "paper", x0: span[0] - offset, x1: (span[1] ?? from) - offset, y0: 0, y1: 1,
    fillcolor: "#8fb8de", opacity: 0.16, line: { width: 0 },
  }));
}

function draw(chosen) {
  const block = chosen < 0 ? data.whole : data.contacts[chosen];
  const seconds = unpacked(block).seconds, begin = block.begin;
  const range = seconds.length ? [begin + seconds[0], begin + seconds[seconds.length - 1]] : [0, 1];
  const whole = unpacked(data.whole).seconds, end = whole.length ? data.whole.begin + whole[whole.length - 1] : 0;
  data.charts.forEach((chart, index) => {
    const layout = look(`${chart.title} [${chart.unit}]`, 300, false);
    Object.assign(layout.xaxis, { title: { text: "time [s]" }, range: range });
    Object.assign(layout, {
      hovermode: "x unified", shapes: spans(end, 0), showlegend: chart.signals.length > 1,
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", xanchor: "left" },
    });
    Plotly.react(`chart${index}`, traces(index, block, begin), layout, settings);
  });
}

function choose(index) {
  document.querySelectorAll("tr.choice").forEach((row, i) => {
    row.classList.toggle("chosen", i === index);
    row.setAttribute("aria-pressed", String(i === index));
  });
  const which = document.getElementById("which");
  which.value = String(index);
  document.getElementById("before").disabled = index < 0;
  document.getElementById("after").disabled = index >= data.contacts.length - 1;
  draw(index);
}

function drawContact(index) {
  const block = unpacked(data.contacts[index]), span = data.spans[index];
  data.charts.forEach((chart, c) => {
    const place = document.getElementById(`contact${index}-${c}`);
    if (place.dataset.drawn) return;
    place.dataset.drawn = "yes";
    const layout = look(`${chart.title} [${chart.unit}]`, 200, true);
    const last = block.seconds.length ? block.seconds[block.seconds.length - 1] : 1;
    Object.assign(layout.xaxis, { title: { text: "time since the touch [s]", standoff: 4 }, range: [block.seconds[0] ?? 0, last] });
    layout.shapes = [{ type: "line", xref: "x", yref: "paper", x0: 0, x1: 0, y0: 0, y1: 1, line: { color: "#8fa3b5", width: 1, dash: "dot" } }];
    if (span[1] !== null) layout.shapes.push({ ...layout.shapes[0], x0: span[1] - span[0], x1: span[1] - span[0] });
    layout.showlegend = chart.signals.length > 1;
    layout.legend = { x: 1, xanchor: "right", y: 1, bgcolor: "rgba(255,255,255,0.7)", font: { size: 9 } };
    Plotly.newPlot(place, traces(c, block, 0), layout, still);
  });
}

function drawHistogram(found, index) {
  const layout = look(found.title, 260, false);
  layout.margin.t = 34;
  Object.assign(layout.xaxis, { title: { text: "µs" }, type: "log" });
  Object.assign(layout.yaxis, { title: { text: "ticks" }, type: "log", zeroline: false });
  // a bar from edge to edge, drawn as one outline: on a logarithmic axis bars of plain widths would not meet
  const x = [], y = [];
  found.bins.forEach(([low, high, count], i) => {
    if (i === 0 || found.bins[i - 1][1] !== low) { x.push(low); y.push(0.5); }
    x.push(low, high); y.push(count, count);
    if (i === found.bins.length - 1 || found.bins[i + 1][0] !== high) { x.push(high); y.push(0.5); }
  });
  layout.yaxis.range = [Math.log10(0.5), Math.log10(Math.max(...found.bins.map(bin => bin[2])) * 1.5)];
  Plotly.newPlot(`histogram${index}`, [{ x: x, y: y, mode: "lines", type: "scatter", fill: "tozeroy",
    line: { color: "#0072b2", width: 1 }, hovertemplate: "%{x:.4g} µs: %{y} ticks<extra></extra>" }], layout, settings);
}

const drawn = data.charts.length ? Math.min(data.contacts.length, data.drawn) : 0;

if (data.charts.length) {
  choose(-1);
  const which = document.getElementById("which");
  which.addEventListener("change", () => choose(Number(which.value)));
  document.getElementById("all").addEventListener("click", () => choose(-1));
  document.getElementById("before").addEventListener("click", () => choose(Math.max(-1, Number(which.value) - 1)));
  document.getElementById("after").addEventListener("click", () => choose(Math.min(data.contacts.length - 1, Number(which.value) + 1)));
  document.querySelectorAll("tr.choice").forEach((row, i) => {
    const take = () => {
      if (i >= data.contacts.length) return;
      choose(i);
      document.getElementById("which").scrollIntoView({ block: "start" });
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
data.histograms.forEach(drawHistogram);

// On paper: everything is drawn and unfolded, as wide as the paper.
const PAPER = 680;
function eachPlot(change) {
  document.querySelectorAll(".js-plotly-plot").forEach(plot => Plotly.relayout(plot, change(plot)));
}
window.addEventListener("beforeprint", () => {
  for (let index = 0; index < drawn; index++) drawContact(index);
  document.querySelectorAll("details:not([open])").forEach(d => { d.open = true; d.dataset.folded = "yes"; });
  eachPlot(plot => plot.classList.contains("small") ? { width: PAPER / 3 - 12 }
    : { width: plot.parentElement.classList.contains("grid") ? PAPER / 2 - 12 : PAPER, height: 230 });
});
window.addEventListener("afterprint", () => {
  document.querySelectorAll("details[data-folded]").forEach(d => { d.open = false; delete d.dataset.folded; });
  eachPlot(plot => plot.classList.contains("small") ? { width: null, autosize: true }
    : { width: null, height: plot.id.startsWith("chart") ? 300 : 260, autosize: true });
});
document.getElementById("print").addEventListener("click", () => window.print());
