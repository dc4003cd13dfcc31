/* Charts of the traces: drag zooms, all charts share time and cursor; keys, buttons and fingers
   (touch_zoom.js) do the same. Where this script does not run, and on paper, the still pictures stand in
   their place. */
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("traces").textContent);
  const places = [...document.querySelectorAll(".trace[data-trace]")];
  const SYNC = "traces", LEAST = 8 * data.step;
  const whole = [data.begin, data.begin + data.step * (Math.max(...data.columns.map(c => c.samples)) - 1)];
  const plots = [], toolbars = [];
  let range = whole.slice();

  const at = row => data.begin + data.step * row;
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const COLOURS = { measured: "--ink", before: "--before", after: "--accent", model: "--accent" };

  function show(low, high) {
    let span = Math.min(Math.max(high - low, LEAST), whole[1] - whole[0]);
    low = Math.min(Math.max(low, whole[0]), whole[1] - span);
    range = [low, low + span];
    for (const plot of plots) plot.setScale("x", { min: range[0], max: range[1] });
    const zoomed = span < (whole[1] - whole[0]) * (1 - 1e-9);
    for (const bar of toolbars) {
      bar.whole.disabled = !zoomed;
      bar.span.textContent = `${tidy(range[0])} to ${tidy(range[1])} s`;
    }
  }
  const tidy = x => String(Number(x.toPrecision(5)));
  const zoom = factor => {
    const middle = (range[0] + range[1]) / 2, half = (range[1] - range[0]) / 2 * factor;
    show(middle - half, middle + half);
  };
  const pan = part => { const by = part * (range[1] - range[0]); show(range[0] + by, range[1] + by); };
  const reset = () => show(...whole);
  const KEYS = {
    ArrowLeft: () => pan(-0.2), ArrowRight: () => pan(0.2), "+": () => zoom(0.5), "=": () => zoom(0.5),
    "-": () => zoom(2), Escape: reset, Home: reset,
  };

  function unpack(column) {
    const rows = column.rows || Array.from({ length: column.samples }, (_, row) => row);
    const values = column.curves.map(c => c.counts.map(n => n === null ? null : c.offset + c.scale * n));
    const [measured, ...models] = values;
    const errors = models.map(m => m.map((v, i) => v === null || measured[i] === null ? null : v - measured[i]));
    return { time: rows.map(at), values, errors };
  }

  /* Behind the curves: what no fit has seen, and the sensor's noise. */
  function background(band) {
    return plot => {
      const c = plot.ctx, box = plot.bbox;
      c.save();
      c.beginPath(); c.rect(box.left, box.top, box.width, box.height); c.clip();
      c.fillStyle = colour("--shade");
      for (const [first, last] of data.held_out) {
        const left = plot.valToPos(at(first), "x", true), right = plot.valToPos(at(last), "x", true);
        c.fillRect(left, box.top, right - left, box.height);
      }
      if (band) {
        const top = plot.valToPos(band, "y", true), bottom = plot.valToPos(-band, "y", true);
        c.fillStyle = colour("--band");
        c.fillRect(box.left, top, box.width, bottom - top);
      }
      c.restore();
    };
  }

  function chart(into, column, label, names, series, height, band) {
    const axis = extra => ({
      stroke: colour("--muted"), grid: { stroke: colour("--line"), width: 1 },
      ticks: { stroke: colour("--line"), width: 1 }, font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif", ...extra,
    });
    const shown = (plot, value) => value == null ? "–" : String(Number(value.toPrecision(5)));
    const lines = names.map(name => ({
      label: name, stroke: colour(COLOURS[name]), width: name === "measured" ? 2 : 1.3,
      points: { show: false }, value: shown,
    }));
    const options = {
      width: into.clientWidth, height,
      scales: { x: { time: false, range: (plot, low, high) => [low, high] } },
      cursor: { sync: { key: SYNC }, drag: { x: true, y: false, dist: 4 }, focus: { prox: -1 } },
      legend: { live: true },
      series: [{ label: "time [s]", value: shown }, ...lines],
      axes: [axis({ size: 30 }), axis({ size: 58, label, labelSize: 18 })],
      hooks: {
        drawClear: [background(band)],
        setScale: [(plot, key) => {
          const { min, max } = plot.scales.x;
          if (key === "x" && min != null && (min !== range[0] || max !== range[1])) show(min, max);
        }],
      },
    };
    const plot = new uPlot(options, [series[0], ...series[1]], into);
    /* A chart that is narrow or wide, as its column is. */
    new ResizeObserver(() => {
      if (into.clientWidth && into.clientWidth !== plot.width) plot.setSize({ width: into.clientWidth, height });
    }).observe(into);
    plot.over.addEventListener("dblclick", reset);
    touchZoom(plot.over, () => range, show, reset);
    plots.push(plot);
  }

  function button(into, text, title, act) {
    const made = document.createElement("button");
    made.type = "button"; made.textContent = text; made.title = title; made.setAttribute("aria-label", title);
    made.addEventListener("click", act);
    return into.appendChild(made);
  }

  function toolbar(into, column) {
    const bar = document.createElement("div");
    bar.className = "tools";
    button(bar, "◀", "earlier (left arrow)", () => pan(-0.2));
    button(bar, "▶", "later (right arrow)", () => pan(0.2));
    button(bar, "+", "zoom in (+)", () => zoom(0.5));
    button(bar, "−", "zoom out (-)", () => zoom(2));
    const all = button(bar, "all", "whole recording (Esc)", reset);
    button(bar, "most telling stretch", "the stretch of unseen data that tells most",
      () => show(at(column.closer[0]), at(column.closer[1])));
    const span = bar.appendChild(document.createElement("span"));
    toolbars.push({ whole: all, span });
    into.appendChild(bar);
  }

  function build() {
    for (const plot of plots.splice(0)) plot.destroy();
    toolbars.length = 0;
    places.forEach(place => {
      const column = data.columns[Number(place.dataset.trace)], live = place.querySelector(".live");
      const { time, values, errors } = unpack(column);
      const names = column.curves.map(c => c.label), unit = column.unit ? ` [${column.unit}]` : "";
      live.replaceChildren();
      live.hidden = false;
      place.classList.add("lives");
      toolbar(live, column);
      const upper = live.appendChild(document.createElement("div"));
      const lower = live.appendChild(document.createElement("div"));
      chart(upper, column, column.name + unit, names, [time, values], 270, 0);
      chart(lower, column, "error" + unit, names.slice(1), [time, errors], 170, column.band);
      if (column.rows) {
        const note = live.appendChild(document.createElement("small"));
        note.textContent = `${column.rows.length} of ${column.samples} samples: extremes and gaps are kept, ` +
          "and all of the most telling stretch where it is short enough.";
      }
      live.onkeydown = event => {
        const act = KEYS[event.key];
        if (act && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); act(); }
      };
    });
    show(...range);
  }

  build();
  document.querySelector(".live-note").hidden = false;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", build);
  window.jaxmuscle = { range: () => range.slice(), plots: () => plots };
})();
