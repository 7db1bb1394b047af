// Recordings as they are packed into the page, back into arrays of numbers; null where nothing is.
const NOTHING = 65535;
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const floats = (text) => Array.from(new Float32Array(bytes(text)));
const unpack = ({ low, step, counts }) =>
  Array.from(new Uint16Array(bytes(counts)), (n) => (n === NOTHING ? null : low + step * n));

const opened = new Map(); // recordings are unpacked when they are first looked at
const decoded = (recording) => {
  if (opened.has(recording)) return opened.get(recording);
  const joints = recording.joints.map((joint) => ({
    ...joint,
    time: floats(joint.time),
    measured: unpack(joint.measured),
    lines: Object.fromEntries(Object.entries(joint.lines).map(([key, line]) => [key, unpack(line)])),
  }));
  const signals = recording.signals.map((s) => ({ ...s, time: floats(s.time), values: unpack(s.values) }));
  const whole = { ...recording, joints, signals };
  opened.set(recording, whole);
  return whole;
};
