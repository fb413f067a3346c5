"use strict";
// Draws one group's curves at a time from the numbers that stand in the page. Nothing is fetched and nothing computed:
// every value shown is one of those numbers.
for (const [place, home] of document.querySelectorAll(".explorer").entries()) {
  const groups = JSON.parse(home.querySelector("script").textContent);
  const hidden = new Set(groups.flatMap((g) => g.curves.filter((c) => c.off).map((c) => c.name)));
  const clip = `clip-${place}`;
  let group, at, log, zero;

  const add = (parent, element, attributes = {}, text = "") => {
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(text);
    parent.append(element);
    return element;
  };
  const html = (parent, tag, attributes, text) => add(parent, document.createElement(tag), attributes, text);
  const svg = (parent, tag, attributes, text) =>
    add(parent, document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, text);
  const said = (value) => {
    if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5)) return String(+value.toPrecision(3)).replace("-", "\u2212");
    const [head, power] = value.toExponential(1).split("e");
    const raised = [...String(+power)].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] ?? "⁻").join("");
    return `${+head === 1 ? "" : `${+head} × `}10${raised}`;
  };
  const digits = (value) => (value >= 0.1 && value < 1000 ? value.toPrecision(3) : said(value));

  // Controls -------------------------------------------------------------------------------------------------------
  const controls = html(home, "div", { class: "controls" });
  const choice = (parent, name, on, change, swatch) => {
    const label = html(parent, "label");
    const box = html(label, "input", { type: "checkbox" });
    box.checked = on;
    box.onchange = () => { change(box.checked); draw(); };
    if (swatch) swatch(svg(label, "svg", { width: 26, height: 12, "aria-hidden": "true" }));
    label.append(name);
    return box;
  };
  const chooser = html(html(controls, "label", {}, "Group "), "select");
  groups.forEach((g, i) => html(chooser, "option", { value: i }, g.title.replace(/^Group /, "")));
  chooser.onchange = () => pick(+chooser.value);
  const axes = html(controls, "fieldset");
  html(axes, "legend", {}, "Logarithmic");
  const logBoxes = ["drive", ""].map((name, i) => choice(axes, name, false, (on) => { log[i] = on; }));
  const shown = html(controls, "fieldset");

  // Picture --------------------------------------------------------------------------------------------------------
  const picture = svg(home, "svg", { tabindex: 0, role: "slider", "aria-label": "Reading", "aria-valuemin": 1 });
  const readout = html(home, "p", { class: "readout" });

  const pick = (i) => {
    group = groups[i];
    log = group.log.map((on, k) => on && (k === 1 || Math.min(...group.x) > 0));
    at = null;
    logBoxes.forEach((box, k) => { box.checked = log[k]; });
    logBoxes[0].disabled = Math.min(...group.x) <= 0;
    logBoxes[1].nextSibling.textContent = group.read;
    shown.replaceChildren();
    html(shown, "legend", {}, "Shown");
    const toggle = (name, swatch) =>
      choice(shown, name, !hidden.has(name), (on) => (on ? hidden.delete(name) : hidden.add(name)), swatch);
    toggle("measured", (s) => svg(s, "circle", { cx: 13, cy: 6, r: 4, class: "reading" }));
    zero = html(shown, "span");
    svg(svg(zero, "svg", { width: 12, height: 12, "aria-hidden": "true" }), "path", { d: "M2 2h8l-4 7z", class: "reading" });
    zero.append("zero");
    const bands = new Map();
    for (const c of group.curves) {
      toggle(c.name, (s) => svg(s, "path", { d: "M1 6H25", class: line(c) }));
      c.bands.forEach((b, i) => { if (!bands.has(b.name)) bands.set(b.name, c.bands.slice(0, i + 1).map((_, k) => band(c, k))); });
    }
    // The inner one lies on the wider.
    for (const [name, looks] of bands) toggle(name, (s) => looks.forEach((look) => svg(s, "rect", { y: 1, width: 26, height: 10, class: look })));
    draw();
  };
  const line = (c) => `line ${c.color}${c.dashed ? " dashed" : ""}`;
  const band = (c, place) => `band ${c.color}${place ? " inner" : ""}`; // the widest is the first

  const scale = (low, high, from, to, isLog) => {
    const f = isLog ? Math.log10 : (v) => v;
    return (v) => from + ((f(v) - f(low)) * (to - from)) / (f(high) - f(low));
  };
  const ticks = (low, high, isLog, most) => {
    const decades = isLog ? Math.log10(high / low) : 0;
    const found = [];
    if (decades >= 0.8) {
      const heads = decades < 1.6 ? [1, 2, 5] : decades < 2.6 ? [1, 3] : [1];
      const stride = Math.max(1, Math.ceil(decades / most));
      for (let p = Math.floor(Math.log10(low)); p <= Math.log10(high); p += stride) found.push(...heads.map((h) => h * 10 ** p));
    } else {
      const rough = (high - low) / most;
      const unit = 10 ** Math.floor(Math.log10(rough));
      const step = unit * [1, 2, 2.5, 5, 10].find((s) => s * unit >= rough);
      for (let k = Math.ceil(low / step); k * step <= high * (1 + 1e-12); k++) found.push(k * step);
    }
    return found.filter((v) => v >= low * (1 - 1e-9) && v <= high * (1 + 1e-9)).map((v) => +v.toPrecision(9));
  };
  const ends = (curves) => {
    const measured = group.measured;
    const middles = curves.flatMap((c) => [...c.middle, ...(c.line?.[1] ?? [])]);
    const tops = curves.flatMap((c) => c.bands.filter((b) => !hidden.has(b.name)).flatMap((b) => b.high));
    const top = Math.max(...measured, ...middles, 1e-9);
    const high = Math.max(top, Math.min(Math.max(0, ...tops), 3 * top));
    const above = measured.filter((v) => v > 0);
    if (!log[1] || !above.length) return [Math.min(0, 1.06 * Math.min(...measured, ...middles)), 1.06 * high];
    const least = Math.min(...above);
    return [0.55 * Math.max(Math.min(least, ...middles.filter((v) => v > 0)), least / 10), 1.4 * high];
  };

  let reach = [];
  function draw() {
    const width = Math.max(picture.getBoundingClientRect().width, 200); // no width yet while the page is laid out
    const height = width < 560 ? 300 : 400;
    const [right, foot, head] = [width - 14, height - 46, 12];
    const curves = group.curves.filter((c) => !hidden.has(c.name));
    let [x0, x1] = [Math.min(...group.x), Math.max(...group.x)];
    const room = log[0] ? (x1 / x0) ** 0.03 : 0.03 * (x1 - x0);
    if (x0 === x1) [x0, x1] = log[0] ? [x0 / 1.1, x1 * 1.1] : [x0 - 0.5, x1 + 0.5];
    else [x0, x1] = log[0] ? [x0 / room, x1 * room] : [x0 - room, x1 + room];
    const [y0, y1] = ends(curves);
    const isLog = y0 > 0;
    const levels = ticks(y0, y1, isLog, 6);
    const left = Math.max(56, 32 + 8 * Math.max(...levels.map((v) => said(v).length))); // room for the longest number
    const x = scale(x0, x1, left, right, log[0]);
    const yFree = scale(y0, y1, foot, head, isLog);
    const y = (v) => Math.max(Math.min(yFree(Math.max(v, y0)), foot), head - 40);
    // What lies below the axes is cut off there, not drawn along their foot.
    const point = (at, v, on) => `${on ? "L" : "M"}${x(at).toFixed(1)} ${Math.max(Math.min(yFree(Math.max(v, isLog ? y0 / 1e3 : v)), foot + 40), head - 40).toFixed(1)}`;
    const path = (at, values) => values.map((v, i) => point(at[i], v, i)).join("");
    const lone = group.x.every((v) => v === group.x[0]); // a line and a band need a width
    const shifted = (dx) => x(group.x[0]) + dx;
    // No launch has no place on a logarithmic axis: it breaks a line, and stands at the foot like a reading of zero.
    const none = (v) => isLog && v === 0;
    const broken = ([at, values]) => values.map((v, i) => (none(v) ? "" : point(at[i], v, i && !none(values[i - 1])))).join("");
    const triangle = (v, size) => `M${x(v) - size} ${foot - 4}h${2 * size}l${-size} 7z`;
    const order = group.x.map((_, i) => i);

    picture.replaceChildren();
    picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
    picture.setAttribute("aria-valuemax", group.x.length);
    svg(svg(picture, "clipPath", { id: clip }), "rect", { x: left, y: head - 6, width: right - left, height: foot - head + 6 });
    for (const v of ticks(x0, x1, log[0], width < 560 ? 4 : 7)) {
      svg(picture, "path", { d: `M${x(v)} ${head}V${foot}`, class: "grid" });
      svg(picture, "text", { x: x(v), y: foot + 18, "text-anchor": "middle" }, said(v));
    }
    for (const v of levels) {
      svg(picture, "path", { d: `M${left} ${yFree(v)}H${right}`, class: "grid" });
      svg(picture, "text", { x: left - 8, y: yFree(v) + 4, "text-anchor": "end" }, said(v));
    }
    svg(picture, "text", { x: (left + right) / 2, y: height - 6, "text-anchor": "middle", class: "label" }, group.label);
    svg(picture, "text", { transform: `translate(14 ${(head + foot) / 2}) rotate(-90)`, "text-anchor": "middle", class: "label" }, group.axis);
    const inside = svg(picture, "g", { "clip-path": `url(#${clip})` });
    for (const c of curves)
      for (const [place, b] of c.bands.entries())
        if (!hidden.has(b.name)) {
          const [at, [low, high]] = [b.line ? c.line[0] : group.x, b.line ?? [b.low, b.high]];
          const d = lone
            ? `M${shifted(-9)} ${y(Math.max(...high))}H${shifted(9)}V${y(Math.min(...low))}H${shifted(-9)}Z`
            : `${path(at, high)}${path([...at].reverse(), [...low].reverse()).replace("M", "L")}Z`;
          svg(inside, "path", { d, class: band(c, place) });
        }
    for (const c of curves) {
      svg(inside, "path", { d: lone ? c.middle.filter((v) => !none(v)).map((v) => `M${shifted(-10)} ${y(v)}H${shifted(10)}`).join("") : broken(c.line ?? [group.x, c.middle]), class: line(c) });
      order.filter((i) => none(c.middle[i])).forEach((i) => svg(picture, "path", { d: triangle(group.x[i], 3), class: `dot ${c.color}` }));
    }
    if (!hidden.has("measured"))
      group.measured.forEach((v, i) => {
        const [cx, cy] = [x(group.x[i]), y(v)];
        const s = group.sigma?.[i];
        if (s && !none(v)) svg(inside, "path", { d: `M${cx} ${y(v - s)}V${y(v + s)}`, class: "sigma" });
        if (none(v)) svg(picture, "path", { d: triangle(group.x[i], 4), class: "reading" });
        else svg(picture, "circle", { cx, cy, r: 4, class: "reading" });
      });
    reach = order.map((i) => [x(group.x[i]), y(group.measured[i])]);
    if (at !== null) {
      svg(picture, "path", { d: `M${reach[at][0]} ${head}V${foot}`, class: "cursor" });
      svg(picture, "circle", { cx: reach[at][0], cy: reach[at][1], r: 6, class: "cursor" });
      for (const c of curves) svg(picture, "circle", { cx: reach[at][0], cy: y(c.middle[at]), r: 4, class: `dot ${c.color}` });
    }
    const zeros = [
      ...(!hidden.has("measured") && group.measured.some(none) ? ["reading"] : []),
      ...curves.filter((c) => c.middle.some(none)).map((c) => `dot ${c.color}`),
    ];
    zero.hidden = !zeros.length;
    zero.querySelector("path").setAttribute("class", zeros[0] ?? "reading");
    report(curves);
  }

  function report(curves) {
    const hint = "Point at the curves, or move with the arrow keys, for the values of a reading.";
    const parts = [];
    if (at !== null) {
      const s = group.sigma ? ` ± ${digits(group.sigma[at])}` : "";
      parts.push(`${said(group.frequency[at])} Hz, ${said(group.amplitude[at])} V: measured ${digits(group.measured[at])}${s} ${group.unit}`);
      for (const c of curves) {
        const bands = c.bands.map((b) => `${b.name} ${digits(b.low[at])} to ${digits(b.high[at])} ${group.unit}`).join(", ");
        parts.push(`${c.name} ${digits(c.middle[at])} ${group.unit}${bands ? ` (${bands})` : ""}`);
      }
    }
    readout.textContent = parts.join("; ") || hint;
    picture.setAttribute("aria-valuenow", at === null ? 1 : at + 1);
    picture.setAttribute("aria-valuetext", readout.textContent);
  }

  picture.onpointermove = picture.onpointerdown = (event) => {
    const box = picture.getBoundingClientRect();
    const grow = picture.viewBox.baseVal.width / box.width;
    const [px, py] = [(event.clientX - box.left) * grow, (event.clientY - box.top) * grow];
    const far = reach.map(([cx, cy]) => (cx - px) ** 2 + 0.05 * (cy - py) ** 2);
    const nearest = far.indexOf(Math.min(...far));
    if (nearest !== at) { at = nearest; draw(); }
  };
  picture.onkeydown = (event) => {
    const last = group.x.length - 1;
    const to = { ArrowRight: (at ?? -1) + 1, ArrowUp: (at ?? -1) + 1, ArrowLeft: (at ?? last + 1) - 1, ArrowDown: (at ?? last + 1) - 1, Home: 0, End: last, Escape: null }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    at = to === null ? null : Math.max(0, Math.min(last, to));
    draw();
  };
  pick(0);
  let before = home.clientWidth;
  new ResizeObserver(() => { if (home.clientWidth !== before) { before = home.clientWidth; draw(); } }).observe(home);
}
