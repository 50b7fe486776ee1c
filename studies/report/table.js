// The table: sorting by a click on a heading, filters, values or differences, columns on demand.

function startTable() {
  const table = document.getElementById("runs"), body = table.tBodies[0];
  const rows = [...body.rows].map((row, place) => ({ row, place, cells: cellsOf(row) }));
  const filters = [...document.querySelectorAll("[data-filter]")];
  const shown = document.getElementById("shown");
  let sorted = null;

  function cellsOf(row) {
    const found = { value: {}, difference: {}, name: {} };
    for (const cell of row.cells) {
      const kind = ["value", "difference"].find((name) => cell.classList.contains(name)) ?? "name";
      const told = cell.dataset.number;
      found[kind][cell.dataset.column] = told === undefined ? cell.textContent.trim() : number(told);
    }
    return found;
  }

  function number(text) {
    return text === "" ? NaN : Number(text);
  }

  function filter() {
    let count = 0;
    for (const { row } of rows) {
      const fits = filters.every((one) => one.value === "" || row.dataset[one.dataset.filter] === one.value);
      row.hidden = !fits;
      count += fits;
    }
    shown.textContent = `${count} of ${rows.length} rows`;
  }

  function keyOf(entry, column) {
    const kind = table.classList.contains("differences") ? "difference" : "value";
    return column in entry.cells.name ? entry.cells.name[column] : entry.cells[kind][column];
  }

  // Cells without a number stay at the end, whichever way is sorted; equal ones keep the table's own order
  function compare(one, other) {
    const a = keyOf(one, sorted.column), b = keyOf(other, sorted.column);
    if (typeof a === "string") return sorted.way * a.localeCompare(b) || one.place - other.place;
    if (Number.isNaN(a) || Number.isNaN(b)) return Number.isNaN(a) - Number.isNaN(b) || one.place - other.place;
    return sorted.way * (a - b) || one.place - other.place;
  }

  function sort() {
    if (!sorted) return;
    body.append(...[...rows].sort(compare).map((entry) => entry.row));
    for (const heading of table.tHead.rows[0].cells) {
      const mine = heading.dataset.column === sorted.column;
      heading.setAttribute("aria-sort", mine ? (sorted.way > 0 ? "ascending" : "descending") : "none");
    }
  }

  for (const heading of table.tHead.rows[0].cells) {
    heading.querySelector("button")?.addEventListener("click", () => {
      const column = heading.dataset.column;
      // numbers with the best first where more is better, names from A on
      const first = heading.dataset.better === "1" ? -1 : 1;
      sorted = { column, way: sorted?.column === column ? -sorted.way : first };
      sort();
    });
  }
  for (const one of filters) one.addEventListener("change", filter);
  for (const one of document.querySelectorAll("input[name=cells]")) {
    one.addEventListener("change", () => {
      table.classList.toggle("differences", document.getElementById("differences").checked);
      sort();
    });
  }
  document.getElementById("more").addEventListener("change", (event) => {
    table.classList.toggle("more", event.target.checked);
  });
  body.addEventListener("click", (event) => {
    const label = event.target.closest("button[data-replay]")?.dataset.replay;
    if (label) document.dispatchEvent(new CustomEvent("replay", { detail: label }));
  });
  filter();
}

// One box for all explanations: on hover, on focus, and on a tap
function startHints() {
  const box = document.getElementById("hint");
  function show(event) {
    const text = event.target.closest?.("[data-hint]")?.dataset.hint;
    box.hidden = !text;
    if (!text) return;
    box.textContent = text;
    const place = event.target.closest("[data-hint]").getBoundingClientRect();
    const left = Math.min(place.left, document.documentElement.clientWidth - box.offsetWidth - 8);
    box.style.left = `${Math.max(8, left)}px`;
    const below = place.bottom + 6;
    const fits = below + box.offsetHeight < window.innerHeight;
    box.style.top = `${fits ? below : place.top - box.offsetHeight - 6}px`;
  }
  for (const name of ["mouseover", "focusin", "click"]) document.addEventListener(name, show);
  document.addEventListener("scroll", () => (box.hidden = true), true);
  document.addEventListener("keydown", (event) => event.key === "Escape" && (box.hidden = true));
}
