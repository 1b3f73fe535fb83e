"use strict";
// Charts, the choice of what they show, and the slider of every scene. Colours come from the style sheet, so that light, dark
// and paper are one set of rules.

const SCENES = JSON.parse(document.getElementById("data").textContent);
const SYMBOLS = { none: "circle", bilateral: "square", "kpcn-fast": "triangle-up", "kpcn-balanced": "diamond", "kpcn-high": "star" };
const DASHES = { none: "dot", bilateral: "dash", "kpcn-fast": "dashdot", "kpcn-balanced": "solid", "kpcn-high": "longdash" };
const SHAPES = {
  none: "M5 1a4 4 0 1 0 .01 0z", bilateral: "M1.5 1.5h7v7h-7z", "kpcn-fast": "M5 1l4.2 7.6H.8z", "kpcn-balanced": "M5 .3L9.7 5 5 9.7.3 5z",
  "kpcn-high": "M5 .4l1.4 3 3.3.4-2.4 2.3.6 3.3L5 7.8 2.1 9.4l.6-3.3L.3 3.8l3.3-.4z",
};
const CONFIG = { responsive: true, displaylogo: false, displayModeBar: "hover", scrollZoom: false,
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };

const distinct = (list) => [...new Set(list)];
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const seconds = (time) => (time >= 100 ? time.toFixed(0) : time.toPrecision(3)) + " s";
const error = (value) => (value >= 0.0995 ? value.toPrecision(3) : value.toExponential(2));
const label = (point) => point.integrator + (point.denoiser === "none" ? ", not denoised" : " + " + point.denoiser);

function axes(yTitle, points) {
  // 1, 2, 5 are labels enough, and less than those over many decades.
  const times = points.map((point) => point.seconds);
  const decades = Math.log10(Math.max(...times) / Math.min(...times));
  const axis = (text) => ({ type: "log", title: { text, font: { size: 13 } }, gridcolor: colour("line"), zeroline: false,
    linecolor: colour("soft"), ticks: "outside", tickcolor: colour("soft"), minor: { ticks: "outside", ticklen: 3, tickcolor: colour("line") } });
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: colour("ink"), family: "system-ui, sans-serif", size: 12 },
    margin: { l: 62, r: 12, t: 12, b: 48 }, hovermode: "closest", showlegend: false,
    hoverlabel: { bgcolor: colour("card"), bordercolor: colour("line"), font: { color: colour("ink") } },
    xaxis: { ...axis("seconds, render and denoiser"), exponentformat: "power", tickformat: "~g", dtick: decades > 3 ? 1 : "D2" },
    yaxis: { ...axis(yTitle), exponentformat: "power", tickformat: "~g" },
  };
}

function ofCombination(points, integrator, denoiser) {
  return points.filter((point) => point.integrator === integrator && point.denoiser === denoiser).sort((a, b) => a.samples - b.samples);
}

// A logarithmic axis has no place for errors at or below zero; the lower bar ends above it.
function bars(points) {
  return {
    type: "data", symmetric: false, thickness: 1, width: 3,
    array: points.map((point) => (point.interval ? Math.max(0, point.interval[1] - point.error) : 0)),
    arrayminus: points.map((point) => (point.interval ? Math.min(point.error - point.interval[0], 0.9 * point.error) : 0)),
  };
}

function drawTrade(scene, view) {
  const traces = [];
  const front = scene.front.map((index) => scene.points[index]);
  traces.push({ x: front.map((p) => p.seconds), y: front.map((p) => p.error), mode: "lines", hoverinfo: "skip",
    line: { color: colour("ink"), width: 7 }, opacity: 0.2 });
  for (const integrator of view.integrators) {
    for (const denoiser of view.denoisers) {
      if (!view.shown.integrator.has(integrator) || !view.shown.denoiser.has(denoiser)) continue;
      const points = ofCombination(scene.points, integrator, denoiser).filter((point) => point.error > 0);
      const paint = colour(integrator);
      traces.push({
        x: points.map((p) => p.seconds), y: points.map((p) => p.error), error_y: { ...bars(points), color: paint }, name: integrator + " " + denoiser,
        mode: "lines+markers", line: { color: paint, width: 1.6, dash: DASHES[denoiser] },
        marker: { symbol: SYMBOLS[denoiser], size: 9, color: points.map((p) => (p.is_known ? paint : colour("paper"))), line: { color: paint, width: 1.5 } },
        text: points.map((p) => "<b>" + label(p) + "</b><br>" + p.samples + " samples, " + seconds(p.seconds) + "<br>relative L2 " + error(p.error) +
          (p.interval ? "<br>95 %: " + error(p.interval[0]) + " … " + error(p.interval[1]) : "") + (p.is_known ? "" : "<br>below the reference’s noise")),
        hovertemplate: "%{text}<extra></extra>",
      });
    }
  }
  const layout = axes("relative L2", scene.points);
  layout.shapes = [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: scene.noise, y1: scene.noise, line: { color: colour("soft"), width: 1, dash: "dot" } }];
  const lowest = Math.min(...scene.points.map((p) => p.error).filter((e) => e > 0));
  if (scene.noise < lowest / 10) layout.shapes = [];
  Plotly.react(view.trade, traces, layout, CONFIG);
}

