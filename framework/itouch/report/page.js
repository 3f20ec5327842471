"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const settings = { responsive: true, displaylogo: false, displayModeBar: window.innerWidth > 700 ? "hover" : false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };

function layout(chart, range) {
  return {
    title: { text: `${chart.title} [${chart.unit}]`, font: { size: 14 }, x: 0, xanchor: "left", y: 0.97, yanchor: "top" },
    margin: { l: 56, r: 12, t: 58, b: 40 }, height: 300, hovermode: "x unified",
    xaxis: { title: { text: "time [s]" }, range: range, zeroline: false },
    yaxis: { zeroline: true, zerolinecolor: "#c4cad1", automargin: true },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", xanchor: "left" },
    showlegend: chart.signals.length > 1, font: { family: "inherit", color: "#1c2530" },
    paper_bgcolor: "#fff", plot_bgcolor: "#fff",
  };
}

function part(range) {
  if (!range) return [0, data.times.length];
  let first = data.times.findIndex(t => t >= range[0]);
  let last = data.times.findIndex(t => t > range[1]);
  if (first < 0) first = 0;
  if (last < 0) last = data.times.length;
  return [Math.max(0, first - 1), last];
}

function draw(range) {
  const [first, last] = part(range);
  const times = data.times.slice(first, last);
  data.charts.forEach((chart, index) => {
    const traces = chart.signals.map(signal => ({
      x: times, y: signal.values.slice(first, last), name: signal.label, mode: "lines",
      line: { color: signal.colour, width: 1.4 }, type: "scatter",
    }));
    const shape = layout(chart, range);
    shape.shapes = data.spans.map(span => ({
      type: "rect", xref: "x", yref: "paper", x0: span[0], x1: span[1], y0: 0, y1: 1,
      fillcolor: "#8fb8de", opacity: 0.16, line: { width: 0 },
    }));
    Plotly.react(`chart${index}`, traces, shape, settings);
  });
}

function choose(index) {
  const contact = index < 0 ? null : data.spans[index];
  document.querySelectorAll("tr.choice").forEach((row, i) => row.classList.toggle("chosen", i === index));
  document.getElementById("which").value = String(index);
  draw(contact ? [contact[0] - 0.5, contact[1] + 0.5] : null);
}

if (data.charts.length) {
  draw(null);
  document.getElementById("which").addEventListener("change", event => choose(Number(event.target.value)));
  document.getElementById("all").addEventListener("click", () => choose(-1));
  document.querySelectorAll("tr.choice").forEach((row, i) => {
    row.addEventListener("click", () => choose(i));
    row.addEventListener("keydown", event => { if (event.key === "Enter") choose(i); });
  });
}
data.histograms.forEach((found, index) => {
  Plotly.newPlot(`histogram${index}`, [{ x: found.edges, y: found.counts, type: "bar", marker: { color: "#0072b2" } }], {
    title: { text: found.title, font: { size: 14 }, x: 0, xanchor: "left" }, height: 260, bargap: 0.02,
    margin: { l: 56, r: 12, t: 34, b: 44 }, xaxis: { title: { text: found.unit }, type: "log" },
    yaxis: { type: "log", title: { text: "ticks" } }, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
  }, settings);
});
document.getElementById("print").addEventListener("click", () => window.print());
