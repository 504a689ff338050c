// A view of the plane: room, obstacles, goals, the arm and what stands in its way, with labels in pixels on top.

class PlaneView {
  constructor(host, { scene, unit }) {
    this.data = scene;
    this.unit = unit;
    this.sides = {};
    this.pinned = [];
    this.world = svg("g");
    this.labels = svg("g");
    this.bar = svg("g", { class: "scale-bar" });
    this.drawing = svg("svg", { class: "scene", tabindex: "0", role: "img", "aria-label": host.dataset.label });
    this.drawing.append(this.world, this.labels, this.bar);
    host.append(this.drawing);
    this.layers = new Map();
    this.drawRoom();
    this.drawBase();
    this.view = new Viewport(this.drawing, scene.look, () => this.redraw());
    this.tellPlace(byId("place"));
  }

  draw(data, motion) {
    const pose = motion ? drawMotion(this, data, motion) : drawFailure(this, data);
    drawSurface(this, this.data.surface ?? {});
    drawGoals(this, this.data.goals);
    if (data.pose) drawGoalPose(byId("goal-pose"), data, motion);
    if (data.nearest) drawRing(this, "least", data.nearest.place, data.nearest.words);
    return pose;
  }

  zoom(factor) {
    this.view.zoom(factor);
  }

  fit(box) {
    this.view.fit(box);
  }

  // The place under the mouse.
  tellPlace(node) {
    this.drawing.addEventListener("pointermove", event => {
      const [x, y] = this.view.toPlane(this.view.pixelOf(event)).map(value => value / this.unit.metres);
      node.textContent = `x ${threeDigits(x, 1)}, y ${threeDigits(y, 1)} ${this.unit.name}`;
    });
    this.drawing.addEventListener("pointerleave", () => { node.textContent = ""; });
  }

  // Places in the drawing are relative to the room's corner, so that rooms far from the origin keep their digits.
  local([x, y]) {
    return [x - this.data.origin[0], y - this.data.origin[1]];
  }

  line(points) {
    return points.map(point => this.local(point).map(value => value.toPrecision(7)).join(",")).join(" ");
  }

  layer(name, parent = this.world) {
    const group = svg("g", { "data-layer": name });
    parent.append(group);
    if (!this.layers.has(name)) this.layers.set(name, []);
    this.layers.get(name).push(group);
    return group;
  }

  show(name, on) {
    for (const group of this.layers.get(name) ?? []) group.style.display = on ? "" : "none";
  }

  // A label, or any mark of a fixed size, that stays at a place of the plane.
  pin(place, node, parent = this.labels) {
    parent.append(node);
    this.pinned.push({ place, node });
  }

  drawRoom() {
    const steps = svg("g", { transform: `scale(${this.data.step})` });
    steps.append(svg("path", { d: this.data.boundary, class: "boundary" }));
    const names = this.layer("names", this.labels);
    this.walls = new Map();
    for (const wall of this.data.obstacles) {
      const path = svg("path", { d: wall.path, class: wall.filled ? "wall" : "wall thin" }, svg("title", {}, wall.name));
      steps.append(path);
      this.walls.set(wall.name, path);
      if (wall.place) this.nameWall(wall, names);
    }
    this.world.append(steps);
  }

  // The base, and the axis along which a feed carries it.
  drawBase() {
    const { base, direction, feed } = this.data.arm;
    const along = way => plus(base, direction, way);
    if (feed) this.polyline("feed", [along(feed[0]), along(feed[1])], "feed-line");
    const mark = svg("path", { d: "M-4 -4h8v8h-8Z", class: "base" }, svg("title", {}, "base"));
    if (feed) this.pin(along(feed[2]), svg("path", { d: "M0 -9V9", class: "hole" }, svg("title", {}, "end of the guide")));
    else this.pin(base, mark);
  }

  nameWall(wall, parent) {
    const text = svg("text", { class: "name", "text-anchor": "middle", dy: "0.35em" }, wall.name);
    const node = svg("g", {}, text);
    const path = this.walls.get(wall.name);
    this.pin(wall.place, node, parent);
    // A name is seen only where it has room inside what is seen of its obstacle, upright where that is upright.
    this.pinned[this.pinned.length - 1].fit = () => {
      const place = this.placeOfName(path, wall.place, 6.2 * wall.name.length);
      node.style.visibility = place ? "" : "hidden";
      if (!place) return;
      node.setAttribute("transform", `translate(${place.x.toFixed(1)} ${place.y.toFixed(1)})`);
      text.setAttribute("transform", place.upright ? "rotate(-90)" : "");
    };
  }

