// The train on the rail: above, cars and axles; below, the adhesion that each axle finds and uses.

function drawTrain(run) {
  const { drawing, series } = run, axles = drawing.axles.length;
  const [start, end] = windowOf(run, series.position.at(0)[0]);
  const gap = Math.min(3, ...drawing.axles.slice(1).map((place, axle) => place - drawing.axles[axle]));
  const metre = plotWidth("train-plot") / (end - start);
  const size = Math.min(13, Math.max(3.5, gap * metre));
  const line = (color, width, dash) => ({ mode: "lines", hoverinfo: "skip", line: { color, width, dash } });
  const met = (axle, dash) => ({
    ...line(CARRIES, 1.6, dash),
    x: series.position.at(0).map((x) => x - drawing.axles[axle]), y: series.adhesion_limit.at(axle),
  });
  const traces = [
    met(0, "solid"), met(axles - 1, "dot"), line(PLAN, 1.2, "dash"),
    { name: "used", type: "bar", width: BAR_LENGTH, marker: { line: { color: "#555555", width: 0.6 } },
      hovertemplate: "%{text}<br>uses %{y:.3f}<extra></extra>", textposition: "none" },
    { name: "available", mode: "markers", hovertemplate: "%{text}<br>could use %{y:.3f}<extra></extra>",
      marker: { symbol: "line-ew-open", size: size + 3, color: CARRIES, line: { width: 2.5 } } },
    { ...line("#5a6772", 1.2, "solid"), name: "cars", fill: "toself", fillcolor: "#dfe6ec", yaxis: "y2" },
    { name: "units", mode: "text", textfont: { size: 12, color: "#1a1a1a" }, hoverinfo: "skip", yaxis: "y2" },
    { name: "axles", mode: "markers", marker: { size, line: { color: "#333333", width: 1 } }, yaxis: "y2",
      hovertemplate: "%{text}<extra></extra>" },
  ];
  let most = 0;
  for (let axle = 0; axle < axles; axle++) most = Math.max(most, largest(series.adhesion_limit.at(axle)));
  Plotly.react("train-plot", traces, {
    ...PLAIN, height: 410, xaxis: axis("place along the line [m] →", { anchor: "y" }),
    yaxis: axis("coefficient [–]", { domain: [0, 0.7], range: [0, 1.08 * most] }),
    yaxis2: { domain: [0.76, 1], range: [-0.7, 3.6], visible: false, fixedrange: true },
  }, CALM);
  explain("train-key", [
    ["the rail as the first axle meets it", "line", CARRIES], ["as the last axle meets it", "line dotted", CARRIES],
    ["available at each axle now", "line thick", CARRIES], ["used by each axle now", "bar", SLIP_COLOURS[1][1]],
    ["plan", "line dashed", PLAN],
  ]);
}

function moveTrain(run, k) {
  const { drawing, series } = run, front = series.position.at(0)[k], expected = series.expected.at(0)[k];
  const places = drawing.axles.map((behind) => front - behind);
  const now = (name) => places.map((_, axle) => series[name].at(axle)[k]);
  const slip = now("slip_velocity"), peak = now("peak_slip"), force = now("rail_force"), load = now("axle_load");
  const colours = slip.map((value, axle) => slipColour(Math.abs(value) / Math.max(peak[axle], 1e-3)));
  const used = force.map((value, axle) => (run.way[k] * value) / Math.max(load[axle], 1));
  const words = slip.map((value, axle) => {
    const unit = drawing.axle_unit[axle];
    return `axle ${axle + 1}, ${unit < 0 ? "no motor" : `unit ${unit + 1}`}<br>slip ${value.toFixed(3)} m/s`;
  });
  const span = windowOf(run, front);
  const cars = outlines(drawing, front), units = unitNumbers(drawing, front, span);
  Plotly.update("train-plot", {
    x: [span, places, places, cars.x, units.x, places],
    y: [[expected, expected], used, now("adhesion_limit"), cars.y, units.y, places.map(() => 0.4)],
    text: [null, words, words, null, units.text, words],
    "marker.color": [undefined, colours, CARRIES, undefined, undefined, colours],
  }, { "xaxis.range": span }, [2, 3, 4, 5, 6, 7]);
}

function outlines(drawing, front) {
  const cars = { x: [], y: [] };
  for (const [start, end] of drawing.cars) {
    const [a, b] = [front - start - 0.4, front - end + 0.4];
    cars.x.push(b, a, a, b, b, null);
    cars.y.push(1, 1, 3.2, 3.2, 1, null);
  }
  return cars;
}

// Numbers of the units over the middle of their axles, but for those that would lie over each other
function unitNumbers(drawing, front, span) {
  const places = new Map(), found = { x: [], y: [], text: [] };
  drawing.axle_unit.forEach((unit, axle) => {
    if (unit >= 0) places.set(unit, [...(places.get(unit) ?? []), drawing.axles[axle]]);
  });
  const apart = (24 * (span[1] - span[0])) / document.getElementById("train-plot").clientWidth;
  let before = Infinity;
  for (const [unit, some] of places) {
    const middle = some.reduce((a, b) => a + b, 0) / some.length;
    if (Math.abs(middle - before) < apart) continue;
    before = middle;
    found.x.push(front - middle);
    found.y.push(2.05);
    found.text.push(String(unit + 1));
  }
  return found;
}
