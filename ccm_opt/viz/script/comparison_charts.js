// Charts of a comparison: shares of problems solved over time, and two methods problem by problem.

const METHOD_COLOURS = ["var(--arm)", "var(--tip)", "var(--good)", "var(--self)", "var(--amber)"];
const METHOD_DASHES = [null, "7 4", "8 3 2 3", "2 3", "10 3"];

class StillChart {
  // draw(axes) gives the elements inside the frame; near(px, py) gives the lines of the bubble, or null.
  constructor(host, { title, height, square, content }) {
    this.content = content;
    this.height = height;
    this.square = square;
    this.box = html("div", { class: "plot" });
    this.bubble = html("div", { class: "bubble", hidden: true });
    this.drawing = svg("svg", { class: "chart", role: "img", "aria-label": title });
    this.box.append(this.drawing, this.bubble);
    host.append(html("figcaption", {}, html("b", {}, title)), this.box);
    onWidth(this.box, () => this.redraw());
    this.drawing.addEventListener("pointermove", event => this.show(event));
    this.drawing.addEventListener("pointerleave", () => { this.bubble.hidden = true; });
  }

  redraw() {
    const width = Math.max(this.box.clientWidth, 220);
    const height = this.square ? width : this.height;
    const { x, y, draw, near } = this.content();
    this.axes = new Axes(width, height, x, y);
    this.near = near;
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.drawing.replaceChildren(this.axes.frame(), ...draw(this.axes));
  }

  show(event) {
    const box = this.drawing.getBoundingClientRect();
    const ratio = this.axes.width / box.width;
    const [px, py] = [(event.clientX - box.left) * ratio, (event.clientY - box.top) * ratio];
    const lines = this.near(this.axes, px, py);
    this.bubble.hidden = !lines;
    if (!lines) return;
    this.bubble.replaceChildren(...lines.map(line => html("div", {}, line)));
    const late = px > this.axes.width / 2;
    this.bubble.style.left = late ? "" : `${px / ratio + 12}px`;
    this.bubble.style.right = late ? `${(this.axes.width - px) / ratio + 12}px` : "";
    this.bubble.style.top = `${Math.max(py / ratio - 16, 2)}px`;
  }
}

function logRange(values) {
  const low = Math.min(...values);
  const high = Math.max(...values);
  const factor = Math.max((high / low) ** 0.06, 1.15);
  return { low: low / factor, high: high * factor, log: true };
}

function linearRange(values) {
  const low = Math.min(...values);
  const high = Math.max(...values);
  const room = 0.06 * (high - low) || 1;
  return { low: low - room, high: high + room };
}

function successChart(host, data) {
  const curves = data.methods.map(method => {
    const runs = data.runs.filter(run => run.method === method.name && run.solved);
    return { ...method, runs: runs.sort((a, b) => a.figures.cpu_s - b.figures.cpu_s) };
  });
  const count = data.problems.length;
  const all = curves.flatMap(curve => curve.runs.map(run => run.figures.cpu_s));
  const x = { ...logRange(all.length ? all : [0.1, 1]), title: "CPU time [s]" };
  x.high *= 1.3;
  const y = { low: 0, high: 105, title: "" };
  const draw = axes => curves.flatMap((curve, k) => {
    const look = { class: "curve", stroke: METHOD_COLOURS[k % 5], "stroke-width": 2, "stroke-dasharray": METHOD_DASHES[k % 5] };
    let path = `M${axes.left} ${axes.up(0)}`;
    curve.runs.forEach((run, i) => { path += `H${axes.across(run.figures.cpu_s).toFixed(1)}V${axes.up((100 * (i + 1)) / count).toFixed(1)}`; });
    const bar = axes.right - 6 - 7 * k;
    const [low, high] = curve.interval.map(share => axes.up(100 * share));
    return [
      svg("path", { ...look, d: `${path}H${axes.right}` }),
      svg("line", { x1: bar, x2: bar, y1: low, y2: high, stroke: look.stroke, "stroke-width": 3, opacity: 0.6 }),
    ];
  });
  const near = (axes, px) => {
    const time = axes.valueAcross(px);
    return [`within ${threeDigits(time)} s`, ...curves.map(curve => {
      const solved = curve.runs.filter(run => run.figures.cpu_s <= time).length;
      return `${curve.name}: ${solved} of ${count}`;
    })];
  };
  new StillChart(host, { title: "Problems solved [%]", height: 300, content: () => ({ x, y, draw, near }) });
  host.append(html("p", { class: "legend" }, ...curves.map((curve, k) => {
    const swatch = html("i", { class: "swatch" });
    swatch.style.background = METHOD_COLOURS[k % 5];
    return html("span", {}, swatch, `${curve.name}: ${curve.runs.length} of ${count}`);
  })));
}

function scatterChart(host, data, [first, second], quantity) {
  const value = (method, problem) => {
    const run = data.runs.find(each => each.method === method && each.problem === problem && each.solved);
    return run?.figures[quantity.key];
  };
  const usable = number => Number.isFinite(number) && (!quantity.log || number > 0);
  const points = data.problems
    .map(problem => ({ problem, x: quantity.factor * value(first, problem), y: quantity.factor * value(second, problem) }))
    .filter(point => usable(point.x) && usable(point.y));
  if (!points.length) return;
  const values = points.flatMap(point => [point.x, point.y]);
  const range = quantity.log ? logRange(values) : linearRange(values);
  const draw = axes => [
    svg("line", { x1: axes.left, y1: axes.bottom, x2: axes.right, y2: axes.top, class: "diagonal" }),
    ...points.map(point => svg("circle", { cx: axes.across(point.x), cy: axes.up(point.y), r: 4, class: "point" })),
  ];
  const near = (axes, px, py) => {
    const away = point => Math.hypot(axes.across(point.x) - px, axes.up(point.y) - py);
    const best = points.reduce((one, other) => (away(other) < away(one) ? other : one));
    if (away(best) > 24) return null;
    const text = number => `${threeDigits(number, 4)} ${quantity.unit}`;
    return [best.problem, `${first}: ${text(best.x)}`, `${second}: ${text(best.y)}`];
  };
  const figure = html("figure");
  host.append(figure);
  const title = `${quantity.title} [${quantity.unit}]`;
  new StillChart(figure, { title, square: true, content: () => ({ x: { ...range, title: first }, y: { ...range, title: second }, draw, near }) });
}
