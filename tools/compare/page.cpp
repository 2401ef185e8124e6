#include "tools/compare/report.h"

#include "tools/report/base64.h"

#include <nlohmann/json.hpp>

#include <string>
#include <string_view>

namespace nusselt::tools {

extern const char* const chart_js; // third_party/chartjs

namespace {

constexpr const char* head = R"page(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>nusselt: run time against error</title>
<style>
:root { color-scheme: light; --ink: #1c2127; --soft: #5d6873; --line: #dde2e7; --ground: #f5f6f7; --card: #fff; }
* { box-sizing: border-box; }
body { margin: 0; font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--ground); }
main { max-width: 1240px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 20px; margin: 0; }
h3 { font-size: 14px; margin: 0 0 8px; color: var(--soft); font-weight: 600; }
p { max-width: 78ch; }
.soft { color: var(--soft); }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 18px; margin: 18px 0; }
.head { display: flex; flex-wrap: wrap; gap: 6px 20px; align-items: baseline; margin-bottom: 12px; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(360px, 1fr)); gap: 22px; margin-top: 18px; }
.row.shots { grid-template-columns: repeat(auto-fill, minmax(255px, 1fr)); }
details > summary { cursor: pointer; }
details > summary h2 { display: inline-block; margin-right: 16px; }
.plot { position: relative; height: 300px; }
.plot.tall { height: 460px; }
select { font: inherit; padding: 2px 6px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; white-space: nowrap; }
th, td { padding: 3px 9px; text-align: right; border-bottom: 1px solid var(--line); }
th { white-space: normal; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
tr.ours td:first-child { font-weight: 600; }
th.group { text-align: center; }
td.apart, th.apart { border-left: 1px solid var(--line); }
td.noise { color: var(--soft); }
figure { margin: 0; }
figure img { width: 100%; height: auto; border: 1px solid var(--line); border-radius: 6px; }
figcaption { font-size: 13px; color: var(--soft); }
.warning { border-left: 4px solid #c77700; padding: 4px 12px; background: #fff6e6; }
.scale { display: inline-block; width: 220px; height: 12px; border-radius: 3px; vertical-align: middle;
  background: linear-gradient(90deg, rgb(39,80,160), rgb(64,194,194), rgb(249,225,64), rgb(237,39,39)); }
</style>
</head>
<body>
<main>
<h1>Run time against error</h1>
<p class="soft" id="machine"></p>
<div id="warnings"></div>
<p>Down and to the left is better. Each point is one way to get the same thing: 25 transfer coefficients a vertex, this
frame. The line is Embree, at different numbers of rays: packets of 4x4 through the mask's own samples, the BVH refitted or rebuilt every frame,
cell-integrated weights. Rings mark the Pareto front. Errors are told against a reference of many more rays; what lies under
its own noise isn't a finding. <em>Clear</em> receivers see at least a tenth of the sky and don't touch another surface; where
surfaces touch, the truth itself flips.</p>
<div class="card" id="summary" hidden><div class="head"><h2>Quality standard, every model</h2></div><div class="scroll"><table></table></div></div>
<div class="card"><div class="head"><h2>Cost against size</h2><span class="soft" id="sized"></span></div><div class="row" id="overview"></div></div>
<div class="card" id="paper" hidden><div class="head"><h2>Tables 1 and 2 of the paper</h2><span class="soft">Kautz, Lehtinen, Aila 2004, on a
3.06 GHz Pentium 4 Xeon; ours: quality paper, which is their method, on scenes of their sizes</span></div><div class="scroll"><table></table></div></div>
<div id="studies"></div>
<div id="scenes"></div>
</main>
<script>)page";

constexpr const char* middle = R"page(</script>
<script id="report" type="application/json">)page";

