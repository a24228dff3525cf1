"use strict";
// Draws the page's plots. A role ("result", "scaled", a joint) has one colour on every plot.
const COLOURS = ["#2f74c0", "#e07b28", "#2e9a60", "#9a52b8", "#c94545", "#7d8794", "#b59a00", "#1498a8", "#dd7aa6", "#7a5a38"];
const FIXED = { result: 0, scaled: 1, toppra: 2, input: 3, measured: 5, declared: 1, calibrated: 0, baseline: 1,
  move: 0, wait: 5, standby: 6, payload: 2 };

function colourOf(role, roles) {
  if (role in FIXED) return COLOURS[FIXED[role]];
  if (!roles.has(role)) roles.set(role, roles.size);
  return COLOURS[roles.get(role) % COLOURS.length];
}

function styleOf(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function faded(colour) {
  return colour + "26"; // 15 % opaque
}

function tracesOf(chart, roles) {
  const traces = [];
  for (const line of chart.lines) {
    const colour = line.style === "faint" ? styleOf("--dim") : colourOf(line.role, roles);
    if (line.low) {
      const edge = { x: line.x, mode: "lines", line: { width: 0 }, hoverinfo: "skip", showlegend: false, legendgroup: line.name };
      traces.push({ ...edge, y: line.low }, { ...edge, y: line.high, fill: "tonexty", fillcolor: faded(colour) });
    }
    traces.push({
      x: line.x, y: line.y, name: line.name, legendgroup: line.name,
      mode: { points: "markers", dots: "lines+markers" }[line.style] || "lines", type: line.x.length > 3000 ? "scattergl" : "scatter",
      marker: { color: colour, size: line.x.length > 200 ? 3 : 7, opacity: line.x.length > 200 ? 0.45 : 1 },
      line: { color: colour, width: line.style === "faint" ? 1 : 2, dash: line.style === "dash" ? "dash" : "solid" },
    });
  }
  for (const [name, point] of Object.entries(chart.marks)) {
    traces.push({ x: [point[0]], y: [point[1]], name, mode: "markers", marker: { size: 13, symbol: "star", color: styleOf("--mark") } });
  }
  for (const [group, values] of Object.entries(chart.bars)) {
    traces.push({
      type: "bar", orientation: "h", name: group, x: Object.values(values), y: Object.keys(values),
      marker: { color: colourOf(group, roles) },
    });
  }
  for (const [name, values] of Object.entries(chart.spread)) {
    traces.push({
      type: "box", orientation: "h", name, x: values, boxpoints: "all", jitter: 0.4, pointpos: 0, fillcolor: "rgba(0,0,0,0)",
      line: { width: 1 }, marker: { color: colourOf(name, roles), size: 5, opacity: 0.6 },
    });
  }
  for (const kind of kindsOf(chart)) {
    const blocks = chart.blocks.filter((block) => block.kind === kind), names = blocks.map((block) => block.name.replaceAll("<", "&lt;"));
    traces.push({
      type: "bar", orientation: "h", name: kind, base: blocks.map((block) => block.start), x: blocks.map((block) => block.duration),
      y: blocks.map((block) => block.lane), text: names, textposition: "inside", insidetextanchor: "middle", textangle: 0,
      hovertemplate: "%{text}: %{base:.4g} s, %{customdata:.4g} s long", customdata: blocks.map((block) => block.duration),
      marker: { color: colourOf(kind, roles), line: { width: 1, color: styleOf("--paper") } },
    });
  }
  if (chart.waterfall.length) {
    const [names, values] = [0, 1].map((k) => chart.waterfall.map((step) => step[k]));
    const changes = values.slice(1).map((value, k) => value - values[k]), last = values[values.length - 1];
    traces.push({
      type: "waterfall", x: [...names, "the plan"], y: [values[0], ...changes, last],
      measure: ["absolute", ...changes.map(() => "relative"), "total"], textposition: "outside",
      text: [values[0], ...changes, last].map((value) => value.toPrecision(6) / 1 + " J"),
      totals: { marker: { color: COLOURS[0] } }, increasing: { marker: { color: COLOURS[1] } }, decreasing: { marker: { color: COLOURS[2] } },
    });
  }
  return traces;
}

function kindsOf(chart) {
  return [...new Set(chart.blocks.map((block) => block.kind))];
}

function lanesOf(chart) {
  return [...new Set(chart.blocks.map((block) => block.lane))];
}

// Energies that differ by little are seen where the axis does not begin at 0.
function floorOf(chart) {
  const values = chart.waterfall.map((step) => step[1]), low = Math.min(...values), high = Math.max(...values);
  return low > 0 ? [Math.max(0, low - 2 * (high - low)), high + 0.15 * (high - Math.max(0, low - 2 * (high - low)))] : undefined;
}

function namesOf(chart) {
  return [...chart.lines.map((line) => line.name), ...Object.keys(chart.marks), ...Object.keys(chart.bars), ...kindsOf(chart)];
}

// Rows that the legend takes below a plot of this width [px]; its entries are as wide as the widest.
function legendRows(chart, width) {
  const names = namesOf(chart);
  if (names.length < 2) return 0;
  const widest = 48 + 6.5 * Math.max(...names.map((name) => name.length));
  return Math.ceil(names.length / Math.max(1, Math.floor((width - 70) / widest)));
}

function heightOf(chart, width) {
  const groups = Object.keys(chart.bars), labels = new Set(groups.flatMap((group) => Object.keys(chart.bars[group])));
  const inner = chart.blocks.length ? Math.max(90, 34 * lanesOf(chart).length) : groups.length ? Math.max(90, labels.size * (chart.stacked ? 22 : 8 + 16 * groups.length)) : 200;
  return inner + 78 + 19 * legendRows(chart, width);
}

function layoutOf(chart, width) {
  const ink = styleOf("--ink"), rule = styleOf("--rule"), bars = Object.keys(chart.bars).length + Object.keys(chart.spread).length + chart.blocks.length > 0;
  const axis = (title) => ({ title: { text: title, standoff: 8 }, gridcolor: rule, zerolinecolor: rule, linecolor: rule, automargin: true });
  const shapes = [], annotations = [];
  for (const [name, value] of Object.entries(chart.levels)) {
    shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: value, y1: value, line: { color: styleOf("--dim"), width: 1, dash: "dash" } });
    annotations.push({ xref: "paper", x: 1, y: value, text: name, showarrow: false, xanchor: "right", yanchor: "bottom", font: { size: 10 } });
  }
  for (const [name, value] of Object.entries(chart.edges)) {
    shapes.push({ type: "line", yref: "paper", y0: 0, y1: 1, x0: value, x1: value, line: { color: styleOf("--dim"), width: 1, dash: "dash" } });
    annotations.push({ yref: "paper", y: 1, x: value, text: name, showarrow: false, xanchor: "left", yanchor: "bottom", font: { size: 10 } });
  }
  if (chart.timed && chart.closest !== null) {
    shapes.push({ type: "line", yref: "paper", y0: 0, y1: 1, x0: chart.closest, x1: chart.closest, line: { color: styleOf("--near"), width: 1, dash: "dot" } });
  }
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 12, family: "system-ui, sans-serif" },
    margin: { l: 56, r: 12, t: 28, b: 46 + 19 * legendRows(chart, width) }, xaxis: axis(chart.x),
    yaxis: bars ? { ...axis(chart.y), autorange: "reversed", categoryarray: chart.blocks.length ? lanesOf(chart) : undefined } : { ...axis(chart.y), range: chart.waterfall.length ? floorOf(chart) : undefined },
    barmode: chart.blocks.length ? "overlay" : chart.stacked ? "stack" : "group", uniformtext: { minsize: 9, mode: "hide" }, hovermode: bars ? "closest" : (chart.timed ? "x unified" : "closest"),
    hoverlabel: { bgcolor: styleOf("--panel"), bordercolor: rule, font: { color: ink } },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: styleOf("--dim"), activecolor: ink },
    legend: { orientation: "h", x: 0, xref: "container", y: 0, yref: "container", yanchor: "bottom", itemsizing: "constant", font: { size: 11 } },
    showlegend: namesOf(chart).length > 1, shapes, annotations,
  };
}

