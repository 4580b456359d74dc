"use strict";
// Draws the recording in the JSON of this page with uPlot: per joint four panels, one zoom for all.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--ink").trim(), line = style.getPropertyValue("--line").trim();
  // Colours that people with red-green colour blindness can tell apart (Okabe and Ito).
  const BLUE = "#0072b2", ORANGE = "#d55e00", GREEN = "#009e73", PINK = "#cc79a7", GREY = "#8a8f94";
  const MODES = { off: "#8a8f94", enabling: "#f0e442", holding: "#0072b2", tracking: "#009e73",
    admittance: "#56b4e9", retracting: "#cc79a7", returning: "#e69f00", releasing: "#d55e00",
    stopping: "#f0e442", faulted: "#c00000" };
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const time = new Float64Array(bytes(data.time).buffer);
  const MISSING = -32768;

  function values(name, joint) {
    const one = data.joints[joint].signals[name];
    const codes = new Int16Array(bytes(one.codes).buffer);
    return Array.from(codes, (c) => (c === MISSING ? null : one.offset + one.scale * c));
  }
  const negative = (row) => row.map((v) => (v === null ? null : -v));
  const sum = (a, b, sign) => a.map((v, i) => (v === null || b[i] === null ? null : v + sign * b[i]));
  const shown = (digits) => (u, v) => (v == null ? "-" : v.toFixed(digits));
  const curve = (label, stroke, digits, more) =>
    ({ label, stroke, width: 1.2, value: shown(digits), spanGaps: false, points: { show: false }, ...more });
  const bound = (label, stroke, more) => curve(label, stroke, 3, { dash: [6, 4], width: 1, ...more });

  // A curve mirrored at zero: drawn and hidden with the curve before it, which alone is in the legend.
  const mirrored = (one) => ({ ...one, class: "mirrored" });
  function hideMirrored(u, i, change) {
    for (let k = i + 1; i && "show" in change && k < u.series.length && u.series[k].class === "mirrored"; k++)
      if (u.series[k].show !== change.show) u.setSeries(k, { show: change.show });
  }

  // Each panel: its axis, its series, and their values for a joint.
  const PANELS = [
    { axis: "residual [Nm]", of: (j) => {
      const threshold = values("threshold", j);
      return [[curve("residual", BLUE, 3, { width: 1.6 }), values("residual", j)],
        [bound("threshold in force", ORANGE), threshold], [mirrored(bound("", ORANGE)), negative(threshold)]];
    } },
    { axis: "velocity [rad/s]", of: (j) => [[curve("link", BLUE, 3), values("link_velocity", j)],
      [curve("motor", ORANGE, 3, { width: 1 }), values("motor_velocity", j)]] },
    { axis: "current [A]", of: (j) => [[curve("current", GREEN, 3), values("current", j)]] },
    { axis: "phi [mrad]", of: (j) => {
      const phi = values("phi", j).map((v) => (v === null ? null : 1e3 * v));
      const sigma = values("phi_sigma", j).map((v) => (v === null ? null : 1e3 * v));
      const gap = 1e3 * data.joints[j].half_gap;
      const rows = [[curve("phi", PINK, 2, { width: 1.6 }), phi],
        [curve("+ its uncertainty", GREY, 2, { width: 0.8 }), sum(phi, sigma, 1)],
        [mirrored(curve("", GREY, 2, { width: 0.8 })), sum(phi, sigma, -1)]];
      return gap > 0 ? [...rows, [bound("half-gap", ORANGE), phi.map(() => gap)],
        [mirrored(bound("", ORANGE)), phi.map(() => -gap)]] : rows;
    }, bands: [{ series: [2, 3], fill: GREY + "40" }] },
  ];

  function shading(first) {
    return (u) => {
      const { ctx, bbox } = u;
      ctx.save();
      for (const [begin, end, mode] of data.modes) {
        const left = Math.max(u.valToPos(begin, "x", true), bbox.left);
        const right = Math.min(u.valToPos(end, "x", true), bbox.left + bbox.width);
        if (right <= left) continue;
        ctx.globalAlpha = 0.13;
        ctx.fillStyle = MODES[mode] || GREY;
        ctx.fillRect(left, bbox.top, right - left, bbox.height);
        ctx.globalAlpha = 0.8;
        ctx.fillStyle = ink;
        ctx.textAlign = "left";
        ctx.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
        if (first && right - left > ctx.measureText(mode).width + 8 * devicePixelRatio)
          ctx.fillText(mode, left + 3 * devicePixelRatio, bbox.top + bbox.height - 4 * devicePixelRatio);
      }
      ctx.restore();
    };
  }

  function marks(joint, first) {
    return (u) => {
      const { ctx, bbox } = u, px = devicePixelRatio;
      let free = bbox.left;  // the labels so far end here
      const vertical = (t, colour, width, dash, sign) => {
        const x = u.valToPos(t, "x", true);
        if (x < bbox.left || x > bbox.left + bbox.width) return;
        ctx.strokeStyle = ctx.fillStyle = colour;
        ctx.lineWidth = width * px;
        ctx.setLineDash(dash.map((d) => d * px));
        ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
        if (!first || !sign || x < free) return;
        ctx.font = `bold ${11 * px}px system-ui`;
        ctx.textAlign = "left";
        ctx.fillText(sign, x + 3 * px, bbox.top + 11 * px);
        free = x + ctx.measureText(sign).width + 6 * px;
      };
      ctx.save();
      data.contacts.forEach((c, k) =>
        vertical(c.time_s, ORANGE, c.joint === joint ? 1.6 : 0.7, c.joint === joint ? [] : [2, 4],
          c.joint === joint ? `contact ${k + 1}` : ""));
      for (const f of data.events) if (f.kind === "fault") vertical(f.time_s, "#c00000", 2.2, [], "fault");
      for (const f of data.events) if (f.kind === "mode") vertical(f.time_s, GREY, 0.6, [1, 3], "");
      if (data.at_s !== null) vertical(data.at_s, ink, 1, [8, 3], `${data.at_s} s`);
      ctx.restore();
    };
  }

  let plots = [], moving = false;
  function zoom(min, max) {
    moving = true;
    for (const u of plots) u.setScale("x", { min, max });
    moving = false;
  }
  const whole = () => zoom(data.from_s, data.until_s);
  const width = () => Math.max(document.getElementById("panels").clientWidth, 280);
  const height = (panel) => (panel === 0 ? 190 : 120);

  function draw() {
    const range = plots.length ? [plots[0].scales.x.min, plots[0].scales.x.max] : [data.from_s, data.until_s];
    for (const u of plots) u.destroy();
    plots = [];
    const place = document.getElementById("panels");
    place.textContent = "";
    data.joints.forEach((joint, j) => {
      if (!chosen.has(joint.name)) return;
      place.append(Object.assign(document.createElement("h3"), { textContent: joint.name }));
      PANELS.forEach((panel, p) => {
        const series = panel.of(j), box = document.createElement("div");
        place.append(box);
        const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line } };
        plots.push(new uPlot({
          width: width(), height: height(p), bands: panel.bands,
          cursor: { sync: { key: "contactd" }, drag: { x: true, y: false }, points: { size: 5 } },
          scales: { x: { time: false, min: range[0], max: range[1] } },
          axes: [{ ...axis, size: 28, values: (u, ticks) => ticks.map((t) => +t.toFixed(4) + " s") },
            { ...axis, size: 62, space: 20, label: panel.axis, labelSize: 18, labelFont: "12px system-ui" }],
          series: [{ label: "time [s]", value: shown(3) }, ...series.map((one) => one[0])],
          hooks: { drawClear: [shading(p === 0)], draw: [marks(joint.name, p === 0)],
            setSeries: [hideMirrored],
            setScale: [(u, key) => { if (key === "x" && !moving) zoom(u.scales.x.min, u.scales.x.max); }],
            ready: [(u) => u.over.addEventListener("dblclick", whole)] },
        }, [time, ...series.map((one) => one[1])], box));
      });
    });
  }

  const chosen = new Set(data.joints.filter((j) => j.shown).map((j) => j.name));
  const chips = document.getElementById("joints");
  for (const joint of data.joints) {
    const chip = Object.assign(document.createElement("button"), { type: "button", textContent: joint.name });
    chip.setAttribute("aria-pressed", chosen.has(joint.name));
    chip.onclick = () => {
      if (!chosen.delete(joint.name)) chosen.add(joint.name);
      chip.setAttribute("aria-pressed", chosen.has(joint.name));
      draw();
    };
    chips.append(chip);
  }
  const legend = document.getElementById("modes");
  for (const mode of new Set(data.modes.map((span) => span[2]))) {
    const item = document.createElement("span"), patch = document.createElement("i");
    patch.style.background = (MODES[mode] || GREY) + "38";
    item.append(patch, mode);
    legend.append(item);
  }
  const events = document.getElementById("events");
  for (const event of data.events) {
    const row = document.createElement("li"), jump = document.createElement("button");
    jump.type = "button";
    jump.className = event.kind;
    jump.append(Object.assign(document.createElement("b"), { textContent: event.time_s.toFixed(2) + " s" }), event.text);
    jump.onclick = () => zoom(Math.max(event.time_s - 1.5, data.from_s), Math.min(event.time_s + 1.5, data.until_s));
    row.append(jump);
    events.append(row);
  }
  if (!data.events.length) events.append(Object.assign(document.createElement("li"), { textContent: "none" }));
  document.getElementById("decimated").textContent = data.ticks_per_bucket === 1 ? "" :
    `Each point is the least or the largest of ${data.ticks_per_bucket} ticks: \`contactd plot --around\` shows every tick.`;
  let waiting = 0;
  addEventListener("resize", () => { cancelAnimationFrame(waiting); waiting = requestAnimationFrame(() =>
    plots.forEach((u, k) => u.setSize({ width: width(), height: height(k % PANELS.length) }))); });
  draw();
})();
