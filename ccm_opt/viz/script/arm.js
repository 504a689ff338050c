// The arm, in the plane and in space: joints and tip from bends, at any time of a motion.

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// a + s b
function plus(a, b, s = 1) {
  return a.map((value, k) => value + s * b[k]);
}

function scaled(a, s) {
  return a.map(value => s * value);
}

function norm(a) {
  return Math.hypot(...a);
}

// A vector turned about a unit vector by an angle.
function turnedAbout(axis, angle, vector) {
  const along = scaled(axis, (1 - Math.cos(angle)) * dot(axis, vector));
  return plus(plus(scaled(vector, Math.cos(angle)), cross(axis, vector), Math.sin(angle)), along);
}

// By how much the tangents of the arc about each joint are longer than half of the arc; 0 for joints that are none.
function growths(arm, bends) {
  const each = arm.base.length - 1;
  return arm.lengths.concat(0).map((_, joint) => {
    const half = Math.max(0.5 * Math.hypot(...bends.slice(each * joint, each * (joint + 1))), 1e-8);
    return arm.arcs ? arm.arcs[joint] * (Math.tan(half) / half - 1) : 0;
  });
}

// A joint turns by a about z, in space then by b about the new y; its link lies along the new x. That of an arc turns by
// the rotation vector (0, b, a), and its links are the arc's tangents.
function armPoints(arm, bends, feed) {
  const dimension = arm.base.length;
  const spatial = vector => [vector[0], vector[1], vector[2] ?? 0];
  let x = spatial(arm.direction);
  let z = arm.up;
  let y = cross(z, x);
  let point = plus(spatial(arm.base), x, feed);
  const points = [point.slice(0, dimension)];
  const grown = growths(arm, bends);
  for (let k = 0; k < bends.length; k += dimension - 1) {
    const [a, b] = [bends[k], dimension === 3 ? bends[k + 1] : 0];
    const link = k / (dimension - 1);
    if (arm.arcs) {
      const angle = Math.hypot(a, b);
      const axis = scaled(plus(scaled(y, b), z, a), 1 / Math.max(angle, 1e-300));
      [x, y, z] = [x, y, z].map(vector => turnedAbout(axis, angle, vector));
    } else {
      const turned = plus(scaled(x, Math.cos(a)), y, Math.sin(a));
      y = plus(scaled(y, Math.cos(a)), x, -Math.sin(a));
      x = plus(scaled(turned, Math.cos(b)), z, -Math.sin(b));
      z = plus(scaled(z, Math.cos(b)), turned, Math.sin(b));
    }
    point = plus(point, x, arm.lengths[link] + grown[link] + grown[link + 1]);
    points.push(point.slice(0, dimension));
    // Corners of the bodies on the link, in its frame.
    for (const [along, left, up] of arm.corners[link] ?? []) {
      points.push(plus(plus(plus(point, x, along), y, left), z, up ?? 0).slice(0, dimension));
    }
  }
  return points;
}

class Motion {
  constructor(arm, groups, unit) {
    this.arm = arm;
    this.unit = unit;
    this.bends = groups.get("bends");
    this.feed = groups.get("feed");
    this.tracking = groups.get("tracking");
    this.duration = this.bends.time[this.bends.time.length - 1];
  }

  bendsAt(time) {
    return this.bends.columns.map(column => DEGREE * valueAt(this.bends.time, column, time));
  }

  feedAt(time) {
    if (!this.feed) return 0;
    return this.unit.metres * this.feed.columns.reduce((sum, column) => sum + valueAt(this.feed.time, column, time), 0);
  }

  pointsAt(time) {
    return armPoints(this.arm, this.bendsAt(time), this.feedAt(time));
  }

  simulatedPointsAt(time) {
    const away = this.tracking.columns.map(column => DEGREE * valueAt(this.tracking.time, column, time));
    const bends = this.bendsAt(time).map((bend, k) => bend + away[k]);
    return armPoints(this.arm, bends, this.feedAt(time));
  }

  tipAt(time) {
    return this.pointsAt(time).at(-1);
  }

  tips(count) {
    return Array.from({ length: count }, (_, k) => this.tipAt((this.duration * k) / (count - 1)));
  }

  // Where the last link, or the tool, points, a unit vector.
  pointingAt(time) {
    const points = this.pointsAt(time);
    const along = plus(points.at(-1), points.at(-2), -1);
    return scaled(along, 1 / norm(along));
  }

  // Times at which all joints have travelled about equally far, both ends among them.
  evenTimes(count) {
    const travelled = [0];
    const times = [0];
    let before = this.pointsAt(0);
    for (let k = 1; k <= 200; k++) {
      const time = (this.duration * k) / 200;
      const points = this.pointsAt(time);
      const moved = points.reduce((sum, p, i) => sum + norm(plus(p, before[i], -1)), 0);
      travelled.push(travelled[k - 1] + moved);
      times.push(time);
      before = points;
    }
    const whole = travelled[travelled.length - 1];
    return Array.from({ length: count }, (_, k) => valueAt(travelled, times, (whole * k) / (count - 1)));
  }
}
