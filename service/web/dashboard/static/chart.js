// Cursor and zoom on charts. Without this script everything is there as well: forms, links and tables.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const numbers = (d) => {
    // places of a path in pixels; steps (l) and absolute places (M, L) as our pictures write them
    const found = [];
    let x = 0, y = 0;
    for (const [, word, a, b] of d.matchAll(/([MLl]) ?(-?[\d.]+)[ ,](-?[\d.]+)/g)) {
      if (word === "l") { x += +a; y += +b; } else { x = +a; y = +b; }
      found.push([x, y]);
    }
    return found;
  };
  const set = (node, values) => { for (const [name, value] of Object.entries(values)) node.setAttribute(name, value); };

  function chart(figure) {
    const svg = figure.querySelector("svg"), output = figure.querySelector("output");
    const panels = [...svg.querySelectorAll("g.panel")].map((g) => {
      const h = Object.fromEntries(["x0", "x1", "y0", "y1", "left", "right", "top", "bottom"].map((n) => [n, +g.dataset[n]]));
      const lines = [...g.querySelectorAll("path[data-name]")].map((p) => ({ name: p.dataset.name, places: numbers(p.getAttribute("d")) }))
        .sort((a, b) => (b.name === "this pump") - (a.name === "this pump"));
      return { ...h, unit: g.dataset.unit, lines };
    });
    if (!panels.length) return;
    const first = panels[0], last = panels[panels.length - 1];
    const places = [...new Set(panels.flatMap((p) => p.lines.filter((l) => l.name !== "sibling").flatMap((l) => l.places.map((q) => q[0]))))].sort((a, b) => a - b);
    const cursor = document.createElementNS(SVG, "path"), box = document.createElementNS(SVG, "rect");
    cursor.setAttribute("class", "cursor"); box.setAttribute("class", "chosen");
    let at = null, from = null;

    const value = (x) => first.x0 + (x - first.left) / (first.right - first.left) * (first.x1 - first.x0);
    const words = (x) => figure.dataset.axis === "time" ? new Date(1000 * value(x)).toISOString().slice(0, 16).replace("T", " ") + " UTC"
      : figure.dataset.axis === "hours" ? value(x).toFixed(1) + " h" : value(x).toPrecision(6) + " s";
    const parameter = (x) => figure.dataset.axis === "time" ? new Date(1000 * value(x)).toISOString().slice(0, 19) + "Z" : value(x).toPrecision(7);
    const nearest = (list, x) => list.reduce((best, p) => Math.abs(p[0] - x) < Math.abs(best[0] - x) ? p : best, list[0]);

    function show() {
      if (at === null) { cursor.remove(); box.remove(); output.textContent = ""; return; }
      set(cursor, { d: `M${at} ${first.top}V${last.bottom}` }); svg.append(cursor);
      if (from !== null && from !== at) {
        set(box, { x: Math.min(from, at), y: first.top, width: Math.abs(at - from), height: last.bottom - first.top }); svg.append(box);
        output.textContent = `${words(Math.min(from, at))} to ${words(Math.max(from, at))}: Enter or release to look closer`;
        return;
      }
      box.remove();
      const said = panels.flatMap((p) => p.lines.filter((l) => l.places.length).map((l) => {
        const q = nearest(l.places, at);
        if (Math.abs(q[0] - at) > 40) return null;
        const v = p.y0 + (p.bottom - q[1]) / (p.bottom - p.top) * (p.y1 - p.y0);
        return `${l.name} ${Math.abs(v) < 1000 ? v.toPrecision(3) : v.toFixed(0)} ${p.unit}`;
      })).filter(Boolean);
      output.textContent = [words(at), ...said].join(" · ");
    }
    function zoom() {
      if (from === null || Math.abs(at - from) < 4) { from = null; show(); return; }
      const [a, b] = [Math.min(from, at), Math.max(from, at)].map((x) => encodeURIComponent(parameter(x)));
      location.assign(figure.dataset.zoom.replace("FROM", a).replace("TO", b));
    }
    function pixel(event) {
      const shape = svg.getBoundingClientRect(), whole = svg.viewBox.baseVal.width;
      return Math.min(Math.max((event.clientX - shape.left) / shape.width * whole, first.left), first.right);
    }
    svg.addEventListener("pointermove", (e) => { at = pixel(e); show(); });
    svg.addEventListener("pointerdown", (e) => { if (e.button === 0 && e.pointerType !== "touch") { from = at = pixel(e); svg.setPointerCapture(e.pointerId); e.preventDefault(); figure.focus({ preventScroll: true }); show(); } });
    svg.addEventListener("pointerup", (e) => { if (from !== null) { at = pixel(e); zoom(); } });
    svg.addEventListener("pointerleave", () => { if (from === null) { at = null; show(); } });
    figure.addEventListener("keydown", (e) => {
      if (e.target !== figure || !places.length) return;
      const i = at === null ? -1 : places.reduce((best, x, k) => Math.abs(x - at) < Math.abs(places[best] - at) ? k : best, 0);
      const to = { ArrowRight: i + 1, ArrowLeft: i < 0 ? places.length - 1 : i - 1, Home: 0, End: places.length - 1 }[e.key];
      if (to !== undefined) {
        if (!e.shiftKey) from = null; else if (from === null) from = at ?? places[Math.max(to, 0)];
        at = places[Math.min(Math.max(to, 0), places.length - 1)];
      } else if (e.key === "Enter") zoom();
      else if (e.key === "Escape") { from = at = null; }
      else return;
      e.preventDefault(); show();
    });
  }
  document.querySelectorAll("figure.chart").forEach(chart);
})();
