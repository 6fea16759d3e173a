// The page: sections made of the report that it holds.
const data = JSON.parse(document.getElementById("data").textContent);
const main = document.getElementById("main");
const root = document.documentElement;

function setTheme(theme) {
  root.dataset.theme = theme;
  // A page from a file may not be allowed to remember.
  try { localStorage.setItem("lrbsim-theme", theme); } catch (_) {}
}
let remembered = null;
try { remembered = localStorage.getItem("lrbsim-theme"); } catch (_) {}
root.dataset.theme = remembered || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
document.getElementById("theme").addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));

function section(title, ...children) {
  return element("section", {}, element("h2", {}, title), ...children);
}

// Words of which some are code, between backticks.
const words = (text) => text.split("`").map((part, i) => (i % 2 ? element("code", {}, part) : part));
const note = (text) => element("p", { class: "soft" }, ...words(text));
const paragraph = (text) => element("p", {}, ...words(text));

// Buttons of which one is pressed.
function choice(names, pick) {
  const tools = element("div", { class: "tools" });
  names.forEach((name, index) => {
    tools.append(element("button", { type: "button", "aria-pressed": index === 0, click: (event) => {
      for (const button of tools.children) button.setAttribute("aria-pressed", button === event.target);
      pick(index);
    } }, name));
  });
  return tools;
}

// A table whose columns sort. cells: strings, numbers, null, or {value, show}.
function table(columns, rows, totals = []) {
  const value = (cell) => (cell !== null && typeof cell === "object" ? cell.value : cell);
  const show = (cell) => (cell !== null && typeof cell === "object" ? cell.show : typeof cell === "number" ? short(cell) : cell === null ? "-" : cell);
  const isText = columns.map((_, column) => rows.some((row) => typeof value(row[column]) === "string"));
  const line = (row, total) => element("tr", { class: row.className || (total ? "total" : null) }, ...row.map((cell, column) => {
    const text = String(show(cell));
    return element("td", { class: (isText[column] ? "text" : "") + (text.length > 24 ? " wrap" : "") }, text);
  }));
  const body = element("tbody", {});
  const fillBody = (ordered) => body.replaceChildren(...ordered.map((row) => line(row)), ...totals.map((row) => line(row, true)));
  fillBody(rows);
  const heads = columns.map((column, index) => {
    const head = element("th", { class: isText[index] ? "text" : "", scope: "col" });
    head.append(element("button", { type: "button", click: () => {
      const up = head.getAttribute("aria-sort") === "descending" || (isText[index] && head.getAttribute("aria-sort") !== "ascending");
      for (const other of head.parentNode.children) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const order = (a, b) => {
        const [x, y] = [value(a[index]), value(b[index])];
        if (x === null || y === null) return (x === null) - (y === null);
        const by = typeof x === "string" || typeof y === "string" ? String(x).localeCompare(String(y)) : x - y;
        return up ? by : -by;
      };
      fillBody([...rows].sort(order));
    } }, column));
    return head;
  });
  return element("div", { class: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...heads)), body));
}

const cell = (number, show) => (number === null || number === undefined || Number.isNaN(number) ? null : { value: number, show });
const ratio = (part, whole) => (whole > 0 ? part / whole : null);
const asPercent = (part) => (part === null ? null : cell(part, percent(part)));

function figures(entries) {
  const box = ([name, value]) => element("div", {}, element("b", {}, value), element("span", { class: "soft" }, name));
  return element("div", { class: "figures" }, ...entries.filter((entry) => entry[1] !== null).map(box));
}

// Milliseconds as text, and how far they may be off where they were extrapolated, with two digits of that; its lower end is cut at 0.
function timeText(ms, interval) {
  if (!interval) return short(ms);
  const half = interval[1] - ms;
  const decimals = half > 0 ? Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(half)))) : 3;
  return `${ms.toFixed(decimals)} \u00b1 ${half.toFixed(decimals)}`;
}
const time = (ms, interval) => (interval ? cell(ms, timeText(ms, interval)) : ms);