  // Where a name of a length [pixel] lies inside the part of an obstacle that is seen; null where it has no room.
  placeOfName(path, [x, y, across, up], length) {
    const edge = 6;
    const [left, bottom] = this.view.toScreen([x - across[0], y - up[0]]);
    const [right, top] = this.view.toScreen([x + across[1], y + up[1]]);
    const low = [Math.max(left, edge), Math.max(top, edge)];
    const high = [Math.min(right, this.view.width - edge), Math.min(bottom, this.view.height - edge)];
    const size = [high[0] - low[0], high[1] - low[1]];
    const upright = size[1] > 1.5 * size[0];
    if (size[upright ? 1 : 0] < length || size[upright ? 0 : 1] < 11) return null;
    const found = [this.view.toScreen([x, y])];
    // The middle first, then other places of what is seen, from the middle outwards.
    for (const share of [0.5, 0.3, 0.7, 0.15, 0.85]) {
      for (const other of [0.5, 0.3, 0.7, 0.15, 0.85]) found.push([low[0] + share * size[0], low[1] + other * size[1]]);
    }
    found.push(found.shift());
    for (const [px, py] of found) {
      if (this.holdsWords(path, px, py, length, upright, low, high)) return { x: px, y: py, upright };
    }
    return null;
  }

  // Whether words about a pixel lie inside an obstacle and the part of the drawing between two corners.
  holdsWords(path, px, py, length, upright, low, high) {
    const [half, thick] = [length / 2, 5];
    const [dx, dy] = upright ? [thick, half] : [half, thick];
    if (px - dx < low[0] || px + dx > high[0] || py - dy < low[1] || py + dy > high[1]) return false;
    for (const [sx, sy] of [[0, 0], [-1, -1], [-1, 1], [1, -1], [1, 1], [0, -1], [0, 1], [-1, 0], [1, 0]]) {
      const [ax, ay] = this.local(this.view.toPlane([px + sx * dx, py + sy * dy]));
      if (!path.isPointInFill(new DOMPoint(ax / this.data.step, ay / this.data.step))) return false;
    }
    return true;
  }

  body(name, look) {
    const runs = radiusRuns(this.data.arm);
    const shown = runs.map(run => svg("polyline", { class: `body ${look}`, "stroke-width": 2 * run.radius }));
    const axis = svg("polyline", { class: `axis ${look}` });
    this.layer(name).append(...shown, axis);
    return points => {
      runs.forEach(({ first, end }, k) => shown[k].setAttribute("points", this.line(points.slice(first, end + 1))));
      axis.setAttribute("points", this.line(points));
    };
  }

  polyline(name, points, look) {
    this.layer(name).append(svg("polyline", { class: look, points: this.line(points) }));
  }

  polygon(name, points, look) {
    this.layer(name).append(svg("polygon", { class: look, points: this.line(points) }));
  }

  circle(name, place, radius, look) {
    const [cx, cy] = this.local(place);
    this.layer(name).append(svg("circle", { class: look, cx, cy, r: radius }));
  }

  redraw() {
    const view = this.view;
    if (!view) return;
    const [left, top] = view.toScreen(this.data.origin);
    this.world.setAttribute("transform", `translate(${left} ${top}) scale(${view.scale} ${-view.scale})`);
    for (const { place, node, fit } of this.pinned) {
      const [x, y] = view.toScreen(place);
      node.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      if (fit) fit(view.scale, [x, y]);
    }
    this.drawBar();
  }

  drawBar() {
    const rough = (0.22 * this.view.width) / this.view.scale / this.unit.metres;
    const length = roundStep(rough / 1.6);
    const pixels = length * this.unit.metres * this.view.scale;
    const foot = this.view.height - 16;
    const text = `${given(length, decimalsFor(length))} ${this.unit.name}`;
    this.bar.replaceChildren(
      svg("path", { d: `M16 ${foot - 5}v5h${pixels.toFixed(1)}v-5` }),
      svg("text", { x: 16 + pixels / 2, y: foot - 8, "text-anchor": "middle" }, text),
    );
  }
}

