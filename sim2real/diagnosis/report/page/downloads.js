// The shown recording as CSV, the plots as PNG, the answer as JSON.
const save = (blob, name) => {
  const link = element("a", { download: name }), address = URL.createObjectURL(blob);
  link.setAttribute("href", address);
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
};
const stem = () => view.recording.label.replace(/[^\w.-]+/g, "_");
const cell = (value) => {
  if (value === null || value === undefined) return "";
  if (typeof value === "number") return String(+value.toPrecision(7));
  const text = /^[=+@\t\r-]/.test(value) ? `'${value}` : value; // no spreadsheet takes a name for a formula
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
};

const csv = () => {
  const rows = [["joint", "unit", "time", "measured", "model_as_given", causesName().replaceAll(" ", "_")]];
  for (const joint of view.recording.joints) {
    const chosen = lineOf(joint);
    joint.time.forEach((t, i) => rows.push([joint.name, joint.unit, t, joint.measured[i], joint.lines[""][i], chosen && chosen[i]]));
  }
  return rows.map((row) => row.map(cell).join(",")).join("\n") + "\n";
};
const picture = () => {
  const heads = 22 * devicePixelRatio, sheet = element("canvas"), tops = [];
  let height = 0;
  for (const { plot } of panels) { tops.push(height); height += heads + plot.ctx.canvas.height; }
  sheet.width = panels[0].plot.ctx.canvas.width;
  sheet.height = height;
  const pen = sheet.getContext("2d");
  pen.fillStyle = colour("paper");
  pen.fillRect(0, 0, sheet.width, height);
  panels.forEach(({ plot, about }, i) => {
    let x = 6 * devicePixelRatio;
    const write = (text, name, weight) => {
      pen.fillStyle = colour(name);
      pen.font = `${weight} ${12 * devicePixelRatio}px system-ui, sans-serif`;
      pen.fillText(text, x, tops[i] + 15 * devicePixelRatio);
      x += pen.measureText(text).width + 14 * devicePixelRatio;
    };
    write(about.title, "ink", "bold");
    for (const line of about.series) write(line.label, line.kind, "normal");
    pen.drawImage(plot.ctx.canvas, 0, tops[i] + heads);
  });
  return sheet;
};

const downloads = () => {
  const on = (id, act) => document.getElementById(id)?.addEventListener("click", act);
  document.getElementById("json").hidden = false;
  on("csv", () => save(new Blob([csv()], { type: "text/csv" }), `${stem()}.csv`));
  on("png", () => picture().toBlob((blob) => save(blob, `${stem()}.png`)));
  on("json", () => save(new Blob([document.getElementById("answer").textContent], { type: "application/json" }), "report.json"));
};
