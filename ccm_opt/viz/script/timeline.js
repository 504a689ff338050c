// The current time: everything on the page follows it.

class Timeline {
  constructor(duration) {
    this.duration = duration;
    this.time = 0;
    this.speed = 1;
    this.loops = true;
    this.playing = false;
    this.followers = [];
    this.switched = [];
  }

  follow(follower) {
    this.followers.push(follower);
  }

  onSwitch(listener) {
    this.switched.push(listener);
  }

  go(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    for (const follower of this.followers) follower(this.time);
  }

  pick(time) {
    this.pause();
    this.go(time);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.playing || this.duration <= 0) return;
    if (this.time >= this.duration) this.go(0);
    this.playing = true;
    this.rest = 0;
    let before = performance.now();
    const step = now => {
      if (!this.playing) return;
      this.advance((Math.max(now - before, 0) / 1000) * this.speed);
      before = now;
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
    this.switched.forEach(listener => listener(true));
  }

  advance(seconds) {
    if (this.time < this.duration) {
      this.go(this.time + seconds);
      return;
    }
    if (!this.loops) {
      this.pause();
      return;
    }
    // The arm is seen at its goal for a while before it begins again.
    this.rest += seconds / this.speed;
    if (this.rest > 0.8) {
      this.rest = 0;
      this.go(0);
    }
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.switched.forEach(listener => listener(false));
  }
}
