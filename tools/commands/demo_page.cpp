#include "tools/commands/demo_page.h"

#include <nlohmann/json.hpp>

namespace nusselt::tools {

namespace {

constexpr const char* before_data = R"page(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>nusselt demo</title>
<style>
:root { color-scheme: light dark; --ink: #1d2430; --soft: #5a6474; --line: #d9dee6; --page: #f6f7f9; --card: #fff;
  --accent: #2f6fdb; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e9ef; --soft: #9aa4b4; --line: #2e3644; --page: #12161d; --card: #1a2029; --accent: #7aa7f7; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 1320px; margin: 0 auto; padding: 2.5rem 1.25rem 4rem; }
h1 { font-size: 2rem; margin: 0; letter-spacing: -0.02em; }
h2 { font-size: 1.3rem; margin: 0; text-transform: capitalize; }
p { margin: 0.4rem 0 0; color: var(--soft); max-width: 75ch; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 12px; padding: 1.25rem; margin-top: 1.5rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: 0.4rem 0.75rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; text-transform: capitalize; }
th { font-weight: 600; font-size: 0.85rem; color: var(--soft); }
tr:last-child td { border-bottom: 0; }
.head { display: flex; flex-wrap: wrap; gap: 0.25rem 1.5rem; align-items: baseline; justify-content: space-between; }
.figures { color: var(--soft); font-size: 0.92rem; font-variant-numeric: tabular-nums; }
.figures b { color: var(--ink); font-weight: 600; }
.trio { display: grid; grid-template-columns: repeat(3, 1fr); gap: 0.6rem; margin-top: 0.9rem; }
figure { margin: 0; }
figure img { display: block; width: 100%; border-radius: 8px; background: #e6e9ee; }
figcaption { text-align: center; font-size: 0.9rem; margin-top: 0.35rem; color: var(--soft); }
.controls { display: flex; align-items: center; gap: 0.9rem; margin-top: 0.8rem; }
input[type=range] { flex: 1; accent-color: var(--accent); }
button { font: inherit; width: 5.2rem; padding: 0.3rem 0; border-radius: 8px; border: 1px solid var(--line);
  background: transparent; color: var(--ink); cursor: pointer; }
button:hover { border-color: var(--accent); color: var(--accent); }
output { min-width: 8.5rem; text-align: right; color: var(--soft); font-size: 0.9rem; font-variant-numeric: tabular-nums; }
@media (max-width: 700px) { .trio { grid-template-columns: 1fr; } }
</style>
</head>
<body>
<main>
<h1>nusselt</h1>
<p>Soft self-shadows of deforming meshes. Every frame, for every vertex, the triangles around it are rasterised into a
mask over its hemisphere and integrated against 25 spherical harmonics: nothing is precomputed, nothing about the
animation is known in advance.</p>
<div class="card wide"><table id="summary"><thead><tr><th>Scene</th><th>Vertices (paper)</th><th>Triangles (paper)</th>
<th>ms a frame</th><th>&micro;s a vertex</th><th>Error, mean</th><th>p99</th><th>Clear, mean</th><th>p99</th><th>Noise of the reference</th>
<th>Paper's error</th></tr></thead><tbody></tbody></table></div>
<div id="scenes"></div>
<section class="card" id="crowd"><div class="head"><h2>Crowd</h2><span class="figures"></span></div><div class="trio"></div>
<figure style="margin-top:0.9rem;overflow-x:auto"></figure></section>
<div class="card"><h2 style="text-transform:none">What the figures mean</h2><div id="notes"></div></div>
</main>
<script>
const data = )page";

constexpr const char* after_data = R"page(;
const percent = x => (100 * x).toFixed(2) + " %";
const columns = ["Unshadowed", "nusselt, every frame", "Ray-traced reference"];
const element = (name, parent, text) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (parent) parent.appendChild(made);
  return made;
};
for (const scene of data.scenes) {
  const row = element("tr", document.querySelector("#summary tbody"));
  for (const cell of [scene.name, scene.vertices + " (" + scene.paper.vertices + ")",
      scene.triangles + " (" + scene.paper.triangles + ")", scene.frame_ms.toFixed(2), scene.us_per_vertex.toFixed(2),
      percent(scene.error_mean), percent(scene.error_p99), percent(scene.clear_mean), percent(scene.clear_p99),
      percent(scene.noise), percent(scene.paper.error)])
    element("td", row, cell);

  const card = element("section", document.querySelector("#scenes"));
  card.className = "card";
  const head = element("div", card);
  head.className = "head";
  element("h2", head, scene.name);
  const figures = element("span", head);
  figures.className = "figures";
  const trio = element("div", card);
  trio.className = "trio";
  const images = columns.map(title => {
    const figure = element("figure", trio);
    const image = element("img", figure);
    image.width = data.width;
    image.height = data.height;
    image.style.height = "auto";
    image.alt = scene.name + ", " + title;
    element("figcaption", figure, title);
    return image;
  });
  const controls = element("div", card);
  controls.className = "controls";
  const play = element("button", controls, "Play");
  const slider = element("input", controls);
  slider.type = "range";
  slider.min = 0;
  slider.max = scene.frames.length - 1;
  slider.value = 0;
  slider.setAttribute("aria-label", scene.name + ": frame");
  const place = element("output", controls);
  const show = () => {
    const frame = scene.frames[slider.value];
    images.forEach((image, k) => image.src = "data:image/jpeg;base64," + frame.images[k]);
    place.textContent = frame.time.toFixed(2) + " s, frame " + (Number(slider.value) + 1) + " of " + scene.frames.length;
    figures.innerHTML = "<b>" + frame.ms.toFixed(2) + "</b> ms a frame &nbsp; <b>" + frame.us.toFixed(2) +
      "</b> &micro;s a vertex &nbsp; error <b>" + percent(frame.mean) + "</b> mean, <b>" + percent(frame.p99) + "</b> p99";
  };
  let timer = 0;
  play.onclick = () => {
    if (timer) {
      clearInterval(timer);
      timer = 0;
    } else {
      timer = setInterval(() => {
        slider.value = (Number(slider.value) + 1) % scene.frames.length;
        show();
      }, Math.max(80, 1000 * scene.duration / scene.frames.length));
    }
    play.textContent = timer ? "Pause" : "Play";
  };
  slider.oninput = show;
  show();
}
const crowd = data.crowd;
["Each alone", "As objects of one frame", "Ray-traced reference"].forEach((title, k) => {
  const figure = element("figure", document.querySelector("#crowd .trio"));
  const image = element("img", figure);
  image.width = crowd.width;
  image.height = crowd.height;
  image.style.height = "auto";
  image.alt = "crowd, " + title;
  image.src = "data:image/jpeg;base64," + crowd.images[k];
  element("figcaption", figure, title);
});
document.querySelector("#crowd .figures").innerHTML = "<b>" + crowd.objects + "</b> objects, " + crowd.vertices +
  " vertices &nbsp; <b>" + crowd.cpu_ms.toFixed(1) + "</b> ms of processor time, <b>" + crowd.over_alone.toFixed(2) +
  "</b> times each alone &nbsp; clear error <b>" + percent(crowd.clear_mean) + "</b> mean, <b>" + percent(crowd.clear_p99) +
  "</b> p99 (each alone " + percent(crowd.alone_clear_mean) + ")";
document.querySelector("#crowd > figure").innerHTML = crowd.plot +
  "<figcaption style='text-align:left'>What a receiver costs as objects are added</figcaption>";
for (const note of data.notes) element("p", document.querySelector("#notes"), note);
</script>
</body>
</html>
)page";

} // namespace

std::string demo_page(const nlohmann::ordered_json& data) {
    std::string text = data.dump();
    // Inside a script element a closing tag would end it.
    for (size_t at = text.find("</"); at != std::string::npos; at = text.find("</", at))
        text.replace(at, 2, "<\\/");
    return before_data + text + after_data;
}

} // namespace nusselt::tools
