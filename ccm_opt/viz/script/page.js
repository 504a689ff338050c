// The page of a plan, or of a problem without one: a view of the plane or of space, and charts, follow one time.

const LAYERS = [
  { name: "bodies", words: "obstacles", look: "wall", on: true },
  { name: "room", words: "workspace", look: "room", on: false },
  { name: "start", words: "start", look: "start", on: true },
  { name: "arm", words: "arm", look: "arm", on: true },
  { name: "end", words: "end", look: "end", on: true },
  { name: "tip", words: "tip path", look: "tip", on: true },
  { name: "goals", words: "goals", look: "goal", on: true },
  { name: "findings", words: "obstructions", look: "least", on: true },
  { name: "least", words: "least gap", look: "least", on: true },
  { name: "way", words: "poses along the way", look: "way", on: false },
  { name: "swept", words: "swept region", look: "swept", on: false },
  { name: "simulated", words: "simulated arm", look: "simulated", on: false },
  { name: "route", words: "shortest path", look: "route", on: false },
  { name: "regions", words: "regions along the path", look: "regions", on: false },
  { name: "names", words: "names", look: "names", on: true },
];

// A switch for every layer that there is, with a swatch as it looks in the scene.
function addSwitches(view, data) {
  for (const { name, words, look, on } of LAYERS) {
    if (!view.layers.has(name)) continue;
    const checked = name === "names" ? data.scene.named : on;
    const box = html("input", { type: "checkbox", checked });
    box.addEventListener("change", () => view.show(name, box.checked));
    const shown = name === "start" && !data.groups ? "arm" : look;
    byId("layers").append(html("label", {}, box, html("i", { class: `swatch ${shown}` }), words));
    view.show(name, checked);
  }
}

function startControls(view, scene) {
  const buttons = { "zoom-in": () => view.zoom(1.4), "zoom-out": () => view.zoom(1 / 1.4),
    fit: () => view.fit(scene.look), room: () => view.fit(scene.extent), ...view.sides };
  for (const [id, act] of Object.entries(buttons)) byId(id).addEventListener("click", act);
  const keys = { "+": "zoom-in", "=": "zoom-in", "-": "zoom-out", 0: "fit", r: "room", x: "look-x", y: "look-y",
    z: "look-z", s: "look-slant" };
  document.addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select")) return;
    buttons[keys[event.key]]?.();
  });
  byId("theme").addEventListener("click", () => view.redraw());
}

function startReadout(timeline, motion, unit, gaps) {
  const written = [...document.querySelectorAll("[data-now]")];
  const values = {
    time: time => inSeconds(time),
    tip: time => `${motion.tipAt(time).map(value => threeDigits(value / unit.metres, 1)).join(", ")} ${unit.name}`,
    heading: time => {
      const way = motion.pointingAt(time);
      if (way.length === 2) return `${threeDigits(Math.atan2(way[1], way[0]) / DEGREE, 1)}°`;
      return way.map(value => threeDigits(value, 2)).join(", ");
    },
    gap: time => {
      if (!gaps) return "–";
      const least = Math.min(valueAt(gaps.time, gaps.walls, time), valueAt(gaps.time, gaps.itself, time));
      const text = `${threeDigits(Math.min(least, gaps.reach) / unit.metres, unit.decimals)} ${unit.name}`;
      return least >= 0.999 * gaps.reach ? `> ${text}` : text;
    },
  };
  timeline.follow(time => {
    for (const node of written) node.textContent = values[node.dataset.now](time);
  });
}

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

function startCharts(timeline, data, groups, motion) {
  const marks = data.marks.map(mark => ({ at: mark.at, words: mark.words }));
  const gaps = data.gaps && { time: decoded(data.gaps.time), walls: decoded(data.gaps.walls),
    itself: decoded(data.gaps.itself), reach: data.gaps.reach };
  startReadout(timeline, motion, data.unit, gaps);
  if (data.gaps) gapChart(byId("gaps"), timeline, data.gaps, data.unit, marks);
  const phase = new Phase(data.phase, marks);
  phase.plane(byId("phase"), timeline);
  phase.over(byId("shares"), timeline);
  startJointCharts(timeline, groups, marks);
  if (byId("curvature") && motion.arm.links > 1) curvatureChart(byId("curvature"), timeline, motion, data.unit);
  startPlayer(timeline, timeMarks(data));
  for (const link of document.querySelectorAll("[data-time]")) {
    link.addEventListener("click", () => timeline.pick(Number(link.dataset.time)));
  }
}

// A link to the page may name a time, as in report.html#t=0.91; else the motion plays, unless motion is not wanted.
function beginAt(timeline) {
  const asked = /^#t=([\d.]+)$/.exec(location.hash);
  timeline.go(asked ? Number(asked[1]) : 0);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!asked && !still) timeline.play();
}

function startPage() {
  const data = JSON.parse(byId("data").textContent);
  const groups = data.groups && new Map(data.groups.map(group => [group.key, readGroup(group)]));
  const motion = groups && new Motion(data.scene.arm, groups, data.unit);
  const view = data.scene.bodies ? new SpaceView(byId("scene"), data) : new PlaneView(byId("scene"), data);
  const pose = view.draw(data, motion);
  addSwitches(view, data);
  startControls(view, data.scene);
  view.fit(data.scene.look);
  startTheme();
  window.addEventListener("beforeprint", () => {
    for (const details of document.querySelectorAll("main details")) details.open = true;
  });
  if (motion) {
    const timeline = new Timeline(motion.duration);
    timeline.follow(pose);
    startCharts(timeline, data, groups, motion);
    beginAt(timeline);
  }
  document.documentElement.dataset.ready = motion ? "plan" : "failure";
}

startPage();
