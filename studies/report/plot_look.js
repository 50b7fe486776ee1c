// What all plots share: their look, marks explained as text, the line of the instant, the colours of slip.

const FONT = { family: "system-ui, sans-serif", size: 13, color: "#1a1a1a" };
const CALM = { displayModeBar: false, responsive: true };
const GRID = { gridcolor: "#e6e6e6", zerolinecolor: "#999999", linecolor: "#666666", automargin: true, fixedrange: true };
const PLAIN = {
  font: FONT, paper_bgcolor: "#ffffff", plot_bgcolor: "#ffffff", hovermode: "closest", showlegend: false,
  margin: { l: 60, r: 12, t: 8, b: 45 },
};
const USED = "#0072b2", CARRIES = "#009e73", LIMIT = "#d55e00", PLAN = "#1a1a1a", OTHER = "#7b3294";
const SLIP_COLOURS = [[0, "#eef3f7"], [0.25, "#9ecae1"], [0.5, "#fdb863"], [0.75, "#d55e00"], [1, "#5b0f2e"]];
const MOST_SLIP = 4; // times the slip at the curve's peak

// An axis with its quantity and unit
const axis = (text, rest = {}) => ({ ...GRID, title: { text }, ...rest });

const largest = (values) => values.reduce((most, one) => (one > most ? one : most), -Infinity);

// Colour of a slip over that at the curve's peak
function slipColour(ratio) {
  const share = Math.min(ratio / MOST_SLIP, 1);
  const next = Math.max(1, SLIP_COLOURS.findIndex(([place]) => place >= share));
  const [[from, a], [to, b]] = [SLIP_COLOURS[next - 1], SLIP_COLOURS[next]];
  const mixed = [1, 3, 5].map((k) => {
    const [low, high] = [a, b].map((colour) => parseInt(colour.slice(k, k + 2), 16));
    return Math.round(low + ((high - low) * (share - from)) / (to - from));
  });
  return `rgb(${mixed.join(",")})`;
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

// A click into a plot over time chooses the instant
function chooseByClick(place) {
  if (place.dataset.listens) return;
  place.dataset.listens = "yes";
  place.on("plotly_afterplot", () => moveCursor(place));
  place.on("plotly_click", (event) => {
    document.dispatchEvent(new CustomEvent("instant", { detail: event.points[0].x }));
  });
}