// The cause to which most of the core-cycles without an instruction were lost, and how many of all they were.
function waitsFor(stack) {
  if (!stack) return null;
  const all = CAUSES.reduce((sum, cause) => sum + stack[cause], 0);
  const worst = CAUSES.filter((cause) => cause !== "issue").reduce((a, b) => (stack[b] > stack[a] ? b : a));
  return `${label(worst)} ${percent(ratio(stack[worst], all), 0)}`;
}

function phaseTable(report) {
  const timed = report.total.cycles !== null, ofPaper = report.phases.some((phase) => phase.in_paper_total);
  const columns = ["phase", "ms", "share", "instructions", "IPC", "lanes active", "L1 hits", "L2 hits", "memory, MB"];
  const rows = report.phases.map((phase) => [
    phase.title + (phase.in_paper_total || !ofPaper ? "" : " *"), time(phase.ms, phase.ms_interval), asPercent(phase.share), phase.instructions.total, cell(phase.ipc, phase.ipc === null ? "" : phase.ipc.toFixed(3)),
    asPercent(ratio(phase.lanes.active, phase.lanes.active + phase.lanes.masked)),
    asPercent(phase.l1d && ratio(phase.l1d.hits, phase.l1d.accesses)), asPercent(phase.l2 && ratio(phase.l2.hits, phase.l2.accesses)),
    phase.memory && cell(phase.memory.bytes, (phase.memory.bytes / 1e6).toFixed(2)),
  ]);
  const sum = (pick) => report.phases.reduce((all, phase) => all + (pick(phase) || 0), 0);
  const instructions = (all) => report.phases.filter((phase) => all || phase.in_paper_total).reduce((sum, phase) => sum + phase.instructions.total, 0);
  const bytes = timed ? (sum((phase) => phase.memory && phase.memory.bytes) / 1e6).toFixed(2) : null;
  const totals = [["total", time(report.total.ms, report.total.ms_interval), "", instructions(true), "", "", "", "", bytes]];
  if (timed && ofPaper) totals.push(["paper's total", time(report.total.paper_ms, report.total.paper_ms_interval), "", instructions(false), "", "", "", "", ""]);
  const steps = report.phases.flatMap((phase) => phase.by_step.map((step) => [phase.title, step.name, step.ms, asPercent(ratio(step.cycles, report.total.cycles)), step.tasks, step.instructions, waitsFor(step.cycle_stack)]));
  return section("Phases", table(columns, rows, totals),
    element("details", {}, element("summary", {}, `the ${steps.length} steps of the phases`), table(["phase", "step", "ms", "share", "tasks", "instructions", "waits for"], steps)),
    note(`${ofPaper ? "* not in the totals of Johnson et al. 2009. " : ""}Click a heading to sort. IPC: instructions per cycle and core.${report.total.ms_interval ? " \u00b1: half of the interval in which `windowed` has the time, with 95 % confidence." : ""}`));
}

// What each limit alone would take of each phase, where times are estimates: nothing was simulated that cycles could have gone to.
function limitsSection(report) {
  const names = Object.keys(report.phases[0].bounds);
  const ms = (cycles) => cycles / (report.machine.clock_ghz * 1e6);
  return section("What limits the phases", table(["limit, ms", ...report.phases.map((phase) => phase.id)], [
    ...names.map((name) => [name, ...report.phases.map((phase) => ms(phase.bounds[name]))]), ["estimate", ...report.phases.map((phase) => phase.ms)]]),
    note("What each part of the machine alone would make the steps of a phase take. Issue: issue slots. Chains: results and accesses that wait for one another, in the threads that there are, or the longest task. L1: its ports, and the rate of gathers. L2: misses that may be outstanding at once. Atomics: the line that most locked operations want, and the task counter. Barrier: first tasks and barriers. Limits that are close add up in part."));
}

