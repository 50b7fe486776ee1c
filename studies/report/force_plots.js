// Units at the instant, slip of every axle, and forces over time; with the train they are all plots of a replay.

function drawRun(run, unit) {
  drawTrain(run);
  drawUnits(run);
  drawSlip(run);
  drawForces(run, unit);
}

function drawInstant(run, k) {
  moveTrain(run, k);
  const now = (name) => run.forces.map((one) => one[name][k]);
  Plotly.restyle("units-plot", { y: ["carries", "force", "limit", "plan"].map(now) }, [0, 1, 2, 3]);
  for (const name of ["slip-plot", "force-plot"]) {
    const place = document.getElementById(name);
    place.dataset.share = k / Math.max(run.instants - 1, 1);
    moveCursor(place);
  }
}

function drawUnits(run) {
  const names = run.forces.map((_, j) => j + 1);
  const most = Math.max(1, ...run.forces.flatMap((one) => [largest(one.force), largest(one.plan)]));
  const [first, last] = unitsShown(run), room = plotWidth("units-plot") / Math.max(last - first + 1, 1);
  const told = (words) => ({ x: names, hovertemplate: `unit %{x}: ${words} %{y:.1f} kN<extra></extra>` });
  const bar = (name, words, width, marker) => ({ name, type: "bar", width, marker, ...told(words) });
  const dash = (name, color, thick) => ({
    name, mode: "markers", ...told(name),
    marker: { symbol: "line-ew-open", color, size: Math.min(34, 0.8 * room), line: { width: thick, color } },
  });
  Plotly.react("units-plot", [
    bar("carries", "the rail carries", 0.8, { color: "#cfe8df", line: { color: CARRIES, width: room < 14 ? 0 : 1 } }),
    bar("delivers", "delivers", 0.45, { color: USED }), dash("limit", LIMIT, 3.5), dash("plan", PLAN, 1.5),
  ], {
    ...PLAIN, height: 330, barmode: "overlay", yaxis: axis("force at the rail [kN]", { range: [0, 1.6 * most] }),
    xaxis: axis("traction unit, 1 = foremost", {
      tick0: 1, dtick: Math.max(1, Math.ceil((last - first + 1) / 16)), range: [first - 0.6, last + 0.6], showgrid: false,
    }),
  }, CALM);
  explain("units-key", [
    ["the rail carries, by the unit's weakest axle", "bar", "#cfe8df"], ["delivers", "bar", USED],
    ["limit", "line thick", LIMIT], ["plan", "line", PLAN],
  ]);
}

function drawSlip(run) {
  const axles = run.drawing.axles.map((_, axle) => axle + 1), place = document.getElementById("slip-plot");
  const [first, last] = axlesShown(run);
  Plotly.react(place, [{
    type: "heatmap", x: run.time, y: axles, zmin: 0, zmax: MOST_SLIP, colorscale: SLIP_COLOURS,
    z: axles.map((axle) => [...slipOverPeak(run, axle - 1)]),
    customdata: axles.map((axle) => [...run.series.slip_velocity.at(axle - 1)]),
    hovertemplate: "axle %{y}, %{x:.2f} s<br>slip %{customdata:.3f} m/s<br>%{z:.1f} times the peak's<extra></extra>",
    colorbar: { title: { text: "slip over<br>peak slip", font: { size: 11 } }, thickness: 10, ticksuffix: "×",
      tickfont: { size: 11 } },
  }], {
    ...PLAIN, height: 330, xaxis: axis("time [s]", { showgrid: false, range: [run.time[0], run.time.at(-1)] }),
    yaxis: axis("axle, 1 = foremost", {
      range: [last + 0.5, first - 0.5], showgrid: false, tick0: 1, dtick: Math.max(1, Math.round((last - first + 1) / 8)),
    }),
  }, CALM);
  chooseByClick(place);
}

function drawForces(run, unit) {
  const sum = (one, name) => {
    const some = unit < 0 ? one.forces : one.forces.slice(unit, unit + 1);
    return Float32Array.from(one.time, (_, k) => some.reduce((total, own) => total + own[name][k], 0));
  };
  const line = (name, y, color, width, dash) => ({
    name, x: run.time, y, mode: "lines", line: { color, width, dash }, hovertemplate: `${name} %{y:.1f} kN<extra></extra>`,
  });
  const delivered = sum(run, "force"), plan = sum(run, "plan");
  const traces = [
    line("rail carries, by the weakest axle of each unit", sum(run, "carries"), CARRIES, 1.3, "dot"),
    line("limit", sum(run, "limit"), LIMIT, 1.6, "solid"), line("plan", plan, PLAN, 1.2, "dash"),
    line(`delivered, ${run.rule}`, delivered, USED, 2, "solid"),
  ];
  if (run.other) {
    traces.push(line(`delivered, ${run.otherRule}`, sum(run.other, "force"), OTHER, 1.4, "dashdot"));
  }
  const least = -largest(delivered.map((one) => -one)), most = Math.max(1, largest(plan), largest(delivered));
  const place = document.getElementById("force-plot");
  Plotly.react(place, traces, {
    ...PLAIN, hovermode: "x unified", height: 360, xaxis: axis("time [s]", { range: [run.time[0], run.time.at(-1)] }),
    yaxis: axis("force at the rail [kN]", { range: [Math.min(0, least), 1.5 * most] }),
  }, CALM);
  chooseByClick(place);
  const kinds = { solid: "line", dot: "line dotted", dash: "line dashed", dashdot: "line dashed" };
  explain("force-key", traces.map((one) => [one.name, kinds[one.line.dash], one.line.color]));
}
