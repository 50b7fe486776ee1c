// Brings the page to life; what needs no plots works even where the browser cannot unpack them.

async function start() {
  startTable();
  startHints();
  startDownloads();
  const page = JSON.parse(document.getElementById("content").textContent);
  const note = document.getElementById("plot-note");
  if (typeof DecompressionStream === "undefined") {
    note.textContent = "This browser is too old to unpack the plots (it lacks DecompressionStream). Text and table work.";
    return;
  }
  await startPlotly();
  startHeadroom(page);
  await startReplay(page);
  note.hidden = true;
  document.body.dataset.ready = "yes";

  // Plots have the width of the screen; on paper they get that of the sheet
  const plots = () => [...document.querySelectorAll(".js-plotly-plot")].filter((one) => one.offsetParent);
  const sheet = (one) => (one.closest(".plots > div:not(.wide)") ? 480 : 990);
  window.addEventListener("beforeprint", () => {
    plots().forEach((one) => Plotly.relayout(one, { width: sheet(one) }));
  });
  window.addEventListener("afterprint", () => {
    plots().forEach((one) => Plotly.relayout(one, { width: null, autosize: true }));
  });
}

start();
