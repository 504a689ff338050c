// The arm in the plane: joints and tip from bends, at any time of a motion.

function armPoints(arm, bends, feed = 0) {
  let heading = arm.heading;
  let x = arm.base[0] + feed * Math.cos(heading);
  let y = arm.base[1] + feed * Math.sin(heading);
  const points = [[x, y]];
  for (const bend of bends) {
    heading += bend;
    x += arm.link * Math.cos(heading);
    y += arm.link * Math.sin(heading);
    points.push([x, y]);
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
    const inUnits = this.feed.columns.reduce((sum, column) => sum + valueAt(this.feed.time, column, time), 0);
    return this.unit.metres * inUnits;
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
    const points = this.pointsAt(time);
    return points[points.length - 1];
  }

  headingAt(time) {
    const heading = this.arm.heading + this.bendsAt(time).reduce((sum, bend) => sum + bend, 0);
    return Math.atan2(Math.sin(heading), Math.cos(heading));
  }

  // Times at which all joints have travelled about equally far, both ends among them.
  evenTimes(count) {
    const travelled = [0];
    const times = [0];
    let before = this.pointsAt(0);
    for (let k = 1; k <= 200; k++) {
      const time = (this.duration * k) / 200;
      const points = this.pointsAt(time);
      const moved = points.reduce((sum, p, i) => sum + Math.hypot(p[0] - before[i][0], p[1] - before[i][1]), 0);
      travelled.push(travelled[k - 1] + moved);
      times.push(time);
      before = points;
    }
    const whole = travelled[travelled.length - 1];
    return Array.from({ length: count }, (_, k) => valueAt(travelled, times, (whole * k) / (count - 1)));
  }
}
