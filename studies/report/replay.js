// The replay: one recorded run at a time, its instant chosen by a slider or played.

async function startReplay(page) {
  const element = (name) => document.getElementById(name);
  const choice = Object.fromEntries(["event", "rule", "controller", "other"].map((name) => [name, element(name)]));
  const [slider, play, pace, unit, part, readout, trouble] =
    ["instant", "play", "pace", "unit", "part", "readout", "trouble"].map(element);
  const known = new Map(), address = element("link");
  let run = null, parts = [], playing = false, last = 0, exact = 0, asked = 0;

  const label = (rule) => `${choice.event.value}/${rule}/${choice.controller.value}/${page.seed}`;

  // What is known of a run, with forces of its units; null where there is no replay of it
  async function load(name) {
    if (!known.has(name)) {
      const content = page.replays[name];
      known.set(name, content?.text ? withForces(await unpackRun(content), page.events[name.split("/")[0]]) : null);
    }
    return known.get(name);
  }

  async function choose() {
    const mine = ++asked, name = label(choice.rule.value), content = page.replays[name];
    const found = await load(name), beside = choice.other.value;
    const other = beside && beside !== choice.rule.value ? await load(label(beside)) : null;
    if (mine !== asked) return; // another choice was made meanwhile
    const bad = content === undefined ? "This run is not part of the comparison." : content.reason;
    trouble.textContent = bad ? `${content?.status ?? "none"}: ${bad}` : "";
    trouble.hidden = !bad;
    element("replay-plots").hidden = readout.hidden = !found;
    for (const one of [slider, play]) one.disabled = !found;
    const changed = run?.event !== choice.event.value;
    run = found && { ...found, event: choice.event.value, rule: choice.rule.value, other, otherRule: beside };
    nameRun();
    if (!run) return stop();
    if (changed) {
      const each = run.forces.map((_, j) => new Option(`unit ${j + 1}`, j));
      unit.replaceChildren(new Option("the whole train", "-1"), ...each);
      slider.max = run.instants - 1;
      slider.value = busiest(run);
      parts = partsOf(run);
      const named = ({ first, last }) => (first < last ? `cars ${first + 1} to ${last + 1}` : `car ${last + 1}`);
      const some = parts.map((one, k) => new Option(named(one), k));
      part.replaceChildren(new Option(`all ${run.drawing.cars.length} cars`, "-1"), ...some);
      part.value = parts.indexOf(partAt(run, parts, Number(slider.value)));
      part.parentElement.hidden = !parts.length;
    }
    choosePart();
    exact = Number(slider.value);
    drawRun(run, Number(unit.value));
    show();
  }

  // What is shown, in words: on paper there is nothing to choose from
  function nameRun() {
    const cars = run?.part ? `, ${part.selectedOptions[0].text}` : "";
    const title = page.events[choice.event.value].title;
    element("event-title").textContent = `${title}: ${choice.rule.value} under ${choice.controller.value}${cars}`;
  }

  function choosePart() {
    run.part = parts[part.value];
    nameRun();
  }

  function show() {
    const k = Number(slider.value);
    slider.setAttribute("aria-valuetext", `${run.time[k].toFixed(2)} seconds`);
    readout.innerHTML = wordsAt(run, k);
    const chosen = ["event", "rule", "controller", "other"].map((name) => encodeURIComponent(choice[name].value));
    address.href = `#replay=${chosen.join("/")}/${run.time[k].toFixed(2)}`;
    drawInstant(run, k);
  }

  function stop() {
    playing = false;
    play.textContent = "▶ Play";
  }

  function step(now) {
    if (!playing || !run) return;
    const period = run.time[1] - run.time[0];
    exact += ((now - last) / 1000) * Number(pace.value) / period;
    last = now;
    slider.value = Math.min(Math.floor(exact), run.instants - 1);
    show();
    if (exact >= run.instants - 1) return stop();
    requestAnimationFrame(step);
  }

  play.addEventListener("click", () => {
    if (playing) return stop();
    playing = true;
    play.textContent = "❚❚ Pause";
    if (Number(slider.value) >= run.instants - 1) slider.value = 0;
    exact = Number(slider.value);
    last = performance.now();
    requestAnimationFrame(step);
  });
  slider.addEventListener("input", () => { exact = Number(slider.value); show(); });
  unit.addEventListener("change", () => { drawRun(run, Number(unit.value)); show(); });
  part.addEventListener("change", () => { choosePart(); drawRun(run, Number(unit.value)); show(); });
  for (const one of Object.values(choice)) one.addEventListener("change", choose);
  document.addEventListener("instant", (event) => {
    slider.value = Math.round((event.detail - run.time[0]) / (run.time[1] - run.time[0]));
    exact = Number(slider.value);
    show();
  });
  document.addEventListener("replay", (event) => {
    [choice.event.value, choice.rule.value, choice.controller.value] = event.detail.split("/");
    choose();
    element("replay").scrollIntoView({ behavior: "smooth" });
  });

  // A link that was copied: event/rule/controller/beside it/time; what this page does not have is passed over
  async function restore() {
    if (!location.hash.startsWith("#replay=")) return false;
    const told = location.hash.slice(8).split("/").map(decodeURIComponent), time = Number(told.pop());
    const lists = [choice.event, choice.rule, choice.controller, choice.other];
    const fits = (list, value) => [...list.options].some((one) => one.value === value);
    if (told.length !== lists.length || !told.every((value, k) => fits(lists[k], value))) return false;
    lists.forEach((list, k) => (list.value = told[k]));
    await choose();
    if (run && Number.isFinite(time)) document.dispatchEvent(new CustomEvent("instant", { detail: time }));
    element("replay").scrollIntoView();
    return true;
  }

  [choice.event.value, choice.rule.value, choice.controller.value] = page.first.split("/");
  window.addEventListener("hashchange", restore);
  if (!(await restore())) await choose();
}

