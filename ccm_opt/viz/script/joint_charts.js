// Charts with a curve for every joint, which can show all of them or one, with its limit.

function jointColour(k, count) {
  const share = count > 1 ? k / (count - 1) : 0;
  // From the base to the tip: blue, green, amber, red, of about the same lightness.
  const hue = share < 0.5 ? 215 - 130 * share : 150 - 250 * (share - 0.5);
  return `hsl(${hue.toFixed(0)} 62% 46%)`;
}

function readGroup(group) {
  return { ...group, time: decoded(group.time), columns: group.columns.map(decoded) };
}

class JointChart {
  constructor(host, timeline, group, { marks, others = [] }) {
    this.group = group;
    this.marks = marks;
    this.others = others;
    this.chosen = null;
    this.decimals = decimalsFor(Math.max(...extremes(group.columns).map(Math.abs), 10 * (group.least || 0)));
    const unit = group.unit;
    this.chart = new Chart(host, timeline, {
      title: `${group.title} [${unit}]`,
      content: () => this.content(),
      note: time => this.note(time),
    });
    host.append(html("p", { class: "peak" }, this.peak()));
  }

  choose(name) {
    this.chosen = this.group.names.includes(name) ? name : null;
    this.chart.redraw();
  }

  text(value) {
    return `${threeDigits(value, this.decimals)} ${this.group.unit}`.replace(" °", "°");
  }

  given(value) {
    return `${given(value, this.decimals)} ${this.group.unit}`.replace(" °", "°");
  }

  value(k, time) {
    return valueAt(this.group.time, this.group.columns[k], time);
  }

  // The joint that is farthest from zero at a time, or the chosen one.
  leader(time) {
    if (this.chosen !== null) return this.group.names.indexOf(this.chosen);
    const sizes = this.group.columns.map((_, k) => Math.abs(this.value(k, time)));
    return sizes.indexOf(Math.max(...sizes));
  }

  note(time) {
    const k = this.leader(time);
    const most = this.chosen === null && this.group.names.length > 1 ? "largest " : "";
    return `${most}${this.text(this.value(k, time))}, ${this.group.names[k]}`;
  }

  peak() {
    let best = [0, 0, 0];
    this.group.columns.forEach((column, k) => column.forEach((value, i) => {
      if (Math.abs(value) > Math.abs(best[0])) best = [value, k, this.group.time[i]];
    }));
    const bound = this.group.limits[best[1]];
    const used = bound ? `, ${threeDigits((100 * Math.abs(best[0])) / bound, 1)} % of its limit ${this.given(bound)}` : "";
    return `Peak ${this.text(best[0])}, ${this.group.names[best[1]]}, at ${inSeconds(best[2])}${used}.`;
  }

  content() {
    const group = this.group;
    const only = this.chosen === null ? null : group.names.indexOf(this.chosen);
    const curves = group.columns.map((column, k) => ({
      name: group.names[k], x: group.time, y: column, colour: jointColour(k, group.columns.length),
      faint: only !== null && k !== only, width: only === k ? 2.4 : 1.3, dotted: only === k || group.columns.length === 1,
    }));
    for (const other of this.others) {
      if (only === null) continue;
      const k = other.names.indexOf(this.chosen);
      if (k >= 0) {
        const look = { colour: "var(--ink)", width: 1.2, dash: "3 3" };
        curves.push({ name: `${other.names[k]}, ${other.title}`, x: other.time, y: other.columns[k], ...look });
      }
    }
    const y = this.range(only);
    const bounds = this.bounds(only);
    const most = only === null && new Set(group.limits).size > 1 ? ", higher for some joints" : "";
    const levels = bounds.flatMap(bound => [
      { value: bound, words: `limit ${this.given(bound)}${most}` },
      { value: -bound },
    ]);
    const x = { low: 0, high: group.time[group.time.length - 1], title: "time [s]" };
    return { x, y, curves, levels, marks: this.marks, words: (time, near) => this.words(time, near) };
  }

  bounds(only) {
    const finite = this.group.limits.filter(bound => bound !== null);
    if (only !== null) return this.group.limits[only] === null ? [] : [this.group.limits[only]];
    return finite.length ? [Math.min(...finite)] : [];
  }

  // The values, and the limits where they are not so far off that the curves would be flat.
  range(only) {
    let [low, high] = extremes(this.group.columns);
    const size = Math.max(Math.abs(low), Math.abs(high), 1e-12);
    for (const bound of this.bounds(only)) {
      if (bound > 3 * size) continue;
      high = Math.max(high, bound);
      if (low < 0) low = Math.min(low, -bound);
    }
    const least = this.group.least || 0;
    low = Math.min(low, -least);
    high = Math.max(high, least);
    const room = 0.06 * (high - low || 1);
    return { low: low - (low < 0 ? room : 0), high: high + room };
  }

  words(time, near) {
    const lines = [inSeconds(time)];
    if (near) {
      const bound = this.group.limits[this.group.names.indexOf(near.name)];
      const value = valueAt(near.x, near.y, time);
      const used = bound ? ` (${Math.round((100 * Math.abs(value)) / bound)} % of its limit)` : "";
      lines.push(`${near.name}: ${this.text(value)}${used}`);
    }
    return lines;
  }
}