function stackSection(report) {
  if (report.total.cycles === null) return null;
  if (report.phases.some((phase) => phase.bounds)) return limitsSection(report);
  const holder = element("div", {});
  const rows = report.phases.map((phase) => {
    const all = CAUSES.reduce((sum, cause) => sum + phase.cycle_stack[cause], 0);
    const parts = CAUSES.map((cause, i) => ({ name: cause, value: (phase.ms * phase.cycle_stack[cause]) / (all || 1), color: COLORS[i], note: `${grouped(phase.cycle_stack[cause])} core-cycles` }));
    return { name: phase.title, parts, note: `${timeText(phase.ms, phase.ms_interval)} ms` };
  });
  const draw = (relative) => holder.replaceChildren(stackedBars(rows, relative));
  draw(false);
  // As many rows as causes: so many columns would be wider than the page.
  const numbers = table(["cause", ...report.phases.map((phase) => phase.id)], CAUSES.map((cause) => [label(cause), ...report.phases.map((phase) => phase.cycle_stack[cause])]));
  return section("Where the cycles went", choice(["in time", "in percent"], (index) => draw(index === 1)), holder, legend(CAUSES, COLORS),
    element("details", {}, element("summary", {}, "core-cycles by cause"), numbers),
    note("Every core-cycle has one cause: an instruction issued, or what the thread that issued next had waited for."));
}

function lanesSection(report) {
  const kinds = ["vector", "gather", "scatter", "atomic", "scalar", "mask", "branch", "prefetch", "spill"];
  const colors = ["#0072b2", "#e69f00", "#d55e00", "#cc79a7", "#8a8f99", "#56b4e9", "#009e73", "#f0e442", "#7a5195"];
  const lanes = report.phases.map((phase) => ({ name: phase.title, note: percent(ratio(phase.lanes.active, phase.lanes.active + phase.lanes.masked)),
    parts: [{ name: "active", value: phase.lanes.active, color: "#0072b2" }, { name: "masked off", value: phase.lanes.masked, color: "#c9cdd4" }] }));
  const mix = report.phases.map((phase) => ({ name: phase.title, note: grouped(phase.instructions.total),
    parts: kinds.map((kind, i) => ({ name: kind, value: phase.instructions[kind], color: colors[i], note: grouped(phase.instructions[kind]) })) }));
  return [section("Lanes", stackedBars(lanes, true), legend(["active", "masked off"], ["#0072b2", "#c9cdd4"]), note("Of 16 lane-slots for each vector instruction.")),
    section("Instructions", stackedBars(mix, true), legend(kinds, colors))];
}

function coresSection(report) {
  const phases = report.phases.filter((phase) => phase.core_busy_cycles);
  if (phases.length === 0) return null;
  const rows = phases.map((phase) => ({ name: phase.title, values: phase.core_busy_cycles.map((busy) => ratio(busy, phase.cycles) || 0) }));
  return section("Cores", strips(rows, "core"), note("Part of a phase's cycles in which a core issued: the more of it, the stronger the blue."));
}

function memorySection(report) {
  if (report.total.cycles === null) return null;
  const names = ["l1d", "l2", "ring", "directory", "memory", "atomics"];
  const counters = names.flatMap((group) => Object.keys(report.phases[0]?.[group] || {}).map((name) => [group, name]));
  const all = ([group, name]) => report.phases.reduce((sum, phase) => sum + phase[group][name], 0);
  // An estimate leaves what it has no idea of at 0.
  const estimated = report.phases.some((phase) => phase.bounds);
  const rows = counters.filter((counter) => !estimated || all(counter) > 0)
    .map(([group, name]) => [`${label(group === "l1d" ? "l1" : group)} ${label(name)}`, ...report.phases.map((phase) => phase[group][name]), all([group, name])]);
  return section("Caches, ring and memory", table(["counter", ...report.phases.map((phase) => phase.id), "all"], rows),
    estimated ? note("Estimates; what roofline does not estimate is left out.") : null);
}

