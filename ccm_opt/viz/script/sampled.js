// Curves that are known at samples: read from the page's data, and linear in between.

function decoded(array) {
  const values = new Float64Array(array.d.length);
  let whole = 0;
  array.d.forEach((difference, k) => {
    whole += difference;
    values[k] = whole * array.step;
  });
  return values;
}

// Number of the sample at or before a place, at most the last but one.
function sampleBefore(places, place) {
  let low = 0;
  let high = places.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (places[middle] <= place) low = middle;
    else high = middle;
  }
  return low;
}

function nearestSample(places, place) {
  const k = sampleBefore(places, place);
  return k + 1 < places.length && places[k + 1] - place < place - places[k] ? k + 1 : k;
}

function valueAt(places, values, place) {
  if (places.length < 2) return values[0];
  const k = sampleBefore(places, place);
  const width = places[k + 1] - places[k];
  const share = width > 0 ? Math.min(Math.max((place - places[k]) / width, 0), 1) : 0;
  return values[k] + share * (values[k + 1] - values[k]);
}

function extremes(columns) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of columns) {
    for (const value of column) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return [low, high];
}
