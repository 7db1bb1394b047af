// Puts the parts together; the page is complete without it.
const store = document.getElementById("recordings");
const data = store ? JSON.parse(store.textContent) : { recordings: [], causes: [] };

downloads();
if (data.recordings.length) {
  data.causes.forEach((_, number) => view.causes.add(number));
  const pick = document.getElementById("pick");
  data.recordings.forEach((recording, index) => pick.add(new Option(recording.label, index)));
  pick.closest("label").hidden = data.recordings.length < 2;
  pick.addEventListener("change", () => open(Number(pick.value)));
  document.getElementById("reset").addEventListener("click", showAll);
  document.getElementById("browser").hidden = false;
  moving();
  open(0);
  links();
  addEventListener("resize", () => {
    const width = Math.max(200, document.getElementById("panels").clientWidth);
    for (const { plot, about } of panels) plot.setSize({ width, height: about.height });
  });
}
followTheme(() => { for (const { plot } of panels) plot.redraw(false); if (data.recordings.length) drawRobot(); });
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