constexpr const char* tail = R"page(</script>
<script>
"use strict";
const report = JSON.parse(document.getElementById("report").textContent);
const make = (name, parent, text, kind) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  if (parent) parent.appendChild(made);
  return made;
};
const colors = { paper: "#8a6d3b", draft: "#2f9e44", standard: "#1c7ed6", fine: "#9c36b5" };
const gray = "#6b7680";
Chart.defaults.animation = false;
Chart.defaults.maintainAspectRatio = false;
Chart.defaults.font.family = "system-ui, sans-serif";
Chart.defaults.plugins.legend.labels.usePointStyle = true;
Chart.defaults.plugins.legend.labels.boxHeight = 7;
// For tests: how many plots there should be, and how many have drawn themselves.
window.plots = { expected: 0, drawn: 0 };
const drawn = { id: "drawn", afterRender(chart) { if (!chart.counted) { chart.counted = true; ++window.plots.drawn; } } };
// Names beside points where there is room, and rings around the front.
const labels = { id: "labels", afterDatasetsDraw(chart) {
  const c = chart.ctx, area = chart.chartArea, taken = [], names = [];
  const meets = (a, b) => a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h;
  c.save();
  c.font = "12px system-ui, sans-serif";
  chart.data.datasets.forEach((set, k) => {
    if (!set.named || !chart.isDatasetVisible(k)) return;
    chart.getDatasetMeta(k).data.forEach((at, j) => {
      const point = set.data[j];
      taken.push({ x: at.x - 6, y: at.y - 6, w: 12, h: 12 });
      names.push({ at, text: point.label, color: set.borderColor, first: set.showLine ? 1 : 0 });
      if (point.front) {
        c.strokeStyle = set.borderColor;
        c.lineWidth = 1.5;
        c.beginPath();
        c.arc(at.x, at.y, 8, 0, 2 * Math.PI);
        c.stroke();
      }
    });
  });
  names.sort((a, b) => a.first - b.first);
  c.textAlign = "left";
  c.textBaseline = "middle";
  for (const name of names) {
    const w = c.measureText(name.text).width, h = 13, places = [];
    for (const away of [10, 22, 34, 46])
      places.push([away, 0], [-away - w, 0], [away * 0.8, -away], [-away * 0.8 - w, away], [away * 0.8, away], [-away * 0.8 - w, -away], [-w / 2, -away - 4], [-w / 2, away + 4]);
    const box = ([dx, dy]) => ({ x: name.at.x + dx, y: name.at.y + dy - h / 2, w, h });
    const fits = b => b.x > area.left && b.x + w < area.right && b.y > area.top && b.y + h < area.bottom && !taken.some(t => meets(b, t));
    const place = box(places.find(p => fits(box(p))) ?? places[0]);
    taken.push(place);
    c.fillStyle = name.color;
    c.fillText(name.text, place.x, place.y + h / 2);
  }
  c.restore();
} };
Chart.register(drawn, labels);
const plot = (parent, title, config, tall) => {
  ++window.plots.expected;
  const box = make("div", parent);
  make("h3", box, title);
  const holder = make("div", box, undefined, tall ? "plot tall" : "plot");
  return new Chart(make("canvas", holder), config);
};
const decade = value => {
  const rounded = Math.log10(value);
  const lead = value / Math.pow(10, Math.floor(rounded + 1e-9));
  return [1, 2, 5].some(n => Math.abs(lead - n) < 1e-6) ? String(Number(value.toPrecision(2))) : "";
};
const known = value => value < 1e299;
// `values`: what must lie inside with some room.
const log = (title, values) => {
  const usable = (values ?? []).filter(v => v > 0 && known(v));
  return { type: "logarithmic", title: { display: true, text: title }, ticks: { callback: decade, maxRotation: 0, autoSkip: false },
    ...(usable.length ? { min: Math.min(...usable) / 1.4, max: Math.max(...usable) * 1.4 } : {}) };
};
const linear = title => ({ type: "linear", beginAtZero: true, title: { display: true, text: title } });
const percent = value => known(value) ? (100 * value).toFixed(value < 0.001 ? 3 : 2) : "\u221e";

document.getElementById("machine").textContent = report.machine.processor + " (" + report.machine.hardware_threads +
  " threads); " + report.build.configuration + "; revision " + report.build.revision + "; " + report.settings.threads +
  (report.settings.threads === 1 ? " thread" : " threads") + " for every entry; nusselt " + report.settings.command;
if (!report.complete) make("p", document.getElementById("warnings"), "This run was cut short: it holds what was done by then.", "warning");

