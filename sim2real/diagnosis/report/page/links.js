// From a finding, a joint, a window or a cause to the recording that shows it.
const follow = ({ log, episode, joint, from, to, without }) => {
  const has = (recording) => (log === undefined || (recording.log === log && recording.episode === episode)) && (joint === undefined || recording.joints.some((one) => one.name === joint));
  const index = data.recordings.findIndex(has);
  if (index < 0) return;
  if (joint !== undefined) view.joints = new Set([joint]);
  if (without !== undefined) view.causes = new Set(data.causes.map((_, number) => number).filter((number) => number !== without));
  document.getElementById("pick").value = index;
  open(index);
  if (from !== undefined) show(from - (to - from) / 4, to + (to - from) / 4);
};
const links = () => {
  const known = new Set(data.recordings.flatMap((recording) => recording.joints.map((joint) => joint.name)));
  const switchable = data.recordings[0].joints.every((joint) => Object.keys(joint.lines).length === 2 ** data.causes.length);
  for (const link of document.querySelectorAll("[data-view]")) {
    const target = JSON.parse(link.dataset.view);
    if ((target.joint !== undefined && !known.has(target.joint)) || (target.without !== undefined && !switchable)) continue;
    link.hidden = false;
    link.closest("div[hidden]")?.removeAttribute("hidden");
    link.addEventListener("click", (event) => { // in a notebook's frame the address is another page's
      event.preventDefault();
      follow(target);
      document.getElementById("browser").scrollIntoView();
    });
  }
};
