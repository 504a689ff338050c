// The scene: room, obstacles, goals and whatever layers a page adds; drawn in the plane, with labels in pixels on top.

class Scene {
  constructor(host, data, unit) {
    this.data = data;
    this.unit = unit;
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
    this.view = new Viewport(this.drawing, data.look, () => this.refresh());
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
    const { base, heading, feed } = this.data.arm;
    const along = way => [base[0] + way * Math.cos(heading), base[1] + way * Math.sin(heading)];
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
    const width = Math.max(2 * this.data.arm.radius, 0);
    const shown = svg("polyline", { class: `body ${look}`, "stroke-width": width });
    const axis = svg("polyline", { class: `axis ${look}` });
    this.layer(name).append(shown, axis);
    return points => {
      const line = this.line(points);
      shown.setAttribute("points", line);
      axis.setAttribute("points", line);
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

  refresh() {
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
