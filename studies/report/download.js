// Files that the page gives: a table as it is shown, as CSV with full numbers, and a plot as SVG.
// A file of its own, since every other one needs a table or a plot alone.

function startDownloads() {
  for (const button of document.querySelectorAll("button[data-csv]")) {
    const name = button.dataset.csv;
    button.addEventListener("click", () => save(`${name}.csv`, "text/csv", csvOf(document.getElementById(name))));
  }
  for (const button of document.querySelectorAll("button[data-svg]")) {
    const name = button.dataset.svg;
    button.addEventListener("click", async () => {
      const text = await Plotly.toImage(name, { format: "svg" });
      save(`${name}.svg`, "image/svg+xml", decodeURIComponent(text.slice(text.indexOf(",") + 1)));
    });
  }
}

// Rows and columns that are seen; numbers as they were computed, not as they are rounded for the eye
function csvOf(table) {
  const seen = (one) => one.offsetParent !== null;
  const words = (cell) => cell.dataset.column ?? cell.innerText.trim().replace(/\s+/g, " ");
  const value = (cell) => cell.dataset.number ?? cell.innerText.trim().replace(/\s+/g, " ").replace(" ▶", "");
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const rows = [[...table.tHead.rows[0].cells].filter(seen).map(words)];
  for (const row of table.tBodies[0].rows) if (seen(row)) rows.push([...row.cells].filter(seen).map(value));
  return rows.map((row) => row.map(quoted).join(",") + "\n").join("");
}

function save(name, kind, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
