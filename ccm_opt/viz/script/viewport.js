// Zoom and pan of a drawing: which part of the plane is seen, by wheel, fingers, mouse and keys.

class Viewport {
  constructor(node, look, changed) {
    this.node = node;
    this.first = look;
    this.changed = changed;
    this.fingers = new Map();
    this.scale = 1;
    this.middle = [0, 1].map(k => (look[0][k] + look[1][k]) / 2);
    this.fitted = look;
    this.listen();
    new ResizeObserver(() => this.resize()).observe(node);
    this.resize();
  }

  get width() {
    return this.node.clientWidth || 600;
  }

  get height() {
    return this.node.clientHeight || 400;
  }

  resize() {
    if (this.fitted) this.fit(this.fitted);
    else this.changed();
  }

  fit(box) {
    this.fitted = box;
    const [width, height] = [0, 1].map(k => Math.max(box[1][k] - box[0][k], 1e-12));
    this.scale = Math.min((this.width - 24) / width, (this.height - 24) / height);
    this.middle = [0, 1].map(k => (box[0][k] + box[1][k]) / 2);
    this.changed();
  }

  toScreen([x, y]) {
    return [this.width / 2 + (x - this.middle[0]) * this.scale, this.height / 2 - (y - this.middle[1]) * this.scale];
  }

  toPlane([px, py]) {
    return [this.middle[0] + (px - this.width / 2) / this.scale, this.middle[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, pixel = [this.width / 2, this.height / 2]) {
    const kept = this.toPlane(pixel);
    const [low, high] = this.first;
    const widest = Math.max(high[0] - low[0], high[1] - low[1]);
    this.fitted = null;
    this.scale = Math.min(Math.max(this.scale * factor, (0.02 * this.width) / widest), (1e4 * this.width) / widest);
    const moved = this.toPlane(pixel);
    this.middle = this.middle.map((value, k) => value + kept[k] - moved[k]);
    this.changed();
  }

  pan(dx, dy) {
    this.fitted = null;
    this.middle = [this.middle[0] - dx / this.scale, this.middle[1] + dy / this.scale];
    this.changed();
  }

  pixelOf(event) {
    const box = this.node.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  listen() {
    const node = this.node;
    // A wheel without Ctrl scrolls the page; with it, and as a pinch on a touch pad, it zooms.
    node.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.0022 * Math.max(Math.min(event.deltaY, 300), -300)), this.pixelOf(event));
    }, { passive: false });
    node.addEventListener("dblclick", event => this.zoom(event.shiftKey ? 0.5 : 2, this.pixelOf(event)));
    node.addEventListener("pointerdown", event => {
      if (event.button !== 0) return;
      this.fingers.set(event.pointerId, this.pixelOf(event));
      if (event.pointerType === "mouse") node.setPointerCapture(event.pointerId);
    });
    node.addEventListener("pointermove", event => this.drag(event));
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) {
      node.addEventListener(name, event => this.fingers.delete(event.pointerId));
    }
  }

  drag(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = this.pixelOf(event);
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, pixel]) => pixel);
    this.fingers.set(event.pointerId, now);
    if (others.length) {
      const other = others[0];
      const was = Math.hypot(before[0] - other[0], before[1] - other[1]);
      const is = Math.hypot(now[0] - other[0], now[1] - other[1]);
      if (was > 0) this.zoom(is / was, [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
      this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    } else if (event.pointerType === "mouse") {
      this.pan(now[0] - before[0], now[1] - before[1]);
    }
  }
}
