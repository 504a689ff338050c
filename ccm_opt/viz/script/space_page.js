// The page of a plan in space: a view that turns, and charts, follow one time.

const SPACE_LAYERS = [
  { name: "bodies", words: "obstacles", look: "wall", on: true },
  { name: "room", words: "room", look: "room", on: false },
  { name: "start", words: "start", look: "start", on: true },
  { name: "arm", words: "arm", look: "arm", on: true },
  { name: "end", words: "end", look: "end", on: true },
  { name: "tip", words: "path of the tip", look: "tip", on: true },
  { name: "goals", words: "goals", look: "goal", on: true },
  { name: "findings", words: "what stands in the way", look: "least", on: true },
  { name: "simulated", words: "simulated arm", look: "simulated", on: false },
];

function bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
}

// Corners in steps of the extent of a body, as whole numbers of 16 bits.
function bodyCorners(body) {
  const whole = new Uint16Array(bytes(body.corners));
  return Float32Array.from(whole, (value, k) => body.low[k % 3] + (value * body.span[k % 3]) / 65535);
}

function armRods(arm, points, colour, opacity) {
  const radius = arm.radius || -1.5;
  return points.slice(1).map((point, k) => [points[k], point, radius, radius, colour, opacity]);
}

function goalRods(goal, arm, reach) {
  const size = 0.8 * (arm.radius || 0.01 * reach);
  const rods = [[goal.position, goal.position, size, size, "good", 1]];
  if (goal.direction) {
    const tip = plus(goal.position, goal.direction, 3 * arm.link);
    const neck = plus(goal.position, goal.direction, 2.2 * arm.link);
    rods.push([goal.position, neck, 0.3 * size, 0.3 * size, "good", 1], [neck, tip, 0.9 * size, 0, "good", 1]);
  }
  for (const place of goal.via) rods.push([place, place, size, size, "amber", 1]);
  return rods;
}

// What passes a gap inside of what would have to, the way that leads through it, or else just the place.
function findingRods({ place, needed, room, way }, arm, reach) {
  const size = 1.3 * (arm.radius || 0.01 * reach);
  const rods = way.slice(1).map((point, k) => [way[k], point, -1.4, -1.4, "bad", 1]);
  if (needed === null) return [...rods, [place, place, size, size, "bad", 0.6]];
  return [...rods, [place, place, room, room, "amber", 1], [place, place, needed, needed, "bad", 0.35]];
}

function boxRods([low, high]) {
  const corner = k => [0, 1, 2].map(axis => (k & (1 << axis) ? high : low)[axis]);
  const rods = [];
  for (let k = 0; k < 8; k++) {
    for (const bit of [1, 2, 4]) if (!(k & bit)) rods.push([corner(k), corner(k | bit), -0.8, -0.8, "edge", 1]);
  }
  return rods;
}

function fillView(view, data, motion) {
  const arm = data.scene.arm;
  for (const body of data.scene.bodies) {
    const faces = new Uint32Array(bytes(body.faces));
    const colour = data.blocking?.includes(body.name) ? "bad" : "edge";
    view.addSurface("bodies", bodyCorners(body), faces, new Uint32Array(bytes(body.edges)), colour);
  }
  if (data.scene.room) view.setRods("room", boxRods(data.scene.room));
  if (motion) {
    view.setRods("start", armRods(arm, motion.pointsAt(0), "start", 0.4));
    view.setRods("end", armRods(arm, motion.pointsAt(motion.duration), "good", 0.3));
    const tips = Array.from({ length: 300 }, (_, k) => motion.pointsAt((motion.duration * k) / 299)[arm.links]);
    view.setRods("tip", tips.slice(1).map((tip, k) => [tips[k], tip, -1.1, -1.1, "tip", 1]));
  } else {
    view.setRods("start", armRods(arm, data.scene.start, "arm", 1));
  }
  if (data.findings) {
    const rods = data.findings.flatMap(finding => findingRods(finding, arm, arm.links * arm.link));
    if (data.attempt) rods.push(...armRods(arm, data.attempt, "bad", 0.4));
    view.setRods("findings", rods);
  }
  view.setRods("goals", data.scene.goals.flatMap(goal => goalRods(goal, arm, arm.links * arm.link)));
}

