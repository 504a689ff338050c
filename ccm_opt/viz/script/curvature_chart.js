// The curvature along the arm at the current time, between the least and the greatest of the whole motion.

function curvatureChart(host, timeline, motion, unit) {
  const { link, links } = motion.arm;
  // The first joint turns the whole arm and bends nothing, so that curvature begins at the second.
  const places = Array.from({ length: links - 1 }, (_, k) => ((k + 1) * link) / unit.metres);
  const perMetre = bend => bend / link;
  const ranges = motion.bends.columns.slice(1).map(column => extremes([column]).map(value => perMetre(DEGREE * value)));
  const limits = motion.bends.limits.slice(1).map(value => perMetre(DEGREE * value));
  const most = Math.max(...ranges.flat().map(Math.abs), 1e-9);
  const bound = Math.min(...limits);
  const high = 1.15 * (bound < 3 * most ? Math.max(bound, most) : most);
  const x = { low: 0, high: (links * link) / unit.metres, title: `along the arm, from the base [${unit.name}]`, fixed: true };
  const bands = [{ x: places, low: ranges.map(range => range[0]), high: ranges.map(range => range[1]), look: "reached" }];
  const levels = [{ value: bound, words: `limit ${threeDigits(bound)} 1/m` }, { value: -bound }];
  const now = () => motion.bendsAt(timeline.time).slice(1).map(perMetre);
  const words = place => {
    const k = Math.min(Math.max(Math.round((place * unit.metres) / link), 1), links - 1);
    const value = now()[k - 1];
    return [`joint ${k + 1}, ${inSeconds(timeline.time)}`, `${threeDigits(value)} 1/m`,
      `${threeDigits((value * link) / DEGREE, 1)}°, limit ±${threeDigits((limits[k - 1] * link) / DEGREE, 1)}°`];
  };
  const chart = new Chart(host, timeline, {
    title: "Curvature along the arm [1/m]",
    content: () => ({
      x: { ...x, place: () => -1 }, y: { low: -high, high }, bands, levels, words,
      curves: [{ name: "now", x: places, y: now(), colour: "var(--arm)", width: 2 }],
    }),
    note: time => `at ${inSeconds(time)}`,
  });
  host.append(html("p", { class: "legend" }, html("span", { class: "soft" },
    "Line: at the current time; band: range over the motion. Counter-clockwise bends are positive.")));
  timeline.follow(() => chart.redraw());
  return chart;
}