function rooflineSection(report) {
  if (report.total.cycles === null || report.machine.ideal?.memory) return null;
  const machine = report.machine, clock = machine.clock_ghz, cores = machine.cores;
  const rings = Math.ceil(cores / machine.ring.cores_per_ring);
  const compute = cores * 16 * clock;
  const levels = [
    { name: "memory", bytes: (phase) => phase.memory.bytes, roof: machine.memory.bandwidth_gb_per_s, how: "bandwidth of all controllers" },
    report.phases[0]?.ring && { name: "ring", bytes: (phase) => phase.ring.bytes, roof: Math.min(8, 2 * cores) * machine.ring.bytes_per_cycle * clock * rings, how: "both directions of every link, a quarter of a ring a message" },
    { name: "L2", bytes: (phase) => 64 * phase.l2.accesses, roof: cores * clock * Math.min(64, (64 * machine.l1d.mshrs) / machine.l2.hit_cycles), how: "lines that L1 can wait for at once, divided by the latency of L2" },
    { name: "L1", bytes: (phase) => 64 * phase.l1d.accesses, roof: cores * clock * 64, how: "a line a cycle and core" },
  ].filter((level) => level);
  const colors = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#7a5195", "#8a8f99", "#f0e442"];
  const holder = element("div", {});
  const draw = (level) => {
    const points = report.phases.map((phase, i) => {
      const seconds = phase.ms / 1e3;
      return { name: phase.title, color: colors[i % colors.length], x: phase.lanes.active / level.bytes(phase), y: phase.lanes.active / seconds / 1e9 };
    }).map((point) => ({ ...point, x: Number.isFinite(point.x) ? point.x : 0 }));
    const roofs = [{ name: `compute: ${short(compute)} G lane operations/s`, at: () => compute, dash: "6 4" }, { name: `${level.name}: ${short(level.roof)} GB/s`, at: (x) => x * level.roof }];
    holder.replaceChildren(roofline(roofs, points, `lane operations per byte of ${level.name}`, "G lane operations/s"),
      note(`Dashed: ${short(compute)} G lane operations/s, a vector instruction a cycle and core. Slanted: ${level.name}, ${short(level.roof)} GB/s, ${level.how}.`));
  };
  draw(levels[0]);
  return section("Roofline", choice(levels.map((level) => level.name), (index) => draw(levels[index])), holder);
}

function flatten(tree, path = "", rows = []) {
  for (const [name, value] of Object.entries(tree || {})) {
    const at = path ? `${path}.${name}` : name;
    if (at === "sources") continue;
    if (value !== null && typeof value === "object" && !Array.isArray(value)) flatten(value, at, rows);
    else rows.push([at, value]);
  }
  return rows;
}

// Numbers of the machine that are not those of the shipped one of its name.
function changes(report) {
  const preset = data.presets[report.machine.name];
  const before = new Map(flatten(preset));
  return preset === undefined ? [] : flatten(report.machine).filter(([path, value]) => JSON.stringify(before.get(path)) !== JSON.stringify(value));
}

function configSection(report) {
  const preset = data.presets[report.machine.name];
  const before = new Map(flatten(preset));
  const sources = report.machine.sources && Object.keys(report.machine.sources).length ? report.machine.sources : preset?.sources || {};
  const changedPaths = new Set(changes(report).map(([path]) => path));
  const rows = flatten(report.machine).map(([path, value]) => {
    const differs = changedPaths.has(path);
    const row = [path, String(value), preset === undefined ? "-" : differs ? String(before.get(path)) : "same", differs ? "set for this run" : sources[path] || ""];
    if (differs) row.className = "differs";
    return row;
  });
  const changed = rows.filter((row) => row.className);
  const say = preset === undefined ? `${report.machine.name} is not a shipped machine.` : changed.length ? `${changed.length} of ${rows.length} numbers differ from the shipped ${report.machine.name}.` : `As the shipped ${report.machine.name}.`;
  const head = ["number", "value", "shipped", "where from"];
  return section("Machine", note(say), changed.length ? table(head, changed) : null, element("details", {}, element("summary", {}, `all ${rows.length} numbers`), table(head, rows)));
}