// Runs of links of equal radius, each from its first joint to the joint at its end.
function radiusRuns(arm) {
  const runs = [];
  arm.radii.forEach((radius, k) => {
    if (runs.length && runs.at(-1).radius === radius) runs.at(-1).end = k + 1;
    else runs.push({ first: k, end: k + 1, radius });
  });
  return runs;
}

function drawMotion(scene, data, motion) {
  for (const region of data.routes.regions ?? []) scene.polygon("regions", region, "region");
  const swept = scene.layer("swept");
  swept.setAttribute("class", "swept");
  for (const time of motion.evenTimes(80)) {
    const joints = motion.pointsAt(time);
    for (const { first, end, radius } of radiusRuns(scene.data.arm)) {
      swept.append(svg("polyline", { points: scene.line(joints.slice(first, end + 1)), "stroke-width": 2 * radius }));
    }
  }
  scene.body("start", "start")(data.scene.start);
  motion.evenTimes(9).slice(1, -1).forEach((time, k) => {
    const line = svg("polyline", { points: scene.line(motion.pointsAt(time)), class: "way-line" });
    line.style.stroke = jointColour(k, 7);
    scene.layer("way").append(line);
  });
  if (data.routes.route) scene.polyline("route", data.routes.route, "route-line");
  scene.body("end", "end")(motion.pointsAt(motion.duration));
  scene.polyline("tip", motion.tips(400), "tip-line");
  const arm = scene.body("arm", "arm");
  const simulated = motion.tracking ? scene.body("simulated", "simulated") : () => {};
  return time => {
    arm(motion.pointsAt(time));
    if (motion.tracking) simulated(motion.simulatedPointsAt(time));
  };
}

// The pose in which the motion is to end, where it does end if that is another, and the curve by its segments.
function drawGoalPose(host, data, motion) {
  const { points, reached, segments } = data.pose;
  const end = motion.pointsAt(motion.duration);
  const shown = [...points, ...end, ...segments.flatMap(segment => segment.points)];
  const [low, high] = [Math.min, Math.max].map(most => [0, 1].map(k => most(...shown.map(place => place[k]))));
  const margin = 0.12 * Math.max(high[0] - low[0], high[1] - low[1]);
  const look = [low.map(value => value - margin), high.map(value => value + margin)];
  const view = new PlaneView(host, { scene: { ...data.scene, look }, unit: data.unit });
  if (!reached) view.body("end", "start")(end);
  view.body("pose", "pose")(points);
  for (const { colour, points: places } of segments) {
    view.layer("curve").append(svg("polyline", { points: view.line(places), class: "segment", style: `stroke: ${colour}` }));
    for (const place of [places[0], places[places.length - 1]]) view.pin(place, svg("circle", { r: 4, class: "joint" }));
  }
  view.redraw();
}

const FINDINGS = {
  circle: (scene, mark) => scene.circle("findings", mark.place, mark.radius, "reach"),
  disc: (scene, mark) => scene.circle("findings", mark.place, mark.radius, "too-thick"),
  way: (scene, mark) => scene.polyline("findings", mark.points, "long-way"),
  gap: (scene, mark) => scene.polyline("findings", mark.points, "narrow-gap"),
  arm: (scene, mark) => scene.body("findings", "curled")(mark.points),
  place: (scene, mark) => drawRing(scene, "findings", mark.place, mark.words),
  words: (scene, mark) => { if (mark.at) drawWords(scene, "findings", mark.at, mark.words, "bad", scene.data.goals); },
};

function drawFailure(scene, data) {
  scene.body("start", "arm")(data.scene.start);
  for (const name of data.blocking) scene.walls.get(name)?.classList.add("blocking");
  for (const mark of data.marks) FINDINGS[mark.kind](scene, mark);
}

// Marks that keep their size: goals with their numbers, a place that is worth a look, a label on a line.

