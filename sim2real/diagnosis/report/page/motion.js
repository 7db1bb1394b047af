// The robot in motion, measured and simulated, at the moment of the cursor.
const BOUND_ROWS = 40, GHOST = 0.85, EDGE_PX = 1.6; // rows that set the scale; opacity; px
const motion = { azimuth: 20, elevation: 12, grow: 1, playing: null, held: null, cloud: [] };

const turned = ([w, x, y, z], [a, b, c]) => { // a vector by a quaternion
  const [t, u, v] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t + y * v - z * u, b + w * u + z * t - x * v, c + w * v + x * u - y * t];
};
const times = ([w, x, y, z], [e, a, b, c]) => [
  w * e - x * a - y * b - z * c, w * a + x * e + y * c - z * b, w * b - x * c + y * e + z * a, w * c + x * b - y * a + z * e];
const plus = (p, q, factor = 1) => p.map((value, i) => value + factor * q[i]);

// Each body's position and quaternion, for values of joints by name; a joint without one is at home.
const placed = (values) => {
  const found = [];
  for (const body of data.skeleton.bodies) {
    const parent = body.parent < 0 ? { position: [0, 0, 0], turn: [1, 0, 0, 0] } : found[body.parent];
    let position = plus(parent.position, turned(parent.turn, body.position)), turn = times(parent.turn, body.turn);
    for (const joint of body.joints) {
      const moved = (values[joint.name] ?? joint.home) - joint.zero;
      if (joint.kind === "slide") position = plus(position, turned(turn, joint.axis), moved);
      else {
        const anchor = plus(position, turned(turn, joint.anchor)), half = moved / 2;
        turn = times(turn, [Math.cos(half), ...joint.axis.map((value) => value * Math.sin(half))]);
        position = plus(anchor, turned(turn, joint.anchor), -1);
      }
    }
    found.push({ position, turn });
  }
  return found;
};
const shapesAt = (values) => {
  const bodies = placed(values);
  return data.skeleton.shapes.map((shape) => {
    const { position, turn } = shape.body < 0 ? { position: [0, 0, 0], turn: [1, 0, 0, 0] } : bodies[shape.body];
    return { radius: shape.radius, points: shape.points.map((point) => plus(position, turned(turn, point))) };
  });
};

const rowAt = (time) => { // the last row not after it
  const { time: clock } = view.recording.joints[0];
  let low = 0, high = clock.length - 1;
  while (low < high) { const middle = (low + high + 1) >> 1; if (clock[middle] <= time + 1e-9) low = middle; else high = middle - 1; }
  return low;
};
const posture = (row, line) => { // null where a joint is not compared then
  const values = {};
  for (const joint of view.recording.joints) {
    const measured = joint.measured[row], angle = line ? line(joint)?.[row] : measured;
    if (angle === null || angle === undefined) return null;
    values[joint.name] = line ? measured + motion.grow * (angle - measured) : measured;
  }
  return values;
};

const hull = (points) => { // of points in the picture
  const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]), half = (order) => {
    const found = [];
    for (const p of order) {
      while (found.length > 1) {
        const [a, b] = found.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        found.pop();
      }
      found.push(p);
    }
    return found.slice(0, -1);
  };
  return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.reverse())];
};

const fitView = () => { // where the measured robot goes
  const rows = view.recording.joints[0].time.length;
  motion.cloud = Array.from({ length: BOUND_ROWS }, (_, k) => shapesAt(posture(Math.floor((k * rows) / BOUND_ROWS)))).flat();
};

const projected = (width, height) => {
  const [a, e] = [motion.azimuth, motion.elevation].map((degrees) => (degrees * Math.PI) / 180);
  const right = [Math.cos(a), Math.sin(a), 0], ahead = [-Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), -Math.sin(e)];
  const up = [right[1] * ahead[2] - right[2] * ahead[1], right[2] * ahead[0] - right[0] * ahead[2], right[0] * ahead[1] - right[1] * ahead[0]];
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const ends = [right, up].map((axis) => {
    let low = Infinity, high = -Infinity;
    for (const { points, radius } of motion.cloud) {
      for (const point of points) { const at = dot(point, axis); low = Math.min(low, at - radius); high = Math.max(high, at + radius); }
    }
    return { middle: (low + high) / 2, size: Math.max(1e-6, high - low) };
  });
  const scale = 0.94 * Math.min(width / ends[0].size, height / ends[1].size);
  const flat = (point) => [width / 2 + scale * (dot(point, right) - ends[0].middle), height / 2 - scale * (dot(point, up) - ends[1].middle)];
  return { scale, flat, deep: (point) => dot(point, ahead) };
};

