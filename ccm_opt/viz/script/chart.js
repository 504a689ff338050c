// A chart: curves over a common axis, levels, bands and marks; it is read by hovering, and a click goes to a time.

let chartCount = 0;

class Chart {
  // content() gives { x, y, curves, levels, bands, marks, dots } for the moment; x.time and x.place translate to times.
  constructor(host, timeline, { title, content, note = null, height = 230 }) {
    this.host = host;
    this.timeline = timeline;
    this.content = content;
    this.note = note;
    this.height = height;
    this.number = ++chartCount;
    this.caption = html("span", { class: "now" });
    this.box = html("div", { class: "plot" });
    this.tip = html("div", { class: "bubble", hidden: true });
    this.box.append(this.tip);
    host.append(html("figcaption", {}, html("b", {}, title), this.caption), this.box);
    this.drawing = svg("svg", { role: "img", "aria-label": title, class: "chart" });
    this.box.prepend(this.drawing);
    onWidth(this.box, () => this.redraw());
    this.listen();
    timeline.follow(time => this.showTime(time));
  }

  redraw() {
    const width = Math.max(this.box.clientWidth, 240);
    this.shown = this.content();
    const { x, y, curves, levels = [], bands = [], marks = [] } = this.shown;
    const axes = new Axes(width, this.height, x, y);
    this.axes = axes;
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${this.height}`);
    const clip = `plot-${this.number}`;
    const inside = svg("g", { "clip-path": `url(#${clip})` });
    const window = { x: axes.left, y: axes.top, width: axes.right - axes.left, height: axes.bottom - axes.top };
    inside.append(...bands.map(band => this.band(band)), ...marks.map(mark => this.mark(mark)));
    inside.append(...curves.map(curve => this.curve(curve)));
    inside.append(...levels.map(level => this.level(level)));
    this.cursor = svg("line", { y1: axes.top, y2: axes.bottom, class: "cursor" });
    this.hover = svg("line", { y1: axes.top, y2: axes.bottom, class: "hover", visibility: "hidden" });
    this.dots = svg("g");
    inside.append(this.hover, this.cursor, this.dots);
    this.drawing.replaceChildren(
      svg("defs", {}, svg("clipPath", { id: clip }, svg("rect", window))),
      axes.frame(),
      inside,
      ...levels.flatMap(level => this.levelWords(level)),
      ...marks.flatMap(mark => this.markWords(mark)),
      ...(this.shown.dotted ?? []).map(dot => this.dot(dot)),
    );
    this.showTime(this.timeline.time);
  }

  curve({ x, y, colour, width = 1.5, dash = null, faint = false, steps = false }) {
    const parts = [];
    let pen = "M";
    for (let k = 0; k < x.length; k++) {
      if (y[k] === null || !Number.isFinite(y[k])) {
        pen = "M";
        continue;
      }
      const px = this.axes.across(x[k]).toFixed(1);
      const py = this.axes.up(y[k]).toFixed(1);
      parts.push(steps && pen === "L" ? `H${px}V${py}` : `${pen}${px} ${py}`);
      pen = "L";
    }
    const look = { d: parts.join(""), stroke: colour, "stroke-width": width, "stroke-dasharray": dash, class: "curve" };
    if (faint) look.opacity = 0.4;
    return svg("path", look);
  }

  band({ x, low, high, look }) {
    const there = x.map((value, k) => `${this.axes.across(value).toFixed(1)} ${this.axes.up(high[k]).toFixed(1)}`);
    const back = x.map((value, k) => `${this.axes.across(value).toFixed(1)} ${this.axes.up(low[k]).toFixed(1)}`);
    return svg("path", { d: `M${there.join("L")}L${back.reverse().join("L")}Z`, class: look });
  }

  level({ value, look = "limit" }) {
    const y = this.axes.up(value);
    return svg("line", { x1: this.axes.left, x2: this.axes.right, y1: y, y2: y, class: `level ${look}` });
  }

  // The words of a level stand where the curves leave most room: left, in the middle or right, above it or below.
  levelWords({ value, words, look = "limit" }) {
    if (!words || value > this.axes.y.high || value < this.axes.y.low) return [];
    const { left, right, top, bottom } = this.axes;
    const width = LETTER * words.length;
    const places = [right - 36 - width, left + 6, (left + right - width) / 2];
    const y = this.axes.up(value);
    let best = null;
    for (const x of places) {
      for (const foot of [y - 4, y + 13]) {
        if (foot - 10 < top - 12 || foot > bottom + 2) continue;
        let room = Math.min(this.roomAround(x, x + width, foot - 4), 30);
        if (this.coversDotWords(x, x + width, foot)) room = -10;
        if (!best || room > best.room + 4) best = { x, y: foot, room };
      }
    }
    return best ? [svg("text", { x: best.x, y: best.y, class: `words ${look}` }, words)] : [];
  }

  // How far the nearest curve passes from a height, between two places across [pixel].
  roomAround(from, to, height) {
    let least = Infinity;
    for (const { x, y, faint } of this.shown.curves) {
      if (faint) continue;
      for (let k = 0; k <= 12; k++) {
        const value = valueAt(x, y, this.axes.valueAcross(from + ((to - from) * k) / 12));
        if (Number.isFinite(value)) least = Math.min(least, Math.abs(this.axes.up(value) - height));
      }
    }
    return least;
  }

  mark({ at }) {
    const x = this.axes.across(at);
    return svg("line", { x1: x, x2: x, y1: this.axes.top, y2: this.axes.bottom, class: "mark" });
  }

  markWords({ at, words }) {
    const x = this.axes.across(at);
    const anchor = x > this.axes.right - 12 ? "end" : "middle";
    return words ? [svg("text", { x, y: this.axes.top - 3, "text-anchor": anchor, class: "mark" }, words)] : [];
  }

  dot({ x, y, colour, words }) {
    const place = this.dotPlace(x, y, words);
    const text = svg("text", { x: place.x, y: place.foot, class: "words ink" }, this.fittingWords(words));
    return svg("g", {}, svg("circle", { cx: place.px, cy: place.py, r: 4.5, fill: colour, class: "dot" }), text);
  }

  dotPlace(x, y, words) {
    const [px, py] = [this.axes.across(x), this.axes.up(y)];
    const width = LETTER * this.fittingWords(words).length;
    const beside = px > (this.axes.left + this.axes.right) / 2 ? px - 7 - width : px + 7;
    const left = Math.min(Math.max(beside, this.axes.left + 4), this.axes.right - 2 - width);
    return { px, py, x: left, end: left + width, foot: py + (py < this.axes.bottom - 26 ? 18 : -10) };
  }

  // Words that are wider than the chart are cut at their first comma.
  fittingWords(words) {
    return LETTER * words.length < this.axes.right - this.axes.left - 6 ? words : words.split(", ")[0];
  }

  coversDotWords(from, to, foot) {
    return (this.shown.dotted ?? []).some(dot => {
      const place = this.dotPlace(dot.x, dot.y, dot.words);
      return from < place.end + 4 && to > place.x - 4 && Math.abs(foot - place.foot) < 14;
    });
  }

  showTime(time) {
    if (!this.axes) return;
    const place = this.shown.x.place ? this.shown.x.place(time) : time;
    const x = this.axes.across(place);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    if (this.note) this.caption.textContent = this.note(time);
    this.dots.replaceChildren(...this.shown.curves.filter(curve => curve.dotted).map(curve => {
      const value = valueAt(curve.x, curve.y, place);
      return svg("circle", { cx: x, cy: this.axes.up(value), r: 3.5, fill: curve.colour, class: "dot" });
    }));
  }

  listen() {
    const place = event => {
      const box = this.drawing.getBoundingClientRect();
      const ratio = this.axes.width / box.width;
      return [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
    };
    const timeOf = value => (this.shown.x.time ? this.shown.x.time(value) : value);
    this.drawing.addEventListener("pointermove", event => {
      const [px, py] = place(event);
      const value = this.axes.valueAcross(px);
      if (event.buttons & 1 && !this.shown.x.fixed) this.timeline.pick(timeOf(value));
      this.showTip(value, px, py);
    });
    this.drawing.addEventListener("pointerleave", () => {
      this.tip.hidden = true;
      this.hover.setAttribute("visibility", "hidden");
    });
    this.drawing.addEventListener("click", event => {
      if (!this.shown.x.fixed) this.timeline.pick(timeOf(this.axes.valueAcross(place(event)[0])));
    });
  }

  showTip(value, px, py) {
    const words = this.shown.words(value, this.nearestCurve(value, py));
    const x = this.axes.across(value);
    this.hover.setAttribute("x1", x);
    this.hover.setAttribute("x2", x);
    this.hover.setAttribute("visibility", "visible");
    this.tip.hidden = false;
    this.tip.replaceChildren(...words.map(line => html("div", {}, line)));
    const late = px > this.axes.width / 2;
    this.tip.style.left = late ? "" : `${px + 14}px`;
    this.tip.style.right = late ? `${this.axes.width - px + 14}px` : "";
    this.tip.style.top = `${Math.max(py - 20, 4)}px`;
  }

  nearestCurve(value, py) {
    let best = null;
    let least = Infinity;
    for (const curve of this.shown.curves) {
      if (!curve.name) continue;
      const away = Math.abs(this.axes.up(valueAt(curve.x, curve.y, value)) - py);
      if (away < least) [best, least] = [curve, away];
    }
    return best;
  }
}
