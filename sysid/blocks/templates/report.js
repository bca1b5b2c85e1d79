"use strict";
(() => {
  const scheme = window.matchMedia("(prefers-color-scheme: dark)");
  const phone = window.matchMedia("screen and (max-width: 44rem)");
  const shown = new Map();
  window.sysidPlots = shown;

  const colour = (role) =>
    getComputedStyle(document.documentElement).getPropertyValue(`--${role}`).trim();

  // Bokeh draws on a canvas, where style sheets do not reach: colours are set by role.
  const paint = (view) => {
    const ink = colour("ink"), muted = colour("muted"), grid = colour("grid");
    for (const model of view.model.references()) {
      const role = model.tags && model.tags[0];
      switch (model.type) {
        case "LinearAxis":
          model.setv({
            axis_label_text_color: ink, major_label_text_color: ink,
            axis_line_color: muted, major_tick_line_color: muted,
          });
          break;
        case "Grid": model.grid_line_color = grid; break;
        case "Legend":
          model.setv({ label_text_color: ink, inactive_fill_color: colour("bg") });
          break;
        case "Line": if (role) model.line_color = colour(role); break;
        case "BoxAnnotation": if (role) model.fill_color = colour(role); break;
        case "Span": if (role) model.line_color = colour(role); break;
      }
    }
  };

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const unpack = ({ data, offset, scale }) =>
    Float64Array.from(new Int16Array(bytes(data)), (n) => n === -32768 ? NaN : offset + scale * n);

  const columns = ({ factor, time, measured, residuals }) => {
    const data = { time: Float64Array.from(new Float32Array(bytes(time))), measured: unpack(measured) };
    for (const [model, content] of Object.entries(residuals)) {
      const residual = unpack(content);
      data[`res_${model}`] = residual;
      data[`sim_${model}`] = data.measured.map((y, i) => y - factor * residual[i]);
    }
    return data;
  };

  // A document is one for many tests: its range, noise bands and samples are made this test's.
  const fill = (node, samples) => {
    if (Array.isArray(node)) node.forEach((part) => fill(part, samples));
    if (node === null || typeof node !== "object" || Array.isArray(node)) return;
    if (node.type === "object") {
      const last = samples.last, channel = samples.channels[node.attributes?.name];
      if (node.name === "Range1d") {
        node.attributes = { ...node.attributes, start: 0, end: last, bounds: [0, last],
                            min_interval: last / 2000 };
      } else if (channel && node.name === "BoxAnnotation") {
        Object.assign(node.attributes, { bottom: -channel.noise, top: channel.noise });
      } else if (node.name === "Figure" && phone.matches && node.attributes.tags?.[0] === "tall") {
        node.attributes.height = Math.round(0.7 * node.attributes.height);
      } else if (channel && node.name === "ColumnDataSource") {
        node.attributes.data = { type: "map", entries: Object.entries(columns(channel)) };
        return;
      }
    }
    Object.values(node).forEach((part) => fill(part, samples));
  };

  // A copy of a document whose models have names of their own.
  const copy = (id, key) => JSON.parse(
    document.getElementById(id).textContent.replace(/"p(\d+)"/g, `"${key}-p$1"`));

  const timeRange = (view) => {
    for (const model of view.model.references()) if (model.type === "Range1d") return model;
    return null;
  };

  const keys = (frame, view) => {
    const range = timeRange(view);
    const said = frame.querySelector(".range");
    if (!range) return;
    const [low, high] = [range.start, range.end];
    const show = (start, end) => {
      const width = Math.min(end - start, high - low);
      const from = Math.min(Math.max(start, low), high - width);
      range.setv({ start: from, end: from + width });
    };
    frame.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const { start, end } = range, width = end - start, middle = (start + end) / 2;
      switch (event.key) {
        case "+": case "=": show(middle - width / 4, middle + width / 4); break;
        case "-": show(middle - width, middle + width); break;
        case "ArrowLeft": show(start - width / 5, end - width / 5); break;
        case "ArrowRight": show(start + width / 5, end + width / 5); break;
        case "0": case "Home": show(low, high); break;
        default: return;
      }
      event.preventDefault();
    });
    const tell = () => {
      const whole = range.start <= low && range.end >= high;
      said.textContent = whole ? "" : `${range.start.toFixed(3)} to ${range.end.toFixed(3)} s`;
    };
    range.change.connect(tell);
  };

  // The static figures stay until the interactive plot stands, and wherever it does not.
  const draw = async (figure) => {
    const frame = figure.querySelector(".interactive");
    const still = figure.querySelector(".static");
    try {
      const samples = JSON.parse(document.getElementById(`${figure.id}-samples`).textContent);
      const item = copy(figure.dataset.document, figure.id);
      fill(item, samples);
      frame.hidden = false;
      const found = await Bokeh.embed.embed_item(item, `${figure.id}-canvas`);
      const view = [...(found.roots || found)][0];
      paint(view);
      keys(frame, view);
      shown.set(figure.id, view);
      still.hidden = true;
    } catch (error) {
      frame.hidden = true;
      still.hidden = false;
      console.warn(`plot ${figure.id}: ${error}`);
    }
  };

  // A page that is being scrolled goes on scrolling when a plot comes under the pointer: the
  // wheel zooms only once the pointer has moved over that plot.
  let under = null;
  const plotOf = (event) => event.target.closest && event.target.closest(".interactive");
  document.addEventListener("pointermove", (event) => { under = plotOf(event); }, true);
  document.addEventListener("scroll", () => { under = null; }, { capture: true, passive: true });
  document.addEventListener("wheel", (event) => {
    const plot = plotOf(event);
    if (plot && plot !== under) event.stopPropagation();
  }, { capture: true, passive: true });

  const start = () => {
    document.getElementById("plot-keys").hidden = false;
    scheme.addEventListener("change", () => shown.forEach(paint));
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        seen.unobserve(entry.target);
        draw(entry.target);
      }
    }, { rootMargin: "600px" });
    document.querySelectorAll("figure.plot").forEach((figure) => seen.observe(figure));
    window.addEventListener("beforeprint", () => {
      document.querySelectorAll("details").forEach((fold) => { fold.open = true; });
    });
  };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
