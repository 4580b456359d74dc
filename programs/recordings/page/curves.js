"use strict";
// Draws the detection curves in the JSON of this page with uPlot: false contacts and detected touches by level.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--ink").trim(), line = style.getPropertyValue("--line").trim();
  const BLUE = "#0072b2", ORANGE = "#d55e00", GREEN = "#009e73";
  const shown = (digits, unit) => (u, v) => (v == null ? "-" : v.toFixed(digits) + unit);
  const place = document.getElementById("panels");

  function chosenLine(level) {
    return (u) => {
      if (level === null) return;
      const { ctx, bbox } = u, x = u.valToPos(level, "x", true), px = devicePixelRatio;
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.save();
      ctx.strokeStyle = ctx.fillStyle = ink;
      ctx.setLineDash([6 * px, 4 * px]);
      ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
      ctx.font = `${11 * px}px system-ui`;
      ctx.textAlign = "left";
      ctx.fillText("chosen", x + 3 * px, bbox.top + 11 * px);
      ctx.restore();
    };
  }

  for (const curve of data.curves) {
    const column = (name, scale) => curve.points.map((p) => (p[name] === null ? null : scale * p[name]));
    const levels = column("level", 1), labelled = curve.labels > 0;
    const title = Object.assign(document.createElement("h3"), { textContent: curve.name +
      (labelled ? `: ${curve.labels} labelled ${curve.labels === 1 ? "touch" : "touches"}` : "") });
    const box = document.createElement("div");
    place.append(title, box);
    const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line } };
    const series = [{ label: data.arm === curve.name ? "step" : "level [Nm]", value: shown(3, "") },
      { label: labelled ? "false contacts an hour" : "contacts an hour", stroke: ORANGE, width: 1.6,
        scale: "rate", value: shown(1, "") }];
    const rows = [levels, column("alarms_per_hour", 1)];
    if (labelled) {
      series.push({ label: "found", stroke: BLUE, width: 1.6, scale: "%", value: shown(0, " %") },
        { label: "delay, median", stroke: GREEN, width: 1, dash: [4, 3], scale: "ms", value: shown(0, " ms") });
      rows.push(column("found", 100 / curve.labels), column("delay_p50_s", 1000));
    }
    const chosen = curve.chosen === null ? null : curve.points[curve.chosen].level;
    const axes = [{ ...axis, label: series[0].label, labelSize: 18 },
      { ...axis, stroke: ORANGE, scale: "rate", size: 60, label: series[1].label, labelSize: 18 }];
    const right = (scale, stroke, label) => ({ ...axis, scale, stroke, side: 1, size: 60, grid: { show: false },
      label, labelSize: 18, values: (u, v) => v.map((x) => `${x} ${scale}`) });
    if (labelled) axes.push(right("%", BLUE, "found"), { ...right("ms", GREEN, "delay"), size: 74 });
    const width = () => Math.max(place.clientWidth, 280);
    const plot = new uPlot({ width: width(), height: 260, series, axes,
      scales: { x: { time: false }, rate: { range: (u, low, high) => [0, Math.max(high, 1) * 1.05] },
        "%": { range: [0, 105] }, ms: { range: (u, low, high) => [0, Math.max(high, 1) * 1.3] } },
      hooks: { draw: [chosenLine(chosen)] } }, rows, box);
    addEventListener("resize", () => plot.setSize({ width: width(), height: 260 }));
  }
})();