const speedup = (e, which) => {
  const equal = e.equal_error[which];
  if (!(equal.speedup > 0)) return "";
  return ({ "error smaller than the curve's": "\u2265 ", "error larger than the curve's": "\u2264 " }[equal.place] ?? "") + equal.speedup.toFixed(1) + " x";
};
const metrics = {
  "mean error, clear": e => e.error.clear.mean, "p99 error, clear": e => e.error.clear.p99, "worst, clear": e => e.error.clear.max,
  "pooled error, clear": e => e.error.clear.pooled, "mean error, all": e => e.error.all.mean, "p99 error, all": e => e.error.all.p99,
  "worst, all": e => e.error.all.max, "absolute error, mean": e => e.absolute.mean, "ambient occlusion, mean": e => e.ambient_occlusion.mean,
  "temporal, mean": e => e.temporal.mean };
for (const light of Object.keys(report.scenes.length ? report.scenes[0].entries[0]?.radiance ?? {} : {}))
  metrics["radiance under " + light + ", rms"] = e => e.radiance[light].relative_rms;

const front = (entries, metric) => entries.filter(e => !entries.some(o => o !== e &&
  metric(o) <= metric(e) && o.us_per_vertex.min <= e.us_per_vertex.min && (metric(o) < metric(e) || o.us_per_vertex.min < e.us_per_vertex.min)));

const curve = (scene, metric) => {
  const usable = e => e.us_per_vertex && e.us_per_vertex.min > 0 && metric(e) > 0 && known(metric(e));
  const timed = scene.entries.filter(usable);
  const best = new Set(front(timed, metric).map(e => e.name));
  const point = e => ({ x: e.us_per_vertex.min, y: 100 * metric(e), label: e.name.replace("embree ", ""), front: best.has(e.name) });
  const of = kind => timed.filter(e => e.kind === kind);
  const sets = [{ label: "Embree, rays a vertex", data: of("peer").map(point), showLine: true, borderColor: gray, backgroundColor: gray,
    pointRadius: 3, borderWidth: 1.5, named: true }];
  for (const e of of("ours")) sets.push({ label: e.name, data: [point(e)], borderColor: colors[e.name], backgroundColor: colors[e.name],
    pointRadius: 5, named: true });
  for (const e of of("centred")) sets.push({ label: e.name, data: [point(e)], borderColor: gray, backgroundColor: "transparent", pointRadius: 4,
    pointStyle: "rect", named: true });
  for (const e of of("naive")) sets.push({ label: e.name + " (one ray at a time)", data: [point(e)], borderColor: "#b08", backgroundColor: "#b08",
    pointRadius: 4, pointStyle: "triangle", named: true });
  const xs = timed.map(e => e.us_per_vertex.min), range = [Math.min(...xs) / 1.5, Math.max(...xs) * 1.5];
  for (const e of scene.entries.filter(e => e.kind === "floor" && metric(e) > 0)) sets.push({ label: e.name, hidden: !/^floor (1024|4096)$/.test(e.name),
    data: range.map(x => ({ x, y: 100 * metric(e) })), showLine: true, borderDash: [3, 4], borderWidth: 1, borderColor: "#c98", backgroundColor: "#c98", pointRadius: 0 });
  return sets;
};

