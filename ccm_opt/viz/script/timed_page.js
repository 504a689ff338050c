// What pages of plans have in common, in the plane and in space: marks in time, charts of joints, where they begin.

function timeMarks(data) {
  const marks = data.marks.map(mark => ({ ...mark, look: "goal" }));
  const near = data.gaps?.nearest;
  if (near) marks.push({ at: near.time, words: "▾", title: `least gap, at ${inSeconds(near.time)}`, look: "near" });
  return marks;
}

function startJointCharts(timeline, groups, marks) {
  const charts = [];
  for (const host of document.querySelectorAll("[data-group]")) {
    const others = host.dataset.beside ? [groups.get(host.dataset.beside)].filter(Boolean) : [];
    charts.push(new JointChart(host, timeline, groups.get(host.dataset.group), { marks, others }));
  }
  const choice = byId("joint");
  for (const name of groups.get("bends").names) choice.append(html("option", { value: name }, name));
  choice.addEventListener("change", () => charts.forEach(chart => chart.choose(choice.value)));
}

// A link to the page may name a time, as in report.html#t=0.91; else the motion plays, unless motion is not wanted.
function beginAt(timeline) {
  const asked = /^#t=([\d.]+)$/.exec(location.hash);
  timeline.go(asked ? Number(asked[1]) : 0);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!asked && !still) timeline.play();
  document.documentElement.dataset.ready = "plan";
}
