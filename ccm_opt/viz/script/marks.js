// Marks of a scene that keep their size: goals with their numbers, a place that is worth a look, a label on a line.

function drawGoals(scene, goals) {
  const marks = scene.layer("goals", scene.labels);
  const discs = scene.layer("goals");
  for (const goal of goals) {
    const [cx, cy] = scene.local(goal.place);
    discs.append(svg("circle", { class: "goal-disc", cx, cy, r: goal.near }));
    const node = svg("g", { class: "goal" });
    if (goal.heading !== null) node.append(...headingMarks(goal));
    node.append(svg("circle", { r: 5 }));
    if (goals.length > 1) node.append(...numberMark(goal));
    node.append(svg("title", {}, goals.length > 1 ? `goal ${goal.number}` : "goal"));
    scene.pin(goal.place, node, marks);
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
