// Wheel, pinch, drag by touch and keys, on every panel alike.
const zoomAbout = (time, factor) => show(time - (time - view.from) * factor, time + (view.to - time) * factor);
const stretch = (plot, factor) => { // the values' axis
  const { min, max } = plot.scales.y, middle = (min + max) / 2, half = ((max - min) / 2) * factor;
  plot.setScale("y", { min: middle - half, max: middle + half });
};

const wheel = ({ plot, box }) => (event) => {
  const sideways = Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey;
  const wanted = event.ctrlKey || event.metaKey || event.altKey || document.activeElement === box;
  if (!wanted && !sideways) return; // the page scrolls
  event.preventDefault();
  const { left, width } = plot.over.getBoundingClientRect(), amount = event.deltaY || event.deltaX;
  if (event.altKey) stretch(plot, Math.exp(0.002 * amount));
  else if (sideways) { const by = ((event.deltaX || event.deltaY) / width) * (view.to - view.from); show(view.from + by, view.to + by); }
  else zoomAbout(plot.posToVal(event.clientX - left, "x"), Math.exp(0.002 * amount));
};

const keys = ({ plot }) => (event) => {
  const width = view.to - view.from, middle = view.moment ?? (view.from + view.to) / 2, by = 0.2 * width;
  const actions = {
    ArrowLeft: () => (event.shiftKey ? point(middle - width / 100) : show(view.from - by, view.to - by)),
    ArrowRight: () => (event.shiftKey ? point(middle + width / 100) : show(view.from + by, view.to + by)),
    "+": () => zoomAbout(middle, 0.6), "=": () => zoomAbout(middle, 0.6), "-": () => zoomAbout(middle, 1 / 0.6),
    ArrowUp: () => stretch(plot, 0.7), ArrowDown: () => stretch(plot, 1 / 0.7), 0: showAll, Home: showAll,
  };
  if (event.ctrlKey || event.metaKey || !actions[event.key]) return;
  event.preventDefault();
  actions[event.key]();
};

// One finger pans and a tap shows values; two fingers zoom. A mouse draws its rectangle by uPlot.
const touch = ({ plot }) => {
  const fingers = new Map();
  const time = (x) => plot.posToVal(x - plot.over.getBoundingClientRect().left, "x");
  let grip = null, begun = null;
  const hold = () => { grip = [...fingers.values()].map((x) => time(x)); };
  const end = (event) => {
    if (!fingers.delete(event.pointerId)) return;
    hold();
    if (event.type === "pointerup" && begun !== null && Math.abs(event.clientX - begun) < 8 && !fingers.size) point(time(event.clientX));
  };
  plot.over.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse") return;
    fingers.set(event.pointerId, event.clientX);
    begun = fingers.size === 1 ? event.clientX : null;
    hold();
  });
  plot.over.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, event.clientX);
    const now = [...fingers.values()].map((x) => time(x));
    if (now.length === 1) { const by = grip[0] - now[0]; show(view.from + by, view.to + by); }
    else {
      const factor = Math.abs(grip[1] - grip[0]) / Math.max(1e-9, Math.abs(now[1] - now[0]));
      const held = (grip[0] + grip[1]) / 2, here = (now[0] + now[1]) / 2;
      show(held - (here - view.from) * factor, held + (view.to - here) * factor);
    }
    hold();
  });
  for (const name of ["pointerup", "pointercancel", "pointerleave"]) plot.over.addEventListener(name, end);
};

const gestures = (panel) => {
  panel.box.addEventListener("wheel", wheel(panel), { passive: false });
  panel.box.addEventListener("keydown", keys(panel));
  panel.plot.over.addEventListener("pointerdown", () => panel.box.focus({ preventScroll: true }));
  panel.plot.over.addEventListener("dblclick", showAll);
  touch(panel);
};