const show = (scene, card, top) => {
  make("span", top, scene.vertices + " vertices, " + scene.triangles + " triangles, " + scene.receivers + " receivers; " + scene.times.length +
    (scene.times.length === 1 ? " moment x " : " moments x ") + scene.repeats + " rounds; " + scene.isa + "; reference " + scene.reference.rays + " rays at " + scene.reference.receivers_per_frame +
    " receivers a frame, noise " + percent(scene.reference.noise.all.mean) + " % (clear " + percent(scene.reference.noise.clear.mean) + " %); " +
    scene.reference.clear + " of " + scene.reference.counted + " clear, " + scene.reference.dark + " see under 1 %" +
    (scene.peer.receivers_timed_per_frame < scene.receivers ? "; Embree timed on " + scene.peer.receivers_timed_per_frame + " receivers, scaled up" : ""), "soft");
  for (const note of scene.notes) make("p", card, note, "warning");
  const chooser = make("label", card, "Figure: ", "soft"), choice = make("select", chooser);
  choice.setAttribute("aria-label", scene.name + ": figure");
  for (const name of Object.keys(metrics)) make("option", choice, name);
  const axes = metric => ({ x: log("CPU microseconds a vertex", scene.entries.map(e => e.us_per_vertex?.min ?? 0)),
    y: log("error, %", scene.entries.filter(e => e.us_per_vertex).map(e => 100 * metric(e))) });
  const main = plot(card, "Run time against error", { type: "scatter", data: { datasets: curve(scene, metrics["mean error, clear"]) },
    options: { scales: axes(metrics["mean error, clear"]), plugins: { legend: { position: "bottom" },
      tooltip: { callbacks: { label: c => (c.raw.label ?? c.dataset.label) + ": " + c.parsed.x.toPrecision(3) + " us, " + c.parsed.y.toPrecision(3) + " %" } } } } }, true);
  choice.onchange = () => {
    main.data.datasets = curve(scene, metrics[choice.value]);
    main.options.scales = axes(metrics[choice.value]);
    main.update();
  };

  const row = make("div", card, undefined, "row");
  const ours = scene.entries.filter(e => e.work);
  const stages = ["refit", "cull", "transform", "raster", "integrate", "rotate"], hues = ["#868e96", "#f59f00", "#4dabf7", "#e8590c", "#37b24d", "#ae3ec9"];
  const theirs = report.paper.find(p => p.name === scene.name);
  const names = ours.map(e => e.name).concat(theirs ? ["published 2004"] : []);
  plot(row, "Where the time goes, %", { type: "bar", data: { labels: names, datasets: stages.map((stage, k) => ({ label: stage, backgroundColor: hues[k],
    data: ours.map(e => 100 * e.work.stages[stage]).concat(theirs ? [100 * (theirs.stages[stage] ?? 0)] : []) })).concat(theirs ? [{ label: "other (published)",
    backgroundColor: "#ced4da", data: ours.map(() => 0).concat([100 * theirs.stages.other]) }] : []) },
    options: { indexAxis: "y", scales: { x: { stacked: true, max: 100 }, y: { stacked: true } }, plugins: { legend: { position: "bottom" } } } });
  const bins = report.histogram, place = k => Math.pow(10, bins.low_decade + (k + 0.5) / bins.bins_per_decade);
  plot(row, "How the errors are spread, clear receivers", { type: "line", data: { datasets: scene.entries.filter(e => e.kind === "ours" || e.name === "embree 1024").map(e => {
    const all = e.histogram.clear.reduce((a, b) => a + b, 0) || 1, color = colors[e.name] ?? gray;
    return { label: e.name, borderColor: color, backgroundColor: color, pointRadius: 0, borderWidth: 1.5, tension: 0.2,
      data: e.histogram.clear.map((n, k) => ({ x: 100 * place(k), y: 100 * n / all })) };
  }) }, options: { scales: { x: { ...log("relative error, %"), ticks: { maxRotation: 0, autoSkip: false, callback: v => Math.abs(Math.log10(v) % 1) < 1e-6 ? String(v) : "" } }, y: linear("receivers, %") }, plugins: { legend: { position: "bottom" } } } });
  if (scene.scaling.length) {
    const kinds = [...new Set(scene.scaling.map(s => s.entry))], most = Math.max(...scene.scaling.map(s => s.threads));
    plot(row, "Scaling over threads", { type: "line", data: { datasets: kinds.map(kind => {
      const points = scene.scaling.filter(s => s.entry === kind), color = colors[kind] ?? gray;
      return { label: kind, borderColor: color, backgroundColor: color, data: points.map(s => ({ x: s.threads, y: points[0].frame_ms.min / s.frame_ms.min })) };
    }).concat([{ label: "ideal", borderColor: "#ccc", backgroundColor: "#ccc", borderDash: [4, 4], pointRadius: 0, data: [{ x: 1, y: 1 }, { x: most, y: most }] }]) },
      options: { scales: { x: { type: "linear", min: 1, max: Math.max(most, 2), ticks: { stepSize: 1 }, title: { display: true, text: "threads" } }, y: linear("times as fast as one") },
        plugins: { legend: { position: "bottom" } } } });
  }
  if (scene.shots.length) {
    const shots = make("div", card, undefined, "row shots");
    for (const shot of scene.shots) {
      const figure = make("figure", shots), image = make("img", figure);
      image.src = "data:image/jpeg;base64," + shot.image;
      image.alt = scene.name + ", " + shot.title;
      make("figcaption", figure, shot.title);
    }
    const key = make("p", card, "0.1 % ", "soft");
    make("span", key, undefined, "scale");
    key.append(" 100 % and more; paler: not clear; dark grey: sees under 1 %; grey: no reference. Rings: the worst vertices that are in view; double: the worst of all");
  }
  const wrap = make("div", card, undefined, "scroll"), table = make("table", wrap);
  table.style.marginTop = "18px";
  const headings = make("tr", make("thead", table));
  for (const text of ["", "us a vertex", "median", "ms a frame", "frames/s", "clear: mean %", "median", "p95", "p99", "max", "pooled", "all: mean %", "p99", "max",
    "absolute %", "AO %", "temporal %", "Embree takes: clear", "all", "triangles a vertex"]) make("th", headings, text);
  for (const light of Object.keys(scene.entries[0]?.radiance ?? {})) make("th", headings, light + " %");
  const body = make("tbody", table);
  for (const e of scene.entries) {
    const line = make("tr", body, undefined, e.kind), c = e.error.clear, a = e.error.all;
    make("td", line, e.name + (e.setup ? " (" + e.setup + ")" : ""));
    for (const text of e.us_per_vertex ? [e.us_per_vertex.min.toFixed(3), e.us_per_vertex.median.toFixed(3), e.frame_ms.median.toFixed(2), e.fps.toFixed(0)] : ["", "", "", ""])
      make("td", line, text);
    make("td", line, c.below_noise ? "<" + percent(scene.reference.noise.clear.mean) : percent(c.mean), c.below_noise ? "noise" : "");
    for (const value of [c.median, c.p95, c.p99, c.max, c.pooled]) make("td", line, percent(value));
    make("td", line, a.below_noise ? "<" + percent(scene.reference.noise.all.mean) : percent(a.mean), a.below_noise ? "noise" : "");
    for (const value of [a.p99, a.max, e.absolute.mean, e.ambient_occlusion.mean]) make("td", line, percent(value));
    make("td", line, e.temporal.count === 0 ? "" : e.temporal.below_noise ? "noise" : percent(e.temporal.mean), e.temporal.below_noise ? "noise" : "");
    for (const which of ["clear", "all"]) make("td", line, e.kind === "ours" ? speedup(e, which) : "");
    make("td", line, e.work ? e.work.per_receiver.triangles_rasterized.toFixed(1) : "");
    for (const light of Object.values(e.radiance)) make("td", line, percent(light.relative_rms));
  }
  make("p", card, "Memory: meshes " + (scene.memory.mesh_bytes / 1e6).toFixed(1) + " MB, whole context " + (scene.memory.context_bytes / 1e6).toFixed(1) +
    " MB, Embree " + (scene.memory.peer_bytes / 1e6).toFixed(1) + " MB. Adding the meshes took " + scene.add_mesh_ms.toFixed(0) + " ms. Embree's BVH: built in " +
    scene.peer.build_ms.toFixed(2) + " ms" + (scene.peer.refit_ms > 0 ? ", refitted in " + scene.peer.refit_ms.toFixed(2) + " ms a frame." : "."), "soft");
};
// Many scenes unfold one by one.
for (const scene of report.scenes) {
  const many = report.scenes.length > 6, card = make(many ? "details" : "section", document.getElementById("scenes"), undefined, "card");
  const top = make(many ? "summary" : "div", card, undefined, "head");
  make("h2", top, scene.name);
  if (!many) {
    show(scene, card, top);
    continue;
  }
  card.id = "scene-" + report.scenes.indexOf(scene);
  card.ontoggle = () => { if (card.open && card.children.length === 1) show(scene, card, top); };
}
for (const failure of report.failures) make("p", document.getElementById("warnings"), failure.name + " was not measured: " + failure.reason, "warning");

