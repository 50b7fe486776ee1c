// Gain of each rule over `alone` by headroom, one mark per event; the random events of the study lie behind, small.

function startHeadroom(page) {
  const place = document.getElementById("headroom-plot");
  if (!place) return;
  const chosen = document.getElementById("headroom-controller");

  function trace(rule, drawn) {
    const own = page.gains.filter((one) => one.rule === rule && one.controller === chosen.value && one.drawn === drawn);
    const look = page.rules[rule] ?? { colour: "#402020", symbol: "hexagon" };
    return {
      name: rule, legendgroup: rule, showlegend: !drawn, mode: "markers",
      x: own.map((one) => 100 * one.headroom), y: own.map((one) => 100 * one.gain), text: own.map((one) => one.scenario),
      hovertemplate: `<b>%{text}</b><br>${rule}<br>headroom %{x:.2f} %<br>gain %{y:+.2f} %<extra></extra>`,
      marker: { color: look.colour, symbol: look.symbol, size: drawn ? 4 : 10, opacity: drawn ? 0.3 : 0.85,
        line: { width: drawn ? 0 : 1, color: "#ffffff" } },
    };
  }

  function draw() {
    const own = page.gains.filter((one) => one.controller === chosen.value);
    const rules = [...new Set(own.map((one) => one.rule))];
    const most = 100 * Math.max(0.01, ...own.map((one) => one.headroom)) * 1.05;
    const all = { name: "all of the headroom", x: [0, most], y: [0, most], mode: "lines", hoverinfo: "skip",
      line: { color: "#444444", dash: "dash", width: 1.2 } };
    const traces = [all, ...rules.map((rule) => trace(rule, true)), ...rules.map((rule) => trace(rule, false))];
    Plotly.react(place, traces, {
      ...PLAIN, height: 460, showlegend: true, xaxis: axis("headroom [% of the plan]"),
      yaxis: axis("gain over alone [% of the plan]"),
      legend: { orientation: "h", yanchor: "bottom", y: 1.02, x: 0, font: { size: 12 } },
    }, CALM);
  }

  chosen.addEventListener("change", draw);
  draw();
}
