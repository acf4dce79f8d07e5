"use strict";
/** Tools of every page: elements, arrays, plots and the player of a 3D view, from a page's data. */
const nrsfmTools = (data) => {
  const plain = { displayModeBar: false, responsive: true };

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

  /** The bytes of a deflated text. */
  function inflate(text) {
    if (!("DecompressionStream" in window)) throw new Error("plots need a browser of 2023 or later");
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  }

  const unpacked = new Map();
  /** An array by name that {@link ready} has unpacked: its shape and numbers. */
  const array = (name) => unpacked.get(name);
  async function unpack(name) {
    if (unpacked.has(name)) return;
    const { kind, shape, scale, data: text } = data.blobs[name];
    const bytes = new Uint8Array(await inflate(text));
    if (kind === "uint8") return unpacked.set(name, { shape, values: Float32Array.from(bytes, (v) => v * scale) });
    const n = bytes.length / 2, row = n / shape[0], whole = new Int16Array(n);
    for (let i = 0; i < n; i++) whole[i] = (bytes[n + i] << 8) + bytes[i] + (i < row ? 0 : whole[i - row]);
    return unpacked.set(name, { shape, values: Float32Array.from(whole, (v) => (v === -32768 ? NaN : v * scale)) });
  }

  let library = null;
  /** Plotly is read when something is to be drawn, and once. */
  async function plotly() {
    const code = new TextDecoder().decode(await inflate(document.getElementById("nrsfm-plotly").textContent));
    document.head.append(make("script", { text: code }));
  }
  /** Wait for plotly, and for the arrays of these names; absent names are passed over. */
  const ready = (...names) => Promise.all([(library ??= plotly()), ...names.filter(Boolean).map(unpack)]);
  /** The names of a run's arrays. */
  const arrays = (run) => [run.view?.found, run.view?.truth, run.affinity?.matrix];

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
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("muted"), activecolor: colour("ink") },
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

  // ---- the player of a 3D view ---------------------------------------------------------------------------------------
  /** The player of `run.view`: `found` and perhaps `truth`, `labels`, `edges`; `ids`, `bodies` and `frames` are names. */
  function player(run) {
    const { view } = run, found = array(view.found), truth = view.truth ? array(view.truth) : null;
    const [frames, , points] = found.shape;
    const known = (v) => (Number.isNaN(v) ? null : v);
    const at = ({ values }, frame, rows) =>
      [0, 1, 2].map((axis) => rows.map((p) => (p < 0 ? null : known(values[(frame * 3 + axis) * points + p]))));
    const every = Array.from({ length: points }, (_, p) => p);
    const labels = view.labels ?? every.map(() => 0), wrong = view.wrong ?? [];
    const bodies = [...new Set(labels)].sort((a, b) => a - b);
    const bones = (view.edges ?? []).flatMap(([a, b]) => [a, b, -1]);
    const ink = colour("ink"), grey = colour("muted");
    const called = (body) => view.bodies?.[body] ?? (view.labels ? `reconstruction, label ${body + 1}` : "reconstruction");
    const parts = [
      ...(truth ? [{ from: truth, rows: every, trace: { name: "ground truth", mode: "markers", marker: { symbol: "circle-open", size: 6, color: grey, line: { width: 1.5 } } } }] : []),
      ...(bones.length ? [{ from: truth ?? found, rows: bones, trace: { name: "its skeleton", mode: "lines", line: { color: grey, width: 2 }, hoverinfo: "skip" } }] : []),
      ...bodies.map((body) => ({ from: found, rows: every.filter((p) => labels[p] === body),
        trace: { name: called(body), mode: "markers",
                 marker: { size: view.size ?? 4, color: data.colours[body % data.colours.length] } } })),
      ...(wrong.length ? [{ from: found, rows: wrong, trace: { name: `wrong label (${wrong.length})`, mode: "markers", marker: { symbol: "square-open", size: 9, color: ink, line: { width: 2 } } } }] : []),
    ];
    const traces = parts.map(({ from, rows, trace }) => {
      const [x, y, z] = at(from, 0, rows);
      return { type: "scatter3d", x, y, z, hovertemplate: "track %{text}<extra>%{fullData.name}</extra>",
               text: rows.map((p) => view.ids?.[p] ?? p), ...trace };
    });
    const low = [0, 1, 2].map(() => Infinity), high = [0, 1, 2].map(() => -Infinity);
    (truth ?? found).values.forEach((v, i) => { if (Number.isNaN(v)) return; const a = Math.floor(i / points) % 3; low[a] = Math.min(low[a], v); high[a] = Math.max(high[a], v); });
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
      const place = `frame ${frame * view.step + 1} of ${view.total}`;
      told.textContent = view.frames ? `${place} (${view.frames[frame]})` : place;
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
      scene: { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", camera: { eye: view.eye ?? { x: 1.9, y: -1.1, z: 0.5 } },
               aspectratio: { x: (1.6 * size[0]) / most, y: (1.6 * size[1]) / most, z: (1.6 * size[2]) / most } },
    }), plain).then(() => show(0));
    /** Upside down without a mirror: what images measure downwards stands up. */
    let up = 1;
    const over = make("button", { type: "button", class: "plain", text: "Turn over", on: { click: () => {
      up = -up;
      Plotly.relayout(box, { "scene.camera.up": { x: 0, y: 0, z: up } });
    } } });
    const keys = { " ": toggle, ArrowLeft: () => { stop(); show(Math.max(0, Number(slider.value) - 1)); },
                   ArrowRight: () => { stop(); show(Math.min(frames - 1, Number(slider.value) + 1)); } };
    const element = make("section", {}, box, make("div", { class: "player" }, button, slider, told, faster, ...(view.eye ? [over] : [])),
      make("p", { class: "caption", text: "Drag to turn, scroll or pinch to zoom; space plays, arrow keys step." +
        (view.step > 1 ? ` Every ${view.step}${view.step === 2 ? "nd" : view.step === 3 ? "rd" : "th"} frame.` : "") }));
    return { element, start, stop, keys };
  }

  // ---- curves --------------------------------------------------------------------------------------------------
  function line(title, curves, options = {}) {
    const box = make("div", { class: "plot", role: "img", "aria-label": title });
    const traces = Object.entries(curves).map(([name, { x, y }], i) => ({ x, y, name, mode: "lines", line: { color: data.colours[i % 6], dash: ["solid", "dash", "dot", "dashdot"][i % 4] } }));
    return { box, start: () => Plotly.newPlot(box, traces, layout({ title: { text: title, font: { size: 14 }, x: 0.02, xanchor: "left" }, height: 320, showlegend: traces.length > 1, ...options }), plain) };
  }

  /** What is plotted of a run besides its view: errors by frame, curves, affinity; each a box and what fills it. */
  function plots(run) {
    const found = [], iteration = { xaxis: { title: { text: "iteration" } } };
    if (run.frames) found.push(line("e_3D by frame", { e_3D: { x: run.frames.map((_, i) => i + 1), y: run.frames } }, { xaxis: { title: { text: "frame" } }, yaxis: { rangemode: "tozero" } }));
    const { objective, ...residuals } = run.curves ?? {};
    if (Object.keys(residuals).length)
      found.push(line("Residuals", Object.fromEntries(Object.entries(residuals).map(([k, v]) => [k.replace("residual_", ""), v])), { ...iteration, yaxis: { type: "log", exponentformat: "power" } }));
    if (objective) found.push(line("Objective (may rise while the penalty grows)", { objective }, iteration));
    if (run.affinity) {
      const box = make("div", { class: "plot", role: "img", "aria-label": "affinity" });
      found.push({ box, start: () => {
        const { trace, shapes } = heat(run.affinity.matrix, run.affinity.edges);
        return Plotly.newPlot(box, [trace], layout({ title: { text: "Affinity, tracks sorted by body", font: { size: 14 }, x: 0.02, xanchor: "left" }, height: 320, shapes,
          xaxis: { constrain: "domain" }, yaxis: { autorange: "reversed", scaleanchor: "x", constrain: "domain" } }), plain);
      } });
    }
    return found;
  }

  /** Keys of a player on an element; an element in focus that knows the key itself keeps it. */
  function listen(target, action) {
    target.addEventListener("keydown", (event) => {
      const own = { INPUT: "Arrow", BUTTON: " ", A: " ", SELECT: "" }[event.target.tagName], run = action(event.key);
      if (!run || (own !== undefined && event.key.startsWith(own))) return;
      event.preventDefault();
      run();
    });
  }

  /** Plots are drawn one after the other. */
  const inOrder = (starts) => starts.reduce((before, start) => before.then(start), Promise.resolve());

  return { arrays, heat, inOrder, layout, listen, make, plain, player, plots, ready, shade };
};
