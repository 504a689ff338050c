// The phase plane of the timing, coloured by the limit that binds, and the share of each limit over time.

const KIND_COLOURS = {
  velocity: "var(--arm)", acceleration: "var(--tip)", torque: "var(--self)", jerk: "var(--amber)",
  "feed velocity": "var(--good)", "feed acceleration": "var(--amber)", "feed force": "var(--bad)", "tip speed": "var(--good)",
};

class Phase {
  constructor(data, marks) {
    this.time = decoded(data.time);
    this.place = decoded(data.place);
    this.speed = decoded(data.speed);
    this.shares = data.shares.map(decoded);
    this.data = data;
    this.marks = marks;
    this.binding = Array.from(this.time, (_, i) => this.bindingAt(i));
  }

  bindingAt(i) {
    const values = this.shares.map(share => share[i]);
    return values.indexOf(Math.max(...values));
  }

  words(i) {
    const k = this.binding[i];
    const share = threeDigits(100 * this.shares[k][i], 1);
    const of = this.data.names[k].length > 1 ? ` of ${this.data.names[k][this.data.drives[k][i]]}` : "";
    return `${this.data.kinds[k]}${of}: ${share} % of its limit`;
  }

  // Runs of samples with the same binding limit, each joined to the next.
  runs() {
    const found = [];
    let begin = 0;
    for (let i = 1; i <= this.time.length; i++) {
      if (i < this.time.length && this.binding[i] === this.binding[begin]) continue;
      found.push([begin, Math.min(i, this.time.length - 1), this.binding[begin]]);
      begin = i;
    }
    return found;
  }

  plane(host, timeline) {
    const most = Math.max(...this.speed);
    const curves = [{ x: this.place, y: this.data.possible, colour: "var(--soft)", width: 1.2, dash: "5 4" }];
    for (const [begin, end, kind] of this.runs()) {
      const part = values => values.slice(begin, end + 1);
      curves.push({ x: part(this.place), y: part(this.speed), colour: this.colour(kind), width: 2.4 });
    }
    const x = {
      low: 0, high: this.place[this.place.length - 1], title: "path length over all bends [°]",
      place: time => valueAt(this.time, this.place, time), time: place => valueAt(this.place, this.time, place),
    };
    const marks = this.marks.map(mark => ({ at: x.place(mark.at), words: mark.words }));
    const words = place => {
      const i = nearestSample(this.place, place);
      return [inSeconds(this.time[i]), `${threeDigits(this.speed[i])} rad/s`, this.words(i)];
    };
    const chart = new Chart(host, timeline, {
      title: "Phase plane: speed along the path [rad/s]",
      content: () => ({ x, y: { low: 0, high: 1.45 * most }, curves, marks, words }),
      note: time => this.words(nearestSample(this.time, time)),
    });
    host.append(this.legend("Coloured by the limit that is closest; dashed: speed at which a velocity reaches its limit."));
    return chart;
  }

  over(host, timeline) {
    const shares = this.shares.map(share => share.map(value => 100 * value));
    const curves = shares.map((share, k) => ({
      name: this.data.kinds[k], x: this.time, y: share, colour: this.colour(k), width: 1, faint: true, dotted: true,
    }));
    // In front only the limit that is nearest: six curves at once say nothing.
    for (const [begin, end, kind] of this.runs()) {
      const part = values => values.slice(begin, end + 1);
      curves.push({ x: part(this.time), y: part(shares[kind]), colour: this.colour(kind), width: 2.2 });
    }
    const planned = 100 * this.data.planned;
    const levels = [{ value: 100, words: "limit" }];
    if (planned < 100) levels.push({ value: planned, words: `used by plans: ${given(planned, 1)} %`, look: "wanted" });
    const x = { low: 0, high: this.time[this.time.length - 1], title: "time [s]" };
    const most = Math.max(100, ...curves.map(curve => Math.max(...curve.y)));
    const chart = new Chart(host, timeline, {
      title: "Use of each limit [%]",
      content: () => ({ x, y: { low: 0, high: 1.1 * most }, curves, levels, marks: this.marks, words: time => this.shareWords(time) }),
      note: time => this.words(nearestSample(this.time, time)),
    });
    host.append(this.legend("For each kind of limit, the joint that uses most of it; bold where that limit is the closest of all."));
    return chart;
  }

  shareWords(time) {
    const i = nearestSample(this.time, time);
    return [inSeconds(time), ...this.shares.map((share, k) => {
      const drive = this.data.names[k].length > 1 ? `, ${this.data.names[k][this.data.drives[k][i]]}` : "";
      return `${this.data.kinds[k]}: ${threeDigits(100 * share[i], 1)} %${drive}`;
    })];
  }

  colour(kind) {
    return KIND_COLOURS[this.data.kinds[kind]] ?? "var(--ink)";
  }

  legend(words) {
    const swatches = this.data.kinds.map((kind, k) => {
      const swatch = html("i", { class: "swatch" });
      swatch.style.background = this.colour(k);
      return html("span", {}, swatch, kind);
    });
    return html("p", { class: "legend" }, ...swatches, html("span", { class: "soft" }, words));
  }
}
