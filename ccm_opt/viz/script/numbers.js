// Numbers as people read them, and round numbers for axes; the same rules as page_units.py.

const DEGREE = Math.PI / 180;

function threeDigits(value, finest = 3) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const decimals = size === 0 ? finest : Math.min(Math.max(2 - Math.floor(Math.log10(size)), 0), finest);
  const text = size.toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

// The number of somebody's choice, such as a limit: without zeros behind its last digit.
function given(value, finest = 3) {
  const text = threeDigits(value, finest);
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

// Decimals with which values up to a size are told apart, at most.
function decimalsFor(size) {
  return size > 0 ? Math.min(Math.max(3 - Math.floor(Math.log10(size)), 0), 9) : 2;
}

function inSeconds(time) {
  return `${time.toFixed(2)} s`;
}

function roundStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(factor => power * factor >= rough * (1 - 1e-9));
}

// Round numbers in an interval, at most about so many, with the decimals that they need.
function ticksBetween(low, high, most) {
  if (!(high > low)) return { values: [low], decimals: 2 };
  const step = roundStep((high - low) / Math.max(most, 1));
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= Math.floor(high / step + 1e-9); k++) values.push(k * step);
  return { values, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Of a range that is seen by ratios: 1, 2 and 5 times powers of ten, or those powers alone.
function ticksByRatio(low, high, most) {
  const decades = Math.log10(high / low);
  const steps = decades * 3 <= most + 1 ? [1, 2, 5] : [1];
  const values = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++) {
    for (const step of steps) values.push(step * 10 ** power);
  }
  const inside = values.filter(value => value >= low && value <= high);
  return inside.length > 1 ? { values: inside, decimals: 0 } : ticksBetween(low, high, Math.min(most, 3));
}

function tickText(value, decimals, ratio = false) {
  if (ratio) return String(Number(value.toPrecision(3))).replace("-", "−");
  if (decimals > 4 || Math.abs(value) >= 1e6) return value.toExponential(1).replace("-", "−");
  return (Math.abs(value) < 1e-12 ? 0 : value).toFixed(decimals).replace("-", "−");
}
