// The page of a plan: the scene and all charts follow one time.

const LAYERS = [
  { name: "start", words: "start", look: "start", on: true },
  { name: "arm", words: "arm", look: "arm", on: true },
  { name: "end", words: "end", look: "end", on: true },
  { name: "tip", words: "path of the tip", look: "tip", on: true },
  { name: "goals", words: "goals", look: "goal", on: true },
  { name: "least", words: "least gap", look: "least", on: true },
  { name: "way", words: "poses on the way", look: "way", on: false },
  { name: "swept", words: "all that it sweeps", look: "swept", on: false },
  { name: "simulated", words: "simulated arm", look: "simulated", on: false },
  { name: "route", words: "shortest way to the end", look: "route", on: false },
  { name: "regions", words: "regions along it", look: "regions", on: false },
  { name: "names", words: "names", look: "names", on: true },
];

function drawPlan(scene, data, motion) {
  const poses = motion.evenTimes(80).map(time => motion.pointsAt(time));
  for (const region of data.routes.regions ?? []) scene.polygon("regions", region, "region");
  const swept = scene.layer("swept");
  swept.setAttribute("class", "swept");
  for (const pose of poses) {
    swept.append(svg("polyline", { points: scene.line(pose), "stroke-width": 2 * scene.data.arm.radius }));
  }
  scene.body("start", "start")(motion.pointsAt(0));
  motion.evenTimes(9).slice(1, -1).forEach((time, k) => {
    const line = svg("polyline", { points: scene.line(motion.pointsAt(time)), class: "way-line" });
    line.style.stroke = jointColour(k, 7);
    scene.layer("way").append(line);
  });
  if (data.routes.route) scene.polyline("route", data.routes.route, "route-line");
  scene.body("end", "end")(motion.pointsAt(motion.duration));
  const times = Array.from({ length: 400 }, (_, k) => (motion.duration * k) / 399);
  scene.polyline("tip", times.map(time => motion.tipAt(time)), "tip-line");
  const arm = scene.body("arm", "arm");
  const simulated = motion.tracking ? scene.body("simulated", "simulated") : () => {};
  drawGoals(scene, data.goals);
  if (data.nearest) drawRing(scene, "least", data.nearest.place, data.nearest.words);
  return time => {
    arm(motion.pointsAt(time));
    if (motion.tracking) simulated(motion.simulatedPointsAt(time));
  };
}

function startReadout(timeline, motion, unit, gaps) {
  const written = [...document.querySelectorAll("[data-now]")];
  const values = {
    time: time => inSeconds(time),
    tip: time => {
      const [x, y] = motion.tipAt(time).map(value => threeDigits(value / unit.metres, 1));
      return `${x}, ${y} ${unit.name}`;
    },
    heading: time => `${threeDigits(motion.headingAt(time) / DEGREE, 1)}°`,
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

function startPlanPage() {
  const data = readData();
  const groups = new Map(data.groups.map(group => [group.key, readGroup(group)]));
  const motion = new Motion(data.scene.arm, groups, data.unit);
  const timeline = new Timeline(motion.duration);
  const scene = new Scene(byId("scene"), data.scene, data.unit);
  timeline.follow(drawPlan(scene, data, motion));
  addSwitches(scene, LAYERS.map(layer => (layer.name === "names" ? { ...layer, on: data.scene.named } : layer)));
  startSceneControls(scene, data.scene.bounds);
  scene.refresh();
  const marks = data.marks.map(mark => ({ at: mark.at, words: mark.words }));
  const gaps = data.gaps && { time: decoded(data.gaps.time), walls: decoded(data.gaps.walls),
    itself: decoded(data.gaps.itself), reach: data.gaps.reach };
  startReadout(timeline, motion, data.unit, gaps);
  if (data.gaps) gapChart(byId("gaps"), timeline, data.gaps, data.unit, marks);
  const phase = new Phase(data.phase, marks);
  phase.plane(byId("phase"), timeline);
  phase.over(byId("shares"), timeline);
  startJointCharts(timeline, groups, marks);
  if (data.scene.arm.links > 1) curvatureChart(byId("curvature"), timeline, motion, data.unit);
  startPlayer(timeline, timeMarks(data));
  for (const link of document.querySelectorAll("[data-time]")) {
    link.addEventListener("click", () => timeline.pick(Number(link.dataset.time)));
  }
  startTheme();
  unfoldForPrint();
  beginAt(timeline);
}

startPlanPage();