function pictureSection(pictures, title = "Picture") {
  if (!pictures || pictures.length === 0) return null;
  const image = element("img", { alt: pictures[0].title, src: pictures[0].url });
  const frame = element("div", { class: "picture" }, image);
  let zoom = 0;
  // Fitted pictures fill the frame, up or down, as far as all of them can be seen.
  const fitted = () => (image.naturalHeight ? `min(100%, ${(76 * image.naturalWidth) / image.naturalHeight}vh)` : "auto");
  const size = () => { image.style.width = zoom === 0 ? fitted() : `${image.naturalWidth * zoom}px`; };
  const zooms = [0, 1, 2, 4, 8];
  image.addEventListener("load", size);
  size();
  const which = pictures.length > 1 ? choice(pictures.map((picture) => picture.title), (index) => { image.src = pictures[index].url; image.alt = pictures[index].title; }) : null;
  const tools = choice(zooms.map((factor) => (factor === 0 ? "fit" : `${factor}\u00d7`)), (index) => { zoom = zooms[index]; size(); });
  tools.classList.add("zoom");
  return section(title, which, tools, frame);
}

// How right the picture is: its measures, and it and the truth under one slider, which mouse, finger and keys move.
function errorSection(report, pictures, judged) {
  const error = report.image.error;
  if (!error) return null;
  const measures = [
    ["mean", error.mean, "Atty et al. 2006: all differences, divided by the number of pixels in shadow or penumbra"],
    ["rmse", error.rmse, "root mean square over pixels in shadow or penumbra in either picture"],
    ["p99", error.p99, "99 % of these pixels are off by no more"],
    ["max", error.max, "greatest difference of a pixel"],
    ["off by more than 0.25", error.off_by_quarter, "part of these pixels"],
    ["bias", error.bias, "as the mean, with signs: above 0, the picture is too light"],
    ["mean of the reference", error.reference_mean, "the reference's own error, from what two halves of its rays differ by"],
    ["rmse of the reference", error.reference_rmse, "the same, root mean square"],
  ];
  const parts = [note(`Parts of the light, against ${grouped(error.samples)} shadow rays a receiver; ${grouped(error.shadowed_receivers)} receivers in shadow or penumbra.`), table(["error", "value", "what"], measures)];
  const ours = (pictures || []).find((picture) => picture.title === "shaded");
  if (!judged || !ours) return section("How right the picture is", ...parts);

  const layers = { ours: ours.url, truth: judged.truth.url, difference: judged.difference.url };
  const pairs = [["ours", "truth"], ["ours", "difference"], ["truth", "difference"]];
  const [under, over] = ["under", "over"].map((name) => element("img", { class: name, alt: name, draggable: "false" }));
  const stack = element("div", { class: "layers" }, under, over, element("i", {}));
  const frame = element("div", { class: "picture wipe fit" }, stack);
  const slider = element("input", { type: "range", min: 0, max: 100, step: 1, value: 50, "aria-label": "Where one picture ends and the other begins", input: () => move(Number(slider.value)) });
  const [left, right] = [element("span", {}), element("span", {})];
  const move = (at) => {
    const percent = Math.min(100, Math.max(0, at));
    slider.value = percent;
    frame.style.setProperty("--at", `${percent}%`);
    slider.setAttribute("aria-valuetext", `${Math.round(percent)} % ${left.textContent}, the rest ${right.textContent}`);
  };
  const show = ([a, b]) => {
    [over.src, over.alt, left.textContent] = [layers[a], a, a];
    [under.src, under.alt, right.textContent] = [layers[b], b, b];
    move(Number(slider.value));
  };
  // On the picture itself too, unless it is zoomed and a drag scrolls it.
  const drag = (event) => {
    const box = stack.getBoundingClientRect();
    if (frame.classList.contains("fit") && box.width > 0) move((100 * (event.clientX - box.left)) / box.width);
  };
  stack.addEventListener("pointerdown", (event) => { if (event.isPrimary) drag(event); });
  stack.addEventListener("pointermove", (event) => { if (event.isPrimary && event.buttons & 1) drag(event); });
  let zoom = 0;
  const size = () => {
    frame.classList.toggle("fit", zoom === 0);
    for (const image of [under, over]) { image.style.width = zoom === 0 ? (image === over ? "100%" : "auto") : `${image.naturalWidth * zoom}px`; image.style.maxWidth = zoom === 0 ? "100%" : "none"; }
  };
  for (const image of [under, over]) image.addEventListener("load", size);
  const zooms = [0, 1, 2, 4, 8];
  const tools = choice(zooms.map((factor) => (factor === 0 ? "fit" : `${factor}\u00d7`)), (index) => { zoom = zooms[index]; size(); });
  size();
  show(pairs[0]);
  const color = (c) => `rgb(${c.join(",")})`;
  const bar = element("div", {});
  bar.style.background = `linear-gradient(to right, ${[...[...data.scale.dark].reverse(), ...data.scale.light.slice(1)].map(color).join(", ")})`;
  const end = data.scale.end;
  const scale = element("div", { class: "scale", role: "img", "aria-label": `Colors of the difference: blue too dark, orange too light, brightest at ${end} or more` }, bar,
    element("p", { class: "soft" }, ...[`${end} or more too dark`, "right", `${end} or more too light`].map((text) => element("span", {}, text))));
  return section("How right the picture is", ...parts, choice(pairs.map((pair) => pair.join(" | ")), (index) => show(pairs[index])), tools,
    element("div", { class: "ends" }, left, slider, right), frame, note("Colors of the difference:"), scale);
}

