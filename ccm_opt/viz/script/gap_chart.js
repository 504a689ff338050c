// the gaps to walls and between links over time, with the preferred clearance and the clearance.

function gapChart(host, timeline, data, unit, marks) {
  const time = decoded(data.time);
  const inUnit = values => values.map(value => value / unit.metres);
  const walls = inUnit(decoded(data.walls));
  const itself = inUnit(decoded(data.itself));
  const high = data.highest / unit.metres;
  const clearance = data.clearance / unit.metres;
  const wanted = data.wanted / unit.metres;
  const low = -Math.max(clearance, 0.04 * high);
  const text = value => `${threeDigits(value, unit.decimals)} ${unit.name}`;
  const chosen = value => `${given(value, unit.decimals)} ${unit.name}`;
  const reach = data.reach / unit.metres;
  const shown = value => (value >= 0.999 * reach ? `more than ${text(reach)}` : text(value));
  const curves = [
    { name: "between links", x: time, y: itself, colour: "var(--self)", width: 1.5, dotted: true },
    { name: "to walls", x: time, y: walls, colour: "var(--arm)", width: 2.2, dotted: true },
  ];
  const lack = walls.map(value => Math.min(value, wanted));
  const bands = [{ x: [time[0], time[time.length - 1]], low: [low, low], high: [0, 0], look: "contact" }];
  if (wanted) bands.push({ x: Array.from(time), low: Array.from(lack), high: Array.from(lack, () => wanted), look: "lack" });
  const required = clearance ? `required: clearance ${chosen(clearance)} to walls` : "contact";
  const levels = [{ value: 0, words: required, look: "required" }];
  if (wanted) levels.push({ value: wanted, words: `preferred ${chosen(wanted)}`, look: "wanted" });
  const near = data.nearest;
  const dotted = [];
  if (near && near.gap / unit.metres < high) {
    const colour = near.itself ? "var(--self)" : "var(--arm)";
    dotted.push({ x: near.time, y: near.gap / unit.metres, colour, words: `least ${text(near.gap / unit.metres)}, ${near.pair}` });
  }
  const x = { low: 0, high: time[time.length - 1], title: "time [s]" };
  const at = (values, moment) => valueAt(time, values, moment);
  return new Chart(host, timeline, {
    title: `Gap beyond radius and clearance [${unit.name}]`,
    height: 260,
    content: () => ({
      x, y: { low, high }, curves, bands, levels, marks, dotted,
      words: moment => [inSeconds(moment), `to walls: ${shown(at(walls, moment))}`, `between links: ${shown(at(itself, moment))}`],
    }),
    note: moment => `to walls ${shown(at(walls, moment))}, between links ${shown(at(itself, moment))}`,
  });
}