const trace = (pen, { points, radius }, { flat, scale }, grow) => { // a shape's path; its width
  const seen = radius ? points.map(flat) : hull(points.map(flat));
  pen.beginPath();
  seen.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  if (radius) pen.lineTo(seen[0][0] + 0.01, seen[0][1]); else pen.closePath();
  pen.lineWidth = radius ? Math.max(1.5, 2 * radius * scale) + grow : Math.max(1, grow);
};
const drawSolid = (pen, shapes, camera) => {
  const middle = ({ points }) => points.reduce((sum, point) => sum + camera.deep(point), 0) / points.length;
  for (const shape of [...shapes].sort((p, q) => middle(q) - middle(p))) {
    for (const [name, grow] of [["edge", 2 * EDGE_PX], ["part", 0]]) {
      trace(pen, shape, camera, grow);
      pen.strokeStyle = pen.fillStyle = colour(name);
      if (shape.radius) pen.stroke(); else if (name === "edge") pen.stroke(); else pen.fill();
    }
  }
};
const drawGhost = (pen, shapes, camera, kind) => { // thin: round shapes by their middles
  pen.strokeStyle = colour(kind);
  pen.globalAlpha = GHOST;
  pen.setLineDash(kind === "nominal" ? [7, 4] : []);
  for (const shape of shapes) { trace(pen, shape, camera, 0); pen.lineWidth = 2.5; pen.stroke(); }
  pen.setLineDash([]);
  pen.globalAlpha = 1;
};

const drawRobot = () => {
  const canvas = document.getElementById("robot"), ratio = devicePixelRatio, { clientWidth: width, clientHeight: height } = canvas;
  if (!data.skeleton || !width) return;
  motion.held = view.moment ?? motion.held; // the pointer may leave the plots
  const time = Math.min(Math.max(motion.held ?? view.from, view.from), view.to), row = rowAt(time), pen = canvas.getContext("2d"), camera = projected(width, height);
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  pen.scale(ratio, ratio);
  pen.lineCap = pen.lineJoin = "round";
  drawSolid(pen, shapesAt(posture(row)), camera);
  const ghosts = [["nominal", (joint) => joint.lines[""]], ["corrected", view.causes.size ? lineOf : null]];
  const shown = ghosts.filter(([, line]) => line).map(([kind, line]) => [kind, posture(row, line)]).filter(([, values]) => values);
  for (const [kind, values] of shown) drawGhost(pen, shapesAt(values), camera, kind);
  canvas.dataset.shown = shown.map(([kind]) => kind).join(" ");
  document.getElementById("clock").textContent = `${time.toFixed(2)} s`;
};

const stop = () => { cancelAnimationFrame(motion.playing); motion.playing = null; document.getElementById("play").textContent = "Play"; };
const play = () => {
  if (motion.playing !== null) { stop(); return; }
  const start = view.moment !== null && view.moment < view.to - 0.05 ? Math.max(view.moment, view.from) : view.from;
  let begun = null; // the first picture's own time
  const step = (now) => {
    begun ??= now;
    const time = start + (now - begun) / 1000;
    if (time >= view.to) { point(view.to); stop(); return; }
    point(time);
    motion.playing = requestAnimationFrame(step);
  };
  document.getElementById("play").textContent = "Pause";
  motion.playing = requestAnimationFrame(step);
};
const moving = () => {
  if (!data.skeleton) return;
  const canvas = document.getElementById("robot");
  document.getElementById("motion").hidden = false;
  document.getElementById("play").addEventListener("click", play);
  document.getElementById("grow").addEventListener("change", ({ target }) => { motion.grow = Number(target.value); drawRobot(); });
  canvas.addEventListener("pointermove", (event) => { // turned by dragging
    if (!event.buttons) return;
    motion.azimuth -= event.movementX / 2;
    motion.elevation = Math.min(89, Math.max(-89, motion.elevation + event.movementY / 2));
    drawRobot();
  });
  new ResizeObserver(drawRobot).observe(canvas);
};
