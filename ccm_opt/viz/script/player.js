// The bar below the page: play, time, speed; and the keys that do the same.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

function startPlayer(timeline, marks) {
  const play = byId("play");
  const slider = byId("time");
  const clock = byId("clock");
  const speed = byId("speed");
  slider.max = timeline.duration;
  slider.step = timeline.duration / 1000;
  for (const value of SPEEDS) speed.append(html("option", { value, selected: value === 1 }, `${value}×`));
  timeline.follow(time => {
    slider.value = time;
    slider.setAttribute("aria-valuetext", inSeconds(time));
    clock.textContent = `${time.toFixed(2)} / ${timeline.duration.toFixed(2)} s`;
  });
  timeline.onSwitch(on => {
    play.textContent = on ? "Pause" : "Play";
    play.setAttribute("aria-pressed", on);
  });
  play.addEventListener("click", () => timeline.toggle());
  slider.addEventListener("input", () => timeline.pick(Number(slider.value)));
  speed.addEventListener("change", () => { timeline.speed = Number(speed.value); });
  byId("loop").addEventListener("change", event => { timeline.loops = event.target.checked; });
  drawMarks(timeline, marks);
  listenToKeys(timeline, speed);
}

function drawMarks(timeline, marks) {
  for (const mark of marks) {
    const button = html("button", { type: "button", class: `mark ${mark.look}`, title: mark.title }, mark.words);
    button.style.left = `${(100 * mark.at) / timeline.duration}%`;
    button.addEventListener("click", () => timeline.pick(mark.at));
    byId("marks").append(button);
  }
}

function changeSpeed(timeline, speed, by) {
  const next = SPEEDS[Math.min(Math.max(SPEEDS.indexOf(timeline.speed) + by, 0), SPEEDS.length - 1)];
  timeline.speed = next;
  speed.value = next;
}

function listenToKeys(timeline, speed) {
  const step = event => (event.shiftKey ? 0.1 : 0.01) * timeline.duration;
  const keys = {
    " ": () => timeline.toggle(),
    ArrowLeft: event => timeline.pick(timeline.time - step(event)),
    ArrowRight: event => timeline.pick(timeline.time + step(event)),
    Home: () => timeline.pick(0),
    End: () => timeline.pick(timeline.duration),
    "[": () => changeSpeed(timeline, speed, -1),
    "]": () => changeSpeed(timeline, speed, 1),
  };
  document.addEventListener("keydown", event => {
    const busy = event.target.closest("select, input[type=checkbox], button, summary, a");
    if (event.ctrlKey || event.metaKey || event.altKey || (busy && event.key === " ")) return;
    if (event.target.closest("select") || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key](event);
  });
}
