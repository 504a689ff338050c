// The frame of a chart: where values stand in it, ticks with numbers, titles of both axes.

const LETTER = 6.9; // width of a letter in a chart [pixel], about

// How far a value is along a range, from 0 to 1; by the ratio on an axis that is logarithmic.
function shareOf(range, value) {
  if (range.log) return Math.log(value / range.low) / Math.log(range.high / range.low);
  return (value - range.low) / (range.high - range.low || 1);
}

function ticksOf(range, most) {
  return range.log ? ticksByRatio(range.low, range.high, most) : ticksBetween(range.low, range.high, most);
}

class Axes {
  constructor(width, height, x, y) {
    this.x = x;
    this.y = y;
    this.width = width;
    this.height = height;
    this.rows = ticksOf(y, height > 200 ? 6 : 4);
    const longest = Math.max(...this.rows.values.map(value => tickText(value, this.rows.decimals, y.log).length));
    this.left = Math.max(36, 14 + LETTER * longest);
    this.right = width - 12;
    this.top = 14;
    this.bottom = height - 34;
  }

  across(value) {
    return this.left + (this.right - this.left) * shareOf(this.x, value);
  }

  up(value) {
    return this.bottom - (this.bottom - this.top) * shareOf(this.y, value);
  }

  valueAcross(pixel) {
    const share = Math.min(Math.max((pixel - this.left) / (this.right - this.left), 0), 1);
    return this.x.log ? this.x.low * (this.x.high / this.x.low) ** share : this.x.low + share * (this.x.high - this.x.low);
  }

  frame() {
    const group = svg("g", { class: "axes" });
    for (const value of this.rows.values) {
      const y = this.up(value).toFixed(1);
      group.append(svg("line", { x1: this.left, x2: this.right, y1: y, y2: y, class: value === 0 ? "zero" : "grid" }));
      group.append(svg("text", { x: this.left - 6, y, dy: "0.35em", "text-anchor": "end" }, tickText(value, this.rows.decimals, this.y.log)));
    }
    const columns = ticksOf(this.x, Math.max(2, Math.floor((this.right - this.left) / 70)));
    for (const value of columns.values) {
      const x = this.across(value).toFixed(1);
      group.append(svg("line", { x1: x, x2: x, y1: this.bottom, y2: this.bottom + 4, class: "tick" }));
      group.append(svg("text", { x, y: this.bottom + 16, "text-anchor": "middle" }, tickText(value, columns.decimals, this.x.log)));
    }
    group.append(svg("line", { x1: this.left, x2: this.right, y1: this.bottom, y2: this.bottom, class: "tick" }));
    group.append(svg("text", { x: this.right, y: this.height - 4, "text-anchor": "end", class: "title" }, this.x.title));
    if (this.y.title) group.append(svg("text", { x: this.left, y: this.top - 3, class: "title" }, this.y.title));
    return group;
  }
}
