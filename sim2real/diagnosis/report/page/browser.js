// All joints of a recording, one below the other, with one time axis and one cursor.
const SHOWN_FIRST = 3; // joints
const HEIGHTS = { position: 180, error: 120, signal: 100 };
const view = { recording: null, joints: new Set(), kinds: new Set(["error", "command"]), causes: new Set(), from: 0, to: 1, moment: null };
let panels = [], busy = false;

const all = (causes) => causes.size === data.causes.length;
const lineOf = (joint) => {
  if (!data.causes.length) return null;
  const key = all(view.causes) ? "all" : [...view.causes].sort((a, b) => a - b).join(",");
  return joint.lines[key] ?? null;
};
const causesName = () => (all(view.causes) ? "with the causes" : `with ${view.causes.size} of ${data.causes.length} causes`);
const milli = (unit) => (unit === "rad" || unit === "m" ? [1000, `m${unit}`] : [1, unit]);
const minus = (line, joint, factor) => line.map((v, i) => (v === null ? null : factor * (v - joint.measured[i])));
const at = (signal, time) => { // the command in force
  let row = -1;
  return time.map((t) => { while (row + 1 < signal.time.length && signal.time[row + 1] <= t + 1e-6) row++; return row < 0 ? null : signal.values[row]; });
};

const jointPanels = (joint, recording) => {
  const chosen = lineOf(joint), about = { time: joint.time, starts: recording.starts };
  const drawn = (pick) => [
    { label: "model as given", kind: "nominal", values: pick(joint.lines[""]) },
    ...(chosen && view.causes.size ? [{ label: causesName(), kind: "corrected", values: pick(chosen) }] : []),
  ];
  const command = view.kinds.has("command") ? recording.signals.find((s) => s.kind === "command" && s.joint === joint.name) : undefined;
  const position = {
    ...about, title: `${joint.name}, ${joint.unit}`, height: HEIGHTS.position, floor: 0, digits: 4,
    series: [
      { label: "measured", kind: "measured", values: joint.measured }, ...drawn((line) => line),
      ...(command ? [{ label: "command", kind: "command", values: at(command, joint.time), stepped: true }] : []),
    ],
  };
  if (!view.kinds.has("error")) return [position];
  const [factor, unit] = milli(joint.unit);
  return [position, {
    ...about, title: `${joint.name}, error, ${unit}`, height: HEIGHTS.error, floor: 2 * factor * joint.floor, digits: 2,
    isError: true, series: drawn((line) => minus(line, joint, factor)),
  }];
};
const signalPanels = (recording) => recording.signals
  .filter((s) => view.kinds.has(s.kind) && !(s.kind === "command" && s.joint))
  .map((s) => ({
    title: `${s.actuator}, ${s.kind}${s.unit ? `, ${s.unit}` : ""}`, time: s.time, starts: [], floor: 0, digits: 3,
    height: HEIGHTS.signal, series: [{ label: s.kind, kind: "signal", values: s.values, stepped: s.kind === "command" }],
  }));

const span = () => { const time = view.recording.joints[0].time; return [time[0], time[time.length - 1]]; };
const show = (from, to) => { // seconds; kept within the recording
  const [start, end] = span(), width = Math.min(end - start, Math.max(0.05, to - from));
  view.from = Math.min(Math.max(from, start), end - width);
  view.to = view.from + width;
  busy = true;
  for (const { plot } of panels) plot.setScale("x", { min: view.from, max: view.to });
  busy = false;
};
const showAll = () => { rebuild(); show(...span()); };

const zoomed = (plot) => {
  const { min, max } = plot.scales.x;
  if (busy || min === undefined || min === null) return;
  if (Math.abs(min - view.from) > 1e-9 || Math.abs(max - view.to) > 1e-9) queueMicrotask(() => show(min, max));
};
const pointed = (source) => {
  if (busy) return;
  busy = true;
  const { left } = source.cursor, time = left < 0 ? null : source.posToVal(left, "x");
  for (const { plot } of panels) if (plot !== source) plot.setCursor({ left: time === null ? -10 : plot.valToPos(time, "x"), top: time === null ? -10 : 1 });
  document.getElementById("moment").textContent = time === null ? "" : `${time.toFixed(3)} s`;
  view.moment = time;
  busy = false;
  drawRobot();
};
const point = (time) => { const [first] = panels; first.plot.setCursor({ left: first.plot.valToPos(time, "x"), top: 1 }); };

const rebuild = () => {
  const host = document.getElementById("panels"), focus = panels.findIndex(({ box }) => box === document.activeElement);
  for (const { plot } of panels) plot.destroy();
  host.replaceChildren();
  const joints = view.recording.joints.filter((joint) => view.joints.has(joint.name));
  const wanted = [...joints.flatMap((joint) => jointPanels(joint, view.recording)), ...signalPanels(view.recording)];
  busy = true;
  panels = wanted.map((about, index) => makePanel(host, { ...about, last: index === wanted.length - 1 }, { zoomed, pointed }));
  busy = false;
  panels.forEach(gestures);
  show(view.from, view.to);
  drawRobot();
  if (focus >= 0) panels[Math.min(focus, panels.length - 1)].box.focus({ preventScroll: true });
};
const open = (index) => {
  view.recording = decoded(data.recordings[index]);
  const names = view.recording.joints.map((joint) => joint.name);
  const kept = names.filter((name) => view.joints.has(name));
  view.joints = new Set(kept.length ? kept : names.slice(0, SHOWN_FIRST));
  [view.from, view.to] = span();
  view.moment = motion.held = null;
  if (data.skeleton) fitView();
  switches();
  rebuild();
};