if (report.scenes.length > 1) {
  const card = document.getElementById("summary"), table = card.querySelector("table"), headings = make("tr", make("thead", table)), body = make("tbody", table);
  card.hidden = false;
  for (const text of ["", "vertices", "triangles", "errors over", "clear", "us a vertex", "triangles a vertex", "clear: mean %", "p99", "max", "floor %", "times the floor", "all: mean %",
    "Embree takes: clear", "all", ""]) make("th", headings, text);
  for (const scene of report.scenes) {
    const line = make("tr", body), e = scene.entries.find(e => e.name === "standard"), floor = scene.entries.find(e => e.name === "floor 1024"), cell = text => make("td", line, text);
    const name = cell("");
    if (report.scenes.length > 6) {
      const link = make("a", name, scene.name), target = document.getElementById("scene-" + report.scenes.indexOf(scene));
      link.href = "#" + target.id;
      link.onclick = () => { target.open = true; };
    } else name.textContent = scene.name;
    cell(scene.vertices);
    cell(scene.triangles);
    if (!e) { cell("not measured within the limit"); continue; }
    cell(scene.reference.receivers_per_frame + " of " + scene.receivers);
    cell(scene.reference.counted ? (100 * scene.reference.clear / scene.reference.counted).toFixed(0) + " %" : "");
    cell(e.us_per_vertex.min > 0 ? e.us_per_vertex.min.toFixed(3) : "");
    cell(e.work ? e.work.per_receiver.triangles_rasterized.toFixed(1) : "");
    const some = e.error.clear.count > 0;
    for (const value of [e.error.clear.mean, e.error.clear.p99, e.error.clear.max]) cell(some ? percent(value) : "");
    cell(some && floor ? percent(floor.error.clear.mean) : "");
    cell(some && floor && floor.error.clear.mean > 1e-5 ? (e.error.clear.mean / floor.error.clear.mean).toFixed(2) : "");
    cell(percent(e.error.all.mean));
    cell(speedup(e, "clear"));
    cell(speedup(e, "all"));
    cell(scene.complete ? "" : "not complete");
  }
}

