// What is shown: joints, kinds of signals, and the causes that are in the model.
const KINDS = { error: "errors", command: "commands", current: "currents", voltage: "voltages" };

const chips = (id, names, isOn, toggle) => {
  const host = document.getElementById(id);
  host.closest("fieldset").hidden = !names.length;
  host.replaceChildren(...names.map(([value, label]) => {
    const chip = element("label", { class: "chip" }), box = element("input", { type: "checkbox", value });
    box.checked = isOn(value);
    box.addEventListener("change", () => { toggle(value, box.checked); rebuild(); });
    chip.append(box, element("span", {}, label));
    return chip;
  }));
};
const put = (set) => (value, on) => { if (on) set.add(value); else set.delete(value); };

const switches = () => {
  const { joints, signals } = view.recording, known = new Set(["error", ...signals.map((s) => s.kind)]);
  const names = joints.map((joint) => [joint.name, joint.name]);
  chips("joints", names.length > 1 ? names : [], (name) => view.joints.has(name), put(view.joints));
  chips("kinds", Object.entries(KINDS).filter(([kind]) => known.has(kind)), (kind) => view.kinds.has(kind), put(view.kinds));
  const switchable = data.causes.length && Object.keys(joints[0].lines).length === 2 ** data.causes.length;
  const causes = switchable ? data.causes.map((title, number) => [number, title]) : [];
  chips("switched", causes, (number) => view.causes.has(number), put(view.causes));
};
