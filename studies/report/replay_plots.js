// The four plots of a replay: the train on the rail, units at the instant, slip of all axles, forces over time.

const SLIP_COLOURS = [[0, "#eef3f7"], [0.25, "#9ecae1"], [0.5, "#fdb863"], [0.75, "#d55e00"], [1, "#5b0f2e"]];
const MOST_SLIP = 4; // times the slip at the curve's peak
const USED = "#0072b2", CARRIES = "#009e73", LIMIT = "#d55e00", PLAN = "#1a1a1a", OTHER = "#7b3294";
const PLAIN = { font: FONT, paper_bgcolor: "#ffffff", plot_bgcolor: "#ffffff", hovermode: "closest", showlegend: false, margin: { l: 60, r: 12, t: 8, b: 45 } };

function drawRun(run, unit, page) {
  drawTrain(run);
  drawUnits(run);
  drawSlip(run);
  drawForces(run, unit, page);
}

function drawInstant(run, k) {
  moveTrain(run, k);
  Plotly.restyle("units-plot", { y: ["carries", "force", "limit", "plan"].map((name) => run.forces.map((one) => one[name][k])) }, [0, 1, 2, 3]);
  for (const name of ["slip-plot", "force-plot"]) {
    const place = document.getElementById(name);
    place.dataset.share = k / (run.instants - 1);
    moveCursor(place);
  }
}

// The line that shows the instant lies over the plot: to draw the plot anew would take longer than a frame
function moveCursor(place) {
  const area = place.querySelector(".nsewdrag")?.getBoundingClientRect(), frame = place.getBoundingClientRect();
  let line = place.querySelector(".cursor");
  if (!area) return;
  if (!line) {
    line = document.createElement("div");
    line.className = "cursor";
    place.append(line);
  }
  line.style.left = `${area.left - frame.left + Number(place.dataset.share ?? 0) * area.width}px`;
  line.style.top = `${area.top - frame.top}px`;
  line.style.height = `${area.height}px`;
}

// What marks mean, as text that flows with the page
function explain(name, entries) {
  document.getElementById(name).replaceChildren(...entries.map(([text, kind, colour]) => {
    const entry = document.createElement("span"), mark = document.createElement("i");
    mark.className = kind;
    mark.style.color = colour;
    entry.append(mark, text);
    return entry;
  }));
}

const largest = (values) => values.reduce((most, one) => (one > most ? one : most), -Infinity);

// Colour of a slip, by the same scale as the plot of all axles
function slipColour(ratio) {
  const share = Math.min(ratio / MOST_SLIP, 1), next = Math.max(1, SLIP_COLOURS.findIndex(([place]) => place >= share));
  const [[from, a], [to, b]] = [SLIP_COLOURS[next - 1], SLIP_COLOURS[next]];
  const mixed = [1, 3, 5].map((k) => {
    const [low, high] = [a, b].map((colour) => parseInt(colour.slice(k, k + 2), 16));
    return Math.round(low + ((high - low) * (share - from)) / (to - from));
  });
  return `rgb(${mixed.join(",")})`;
}

function drawTrain(run) {
  const { drawing } = run, axles = drawing.axles.length;
  const [start, end] = windowOf(run, run.series.position.at(0)[0], drawing.cars.at(-1)[1]);
  const gap = Math.min(3, ...drawing.axles.slice(1).map((place, axle) => place - drawing.axles[axle]));
  const metre = (document.getElementById("train-plot").clientWidth - 72) / (end - start);
  const size = Math.min(13, Math.max(3.5, gap * metre));
  const found = (axle, name, dash) => ({
    name, mode: "lines", hoverinfo: "skip", line: { color: CARRIES, width: 1.6, dash },
    x: run.series.position.at(0).map((x) => x - drawing.axles[axle]), y: run.series.adhesion_limit.at(axle),
  });
  const traces = [
    found(0, "rail as the first axle meets it", "solid"), found(axles - 1, "as the last axle meets it", "dot"),
    { name: "plan", mode: "lines", hoverinfo: "skip", line: { color: PLAN, width: 1.2, dash: "dash" } },
    { name: "used now", type: "bar", width: 1.5, marker: { line: { color: "#555555", width: 0.6 } },
      hovertemplate: "%{text}<br>uses %{y:.3f}<extra></extra>", textposition: "none" },
    { name: "available now", mode: "markers", marker: { symbol: "line-ew-open", size: size + 3, color: CARRIES, line: { width: 2.5 } },
      hovertemplate: "%{text}<br>could use %{y:.3f}<extra></extra>" },
    { name: "cars", mode: "lines", fill: "toself", fillcolor: "#dfe6ec", line: { color: "#5a6772", width: 1.2 }, hoverinfo: "skip", yaxis: "y2", showlegend: false },
    { name: "units", mode: "text", textfont: { size: 12, color: "#1a1a1a" }, hoverinfo: "skip", yaxis: "y2", showlegend: false },
    { name: "axles", mode: "markers", yaxis: "y2", showlegend: false, marker: { size, line: { color: "#333333", width: 1 } },
      hovertemplate: "%{text}<extra></extra>" },
  ];
  let most = 0;
  for (let axle = 0; axle < axles; axle++) most = Math.max(most, largest(run.series.adhesion_limit.at(axle)));
  Plotly.react("train-plot", traces, {
    ...PLAIN, height: 410,
    xaxis: { ...GRID, title: { text: "place along the line [m] →" }, anchor: "y" },
    yaxis: { ...GRID, title: { text: "coefficient [–]" }, domain: [0, 0.7], range: [0, 1.08 * most] },
    yaxis2: { domain: [0.76, 1], range: [-0.7, 3.6], visible: false, fixedrange: true },
  }, CALM);
  explain("train-key", [["the rail as the first axle meets it", "line", CARRIES], ["as the last axle meets it", "line dotted", CARRIES],
    ["available at each axle now", "line thick", CARRIES], ["used by each axle now", "bar", SLIP_COLOURS[1][1]], ["plan", "line dashed", PLAN]]);
}

