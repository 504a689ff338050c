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
    const [x, y, across, up] = wall.place;
    const text = svg("text", { class: "name", "text-anchor": "middle", dy: "0.35em" }, wall.name);
    const node = svg("g", {}, text);
    this.pin([x, y], node, parent);
    // A name is seen only where it has room inside its obstacle, upright where that is upright.
    this.pinned[this.pinned.length - 1].fit = scale => {
      const length = 6.2 * wall.name.length;
      const upright = up > 1.5 * across;
      const room = upright ? up * scale > length && across * scale > 11 : across * scale > length && up * scale > 11;
      text.setAttribute("transform", upright ? "rotate(-90)" : "");
      node.style.visibility = room ? "" : "hidden";
    };
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
