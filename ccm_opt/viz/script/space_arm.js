// The arm in space: joints and tip from two bends a joint, at any time of a motion.

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// a + s b
function plus(a, b, s = 1) {
  return [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
}

function scaled(a, s) {
  return [s * a[0], s * a[1], s * a[2]];
}

function norm(a) {
  return Math.hypot(a[0], a[1], a[2]);
}

function unit(a) {
  return scaled(a, 1 / Math.max(norm(a), 1e-300));
}

// A joint turns by a about z, then by b about the new y; its link lies along the new x.
function spacePoints(arm, bends, feed) {
  let x = arm.direction;
  let y = cross(arm.up, arm.direction);
  let z = arm.up;
  let point = plus(arm.base, x, feed);
  const points = [point];
  for (let k = 0; k < bends.length; k += 2) {
    const [ca, sa, cb, sb] = [Math.cos(bends[k]), Math.sin(bends[k]), Math.cos(bends[k + 1]), Math.sin(bends[k + 1])];
    const turned = plus(scaled(x, ca), y, sa);
    y = plus(scaled(y, ca), x, -sa);
    x = plus(scaled(turned, cb), z, -sb);
    z = plus(scaled(z, cb), turned, sb);
    point = plus(point, x, arm.link);
    points.push(point);
  }
  return points;
}

class SpaceMotion {
  constructor(arm, groups, unitOfPage) {
    this.arm = arm;
    this.unit = unitOfPage;
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
    return spacePoints(this.arm, this.bendsAt(time), this.feedAt(time));
  }

  simulatedPointsAt(time) {
    const away = this.tracking.columns.map(column => DEGREE * valueAt(this.tracking.time, column, time));
    const bends = this.bendsAt(time).map((bend, k) => bend + away[k]);
    return spacePoints(this.arm, bends, this.feedAt(time));
  }
}