// Adds to a run what the plots show of its units [kN], in the direction of the demand: each (instants,)
function withForces(run, drawing) {
  const n = run.instants, s = run.series, way = new Float32Array(n);
  const demand = s.driver_command.at(0), expected = s.expected.at(0);
  for (let k = 0, last = 1; k < n; k++) way[k] = last = Math.sign(demand[k]) || last;
  const units = s.limit?.columns ?? 0, forces = [];
  for (let j = 0; j < units; j++) {
    const axles = drawing.axle_unit.map((own, axle) => (own === j ? axle : -1)).filter((axle) => axle >= 0);
    const load = axles.reduce((sum, axle) => sum + drawing.axle_load[axle], 0) / 1e3;
    const names = ["force", "limit", "carries", "plan"];
    const found = Object.fromEntries(names.map((name) => [name, new Float32Array(n)]));
    const limit = s.limit.at(j);
    for (let k = 0; k < n; k++) {
      let sum = 0, least = Infinity;
      for (const axle of axles) {
        sum += s.rail_force.at(axle)[k];
        least = Math.min(least, s.adhesion_limit.at(axle)[k] * s.axle_load.at(axle)[k]);
      }
      found.force[k] = (way[k] * sum) / 1e3;
      found.carries[k] = (axles.length * least) / 1e3;
      found.limit[k] = limit[k] * load;
      found.plan[k] = expected[k] * load;
    }
    forces.push(found);
  }
  return { ...run, way, forces, drawing };
}

// The instant at which most axles slip, the middle of a run in which none does
function busiest(run) {
  const count = new Float32Array(run.instants);
  for (let axle = 0; axle < run.drawing.axle_unit.length; axle++) {
    slipOverPeak(run, axle).forEach((value, k) => (count[k] += value > 2));
  }
  const most = largest(count);
  return most > 0 ? count.indexOf(most) : Math.floor(run.instants / 2);
}

function slipOverPeak(run, axle) {
  const slip = run.series.slip_velocity.at(axle), peak = run.series.peak_slip.at(axle);
  return slip.map((value, k) => Math.abs(value) / Math.max(peak[k], 1e-3));
}

function wordsAt(run, k) {
  const kmh = (3.6 * run.series.speed.at(0)[k]).toFixed(1);
  const total = (name) => run.forces.reduce((sum, one) => sum + one[name][k], 0);
  const axles = run.drawing.axle_unit.length;
  let slipping = 0;
  for (let axle = 0; axle < axles; axle++) {
    slipping += Math.abs(run.series.slip_velocity.at(axle)[k]) > 2 * run.series.peak_slip.at(axle)[k];
  }
  const asked = 3.6 * run.series.driver_command.at(0)[k];
  return `<b>${run.time[k].toFixed(2)} s</b> · ${kmh} km/h · asked ${asked.toFixed(1)} km/h/s · units deliver ` +
    `<b>${total("force").toFixed(0)} kN</b> of ${total("plan").toFixed(0)} kN planned · ${slipping} of ${axles} axles slip`;
}