function provenanceSection(report) {
  const rows = [...flatten(report.provenance, "provenance"), ...flatten(report.scene, "scene"), ...flatten(report.image, "image"), ...flatten(data.kind === "run" ? data.host : null, "host")];
  return section("Where this is from", element("details", {}, element("summary", {}, "scene, hashes, versions, host"), table(["what", "value"], rows.map(([path, value]) => [path, String(typeof value === "object" ? JSON.stringify(value) : value)]))));
}

function validationSection(report) {
  const error = report.model_error;
  // It is of times, which a functional run has none of.
  if (!error || report.total.cycles === null) return null;
  const rows = [
    ["validated", `${error.machine} at fidelity ${error.fidelity}`],
    ["published figures of high confidence", error.rows],
    ["of these in the range of their sources", error.inside],
    ["mean error, %", error.mean_error_percent],
    ["worst error, %", error.worst_error_percent],
    ["mean error of figures that nothing was fitted to, %", error.held_out_mean_error_percent],
  ];
  return section("How far to trust it", table(["what", "value"], rows), note("Times of other machines and fidelities rest on the same model with other parameters."));
}

function runSections(report, pictures) {
  const total = report.total, scene = report.scene, changed = changes(report);
  return [
    note(`${report.provenance.algorithm}, ${report.provenance.fidelity}, ${scene.width} \u00d7 ${scene.height} pixels, ${grouped(scene.triangles)} triangles, ${grouped(scene.silhouette_edges)} silhouette edges, ${report.machine.cores} cores at ${report.machine.clock_ghz} GHz`),
    changed.length ? note(`Differs from the shipped ${report.machine.name}: ${changed.map(([path, value]) => `${path} ${value}`).join(", ")}.`) : null,
    ...report.warnings.map((warning) => element("p", { class: "error" }, ...words(`Warning: ${warning.message}.`))),
    figures([["milliseconds a frame", total.ms === null ? null : timeText(total.ms, total.ms_interval)], ["frames a second", total.fps === null ? null : short(total.fps)],
      ["ms of the paper's phases", total.paper_ms === null ? null : timeText(total.paper_ms, total.paper_ms_interval)], ["mean visibility", report.image.mean_visibility === null ? null : short(report.image.mean_visibility)], ["receivers in penumbra", grouped(report.image.penumbra_receivers)], ["mean error by the reference", report.image.error ? short(report.image.error.mean) : null]]),
    phaseTable(report), pictureSection(pictures), errorSection(report, pictures, data.judged), stackSection(report), coresSection(report), ...lanesSection(report), rooflineSection(report), memorySection(report), configSection(report), validationSection(report), provenanceSection(report),
  ].filter((part) => part !== null);
}

