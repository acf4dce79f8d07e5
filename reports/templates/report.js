"use strict";
(() => {
  const data = JSON.parse(document.getElementById("nrsfm-data").textContent);
  const dialog = document.getElementById("run");
  const { arrays, heat, inOrder, layout, listen, make, plain, player, plots, ready, shade } = nrsfmTools(data);

  // ---- charts --------------------------------------------------------------------------------------------------
  /** Each panel is a plot of its own; one legend serves all of them. */
  async function draw(element) {
    const chart = data.charts[element.dataset.chart];
    await ready(...chart.panels.map((panel) => panel.matrix));
    for (const plot of element.querySelectorAll(".js-plotly-plot")) Plotly.purge(plot);
    const looks = new Map(chart.panels.flatMap((panel) => panel.series.map((series) => [series.label, series.look])));
    const panels = chart.panels.map((panel) => {
      const box = make("div", { class: panel.matrix ? "panel square" : "panel" });
      return { panel, box };
    });
    const legend = looks.size < 2 && !chart.panels.some((panel) => panel.series.length > 1) ? [] : [...looks].map(([label, { colour: ink, dash }]) =>
      make("span", {}, make("i", { class: "swatch", style: `border-top: 3px ${{ solid: "solid", dash: "dashed", dot: "dotted" }[dash]} ${ink}` }), label));
    element.replaceChildren(make("div", { class: chart.panels.length > 1 ? "panels" : "" }, ...panels.map(({ box }) => box)), make("p", { class: "legend" }, ...legend));
    for (const { panel, box } of panels) {
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

  // ---- a run: the dialog ---------------------------------------------------------------------------------------
  let playing = null;
  const facts = (title, entries) => make("section", {}, make("h3", { text: title }),
    make("dl", {}, ...Object.entries(entries).flatMap(([name, value]) => [make("dt", { text: name }), make("dd", { text: value })])));

  /** Show a run; `cell` says what stands in the table: its place and number, and its verdict. */
  async function open(keys, chosen = keys[0], cell = []) {
    close();
    const run = data.runs[chosen];
    if (!run) return;
    const title = make("h2", { id: "run-title", text: `${run.dataset}, ${run.method}` });
    const shut = make("button", { type: "button", class: "plain", text: "Close", on: { click: () => dialog.close() } });
    const head = make("header", {}, title);
    if (keys.length > 1) {
      const pick = make("select", { "aria-label": "run" }, ...keys.map((key, i) => make("option", { value: key, text: `run ${i + 1} of ${keys.length}` })));
      pick.value = chosen;
      pick.addEventListener("change", () => open(keys, pick.value, cell));
      head.append(pick);
    }
    head.append(shut);
    const said = [run.setting, `status ${run.status}`];
    if (run.stand_in) said.push("procedural stand-in");
    for (const [name, value] of Object.entries(run.sizes)) if (value !== null) said.push(`${value} ${name}`);
    const body = make("div", {}, ...cell.map((text) => make("p", { class: "cell", text })), make("p", { class: "caption", text: said.join(", ") }));
    if (run.error) body.append(make("p", { class: "error", text: run.error }));
    const named = Object.entries(run.metrics ?? {}).map(([name, value]) => [data.names[name] ? `${data.names[name]} (${name})` : name, value]);
    const drawn = make("div", {}, make("p", { class: "caption", text: "Reading the plots …" }));
    const metrics = facts("Metrics", Object.fromEntries(named));
    metrics.classList.add("metrics");
    body.append(metrics, drawn);
    const cost = {};
    if (run.seconds !== undefined) cost["time"] = `${run.seconds.toFixed(1)} s`;
    if (run.peak_mb !== undefined) cost["memory"] = `${run.peak_mb.toFixed(0)} MB`;
    const identity = { trial: chosen, run: run.run ?? "–", finished: run.finished ?? "–", ...cost };
    const where = facts("Trial", identity);
    if (run.link) where.append(make("a", { href: run.link, text: "open in the tracker", rel: "noreferrer" }));
    body.append(make("div", { class: "facts" }, facts("Parameters", run.parameters ?? {}), facts("Versions", run.versions ?? {}), where));
    dialog.replaceChildren(head, body);
    if (!dialog.open) dialog.showModal();
    history.replaceState(null, "", `#run=${encodeURIComponent(chosen)}`);
    try {
      await ready(...arrays(run));
    } catch (error) {
      return drawn.replaceChildren(make("p", { class: "error", text: error.message }));
    }
    if (!drawn.isConnected) return;  // another run was opened meanwhile
    const starts = [], grid = make("div", { class: "plots" });
    drawn.replaceChildren(grid);
    if (run.view) {
      playing = player(run);
      grid.before(playing.element);
      playing.element.querySelector("[autofocus]").focus();  // the dialog has been opened before
      starts.push(playing.start);
    }
    for (const { box, start } of plots(run)) { grid.append(box); starts.push(start); }
    inOrder(starts);
  }

  function close() {
    playing?.stop();
    playing = null;
    for (const plot of dialog.querySelectorAll(".js-plotly-plot")) Plotly.purge(plot);
    dialog.replaceChildren();
  }

  dialog.addEventListener("close", () => { close(); history.replaceState(null, "", location.pathname + location.search); });
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  listen(dialog, (key) => playing?.keys[key]);

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

  /** Hide the columns of methods that are not ticked. */
  function choose(ticks) {
    const table = ticks.parentElement.querySelector("table.grid");
    for (const box of ticks.querySelectorAll("input"))
      for (const cell of table.querySelectorAll(`[data-method="${box.dataset.method}"]`)) cell.hidden = !box.checked;
  }
  for (const ticks of document.querySelectorAll(".ticks")) {
    ticks.addEventListener("change", () => choose(ticks));
    ticks.querySelector(".all").addEventListener("click", () => { ticks.querySelectorAll("input").forEach((box) => { box.checked = true; }); choose(ticks); });
    choose(ticks);
  }

  document.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button?.classList.contains("sort")) sort(button);
    if (!button?.classList.contains("open")) return;
    const cell = button.closest("td.cell"), keys = button.dataset.runs.split(" ").filter((key) => key in data.runs);
    open(keys, keys[0], cell ? [button.getAttribute("aria-label").replace("; open the run", ""), cell.title.split("\n")[0]] : []);
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
