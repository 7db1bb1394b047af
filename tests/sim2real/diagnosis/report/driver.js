// What a reader does with the page, as functions for the tests.
const $ = (id) => document.getElementById(id);
const all = (selector) => [...document.querySelectorAll(selector)];
const over = (n) => all(".u-over")[n];
const mouse = (type, target, x, y) => {
  const box = target.getBoundingClientRect();
  const at = { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
  const how = { bubbles: true, cancelable: true, view: window, movementX: 1, movementY: 1 };
  target.dispatchEvent(new MouseEvent(type, { ...how, ...at }));
};
const drag = (target, from, to) => {
  mouse("mousedown", target, ...from); mouse("mousemove", target, ...to); mouse("mouseup", target, ...to);
};
const touch = (type, target, id, x) => {
  const box = target.getBoundingClientRect();
  const at = { clientX: box.left + x * box.width, clientY: box.top + 20, pointerId: id };
  target.dispatchEvent(new PointerEvent(type, { bubbles: true, pointerType: "touch", ...at }));
};
const key = (name, more) => all(".panel")[0].dispatchEvent(
  new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true, ...more }));
const later = (ms = 60) => new Promise((done) => setTimeout(done, ms));
const seen = () => all(".panel-head output").map((one) => one.textContent);
const moment = () => parseFloat($("moment").textContent);
// Under virtual time a headless browser paints nothing, and would never call for a picture.
window.requestAnimationFrame = (step) => setTimeout(() => step(performance.now()), 16);
window.cancelAnimationFrame = clearTimeout;
const span = async (n = 0) => { // the time at both ends of a plot, by pointing there
  mouse("mouseenter", over(n), 0.001, 0.5); mouse("mousemove", over(n), 0.001, 0.5);
  await later(); const from = moment();
  mouse("mousemove", over(n), 0.999, 0.5);
  await later(); return [from, moment()];
};
const titles = () => all(".panel-head b").map((one) => one.textContent);