function plotOf(finding) {
  const plot = finding.svg ? element("div", { class: "paper" }) : null;
  if (plot) plot.innerHTML = finding.svg.replace(/(<svg[^>]*?) width="(\d+)" height="(\d+)"/, "$1");
  return plot;
}

function findingSection(finding) {
  const plot = plotOf(finding);
  return section(finding.title, plot, table(finding.sheet.columns, finding.sheet.rows), ...finding.notes.map(note));
}

// Small pictures of all points side by side, or where they differ from the reference; one row for each value of the first axis.
function pointPictures(study, name) {
  const points = study.points.filter((point) => point.pictures);
  if (!points.length) return null;
  const rows = new Map();
  for (const point of points) {
    const key = JSON.stringify(point.values[0]);
    rows.set(key, [...(rows.get(key) || []), point]);
  }
  const images = [];
  const figure = (point) => {
    const image = element("img", { alt: name(point), loading: "lazy" });
    images.push([image, point.pictures]);
    const report = point.report, error = report && report.image.error;
    const numbers = report ? [report.total.ms === null ? null : `${timeText(report.total.ms, report.total.ms_interval)} ms`, error ? `error ${short(error.mean)}` : null].filter((part) => part).join(", ") : "";
    return element("figure", {}, image, element("figcaption", {}, element("b", {}, name(point)), element("br", {}), numbers));
  };
  const gallery = [...rows.values()].map((row) => element("div", { class: "gallery" }, ...row.map(figure)));
  const show = (difference) => images.forEach(([image, pictures]) => {
    const picture = (difference && pictures.difference) || pictures.shaded;
    image.src = `data:image/png;base64,${picture}`;
  });
  show(false);
  const judged = points.some((point) => point.pictures.difference);
  return section("Pictures", judged ? choice(["pictures", "differences from the reference"], (index) => show(index === 1)) : null, ...gallery,
    judged ? note("In differences, blue is too dark and orange too light; the brightest is a quarter of the light or more.") : null);
}

function studySections(study) {
  const axes = study.study.axes.map((axis) => axis.path);
  const name = (point) => axes.map((axis, i) => `${axis} ${typeof point.values[i] === "string" ? point.values[i] : JSON.stringify(point.values[i])}`).join(", ");
  const good = study.points.filter((point) => point.report !== null);
  const holder = element("div", { id: "point" });
  const pick = element("select", { "aria-label": "Point of the study", change: (event) => holder.replaceChildren(...runSections(good[event.target.value].report)) }, ...good.map((point, index) => element("option", { value: index }, name(point))));
  if (good.length) holder.replaceChildren(...runSections(good[0].report));
  const failed = study.points.filter((point) => point.error !== null).map((point) => element("p", { class: "error" }, `${name(point)}: ${point.error}`));
  return [paragraph(study.study.question), ...data.findings.map(findingSection), pointPictures(study, name), ...failed, good.length ? section("One point", pick, holder, data.left_out ? note(`The reports of ${data.left_out} more points are in study.json.`) : null) : note("No point has a result.")].filter((part) => part !== null);
}