function moveTrain(run, k) {
  const { drawing, series } = run, front = series.position.at(0)[k], expected = series.expected.at(0)[k];
  const places = drawing.axles.map((behind) => front - behind), last = drawing.cars.at(-1)[1];
  const ratio = places.map((_, axle) => Math.abs(series.slip_velocity.at(axle)[k]) / Math.max(series.peak_slip.at(axle)[k], 1e-3));
  const colours = ratio.map(slipColour);
  const used = places.map((_, axle) => (run.way[k] * series.rail_force.at(axle)[k]) / Math.max(series.axle_load.at(axle)[k], 1));
  const words = places.map((_, axle) => {
    const unit = drawing.axle_unit[axle], slip = series.slip_velocity.at(axle)[k];
    return `axle ${axle + 1}, ${unit < 0 ? "no motor" : `unit ${unit + 1}`}<br>slip ${slip.toFixed(3)} m/s`;
  });
  const cars = { x: [], y: [] }, names = { x: [], y: [], text: [] };
  for (const [start, end] of drawing.cars) {
    const [a, b] = [front - start - 0.4, front - end + 0.4];
    cars.x.push(b, a, a, b, b, null);
    cars.y.push(1, 1, 3.2, 3.2, 1, null);
  }
  const span = windowOf(run, front, last);
  const apart = (24 * (span[1] - span[0])) / document.getElementById("train-plot").clientWidth;
  let before = Infinity;
  for (const [unit, place] of middles(drawing)) {
    if (Math.abs(place - before) < apart) continue; // numbers that would lie over each other
    before = place;
    names.x.push(front - place);
    names.y.push(2.05);
    names.text.push(String(unit + 1));
  }
  const wheels = places.map(() => 0.4);
  Plotly.update("train-plot", {
    x: [span, places, places, cars.x, names.x, places],
    y: [[expected, expected], used, places.map((_, axle) => series.adhesion_limit.at(axle)[k]), cars.y, names.y, wheels],
    text: [null, words, words, null, names.text, words],
    "marker.color": [undefined, colours, CARRIES, undefined, undefined, colours],
  }, { "xaxis.range": span }, [2, 3, 4, 5, 6, 7]);
}

// Stretch of line that is shown: all of the run where the train is large in it, else what surrounds the train
function windowOf(run, front, length) {
  const position = run.series.position.at(0), from = position[0] - length, to = position.at(-1);
  if (to - from < 2.5 * length) return [from - 5, to + 5];
  return [front - 1.35 * length, front + 0.35 * length];
}

function middles(drawing) {
  const places = new Map();
  drawing.axle_unit.forEach((unit, axle) => unit >= 0 && places.set(unit, [...(places.get(unit) ?? []), drawing.axles[axle]]));
  return [...places].map(([unit, some]) => [unit, some.reduce((a, b) => a + b, 0) / some.length]);
}

