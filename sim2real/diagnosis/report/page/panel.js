// One plot: a heading that is legend and readout, and uPlot below it.
const MINUS = "\u2212";
const spelled = (value, digits) => value.toFixed(digits).replace("-", MINUS);

const element = (name, attributes = {}, text = "") => {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
};

// Zero and powers of ten on either side, for errors that span several of them.
const decades = (least, most) => {
  const high = Math.floor(Math.log10(most)), found = [0];
  const every = Math.max(1, Math.ceil((high - Math.log10(least)) / 2));
  for (let power = high; power > Math.log10(least); power -= every) found.push(10 ** power, -(10 ** power));
  return found.sort((a, b) => a - b);
};

const heading = (title, series, toggle) => {
  const head = element("div", { class: "panel-head" });
  head.append(element("b", {}, title));
  const outputs = series.map((line, index) => {
    const key = element("button", { type: "button", class: `key ${line.kind}`, "aria-pressed": "true" }, line.label);
    const value = element("output");
    key.append(value);
    key.addEventListener("click", () => {
      const shown = key.getAttribute("aria-pressed") !== "true";
      key.setAttribute("aria-pressed", shown);
      toggle(index + 1, shown);
    });
    head.append(key);
    return value;
  });
  return [head, outputs];
};

const marks = (plot, { starts, floor, time }) => {
  const { ctx, bbox } = plot, right = bbox.left + bbox.width;
  ctx.save();
  if (floor) {
    const top = plot.valToPos(floor, "y", true), low = plot.valToPos(-floor, "y", true);
    ctx.fillStyle = colour("band");
    const from = Math.max(top, bbox.top), to = Math.min(low, bbox.top + bbox.height);
    if (to > from) ctx.fillRect(bbox.left, from, bbox.width, to - from);
  }
  ctx.strokeStyle = colour("restart");
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
  ctx.beginPath();
  for (const row of starts) {
    const x = Math.round(plot.valToPos(time[row], "x", true));
    if (x > bbox.left && x < right) { ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); }
  }
  ctx.stroke();
  ctx.restore();
};

const STROKES = {
  measured: { width: 5 }, nominal: { width: 1.7, dash: [6, 4] }, corrected: { width: 1.7 },
  command: { width: 1.2, dash: [2, 3] }, signal: { width: 1.3 },
};
const FAR = 12, SPREAD = 1e4; // errors of so many floors are on a logarithmic scale of so many steps

const errorScale = (most, floor) => {
  const range = (u, low, high) => {
    const end = 1.1 * Math.max(Math.abs(low || 0), Math.abs(high || 0), 2.5 * floor, 1e-9);
    return [-end, end];
  };
  if (!floor || most <= FAR * floor) return { scale: { range } };
  const linear = Math.max(floor, most / SPREAD);
  const splits = (u, index, low, high) => decades(linear, Math.max(high, -low));
  return { scale: { distr: 4, asinh: linear, range }, splits };
};

// about: {title, series: [{label, kind, values, stepped}], time, starts, floor, isError, height, last, digits}
const makePanel = (host, about, events) => {
  let plot = null;
  const [head, outputs] = heading(about.title, about.series, (index, show) => plot.setSeries(index, { show }));
  const box = element("div", { class: "panel", tabindex: "0", role: "img", "aria-label": about.title });
  host.append(head, box);
  const faint = () => colour("grid"), ink = () => colour("soft"), font = "11px system-ui, sans-serif";
  const line = { stroke: faint, width: 1 }, common = { stroke: ink, font, grid: line, ticks: { show: false } };
  let most = 0;
  if (about.isError) for (const s of about.series) for (const v of s.values) if (v !== null) most = Math.max(most, Math.abs(v));
  const { scale, splits } = about.isError ? errorScale(most, about.floor) : { scale: {} };
  const y = { ...common, size: 54, ...(splits && { splits, filter: (u, found) => found }), values: (u, found) => found.map((v) => (v === null ? "" : String(+v.toPrecision(6)).replace("-", MINUS))) };
  const x = { ...common, size: about.last ? 26 : 8, values: (u, found) => found.map((v) => (about.last ? `${+v.toFixed(3)} s` : "")) };
  const style = (s) => ({
    label: s.label, ...STROKES[s.kind], stroke: () => colour(s.kind), points: { show: false }, spanGaps: false,
    ...(s.stepped && { paths: uPlot.paths.stepped({ align: 1 }) }),
  });
  plot = new uPlot({
    width: Math.max(200, host.clientWidth), height: about.height, legend: { show: false }, padding: [8, 10, 0, 0],
    scales: { x: { time: false }, y: scale }, axes: [x, y], series: [{}, ...about.series.map(style)],
    cursor: { drag: { x: true, y: true, uni: 24 }, y: false, points: { size: 6 }, focus: { prox: -1 } },
    hooks: {
      drawAxes: [(u) => marks(u, about)],
      setScale: [(u, key) => { if (key === "x") events.zoomed(u); }],
      setCursor: [(u) => {
        const row = u.cursor.idx;
        outputs.forEach((out, i) => {
          const value = row === null || row === undefined ? null : u.data[i + 1][row];
          out.textContent = value === null || value === undefined ? "" : spelled(value, about.digits);
        });
        events.pointed(u);
      }],
    },
  }, [about.time, ...about.series.map((s) => s.values)], box);
  return { plot, box, head, about };
};