// Words and pictures first: whoever reads of it for the first time finds numbers under each family, when wanted.
function stabilitySections() {
  const [whole, ...families] = data.findings;
  const terms = element("details", {}, element("summary", {}, "what the columns of the tables mean"),
    table(["column", "meaning"], data.columns));
  const strip = (index, finding) => element("div", { class: "strip" }, ...data.report.families[index].points.map((point, at) => {
    const verdict = data.about[index].verdicts[at], measured = point.outcome.measured;
    const alt = `${finding.sheet.columns[0]} ${point.x}: ${verdict}`;
    const picture = measured && measured.picture ? element("img", { src: `data:image/png;base64,${measured.picture}`, alt }) : element("i", {}, measured ? "picture not kept: too large" : "no picture");
    return element("figure", { class: verdict === "holds" || verdict === "no shadow" ? null : "breaks" }, picture,
      element("figcaption", {}, element("b", {}, finding.sheet.rows[at][0].show), ` ${verdict}`));
  }));
  const family = (finding, index) => {
    const { varied, meaning } = data.about[index];
    return section(finding.title, paragraph(`${varied} ${meaning}`), note(`${finding.sheet.columns[0]}:`), strip(index, finding), ...finding.notes.map(paragraph),
      plotOf(finding), element("details", {}, element("summary", {}, `all ${finding.sheet.rows.length} points in numbers`), table(finding.sheet.columns, finding.sheet.rows)));
  };
  return [...data.introduction.map(paragraph), section(whole.title, ...whole.notes.map(paragraph), table(whole.sheet.columns, whole.sheet.rows)), terms, ...families.map(family)];
}

// The table first, then each quality: how it is measured, its figures, and what each method draws beside the truth.
function table3Sections() {
  const [whole, ...findings] = data.findings;
  const rows = [...data.report.truths, ...data.report.rows];
  const quality = (finding, index) => {
    const { id, about, ticks } = data.qualities[index];
    const cases = rows.map((row) => row.cases.filter((one) => one.quality === id));
    const strip = (name, at) => [note(name), element("div", { class: "strip" }, ...rows.map((row, i) => {
      const one = cases[i][at], image = element("img", { src: `data:image/png;base64,${one.picture}`, alt: `${row.name}, ${name}` });
      return element("figure", { class: ticks[i][at] ? null : "breaks" }, image, element("figcaption", {}, element("b", {}, short(one.figure)), ` ${row.name}${i < data.report.truths.length ? ", " + row.light : ""}`));
    }))];
    return section(finding.title, ...about.map(paragraph), ...cases[0].flatMap((one, at) => strip(one.case, at)), plotOf(finding),
      element("details", {}, element("summary", {}, "all figures"), table(finding.sheet.columns, finding.sheet.rows)));
  };
  return [...data.introduction.map(paragraph), section(whole.title, table(whole.sheet.columns, whole.sheet.rows), ...whole.notes.map(paragraph)), ...findings.map(quality)];
}

// The price list first, then each subject.
function fidelitySections() {
  return [...data.introduction.map(paragraph), ...data.findings.map((finding) => section(finding.title, finding.svg === null ? null : plotOf(finding),
    table(finding.sheet.columns, finding.sheet.rows), ...finding.notes.map(paragraph)))];
}

function framesSections(frames) {
  const timed = frames.frames.every((frame) => frame.ms !== null);
  const ids = frames.frames[0].phases.map((phase) => phase.id);
  const rows = frames.frames.map((frame, index) => [index, frame.time, frame.ms, ...frame.phases.map((phase) => phase.ms), frame.mean_visibility]);
  return [note(`${frames.frames.length} frames of ${frames.scene} on ${frames.machine}; the worst is frame ${frames.worst_frame}.`),
    timed ? section("Time of each frame", lineChart(frames.frames.map((frame) => frame.ms), "frame", "ms")) : null, pictureSection(data.pictures, "All frames"),
    section("Frames", table(["frame", "time", "ms", ...ids, "mean visibility"], rows)),
    element("h2", {}, `The worst frame: ${frames.worst_frame}`), ...runSections(data.report, data.worst)].filter((part) => part !== null);
}

document.getElementById("title").textContent = data.title;
const makers = { run: () => runSections(data.report, data.pictures), study: () => studySections(data.study), stability: stabilitySections, table3: table3Sections, fidelity: fidelitySections, frames: () => framesSections(data.frames) };
main.append(...makers[data.kind]());