// One cursor over all plots of time: `show(t)` draws it, `onTime` is told where the pointer is.
class Charts {
  constructor(charts, closest) {
    this.roles = new Map();
    this.charts = charts.map((chart) => ({ ...chart, closest }));
    this.places = [];
    this.onTime = null;
  }

  async draw() {
    for (const place of document.querySelectorAll(".chart")) {
      const chart = this.charts[Number(place.dataset.chart)];
      const plot = document.createElement("div");
      plot.className = "plot";
      place.append(plot);
      plot.style.height = heightOf(chart, place.clientWidth) + "px";
      await Plotly.newPlot(plot, tracesOf(chart, this.roles), layoutOf(chart, place.clientWidth), {
        displaylogo: false, modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
      });
      plot.dataset.drawn = "yes";
      const cursor = document.createElement("div");
      cursor.className = "cursor";
      place.append(cursor);
      this.places.push({ chart, plot, cursor });
      if (chart.timed && !chart.blocks.length) {
        plot.on("plotly_hover", (event) => { if (this.onTime && event.points.length) this.onTime(event.points[0].x); });
      }
    }
  }

  // After a change of colours or of the page's width.
  restyle() {
    for (const { chart, plot } of this.places) {
      const width = plot.parentElement.clientWidth;
      plot.style.height = heightOf(chart, width) + "px";
      Plotly.react(plot, tracesOf(chart, this.roles), { ...layoutOf(chart, width), width: plot.clientWidth, height: plot.clientHeight });
    }
  }

  show(time) {
    for (const { chart, plot, cursor } of this.places) {
      if (!chart.timed || !plot._fullLayout) continue;
      const axis = plot._fullLayout.xaxis, x = axis.d2p(time);
      const inside = x >= 0 && x <= axis._length;
      cursor.style.display = inside ? "block" : "none";
      cursor.style.left = plot.offsetLeft + axis._offset + x + "px";
      cursor.style.top = plot.offsetTop + plot._fullLayout.yaxis._offset + "px";
      cursor.style.height = plot._fullLayout.yaxis._length + "px";
    }
  }
}
