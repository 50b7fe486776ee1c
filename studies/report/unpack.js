// Takes apart what `packing.py` has packed, and brings the plotting library to life. Nothing is loaded from anywhere.

async function inflated(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function startPlotly() {
  const text = new TextDecoder().decode(await inflated(document.getElementById("plotly").textContent));
  const script = document.createElement("script");
  script.textContent = text;
  document.head.append(script);
}

// A run: `instants`, `time` [s], and `series`, name -> {columns, at(column) -> one number per instant}
async function unpackRun(content) {
  const planes = await inflated(content.text);
  const count = planes.length / 2, n = content.instants;
  const series = {};
  let start = 0;
  for (const [name, columns, step] of content.series) {
    const width = columns ?? 1, values = new Float32Array(n * width);
    for (let column = 0; column < width; column++) {
      let whole = 0;
      for (let k = column * n; k < (column + 1) * n; k++) {
        whole = ((whole + (planes[start + k] | (planes[count + start + k] << 8))) << 16) >> 16;
        values[k] = whole === -32768 ? NaN : whole * step;
      }
    }
    start += n * width;
    series[name] = { columns, at: (column) => values.subarray(column * n, (column + 1) * n) };
  }
  const time = Float32Array.from({ length: n }, (_, k) => content.start + k * content.period);
  return { instants: n, time, series };
}