function drawSplit(scene, view) {
  const traces = [];
  const integrator = view.split.value;
  view.denoisers.forEach((denoiser, index) => {
    const points = ofCombination(scene.points, integrator, denoiser);
    const paint = colour(["ink", "bdpt", "pssmlt", "path", "mlt"][index % 5]);
    for (const [part, name, dash] of [["bias2", "bias²", "solid"], ["variance", "variance", "dash"]]) {
      const known = points.filter((point) => point[part] > 0);
      traces.push({
        x: known.map((p) => p.seconds), y: known.map((p) => p[part]), name: denoiser + ", " + name, mode: "lines+markers",
        line: { color: paint, dash, width: 1.8 }, marker: { symbol: SYMBOLS[denoiser], size: 7 },
        text: known.map((p) => "<b>" + label(p) + "</b><br>" + p.samples + " samples<br>" + name + " " + error(p[part]) + " of " + error(p.error)),
        hovertemplate: "%{text}<extra></extra>",
      });
    }
  });
  const layout = axes("part of relative L2", scene.points);
  layout.showlegend = true;
  layout.legend = { orientation: "h", y: -0.25, font: { size: 11 } };
  layout.margin.b = 90;
  Plotly.react(view.splitPlot, traces, layout, CONFIG);
}

function chips(view, kind, names, redraw) {
  const row = view.section.querySelector('[data-chips="' + kind + '"]');
  for (const name of names) {
    const button = document.createElement("button");
    button.type = "button";
    const isShown = () => view.shown[kind].has(name);
    if (kind === "integrator") {
      const dot = document.createElement("i");
      dot.style.setProperty("--colour", "var(--" + name + ")");
      button.append(dot);
    } else {
      const shape = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      shape.setAttribute("viewBox", "0 0 10 10");
      const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
      path.setAttribute("d", SHAPES[name]);
      shape.append(path);
      button.append(shape);
    }
    button.append(name === "none" ? "not denoised" : name);
    button.setAttribute("aria-pressed", isShown());
    button.addEventListener("click", () => {
      if (isShown()) view.shown[kind].delete(name); else view.shown[kind].add(name);
      button.setAttribute("aria-pressed", isShown());
      redraw();
    });
    row.append(button);
  }
}

function viewer(scene, section) {
  const stage = section.querySelector(".stage");
  const { shown, reference } = scene.pictures;
  const options = [{ text: "reference", picture: reference, map: null, short: "reference" }];
  for (const one of shown) {
    const point = scene.points[one.point];
    const text = label(point) + " · " + point.samples + " samples · " + seconds(point.seconds) + " · " + error(point.error);
    options.push({ text, picture: one.picture, map: one.map, point, short: label(point) + "\u2003" + error(point.error) });
  }
  const find = (test, otherwise) => { const index = options.findIndex((one) => one.point && test(one.point)); return index < 0 ? otherwise : index; };
  const take = scene.take || scene.auto;
  const start = {
    left: find((p) => p.integrator === take.integrator && p.denoiser === "none", Math.min(1, options.length - 1)),
    right: find((p) => p.integrator === take.integrator && p.denoiser === take.denoiser, 0),
  };
  let show = "picture";
  const update = () => {
    for (const side of ["left", "right"]) {
      const option = options[section.querySelector('[data-side="' + side + '"]').value];
      const image = section.querySelector('[data-image="' + side + '"]');
      image.src = (show === "map" && option.map) || option.picture;
      image.alt = option.text;
      section.querySelector('[data-caption="' + side + '"]').textContent = option.short;
    }
  };
  for (const side of ["left", "right"]) {
    const select = section.querySelector('[data-side="' + side + '"]');
    options.forEach((option, index) => select.append(new Option(option.text, index)));
    select.value = start[side];
    select.addEventListener("change", update);
  }
  for (const button of section.querySelectorAll("[data-show]")) {
    button.addEventListener("click", () => {
      show = button.dataset.show;
      for (const other of section.querySelectorAll("[data-show]")) other.setAttribute("aria-pressed", other === button);
      update();
    });
  }
  const range = stage.querySelector("input");
  range.addEventListener("input", () => stage.style.setProperty("--cut", range.value + "%"));
  update();
}

const redraws = [];
for (const section of document.querySelectorAll("section.scene")) {
  const scene = SCENES[section.dataset.scene];
  const view = {
    section, integrators: distinct(scene.points.map((p) => p.integrator)), denoisers: distinct(scene.points.map((p) => p.denoiser)),
    trade: section.querySelector('[data-plot="trade"]'), splitPlot: section.querySelector('[data-plot="split"]'),
    split: section.querySelector("[data-split]"),
  };
  const take = scene.take || scene.auto;
  // All lines at once are too many to read: the noisy ones and those of the usual denoiser first, of the best where that
  // was not measured.
  const usual = view.denoisers.includes(scene.auto.denoiser) ? scene.auto.denoiser : take.denoiser;
  const first = view.denoisers.filter((name) => name === "none" || name === usual);
  view.shown = { integrator: new Set(view.integrators), denoiser: new Set(first) };
  for (const name of view.integrators) view.split.append(new Option(name, name));
  view.split.value = take.integrator;
  const trade = () => drawTrade(scene, view);
  const split = () => drawSplit(scene, view);
  chips(view, "integrator", view.integrators, trade);
  chips(view, "denoiser", view.denoisers, trade);
  view.split.addEventListener("change", split);
  viewer(scene, section);
  redraws.push(trade, split);
}
const redraw = () => redraws.forEach((draw) => draw());
redraw();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
matchMedia("print").addEventListener("change", redraw);
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
});