function drawSurface(scene, surface) {
  const layer = scene.layer("surface");
  for (const [look, pieces] of Object.entries(surface)) {
    const lines = pieces.map(ends => `M${ends.map(place => scene.local(place).join(" ")).join("L")}`);
    layer.append(svg("path", { class: `surface ${look}`, d: lines.join("") }));
  }
}

function drawGoals(scene, goals) {
  const marks = scene.layer("goals", scene.labels);
  const discs = scene.layer("goals");
  for (const goal of goals) {
    const [cx, cy] = scene.local(goal.place);
    discs.append(svg("circle", { class: "goal-disc", cx, cy, r: goal.near }));
    if (goal.sight.length) {
      const outline = [goal.sight[0][0], ...goal.sight[1]].map(place => scene.local(place).join(" "));
      discs.append(svg("path", { class: "sight", d: `M${outline.join("L")}Z` }));
    }
    const node = svg("g", { class: "goal" });
    if (goal.heading !== null) node.append(...headingMarks(goal));
    node.append(svg("circle", { r: 5 }));
    if (goals.length > 1) node.append(...numberMark(goal));
    node.append(svg("title", {}, goals.length > 1 ? `goal ${goal.number}` : "goal"));
    scene.pin(goal.place, node, marks);
    for (const place of goal.via) scene.pin(place, svg("circle", { r: 4, class: "via" }), marks);
  }
}

function headingMarks(goal) {
  const degrees = (-goal.heading * 180) / Math.PI;
  const parts = [];
  if (goal.turn > 0.05) parts.push(wedge(goal));
  if (goal.turn < Math.PI) {
    const arrow = svg("path", { d: "M5 0H30M24 -4.5L31 0L24 4.5", class: "arrow", transform: `rotate(${degrees})` });
    parts.push(arrow);
  }
  return parts;
}

function wedge(goal) {
  const [from, to] = [goal.heading - goal.turn, goal.heading + goal.turn];
  if (goal.turn >= Math.PI) return svg("circle", { r: 28, class: "wedge" });
  const [x0, y0, x1, y1] = [Math.cos(from), -Math.sin(from), Math.cos(to), -Math.sin(to)].map(v => 28 * v);
  const large = goal.turn > Math.PI / 2 ? 1 : 0;
  return svg("path", { d: `M0 0L${x0} ${y0}A28 28 0 ${large} 0 ${x1} ${y1}Z`, class: "wedge" });
}

// The number stands behind the goal, where its arrow does not point.
function numberMark(goal) {
  const away = goal.heading === null ? Math.PI / 2 : goal.heading + Math.PI;
  const [x, y] = [15 * Math.cos(away), -15 * Math.sin(away)];
  return [
    svg("circle", { cx: x, cy: y, r: 8, class: "number" }),
    svg("text", { x, y, dy: "0.35em", "text-anchor": "middle", class: "number" }, String(goal.number)),
  ];
}

function drawRing(scene, name, place, words, look = "least") {
  const ring = svg("g", { class: look }, svg("circle", { r: 9 }), svg("circle", { r: 1.5 }), svg("title", {}, words));
  scene.pin(place, ring, scene.layer(name, scene.labels));
}

function drawWords(scene, name, place, words, look, goals = []) {
  const text = svg("text", { class: `words ${look}`, "text-anchor": "middle" }, words);
  scene.pin(place, svg("g", {}, text), scene.layer(name, scene.labels));
  // The words stay inside the drawing where their place is near its edge, and off the goals.
  scene.pinned[scene.pinned.length - 1].fit = (_, [x, y]) => {
    const length = text.getComputedTextLength() || 8 * words.length;
    const half = Math.min(length / 2 + 8, scene.view.width / 2 - 4);
    const middle = Math.min(Math.max(x, half), scene.view.width - half);
    const covers = foot => goals.some(goal => {
      const [gx, gy] = scene.view.toScreen(goal.place);
      return Math.abs(gx - middle) < half + 8 && Math.abs(gy - (y + foot - 5)) < 16;
    });
    const inside = foot => y + foot > 14 && y + foot < scene.view.height - 8;
    const feet = [-18, 28, -40, 50];
    const free = feet.find(foot => inside(foot) && !covers(foot)) ?? feet.find(inside) ?? -18;
    text.setAttribute("x", middle - x);
    text.setAttribute("y", free);
  };
}
