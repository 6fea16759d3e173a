"use strict";
// Small charts, drawn as SVG. Colors are Okabe and Ito's, then grays; every part has its name and number as a title.
const CAUSES = ["issue", "dependency", "l1", "l2", "mshr", "tlb", "remote", "ring", "memory", "atomic", "gather_lines", "queue", "barrier"];
const COLORS = ["#0072b2", "#56b4e9", "#009e73", "#8fd6bb", "#00533d", "#8c6d31", "#e69f00", "#f0e442", "#d55e00", "#cc79a7", "#7a5195", "#8a8f99", "#c9cdd4"];
const LABELS = { l1: "L1", l2: "L2", mshr: "MSHR", tlb: "TLB", gather_lines: "gather lines", barrier: "barrier / idle" };
const label = (name) => LABELS[name] || name.replaceAll("_", " ");

function element(name, attributes, ...children) {
  const node = document.createElement(name);
  fill(node, attributes, children);
  return node;
}

function shape(name, attributes, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  fill(node, attributes, children);
  return node;
}

function fill(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes || {})) {
    if (typeof value === "function") node.addEventListener(key, value);
    else if (value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
}

// Four digits of a number, or all of a whole one.
function short(number) {
  if (number === null || number === undefined) return "-";
  if (Number.isInteger(number)) return grouped(number);
  const size = Math.abs(number);
  if (size >= 1e7 || size < 1e-4) return number.toExponential(3);
  return number.toFixed(Math.max(0, Math.min(7, 3 - Math.floor(Math.log10(size)))));
}

const grouped = (number) => String(number).replace(/\B(?=(\d{3})+$)/g, "\u202f");
const percent = (part, digits = 1) => (part === null || Number.isNaN(part) ? "-" : (part * 100).toFixed(digits) + "%");

function legend(names, colors) {
  const entry = (name, index) => element("span", {}, element("i", { style: `background:${colors[index]}` }), label(name));
  return element("div", { class: "legend" }, ...names.map(entry));
}

// Horizontal bars in parts. rows: {name, parts: [{name, value, color}], note}
function stackedBars(rows, relative) {
  const width = 1000, left = 210, height = 30;
  const right = Math.max(90, ...rows.map((row) => 9 * (row.note || "").length + 16));
  const sum = (row) => row.parts.reduce((all, part) => all + part.value, 0);
  const most = Math.max(...rows.map(sum), 1e-12);
  const chart = shape("svg", { class: "chart", viewBox: `0 0 ${width} ${rows.length * height + 4}`, role: "img" });
  rows.forEach((row, index) => {
    const y = index * height + 4, all = sum(row);
    chart.append(shape("text", { x: left - 10, y: y + 16, "text-anchor": "end" }, row.name));
    let x = left;
    for (const part of row.parts) {
      const length = ((width - left - right) * part.value) / (relative ? all || 1 : most);
      if (length <= 0) continue;
      const title = `${row.name}: ${label(part.name)} ${percent(part.value / (all || 1))}${part.note ? ", " + part.note : ""}`;
      chart.append(shape("rect", { x, y, width: length, height: height - 8, fill: part.color }, shape("title", {}, title)));
      x += length;
    }
    chart.append(shape("text", { x: x + 6, y: y + 16, class: "quiet" }, row.note));
  });
  return element("div", { class: "chartbox" }, chart);
}

// A row of cells for each name, the darker the more. rows: {name, values in [0, 1]}
function strips(rows, what) {
  const width = 1000, left = 210, height = 26;
  const chart = shape("svg", { class: "chart", viewBox: `0 0 ${width} ${rows.length * height + 22}`, role: "img" });
  const columns = Math.max(...rows.map((row) => row.values.length), 1);
  const cell = (width - left) / columns;
  rows.forEach((row, index) => {
    const y = index * height;
    chart.append(shape("text", { x: left - 10, y: y + 16, "text-anchor": "end" }, row.name));
    chart.append(shape("rect", { x: left, y, width: width - left, height: height - 4, fill: "none", class: "faint" }));
    row.values.forEach((value, core) => {
      const title = shape("title", {}, `${row.name}, ${what} ${core}: ${percent(value)}`);
      chart.append(shape("rect", { x: left + core * cell, y, width: Math.max(cell - 0.5, 0.5), height: height - 4, fill: "#0072b2", "fill-opacity": value }, title));
    });
  });
  chart.append(shape("text", { x: left, y: rows.length * height + 14, class: "quiet" }, `${what} 0`));
  chart.append(shape("text", { x: width, y: rows.length * height + 14, class: "quiet", "text-anchor": "end" }, `${what} ${columns - 1}`));
  return element("div", { class: "chartbox" }, chart);
}

// Logarithmic axes, roofs as lines, phases as points. roofs: {name, at(x)}, points: {name, x, y, color}
function roofline(roofs, points, xLabel, yLabel) {
  const box = { left: 80, top: 16, right: 720, bottom: 360 };
  const known = points.filter((point) => point.x > 0 && point.y > 0);
  const chart = shape("svg", { class: "chart", viewBox: "0 0 1000 410", role: "img" });
  if (known.length === 0) return element("p", { class: "soft" }, "No phase moved data here.");
  const xs = known.map((point) => point.x);
  const x0 = Math.pow(10, Math.floor(Math.log10(Math.min(...xs)) - 0.3)), x1 = Math.pow(10, Math.ceil(Math.log10(Math.max(...xs)) + 0.3));
  const ys = known.map((point) => point.y).concat(roofs.map((roof) => roof.at(x1)));
  const y0 = Math.pow(10, Math.floor(Math.log10(Math.min(...ys)))), y1 = Math.pow(10, Math.ceil(Math.log10(Math.max(...ys)) + 0.05));
  const place = (value, low, high, from, to) => from + (Math.log(value / low) / Math.log(high / low)) * (to - from);
  const px = (x) => place(x, x0, x1, box.left, box.right), py = (y) => place(y, y0, y1, box.bottom, box.top);
  for (let x = x0; x <= x1 * 1.01; x *= 10) {
    chart.append(shape("line", { x1: px(x), x2: px(x), y1: box.top, y2: box.bottom, class: "faint" }));
    chart.append(shape("text", { x: px(x), y: box.bottom + 18, "text-anchor": "middle" }, short(x)));
  }
  for (let y = y0; y <= y1 * 1.01; y *= 10) {
    chart.append(shape("line", { x1: box.left, x2: box.right, y1: py(y), y2: py(y), class: "faint" }));
    chart.append(shape("text", { x: box.left - 8, y: py(y) + 5, "text-anchor": "end" }, short(y)));
  }
  for (const roof of roofs) {
    const steps = Array.from({ length: 121 }, (_, i) => x0 * Math.pow(x1 / x0, i / 120)).filter((x) => roof.at(x) >= y0);
    chart.append(shape("polyline", { points: steps.map((x) => `${px(x)},${py(roof.at(x))}`).join(" "), fill: "none", class: "axis", "stroke-width": 2, "stroke-dasharray": roof.dash || null }, shape("title", {}, roof.name)));
  }
  points.forEach((point, index) => {
    const y = box.top + 8 + index * 22;
    const title = point.x > 0 && point.y > 0 ? `${point.name}: ${short(point.x)}, ${short(point.y)}` : `${point.name}: no data moved`;
    if (point.x > 0 && point.y > 0) chart.append(shape("circle", { cx: px(point.x), cy: py(point.y), r: 6, fill: point.color, class: "axis" }, shape("title", {}, title)));
    chart.append(shape("circle", { cx: 742, cy: y, r: 6, fill: point.color, class: "axis" }), shape("text", { x: 756, y: y + 5 }, point.name));
  });
  chart.append(shape("text", { x: box.right, y: box.bottom + 40, "text-anchor": "end", class: "quiet" }, xLabel));
  chart.append(shape("text", { x: box.left + 6, y: box.top + 14, class: "quiet" }, yLabel));
  return element("div", { class: "chartbox" }, chart);
}

// A line over frames. values: numbers; marks the greatest.
function lineChart(values, xLabel, yLabel) {
  const box = { left: 70, top: 16, right: 980, bottom: 240 };
  const chart = shape("svg", { class: "chart", viewBox: "0 0 1000 290", role: "img" });
  const most = Math.max(...values) * 1.08 || 1;
  const px = (i) => box.left + (i / Math.max(values.length - 1, 1)) * (box.right - box.left), py = (v) => box.bottom - (v / most) * (box.bottom - box.top);
  for (let i = 0; i <= 4; i++) {
    const value = (most * i) / 4;
    chart.append(shape("line", { x1: box.left, x2: box.right, y1: py(value), y2: py(value), class: "faint" }), shape("text", { x: box.left - 8, y: py(value) + 5, "text-anchor": "end" }, short(value)));
  }
  chart.append(shape("polyline", { points: values.map((v, i) => `${px(i)},${py(v)}`).join(" "), fill: "none", stroke: "#0072b2", "stroke-width": 2 }));
  const worst = values.indexOf(Math.max(...values));
  values.forEach((value, i) => {
    const title = shape("title", {}, `frame ${i}: ${short(value)}`);
    chart.append(shape("circle", { cx: px(i), cy: py(value), r: i === worst ? 7 : 4, fill: i === worst ? "#d55e00" : "#0072b2" }, title));
  });
  chart.append(shape("text", { x: box.right, y: box.bottom + 38, "text-anchor": "end", class: "quiet" }, xLabel), shape("text", { x: box.left + 6, y: box.top + 2, class: "quiet" }, yLabel));
  return element("div", { class: "chartbox" }, chart);
}