const overview = document.getElementById("overview");
document.getElementById("sized").textContent = report.sizes.length ? "Lines: the hand, one moment, meshed finer and finer; outlined points: the scenes" : "One point a scene";
const sized = (title, x, label, y, unit) => {
  const sets = [];
  for (const [name, color] of Object.entries({ ...colors, "embree 1024": gray })) {
    const line = report.sizes.filter(p => p.entry === name && p.us_per_vertex.min > 0).map(p => ({ x: p[x], y: y(p), label: "hand" })).sort((a, b) => a.x - b.x);
    const scenes = report.scenes.map(s => ({ s, e: s.entries.find(e => e.name === name) })).filter(p => p.e && p.e.us_per_vertex && p.e.us_per_vertex.min > 0)
      .map(p => ({ x: p.s[x], y: y(p.e), label: p.s.name }));
    if (line.length) sets.push({ label: name, data: line, showLine: true, borderColor: color, backgroundColor: color, pointRadius: 2.5, borderWidth: 1.5 });
    if (scenes.length) sets.push({ label: name + (line.length ? ", scenes" : ""), data: scenes, borderColor: color, backgroundColor: line.length ? "transparent" : color, pointRadius: 4 });
  }
  plot(overview, title, { type: "scatter", data: { datasets: sets }, options: { scales: { x: log(label, sets.flatMap(set => set.data.map(p => p.x))), y: log(unit, sets.flatMap(set => set.data.map(p => p.y))) },
    plugins: { legend: { position: "bottom", labels: { filter: item => !item.text.endsWith(", scenes") } },
      tooltip: { callbacks: { label: c => c.raw.label + ", " + c.dataset.label.replace(", scenes", "") + ": " + c.parsed.y.toPrecision(3) } } } } }, true);
};
sized("Cost of a frame against vertices", "vertices", "vertices", e => e.frame_ms.min, "ms a frame");
sized("Cost of a vertex against triangles", "triangles", "triangles", e => e.us_per_vertex.min, "CPU microseconds a vertex");

const topics = { glossy: "Glossy surfaces: processor time over diffuse transfer, instead of it and beside it; error against rays",
  direct: "Direct light beside 25 terms: processor time over transfer alone; error of the radiance against rays into the light itself",
  pvs: "Potentially visible sets of the animation: triangles looked at a receiver, processor time over culling alone; error half-way between recorded frames",
  objects: "Many objects: processor time over the sum of their times alone; error of all, as one object, and each alone",
  falloff: "Occlusion that fades with distance: processor time over none, error against rays",
  static: "What stands still: the scene on a ground that only receives" };
