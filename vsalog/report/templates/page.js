"use strict";
// Draws the charts that the page contains as JSON. Labels were escaped when the page was written.
(() => {
  const root = document.documentElement;
  const font = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif';
  const dashes = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];
  // Viridis without the end that the paper swallows.
  const shades = {
    light: [[0, "#440154"], [0.25, "#414487"], [0.5, "#2a788e"], [0.75, "#22a884"], [1, "#8fce3a"]],
    dark: [[0, "#5a6fc4"], [0.25, "#2f9a9e"], [0.5, "#35b779"], [0.75, "#a0da39"], [1, "#fde725"]],
  };
  const plots = [...document.querySelectorAll(".plot")];
  const narrow = (box) => box.clientWidth < 620;
  const colour = (name) => getComputedStyle(root).getPropertyValue(/^\d+$/.test(name) ? `--c${name % 7}` : `--${name}`).trim();
  // Pixels that A4 and Letter have room for between their margins.
  const PAPER = 690;
  let printing = false;

  function isDark() {
    if (printing) return false;
    const chosen = root.dataset.theme;
    return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  }

  function webgl() {
    try { return Boolean(document.createElement("canvas").getContext("webgl")); } catch { return false; }
  }

  function trace(curve, at, axes, first) {
    const own = { x: curve.x, y: curve.y, xaxis: `x${at}`, yaxis: `y${at}`, name: curve.label, showlegend: curve.label !== "" };
    const paint = colour(curve.colour);
    if (curve.kind === "bars") {
      return { ...own, type: "bar", width: curve.width, marker: { color: paint, opacity: 0.75, line: { width: 0 } } };
    }
    if (curve.kind === "area") {
      const fill = { mode: "lines", line: { width: 0 }, fill: "toself", fillcolor: colour(`${curve.colour}-fill`) };
      return { ...own, ...fill, type: "scatter", hoverinfo: "skip" };
    }
    if (curve.kind === "points") {
      const marker = curve.symbol ? { size: 12, color: paint, symbol: curve.symbol, line: { width: 2, color: paint } } : { size: 4, color: paint, opacity: 0.75 };
      if (curve.shade) {
        const bar = { title: { text: axes.shade_label, side: "right" }, thickness: 12, outlinewidth: 0, len: 0.95, ypad: 0 };
        Object.assign(marker, { color: curve.shade, colorscale: shades[isDark() ? "dark" : "light"], showscale: true, colorbar: bar });
        own.showlegend = false;
      }
      return { ...own, type: "scatter", mode: "markers", marker };
    }
    const number = /^\d+$/.test(curve.colour) ? Math.floor(curve.colour / 7) : 0;
    const dash = curve.dashed ? "dash" : dashes[number % dashes.length];
    const mode = curve.kind === "marked" ? "lines+markers" : "lines";
    return { ...own, type: "scatter", mode, line: { width: 1.6, color: paint, dash }, marker: { size: 6 }, connectgaps: false };
  }

  function axis(text, more) {
    const line = { gridcolor: colour("grid"), linecolor: colour("soft"), zerolinecolor: colour("soft"), zerolinewidth: 1 };
    return { title: { text, standoff: 8 }, automargin: true, ticks: "outside", tickcolor: colour("soft"), ...line, ...more };
  }

  function base(height) {
    return {
      height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest", barmode: "overlay", bargap: 0,
      font: { family: font, size: 13, color: colour("ink") }, margin: { l: 62, r: 14, t: 12, b: 46 },
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)" },
      hoverlabel: { bgcolor: colour("panel"), bordercolor: colour("line"), font: { color: colour("ink") } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("accent") },
      // A finger scrolls the page; a mouse zooms.
      dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
    };
  }

  // Layout of n panels: side by side where there is room, else one below the other; [x from, to, y from, to] of each.
  function places(spec, box) {
    const n = spec.axes.length;
    if (spec.side_by_side && !narrow(box)) {
      const gap = n > 1 ? 0.09 : 0, wide = (1 - gap * (n - 1)) / n;
      return { height: 370, at: spec.axes.map((_, i) => [i * (wide + gap), i * (wide + gap) + wide, 0, 1]) };
    }
    const rows = spec.axes.map((axes, i) => (axes.rows.length ? 40 * axes.rows.length + 30 : i === 0 || !spec.linked ? 260 : 170));
    const gap = spec.linked ? 26 : 90, all = rows.reduce((a, b) => a + b, 0) + gap * (n - 1);
    let top = all;
    const at = rows.map((h) => { const y = [0, 1, (top - h) / all, top / all]; top -= h + gap; return y; });
    return { height: all + 118, at };
  }

  function flat(spec, box) {
    const { height, at } = places(spec, box);
    const layout = { ...base(height), shapes: [] }, data = [];
    spec.axes.forEach((axes, i) => {
      const id = i === 0 ? "" : i + 1, last = i === spec.axes.length - 1;
      const link = spec.linked ? { matches: i ? "x" : undefined, showticklabels: last } : {};
      layout[`xaxis${id}`] = axis(spec.linked && !last ? "" : axes.x_label, { domain: at[i].slice(0, 2), anchor: `y${id}`, ...link });
      layout[`yaxis${id}`] = axis(axes.y_label, { domain: at[i].slice(2), anchor: `x${id}` });
      if (axes.x_log) layout[`xaxis${id}`].type = "log";
      if (axes.y_log) layout[`yaxis${id}`].type = "log";
      if (axes.x_ticks.length) Object.assign(layout[`xaxis${id}`], { tickvals: axes.x_ticks.map((t) => t[0]), ticktext: axes.x_ticks.map((t) => t[1]) });
      if (axes.rows.length) {
        const named = { tickvals: axes.rows.map((_, k) => -k), ticktext: axes.rows, range: [0.6 - axes.rows.length, 0.6], zeroline: false };
        Object.assign(layout[`yaxis${id}`], named, { fixedrange: true, ticks: "" });
      }
      const shaded = { type: "rect", xref: `x${id}`, yref: `y${id} domain`, y0: 0, y1: 1, fillcolor: colour("shade"), line: { width: 0 }, layer: "below" };
      for (const [x0, x1] of axes.spans) layout.shapes.push({ ...shaded, x0, x1 });
      for (const curve of axes.curves) data.push(trace(curve, id, axes));
      if (axes.spans.length && axes.span_label) {
        const marker = { symbol: "square", size: 13, color: colour("shade") };
        data.push({ type: "scatter", mode: "markers", x: [null], y: [null], xaxis: `x${id}`, yaxis: `y${id}`, name: axes.span_label, marker });
      }
    });
    layout.showlegend = data.some((t) => t.showlegend !== false);
    return { data, layout };
  }

  function solid(spec, box) {
    const s = spec.surface, [dx, dy, dz] = s.data, scale = shades[isDark() ? "dark" : "light"];
    const points = { mode: "markers", name: "data", showlegend: true };
    if (!webgl()) {
      // Without WebGL the data are seen from above, the torque as colour.
      const bar = { title: { text: s.labels[2], side: "right" }, thickness: 12, outlinewidth: 0 };
      const marker = { size: 5, color: dz, colorscale: scale, showscale: true, colorbar: bar };
      const layout = { ...base(420), xaxis: axis(s.labels[0]), yaxis: axis(s.labels[1]), showlegend: false };
      return { data: [{ ...points, type: "scatter", x: dx, y: dy, marker }], layout };
    }
    const layout = { ...base(narrow(box) ? 400 : 540), showlegend: true, margin: { l: 0, r: 0, t: 0, b: 0 } };
    const three = (text) => ({ ...axis(text), title: { text, font: { size: 12 } }, tickfont: { size: 11 }, showbackground: false, nticks: 6, automargin: undefined, ticks: undefined });
    layout.scene = {
      xaxis: three(s.labels[0]), yaxis: three(s.labels[1]), zaxis: three(s.labels[2]), dragmode: "turntable", aspectmode: "manual",
      aspectratio: { x: 1.25, y: 1.25, z: 0.8 }, camera: { eye: { x: 1.3, y: -1.6, z: 0.75 }, center: { x: 0, y: 0, z: -0.17 } },
    };
    layout.legend = { ...layout.legend, y: 0.98, yanchor: "top" };
    const contours = { x: { show: true, color: colour("soft"), width: 1 }, y: { show: true, color: colour("soft"), width: 1 } };
    const sheet = { type: "surface", x: s.x, y: s.y, z: s.z, colorscale: scale, showscale: false, opacity: 0.85, contours, name: "model", showlegend: true };
    const marks = { ...points, type: "scatter3d", x: dx, y: dy, z: dz, marker: { size: 2.2, color: colour("measured"), symbol: "x" } };
    return { data: [sheet, marks], layout };
  }

  const config = {
    // A log's data stay here: no button offers to send them anywhere.
    showSendToCloud: false, plotlyServerURL: "",
    responsive: false, displaylogo: false, doubleClick: "reset", scrollZoom: false, showTips: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "toggleSpikelines", "hoverCompareCartesian", "hoverClosestCartesian"],
    toImageButtonOptions: { format: "svg" },
  };

  function draw(box) {
    const spec = (box.spec ??= JSON.parse(document.getElementById(box.dataset.chart).textContent));
    const { data, layout } = spec.surface ? solid(spec, box) : flat(spec, box);
    // Zooming survives a change of colours and of width.
    layout.uirevision = "kept";
    // Without it a second drawing keeps the first one's width; paper is narrower than most screens.
    layout.width = printing ? Math.min(box.clientWidth, PAPER) : box.clientWidth;
    const first = !box.drawn;
    box.drawn = true;
    box.wide = box.clientWidth;
    if (first) box.textContent = "";
    config.toImageButtonOptions.filename = spec.name;
    config.displayModeBar = printing || narrow(box) ? false : "hover";
    // The buttons are in the top right corner, above the legend.
    if (!narrow(box) && !printing && !spec.surface) layout.margin.t = layout.showlegend ? 56 : 30;
    return Plotly.react(box, data, layout, config).then(() => {
      if (first) {
        follow(box, spec);
        box.dataset.state = "drawn";
      }
    });
  }

  // Figures over time of one transmission are zoomed together.
  let following = false;
  function follow(box, spec) {
    if (!spec.linked && spec.name !== "stiffness") return;
    box.on("plotly_relayout", (change) => {
      if (following) return;
      const range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
      const all = change["xaxis.autorange"];
      if (range[0] === undefined && !all) return;
      following = true;
      const others = plots.filter((p) => p !== box && p.drawn && p.dataset.group === box.dataset.group && p.spec.axes.length);
      const wanted = others.filter((p) => p.spec.linked || p.spec.name === "stiffness");
      const change_ = all ? { "xaxis.autorange": true } : { "xaxis.range": range };
      Promise.all(wanted.map((p) => Plotly.relayout(p, change_))).finally(() => { following = false; });
    });
  }

  // Arrow keys move, + and − zoom, 0 shows all.
  function key(event) {
    const box = event.currentTarget, layout = box._fullLayout;
    if (event.target !== box || !layout?.xaxis || event.ctrlKey || event.metaKey || event.altKey) return;
    const [a, b] = layout.xaxis.range, span = b - a;
    const to = { ArrowLeft: [a - 0.2 * span, b - 0.2 * span], ArrowRight: [a + 0.2 * span, b + 0.2 * span], "+": [a + 0.2 * span, b - 0.2 * span],
      "=": [a + 0.2 * span, b - 0.2 * span], "-": [a - span / 3, b + span / 3] }[event.key];
    if (event.key === "0") Plotly.relayout(box, { "xaxis.autorange": true, ...(box.spec.axes[0].rows.length ? {} : { "yaxis.autorange": true }) });
    else if (to) Plotly.relayout(box, { "xaxis.range[0]": to[0], "xaxis.range[1]": to[1] });
    else return;
    event.preventDefault();
  }

  const redraw = () => Promise.all(plots.filter((box) => box.drawn).map(draw));

  async function library() {
    const bytes = Uint8Array.from(atob(document.getElementById("library").textContent.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  }

  // A click on a heading sorts by the data-v of its cells, numbers as numbers; a second one the other way round.
  function sorted(table) {
    const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
    const value = (row, i) => { const cell = row.cells[i]; return cell.dataset.v ?? cell.textContent.trim(); };
    heads.forEach((head, i) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
        const rows = [...body.rows].map((row) => [value(row, i), row]), numeric = rows.every(([v]) => v === "" || !isNaN(v));
        // What has no value comes last.
        rows.sort(([a], [b]) => a === "" || b === "" ? (a === "") - (b === "") : way * (numeric ? a - b : a < b ? -1 : a > b ? 1 : 0));
        body.append(...rows.map(([, row]) => row));
      });
    });
  }

  async function start() {
    document.querySelectorAll(".sortable").forEach(sorted);
    if (!plots.length) return;
    try {
      await library();
    } catch (error) {
      for (const box of plots) box.textContent = `This browser cannot unpack the figures (${error}); the tables and sentences have the same content.`;
      return;
    }
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        seen.unobserve(entry.target);
        if (!entry.target.drawn) draw(entry.target);
      }
    }, { rootMargin: "800px" });
    const resized = new ResizeObserver((entries) => {
      for (const { target } of entries) if (target.drawn && target.clientWidth !== target.wide && !printing) draw(target);
    });
    for (const box of plots) {
      seen.observe(box);
      resized.observe(box);
      box.addEventListener("keydown", key);
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    // Paper is white: all figures are drawn, in light colours, before they are printed.
    let theme;
    addEventListener("beforeprint", () => {
      theme = root.dataset.theme;
      root.dataset.theme = "light";
      printing = true;
      plots.forEach(draw);
    });
    addEventListener("afterprint", () => {
      printing = false;
      if (theme === undefined) delete root.dataset.theme; else root.dataset.theme = theme;
      redraw();
    });
    root.dataset.state = "ready";
  }

  const toggle = document.getElementById("theme");
  const labelled = () => { toggle.textContent = isDark() ? "Light colours" : "Dark colours"; };
  toggle.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    labelled();
    redraw();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", labelled);
  toggle.hidden = false;
  labelled();
  start();
})();