function drawUnits(run) {
  const names = run.forces.map((_, j) => j + 1);
  const most = Math.max(1, ...run.forces.flatMap((one) => [largest(one.force), largest(one.plan)]));
  const bar = (name, symbol, colour, dash) => ({ name, x: names, mode: "markers",
    marker: { symbol, color: colour, size: Math.min(34, 460 / names.length), line: { width: dash, color: colour } },
    hovertemplate: `unit %{x}: ${name} %{y:.1f} kN<extra></extra>` });
  Plotly.react("units-plot", [
    { name: "rail carries, by the weakest axle", x: names, type: "bar", marker: { color: "#cfe8df", line: { color: CARRIES, width: 1 } }, width: 0.8,
      hovertemplate: "unit %{x}: the rail carries %{y:.1f} kN<extra></extra>" },
    { name: "delivers", x: names, type: "bar", width: 0.45, marker: { color: USED }, hovertemplate: "unit %{x}: delivers %{y:.1f} kN<extra></extra>" },
    bar("limit", "line-ew-open", LIMIT, 3.5), bar("plan", "line-ew-open", PLAN, 1.5),
  ], {
    ...PLAIN, height: 330, barmode: "overlay",
    xaxis: { ...GRID, title: { text: "traction unit, 1 = foremost" }, tick0: 1, dtick: Math.ceil(names.length / 16), range: [0.4, names.length + 0.6], showgrid: false },
    yaxis: { ...GRID, title: { text: "force at the rail [kN]" }, range: [0, 1.6 * most] },
  }, CALM);
  explain("units-key", [["the rail carries, by the unit's weakest axle", "bar", "#cfe8df"], ["delivers", "bar", USED], ["limit", "line thick", LIMIT], ["plan", "line", PLAN]]);
}

function drawSlip(run) {
  const axles = run.drawing.axles.map((_, axle) => axle + 1);
  const place = document.getElementById("slip-plot");
  Plotly.react(place, [{
    type: "heatmap", x: run.time, y: axles, z: axles.map((axle) => [...slipOverPeak(run, axle - 1)]), zmin: 0, zmax: MOST_SLIP, colorscale: SLIP_COLOURS,
    customdata: axles.map((axle) => [...run.series.slip_velocity.at(axle - 1)]),
    hovertemplate: "axle %{y}, %{x:.2f} s<br>slip %{customdata:.3f} m/s<br>%{z:.1f} times the peak's<extra></extra>",
    colorbar: { title: { text: "slip over<br>peak slip", font: { size: 11 } }, thickness: 10, ticksuffix: "×", tickfont: { size: 11 } },
  }], {
    ...PLAIN, height: 330,
    xaxis: { ...GRID, title: { text: "time [s]" }, showgrid: false, range: [run.time[0], run.time.at(-1)] }, yaxis: { ...GRID, title: { text: "axle, 1 = foremost" }, autorange: "reversed", showgrid: false, tick0: 1, dtick: Math.max(1, Math.round(axles.length / 8)) },
  }, CALM);
  chooseByClick(place);
}

function drawForces(run, unit, page) {
  const some = (one) => (unit < 0 ? one.forces : one.forces.slice(unit, unit + 1));
  const sum = (one, name) => Float32Array.from(one.time, (_, k) => some(one).reduce((total, own) => total + own[name][k], 0));
  const line = (name, y, colour, width, dash) => ({ name, x: run.time, y, mode: "lines", line: { color: colour, width, dash },
    hovertemplate: `${name} %{y:.1f} kN<extra></extra>` });
  const delivered = sum(run, "force"), plan = sum(run, "plan");
  const traces = [
    line("rail carries, by the weakest axle of each unit", sum(run, "carries"), CARRIES, 1.3, "dot"), line("limit", sum(run, "limit"), LIMIT, 1.6, "solid"),
    line("plan", plan, PLAN, 1.2, "dash"), line(`delivered, ${run.rule}`, delivered, USED, 2, "solid"),
  ];
  if (run.other) traces.push(line(`delivered, ${run.otherRule}`, sum(run.other, "force"), OTHER, 1.4, "dashdot"));
  const place = document.getElementById("force-plot");
  const most = Math.max(1, largest(plan), largest(delivered));
  Plotly.react(place, traces, {
    ...PLAIN, hovermode: "x unified", height: 360,
    xaxis: { ...GRID, title: { text: "time [s]" }, range: [run.time[0], run.time.at(-1)] },
    yaxis: { ...GRID, title: { text: "force at the rail [kN]" }, range: [Math.min(0, -largest(delivered.map((one) => -one))), 1.5 * most] },
  }, CALM);
  chooseByClick(place);
  const kinds = { solid: "line", dot: "line dotted", dash: "line dashed", dashdot: "line dashed" };
  explain("force-key", traces.map((one) => [one.name, kinds[one.line.dash], one.line.color]));
}

// A click into a plot over time chooses the instant
function chooseByClick(place) {
  if (place.dataset.listens) return;
  place.dataset.listens = "yes";
  place.on("plotly_afterplot", () => moveCursor(place));
  place.on("plotly_click", (event) => document.dispatchEvent(new CustomEvent("instant", { detail: event.points[0].x })));
}