for (const study of report.studies) {
  const card = make("div", document.getElementById("studies"), undefined, "card"), head = make("div", card, undefined, "head");
  make("h2", head, study.scene + ", " + study.topic);
  make("span", head, topics[study.topic], "soft");
  const table = make("table", make("div", card, undefined, "scroll")), names = make("tr", table);
  for (const name of study.columns) make("th", names, name);
  for (const cells of study.rows) {
    const row = make("tr", table);
    for (const cell of cells) make("td", row, cell);
  }
}

const pairs = report.scenes.map(s => ({ s, p: report.paper.find(p => p.name === s.name), e: s.entries.find(e => e.name === "paper") })).filter(x => x.p && x.e && x.e.work);
if (pairs.length) {
  const card = document.getElementById("paper"), table = card.querySelector("table"), group = make("tr", table), line = make("tr", table);
  card.hidden = false;
  make("th", group, "");
  make("th", line, "");
  for (const x of pairs) {
    const over = make("th", group, x.s.name, "group apart");
    over.colSpan = 2;
    make("th", line, "published", "apart");
    make("th", line, "ours");
  }
  const both = (name, a, b) => {
    const row = make("tr", table);
    make("td", row, name);
    for (const x of pairs) {
      make("td", row, a(x), "apart");
      make("td", row, b(x));
    }
  };
  const given = value => value > 0 ? value.toFixed(1) : "-";
  both("vertices", x => x.p.vertices, x => x.s.vertices);
  both("triangles", x => x.p.triangles, x => x.s.triangles);
  both("triangles of the coarse mesh", x => x.p.coarse_triangles, x => x.s.coarse_triangles);
  both("triangles rasterised a vertex", x => x.p.triangles_rasterized.toFixed(1), x => x.e.work.per_receiver.triangles_rasterized.toFixed(1));
  both("triangles rasterised with their PVS", x => given(x.p.triangles_rasterized_pvs), () => "-");
  both("triangles considered a vertex", () => "-", x => x.e.work.per_receiver.triangles_considered.toFixed(1));
  both("frames a second", x => x.p.fps.toFixed(1), x => x.e.fps.toFixed(0));
  both("frames a second with their PVS", x => given(x.p.fps_pvs), () => "-");
  const sets = (s, column) => {
    const study = report.studies.find(t => t.scene === s.name && t.topic === "pvs"), row = study && study.rows.find(r => r[0] === "standard");
    return row ? row[study.columns.indexOf(column)] : "-";
  };
  both("standard: triangles looked at", () => "-", x => sets(x.s, "looked at"));
  both("standard: looked at with a visible set", () => "-", x => sets(x.s, "looked at with a set"));
  both("standard: frames a second", () => "-", x => sets(x.s, "frames a second"));
  both("standard: frames a second with a visible set", () => "-", x => sets(x.s, "frames with a set"));
  both("mean L2 error, %", x => percent(x.p.error), x => percent(x.e.error.all.mean));
  const share = (e, names) => names.reduce((sum, name) => sum + e.work.stages[name], 0);
  both("rasterization, % of time", x => percent(x.p.stages.raster), x => percent(share(x.e, ["raster"])));
  both("integration, %", x => percent(x.p.stages.integrate), x => percent(share(x.e, ["integrate"])));
  both("transform and culling, %", x => percent(x.p.stages.transform), x => percent(share(x.e, ["transform", "cull"])));
  both("other, %", x => percent(x.p.stages.other), x => percent(share(x.e, ["rotate", "refit"])));
}
</script>
</body>
</html>
)page";

// Inside a script element a closing tag would end it.
std::string for_script(std::string text) {
    for (size_t at = text.find("</"); at != std::string::npos; at = text.find("</", at))
        text.replace(at, 2, "<\\/");
    return text;
}

} // namespace

std::string report_page(const Comparison& comparison) {
    nlohmann::ordered_json json = report_json(comparison);
    for (size_t k = 0; k < comparison.scenes.size(); ++k) {
        auto& shots = json["scenes"][k]["shots"] = nlohmann::ordered_json::array();
        for (const Shot& shot : comparison.scenes[k].shots)
            shots.push_back({{"title", shot.title}, {"image", base64(encode_jpeg(shot.picture, 90))}});
    }
    // The map that it names isn't there.
    std::string_view library = chart_js;
    library = library.substr(0, library.rfind("//# sourceMappingURL"));
    return std::string(head).append(library).append(middle).append(for_script(json.dump())).append(tail);
}

} // namespace nusselt::tools
