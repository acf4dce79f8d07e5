"use strict";
(() => {
  const data = JSON.parse(document.getElementById("nrsfm-data").textContent);
  const dialog = document.getElementById("run");
  const plain = { displaylogo: false, responsive: true };

  // ---- small helpers -------------------------------------------------------------------------------------------
  /** An element; text always goes in as text. */
  function make(tag, options = {}, ...children) {
    const { text, on, ...attributes } = options;
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    for (const [name, action] of Object.entries(on ?? {})) element.addEventListener(name, action);
    if (text !== undefined) element.textContent = text;
    element.append(...children);
    return element;
  }

  const unpacked = new Map();
  /** An array by name: its shape and numbers. */
  function array(name) {
    if (!unpacked.has(name)) {
      const { kind, shape, scale, data: text } = data.blobs[name];
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
      const values = Float32Array.from(kind === "int16" ? new Int16Array(bytes.buffer) : bytes, (v) => (v === -32768 ? NaN : v * scale));
      unpacked.set(name, { shape, values });
    }
    return unpacked.get(name);
  }

  /** What a colour of the style sheet is under the present theme. */
  function colour(name) {
    const probe = make("span", { style: `color: var(--${name})` });
    document.querySelector(".nrsfm").append(probe);
    const found = getComputedStyle(probe).color;
    probe.remove();
    return found;
  }

  function layout(more = {}) {
    const axis = { gridcolor: colour("line"), zerolinecolor: colour("line"), automargin: true };
    const { xaxis, yaxis, ...rest } = more;
    return {
      font: { color: colour("ink"), size: 13 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      margin: { l: 55, r: 15, t: 35, b: 45 }, legend: { orientation: "h", y: -0.25 },
      xaxis: { ...axis, ...xaxis }, yaxis: { ...axis, ...yaxis }, ...rest,
    };
  }

  const shade = (hex, alpha) => `rgba(${[1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)).join(",")},${alpha})`;

  /** A matrix with lines where bodies end. */
  function heat(matrix, edges) {
    const { shape: [rows, columns], values } = array(matrix);
    const z = Array.from({ length: rows }, (_, i) => Array.from(values.subarray(i * columns, (i + 1) * columns)));
    const line = { color: data.colours[1], width: 1.5 };
    return {
      trace: { type: "heatmap", z, showscale: false, hoverinfo: "x+y+z",
               colorscale: [[0, colour("ground")], [1, colour("ink")]] },
      shapes: edges.flatMap((e) => [
        { type: "line", x0: e - 0.5, x1: e - 0.5, y0: -0.5, y1: rows - 0.5, line },
        { type: "line", y0: e - 0.5, y1: e - 0.5, x0: -0.5, x1: columns - 0.5, line },
      ]),
    };
  }

  // ---- charts --------------------------------------------------------------------------------------------------
  /** Each panel is a plot of its own; one legend serves all of them. */
  function draw(element) {
    for (const plot of element.querySelectorAll(".js-plotly-plot")) Plotly.purge(plot);
    const chart = data.charts[element.dataset.chart];
    const looks = new Map(chart.panels.flatMap((panel) => panel.series.map((series) => [series.label, series.look])));
    const plots = chart.panels.map((panel) => {
      const box = make("div", { class: panel.matrix ? "panel square" : "panel" });
      return { panel, box };
    });
    const legend = looks.size < 2 && !chart.panels.some((panel) => panel.series.length > 1) ? [] : [...looks].map(([label, { colour: ink, dash }]) =>
      make("span", {}, make("i", { class: "swatch", style: `border-top: 3px ${{ solid: "solid", dash: "dashed", dot: "dotted" }[dash]} ${ink}` }), label));
    element.replaceChildren(make("div", { class: chart.panels.length > 1 ? "panels" : "" }, ...plots.map(({ box }) => box)), make("p", { class: "legend" }, ...legend));
    for (const { panel, box } of plots) {
      const title = { text: panel.title, font: { size: 13 }, y: 0.97, yanchor: "top" };
      const axes = { xaxis: { title: { text: panel.x, standoff: 4 }, type: panel.log_x ? "log" : "linear" },
                     yaxis: { title: { text: panel.y, standoff: 4 }, type: panel.log_y ? "log" : "linear", exponentformat: "power", rangemode: panel.log_y ? "normal" : "tozero" } };
      const common = { title, showlegend: false, margin: { l: 50, r: 8, t: 30, b: 40 } };
      if (panel.matrix) {
        const { trace, shapes } = heat(panel.matrix, panel.edges);
        Plotly.newPlot(box, [trace], layout({ ...common, shapes, xaxis: { constrain: "domain", ...axes.xaxis }, yaxis: { ...axes.yaxis, autorange: "reversed", scaleanchor: "x", constrain: "domain", rangemode: "normal" } }), plain);
        continue;
      }
      const traces = panel.series.flatMap((series) => {
        const { colour: ink, symbol, dash } = series.look, { x, y, spread } = series;
        const mode = series.scatter ? "markers" : x.length < 30 ? "lines+markers" : "lines";
        const band = { x: [...x, ...x.toReversed()], y: [...y.map((v, k) => v + spread[k]), ...y.map((v, k) => Math.max(0, v - spread[k])).toReversed()],
                       fill: "toself", hoverinfo: "skip", line: { width: 0 }, mode: "lines", fillcolor: shade(ink, 0.18) };
        return [...(spread.length ? [band] : []), { x, y, mode, name: series.label, line: { color: ink, dash, width: 1.7 }, marker: { symbol, color: ink, size: 7 } }];
      });
      Plotly.newPlot(box, traces, layout({ ...common, ...axes }), plain);
    }
    element.dataset.drawn = "yes";
  }

  // ---- a run: its player ---------------------------------------------------------------------------------------
  function player(run) {
    const { view } = run, truth = array(view.truth), found = array(view.found);
    const [frames, , points] = truth.shape;
    const known = (v) => (Number.isNaN(v) ? null : v);
    const at = ({ values }, frame, rows) =>
      [0, 1, 2].map((axis) => rows.map((p) => (p < 0 ? null : known(values[(frame * 3 + axis) * points + p]))));
    const every = Array.from({ length: points }, (_, p) => p);
    const labels = view.labels ?? every.map(() => 0), wrong = view.wrong ?? [];
    const bodies = [...new Set(labels)].sort((a, b) => a - b);
    const bones = (view.edges ?? []).flatMap(([a, b]) => [a, b, -1]);
    const ink = colour("ink"), grey = colour("muted");
    const parts = [
      { from: truth, rows: every, trace: { name: "ground truth", mode: "markers", marker: { symbol: "circle-open", size: 6, color: grey, line: { width: 1.5 } } } },
      ...(bones.length ? [{ from: truth, rows: bones, trace: { name: "its skeleton", mode: "lines", line: { color: grey, width: 2 }, hoverinfo: "skip" } }] : []),
      ...bodies.map((body) => ({ from: found, rows: every.filter((p) => labels[p] === body),
        trace: { name: view.labels ? `reconstruction, label ${body + 1}` : "reconstruction", mode: "markers",
                 marker: { size: 4, color: data.colours[body % data.colours.length] } } })),
      ...(wrong.length ? [{ from: found, rows: wrong, trace: { name: `wrong label (${wrong.length})`, mode: "markers", marker: { symbol: "square-open", size: 9, color: ink, line: { width: 2 } } } }] : []),
    ];
    const traces = parts.map(({ from, rows, trace }) => {
      const [x, y, z] = at(from, 0, rows);
      return { type: "scatter3d", x, y, z, hovertemplate: "track %{text}<extra>%{fullData.name}</extra>", text: rows, ...trace };
    });
    const low = [0, 1, 2].map(() => Infinity), high = [0, 1, 2].map(() => -Infinity);
    truth.values.forEach((v, i) => { if (Number.isNaN(v)) return; const a = Math.floor(i / points) % 3; low[a] = Math.min(low[a], v); high[a] = Math.max(high[a], v); });
    const pad = 0.08 * Math.max(...high.map((v, a) => v - low[a])), size = high.map((v, a) => v - low[a] + 2 * pad), most = Math.max(...size);
    const axis = (a) => ({ range: [low[a] - pad, high[a] + pad], title: { text: "xyz"[a] }, color: grey, gridcolor: colour("line"), showbackground: false, showspikes: false });

    const box = make("div", { class: "view", "aria-label": "3D view; drag to turn", role: "img" });
    const slider = make("input", { type: "range", min: 0, max: frames - 1, value: 0, "aria-label": "frame" });
    const told = make("output", {}), button = make("button", { type: "button", class: "plain", text: "▶ Play", autofocus: "" });
    let timer = null, speed = 1;
    const faster = make("select", { "aria-label": "speed" }, ...[["½ speed", 0.5], ["speed 1", 1], ["2 × speed", 2]].map(([text, value]) => make("option", { value, text })));
    faster.value = "1";
    faster.addEventListener("change", () => { speed = Number(faster.value); });

    function show(frame) {
      const sets = parts.map(({ from, rows }) => at(from, frame, rows));
      slider.value = frame;
      told.textContent = `frame ${frame * view.step + 1} of ${view.total}`;
      box.dataset.frame = frame;
      return Plotly.restyle(box, { x: sets.map((s) => s[0]), y: sets.map((s) => s[1]), z: sets.map((s) => s[2]) }, parts.map((_, i) => i));
    }
    function stop() {
      clearTimeout(timer);
      timer = null;
      button.textContent = "▶ Play";
    }
    function step() {
      if (!box.isConnected) return stop();
      const began = performance.now();
      show((Number(slider.value) + 1) % frames).then(() => {
        if (timer !== null) timer = setTimeout(step, Math.max(0, 70 / speed - (performance.now() - began)));
      });
    }
    function toggle() {
      if (timer !== null) return stop();
      button.textContent = "❚❚ Pause";
      timer = setTimeout(step, 0);
    }
    button.addEventListener("click", toggle);
    slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
    const start = () => Plotly.newPlot(box, traces, layout({
      margin: { l: 0, r: 0, t: 0, b: 0 }, legend: { orientation: "h", y: 0 }, uirevision: "kept",
      scene: { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", camera: { eye: { x: 1.5, y: -0.9, z: 0.5 } },
               aspectratio: { x: (1.6 * size[0]) / most, y: (1.6 * size[1]) / most, z: (1.6 * size[2]) / most } },
    }), plain).then(() => show(0));
    const keys = { " ": toggle, ArrowLeft: () => { stop(); show(Math.max(0, Number(slider.value) - 1)); },
                   ArrowRight: () => { stop(); show(Math.min(frames - 1, Number(slider.value) + 1)); } };
    const element = make("section", {}, box, make("div", { class: "player" }, button, slider, told, faster),
      make("p", { class: "caption", text: "Drag to turn, scroll or pinch to zoom; space plays, arrow keys step." +
        (view.step > 1 ? ` Every ${view.step}${view.step === 2 ? "nd" : view.step === 3 ? "rd" : "th"} frame.` : "") }));
    return { element, start, stop, keys };
  }

  // ---- a run: the dialog ---------------------------------------------------------------------------------------
  let playing = null;
  const facts = (title, entries) => make("section", {}, make("h3", { text: title }),
    make("dl", {}, ...Object.entries(entries).flatMap(([name, value]) => [make("dt", { text: name }), make("dd", { text: value })])));

  function line(title, curves, options = {}) {
    const box = make("div", { class: "plot", role: "img", "aria-label": title });
    const traces = Object.entries(curves).map(([name, { x, y }], i) => ({ x, y, name, mode: "lines", line: { color: data.colours[i % 6], dash: ["solid", "dash", "dot", "dashdot"][i % 4] } }));
    return { box, start: () => Plotly.newPlot(box, traces, layout({ title: { text: title, font: { size: 14 } }, height: 320, showlegend: traces.length > 1, ...options }), plain) };
  }

  function open(keys, chosen = keys[0]) {
    close();
    const run = data.runs[chosen];
    if (!run) return;
    const title = make("h2", { id: "run-title", text: `${run.dataset}, ${run.method}` });
    const shut = make("button", { type: "button", class: "plain", text: "Close", on: { click: () => dialog.close() } });
    const head = make("header", {}, title);
    if (keys.length > 1) {
      const pick = make("select", { "aria-label": "run" }, ...keys.map((key, i) => make("option", { value: key, text: `run ${i + 1} of ${keys.length}` })));
      pick.value = chosen;
      pick.addEventListener("change", () => open(keys, pick.value));
      head.append(pick);
    }
    head.append(shut);
    const said = [run.setting, `status ${run.status}`];
    if (run.stand_in) said.push("procedural stand-in");
    for (const [name, value] of Object.entries(run.sizes)) if (value !== null) said.push(`${value} ${name}`);
    const body = make("div", {}, make("p", { class: "caption", text: said.join(", ") }));
    if (run.error) body.append(make("p", { class: "error", text: run.error }));
    const plots = [];
    if (run.view) {
      playing = player(run);
      body.append(playing.element);
      plots.push(playing.start);
    }
    const grid = make("div", { class: "plots" });
    const add = ({ box, start }) => { grid.append(box); plots.push(start); };
    if (run.frames) add(line("e_3D by frame", { e_3D: { x: run.frames.map((_, i) => i + 1), y: run.frames } }, { xaxis: { title: { text: "frame" } }, yaxis: { rangemode: "tozero" } }));
    const { objective, ...residuals } = run.curves ?? {};
    if (Object.keys(residuals).length)
      add(line("Residuals", Object.fromEntries(Object.entries(residuals).map(([k, v]) => [k.replace("residual_", ""), v])), { xaxis: { title: { text: "iteration" } }, yaxis: { type: "log", exponentformat: "power" } }));
    if (objective) add(line("Objective", { objective }, { xaxis: { title: { text: "iteration" } } }));
    if (run.affinity) {
      const box = make("div", { class: "plot", role: "img", "aria-label": "affinity" });
      grid.append(box);
      plots.push(() => {
        const { trace, shapes } = heat(run.affinity.matrix, run.affinity.edges);
        return Plotly.newPlot(box, [trace], layout({ title: { text: "Affinity, tracks sorted by body", font: { size: 14 } }, height: 320, shapes,
          xaxis: { constrain: "domain" }, yaxis: { autorange: "reversed", scaleanchor: "x", constrain: "domain" } }), plain);
      });
    }
    body.append(grid);
    const cost = {};
    if (run.seconds !== undefined) cost["time"] = `${run.seconds.toFixed(1)} s`;
    if (run.peak_mb !== undefined) cost["memory"] = `${run.peak_mb.toFixed(0)} MB`;
    const identity = { trial: chosen, run: run.run ?? "–", finished: run.finished ?? "–", ...cost };
    const where = facts("Trial", identity);
    if (run.link) where.append(make("a", { href: run.link, text: "open in the tracker", rel: "noreferrer" }));
    body.append(make("div", { class: "facts" }, facts("Metrics", run.metrics ?? {}), facts("Parameters", run.parameters ?? {}), facts("Versions", run.versions ?? {}), where));
    dialog.replaceChildren(head, body);
    if (!dialog.open) dialog.showModal();
    history.replaceState(null, "", `#run=${encodeURIComponent(chosen)}`);
    plots.reduce((before, start) => before.then(start), Promise.resolve());
  }

  function close() {
    playing?.stop();
    playing = null;
    for (const plot of dialog.querySelectorAll(".js-plotly-plot")) Plotly.purge(plot);
    dialog.replaceChildren();
  }

  dialog.addEventListener("close", () => { close(); history.replaceState(null, "", location.pathname + location.search); });
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  dialog.addEventListener("keydown", (event) => {
    const action = playing?.keys[event.key], own = { INPUT: "Arrow", BUTTON: " ", A: " ", SELECT: "" }[event.target.tagName];
    if (!action || (own !== undefined && event.key.startsWith(own))) return;  // the element knows the key itself
    event.preventDefault();
    action();
  });

  // ---- tables --------------------------------------------------------------------------------------------------
  function sort(button) {
    const table = button.closest("table"), heading = button.closest("th"), column = Number(button.dataset.column);
    const direction = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const th of table.querySelectorAll("th[aria-sort]")) th.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
    const body = table.tBodies[0], rows = [...body.rows].filter((row) => !row.classList.contains("mean"));
    const means = [...body.rows].filter((row) => row.classList.contains("mean"));
    const value = (row) => (column ? Number(row.cells[column].dataset.value ?? NaN) : row.cells[0].textContent);
    const order = (a, b) => {
      const [u, v] = [value(a), value(b)];
      if (!column) return direction * u.localeCompare(v);
      return Number.isNaN(u) - Number.isNaN(v) || direction * (u - v);  // without a number last, either way
    };
    body.append(...rows.sort(order), ...means);
  }

  document.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button?.classList.contains("sort")) sort(button);
    if (button?.classList.contains("open")) open(button.dataset.runs.split(" ").filter((key) => key in data.runs));
  });

  // ---- theme, figures, address ---------------------------------------------------------------------------------
  const charts = [...document.querySelectorAll("[data-chart]")];
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) if (isIntersecting) { seen.unobserve(target); draw(target); }
  }, { rootMargin: "300px" });
  charts.forEach((element) => seen.observe(element));
  const redraw = () => charts.filter((element) => element.dataset.drawn).forEach(draw);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", redraw);
  document.getElementById("theme").addEventListener("click", () => {
    const now = document.documentElement.style.colorScheme || (dark.matches ? "dark" : "light");
    document.documentElement.style.colorScheme = now === "dark" ? "light" : "dark";
    redraw();
  });
  function follow() {
    const key = new URLSearchParams(location.hash.slice(1)).get("run");
    if (key) open([key]);
  }
  addEventListener("hashchange", follow);
  follow();
})();