function startSpaceControls(view, scene) {
  const looks = { "look-x": [0, 0], "look-y": [-Math.PI / 2, 0], "look-z": [-Math.PI / 2, 1.55], "look-slant": [-0.9, 0.5] };
  const buttons = { "zoom-in": () => view.zoom(1.4), "zoom-out": () => view.zoom(1 / 1.4), fit: () => view.fit(scene.look),
    room: () => view.fit(scene.extent) };
  for (const [id, [yaw, pitch]] of Object.entries(looks)) buttons[id] = () => view.look(yaw, pitch);
  for (const [id, act] of Object.entries(buttons)) byId(id).addEventListener("click", act);
  const keys = { "+": "zoom-in", "=": "zoom-in", "-": "zoom-out", 0: "fit", r: "room", x: "look-x", y: "look-y", z: "look-z",
    s: "look-slant" };
  document.addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, input[type=text]")) return;
    if (event.key in keys) buttons[keys[event.key]]();
  });
  byId("clarity").addEventListener("input", event => {
    view.clarity = Number(event.target.value);
    view.redraw();
  });
  // A plane across the direction that is chosen, from beyond everything to before it.
  const cut = () => {
    const axis = Number(byId("cut-axis").value);
    const share = Number(byId("cut").value);
    const normal = [0, 1, 2].map(k => (k === axis ? 1 : 0));
    const [low, high] = scene.extent.map(corner => corner[axis]);
    view.cut = share >= 1 ? null : [...normal, low + share * (high - low)];
    view.redraw();
  };
  for (const id of ["cut", "cut-axis"]) byId(id).addEventListener("input", cut);
  byId("theme").addEventListener("click", () => view.redraw());
}

function addSpaceSwitches(view, layers) {
  for (const { name, words, look, on } of layers) {
    const box = html("input", { type: "checkbox", checked: on });
    box.addEventListener("change", () => view.show(name, box.checked));
    byId("layers").append(html("label", {}, box, html("i", { class: `swatch ${look}` }), words));
    view.show(name, on);
  }
}

function startSpaceReadout(timeline, motion, unitOfPage, gaps) {
  const written = [...document.querySelectorAll("[data-now]")];
  const text = value => threeDigits(value / unitOfPage.metres, 1);
  const tip = time => motion.pointsAt(time)[motion.arm.links];
  const along = time => {
    const points = motion.pointsAt(time);
    return unit(plus(points[motion.arm.links], points[motion.arm.links - 1], -1));
  };
  const values = {
    time: time => inSeconds(time),
    tip: time => `${tip(time).map(text).join(", ")} ${unitOfPage.name}`,
    heading: time => along(time).map(value => threeDigits(value, 2)).join(", "),
    gap: time => {
      if (!gaps) return "–";
      const least = Math.min(valueAt(gaps.time, gaps.walls, time), valueAt(gaps.time, gaps.itself, time));
      const shown = `${threeDigits(Math.min(least, gaps.reach) / unitOfPage.metres, unitOfPage.decimals)} ${unitOfPage.name}`;
      return least >= 0.999 * gaps.reach ? `> ${shown}` : shown;
    },
  };
  timeline.follow(time => {
    for (const node of written) node.textContent = values[node.dataset.now](time);
  });
}

function startSpacePage() {
  const data = readData();
  const host = byId("scene");
  const view = new SpaceView(host, host.dataset.label);
  if (!view.gl) host.append(html("p", { class: "soft" }, "This browser has no WebGL 2; see the picture plan.png."));
  const motion = data.groups ? new SpaceMotion(data.scene.arm, new Map(data.groups.map(group => [group.key, readGroup(group)])), data.unit) : null;
  fillView(view, data, motion);
  const simulated = motion?.tracking;
  const layers = SPACE_LAYERS.filter(layer => view.rods.has(layer.name) || ["bodies", "arm"].includes(layer.name) || (layer.name === "simulated" && simulated));
  addSpaceSwitches(view, layers.filter(layer => motion || layer.name !== "arm"));
  startSpaceControls(view, data.scene);
  view.fit(data.scene.look);
  startTheme();
  unfoldForPrint();
  view.redraw();
  if (motion) startSpaceMotion(view, data, motion);
  else document.documentElement.dataset.ready = "plan";
}

function startSpaceMotion(view, data, motion) {
  const groups = new Map(data.groups.map(group => [group.key, readGroup(group)]));
  const timeline = new Timeline(motion.duration);
  timeline.follow(time => {
    view.setRods("arm", armRods(data.scene.arm, motion.pointsAt(time), "arm", 1));
    if (motion.tracking) view.setRods("simulated", armRods(data.scene.arm, motion.simulatedPointsAt(time), "tip", 0.4));
  });
  const marks = data.marks.map(mark => ({ at: mark.at, words: mark.words }));
  const gaps = data.gaps && { time: decoded(data.gaps.time), walls: decoded(data.gaps.walls),
    itself: decoded(data.gaps.itself), reach: data.gaps.reach };
  startSpaceReadout(timeline, motion, data.unit, gaps);
  if (data.gaps) gapChart(byId("gaps"), timeline, data.gaps, data.unit, marks);
  const phase = new Phase(data.phase, marks);
  phase.plane(byId("phase"), timeline);
  phase.over(byId("shares"), timeline);
  startJointCharts(timeline, groups, marks);
  startPlayer(timeline, timeMarks(data));
  for (const link of document.querySelectorAll("[data-time]")) {
    link.addEventListener("click", () => timeline.pick(Number(link.dataset.time)));
  }
  beginAt(timeline);
}

startSpacePage();
