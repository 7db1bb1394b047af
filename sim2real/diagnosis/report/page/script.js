// Lets a reader browse whole recordings; the page is complete without it.
(() => {
  "use strict";
  const recordings = JSON.parse(document.getElementById("recordings").textContent);
  const canvas = document.getElementById("canvas"), pick = document.getElementById("pick");
  const readout = document.getElementById("readout");
  const LEFT = 54, TOP = 8, MID = 208, LOW = 230, END = 304;
  let W = 900, RIGHT = W - 8, chosen = recordings[0], from = 0, to = 1, down = null;

  const make = (name, attributes, text) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    if (text !== undefined) element.textContent = text;
    canvas.appendChild(element);
    return element;
  };
  const step = (rough) => {
    const power = 10 ** Math.floor(Math.log10(rough));
    return power * [1, 2, 5, 10].find((m) => m * power >= rough * (1 - 1e-9));
  };
  const axis = (low, high, start, end) => {
    const map = (v) => start + ((v - low) / (high - low)) * (end - start);
    map.ticks = (count) => {
      const by = step(low === -high ? 0.401 * high : (high - low) / count), digits = Math.max(0, -Math.floor(Math.log10(by) + 1e-9));
      const out = [];
      for (let k = Math.ceil(low / by - 1e-9); k * by <= high + by * 1e-9; k++)
        out.push([map(k * by), (k * by).toFixed(digits).replace("-", "−")]);
      return out;
    };
    return map;
  };
  const path = (x, y, first, last) => {
    const stride = Math.max(1, Math.ceil((last - first) / 3000));
    let d = "";
    for (let i = first; i <= last; i += stride) d += (d ? "L" : "M") + x(i).toFixed(1) + " " + y(i).toFixed(1);
    return d;
  };
  const range = (values) => values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  const nearest = (t) => {
    let low = 0, high = chosen.time.length - 1;
    while (low < high) { const mid = (low + high) >> 1; if (chosen.time[mid] < t) low = mid + 1; else high = mid; }
    return low;
  };

  const draw = () => {
    canvas.replaceChildren();
    W = Math.max(320, Math.round(canvas.clientWidth)); RIGHT = W - 8;
    canvas.setAttribute("viewBox", `0 0 ${W} ${END + 22}`);
    const t = chosen.time, scale = chosen.unit === "rad" || chosen.unit === "m" ? 1000 : 1;
    const first = Math.max(0, nearest(from) - 1), last = Math.min(t.length - 1, nearest(to));
    const lines = ["measured", "nominal", "corrected"].filter((line) => chosen[line]);
    const piece = lines.map((line) => chosen[line].slice(first, last + 1));
    let [low, high] = range(piece.flat());
    const room = Math.max(0.05 * (high - low), 1e-4);
    const miss = piece.slice(1).map((line) => line.map((v, i) => scale * (v - piece[0][i])));
    const most = 1.08 * Math.max(range(miss.flat().map(Math.abs))[1], 2.5 * scale * chosen.floor);
    const x = axis(from, to, LEFT, RIGHT), upper = axis(low - room, high + room, MID, TOP), lower = axis(-most, most, END, LOW);
    for (let i = first; i <= last; i++) {
      if (chosen.held[i] || i === last) continue;
      let j = i; while (j < last && !chosen.held[j]) j++;
      const a = Math.max(LEFT, x(t[i])), b = Math.min(RIGHT, x(t[j]));
      make("rect", { class: "fitted", x: a, y: TOP, width: Math.max(0, b - a), height: END - TOP });
      i = j;
    }
    for (const [y, text] of upper.ticks(4)) { make("path", { class: "grid", d: `M${LEFT} ${y}H${RIGHT}` }); make("text", { class: "n", x: LEFT - 5, y }, text); }
    for (const [y, text] of lower.ticks(3)) { make("path", { class: "grid", d: `M${LEFT} ${y}H${RIGHT}` }); make("text", { class: "n", x: LEFT - 5, y }, text); }
    for (const [at, text] of x.ticks(W / 90)) { make("path", { class: "grid", d: `M${at} ${TOP}V${MID}M${at} ${LOW}V${END}` }); make("text", { class: "t", x: at, y: END + 15 }, text); }
    make("text", { class: "t", x: RIGHT - 4, y: END + 15 }, "s");
    make("text", { class: "u", transform: `translate(11 ${(TOP + MID) / 2}) rotate(-90)` }, chosen.unit);
    make("text", { class: "u", transform: `translate(11 ${(LOW + END) / 2}) rotate(-90)` }, `error, ${scale === 1000 ? "m" : ""}${chosen.unit}`);
    const zone = 2 * scale * chosen.floor;
    make("rect", { class: "band", x: LEFT, width: RIGHT - LEFT, y: lower(zone), height: lower(-zone) - lower(zone) });
    const inside = (i) => Math.min(RIGHT, Math.max(LEFT, x(t[i])));
    for (const line of lines) make("path", { class: line, d: path(inside, (i) => upper(chosen[line][i]), first, last) });
    for (const line of lines.slice(1)) make("path", { class: line, d: path(inside, (i) => lower(scale * (chosen[line][i] - chosen.measured[i])), first, last) });
  };

  const time = (event) => {
    const box = canvas.getBoundingClientRect(), at = ((event.clientX - box.left) / box.width) * W;
    return from + ((Math.min(RIGHT, Math.max(LEFT, at)) - LEFT) / (RIGHT - LEFT)) * (to - from);
  };
  const place = (t) => LEFT + ((t - from) / (to - from)) * (RIGHT - LEFT);
  const show = (a, b) => {
    const start = chosen.time[0], end = chosen.time.at(-1), width = Math.min(end - start, Math.max(0.2, b - a));
    from = Math.min(Math.max(a, start), end - width); to = from + width; draw();
  };
  const all = () => show(chosen.time[0], chosen.time.at(-1));
  const open = (index) => { chosen = recordings[index]; readout.textContent = ""; all(); };

  canvas.addEventListener("pointerdown", (event) => { down = time(event); canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    canvas.querySelectorAll(".cursor, .brush").forEach((e) => e.remove());
    const now = time(event), i = nearest(now), m = chosen.measured[i];
    if (down !== null) make("rect", { class: "brush", x: place(Math.min(down, now)), width: Math.abs(place(now) - place(down)), y: TOP, height: END - TOP });
    make("line", { class: "cursor", x1: place(now), x2: place(now), y1: TOP, y2: END });
    readout.textContent = `${chosen.time[i].toFixed(2)} s: measured ${m.toFixed(4)}, model as given ${chosen.nominal[i].toFixed(4)}${chosen.corrected ? `, with the causes ${chosen.corrected[i].toFixed(4)}` : ""} ${chosen.unit}`;
  });
  canvas.addEventListener("pointerup", (event) => {
    const now = time(event), before = down; down = null;
    if (before !== null && Math.abs(place(now) - place(before)) > 8) show(Math.min(before, now), Math.max(before, now)); else draw();
  });
  canvas.addEventListener("dblclick", all);
  canvas.addEventListener("keydown", (event) => {
    const width = to - from, by = 0.2 * width, keys = { ArrowLeft: [-by, -by], ArrowRight: [by, by], "+": [by, -by], "-": [-by, by] };
    if (keys[event.key]) { show(from + keys[event.key][0], to + keys[event.key][1]); event.preventDefault(); }
  });
  canvas.setAttribute("tabindex", "0");
  document.getElementById("reset").addEventListener("click", all);
  recordings.forEach((recording, index) => pick.add(new Option(recording.label, index)));
  pick.addEventListener("change", () => open(Number(pick.value)));
  document.getElementById("browser").hidden = false;
  open(0);
  addEventListener("resize", draw);
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
})();
