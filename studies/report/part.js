// The part of a long train that is shown: so many cars that the bars of their axles are wide enough to read.

const BAR_LENGTH = 1.5; // of the line that an axle's bar covers [m]
const READABLE = 5, THIN = 2.5; // widths of a bar [px]: what a part gives it, and where a part is shown at first

// Parts with equal numbers of cars, the foremost first; none where the whole train is readable
function partsOf(run) {
  const { cars } = run.drawing, length = cars.at(-1)[1], width = plotWidth("train-plot");
  if (barWidth(run) >= READABLE) return [];
  const count = Math.min(cars.length, Math.ceil((1.2 * length * READABLE) / (BAR_LENGTH * width)));
  const parts = [];
  for (let part = 0; part < count; part++) {
    const first = Math.round((part * cars.length) / count), last = Math.round(((part + 1) * cars.length) / count) - 1;
    parts.push({ first, last, ends: [cars[first][0], cars[last][1]] });
  }
  return parts.length > 1 ? parts : [];
}

// Width of an axle's bar where the whole train is shown [px]
function barWidth(run) {
  const [from, to] = windowOf(run, run.series.position.at(0)[0]);
  return (BAR_LENGTH * plotWidth("train-plot")) / (to - from);
}

// The part that is shown at first: where an axle slips most at the instant `k`; null for the whole train
function partAt(run, parts, k) {
  if (!parts.length || barWidth(run) >= THIN) return null;
  const slip = run.drawing.axles.map((_, axle) => slipOverPeak(run, axle)[k]);
  const place = run.drawing.axles[slip.indexOf(largest(slip))];
  return parts.find(({ ends }) => place <= ends[1]) ?? null;
}

// Stretch of line that is shown: around a part; else all of the run where the train is large in it; else around the train
function windowOf(run, front) {
  const position = run.series.position.at(0), length = run.drawing.cars.at(-1)[1];
  if (run.part) {
    const [start, end] = run.part.ends, beside = 0.1 * (end - start);
    return [front - end - beside, front - start + beside];
  }
  const from = position[0] - length, to = position.at(-1);
  if (to - from < 2.5 * length) return [from - 5, to + 5];
  return [front - 1.35 * length, front + 0.35 * length];
}

// Numbers of the first and the last axle of the part, 1 = foremost
function axlesShown(run) {
  const { axles } = run.drawing, [start, end] = run.part?.ends ?? [0, Infinity];
  const shown = axles.map((_, axle) => axle + 1).filter((axle) => axles[axle - 1] >= start && axles[axle - 1] <= end);
  return [shown[0], shown.at(-1)];
}

// The same of its traction units; those of the whole train where the part has none
function unitsShown(run) {
  const [first, last] = axlesShown(run), all = [1, run.forces.length];
  const own = run.drawing.axle_unit.slice(first - 1, last).filter((unit) => unit >= 0);
  return own.length ? [Math.min(...own) + 1, Math.max(...own) + 1] : all;
}

function plotWidth(name) {
  return document.getElementById(name).clientWidth - 72; // without the axis and its title
}
