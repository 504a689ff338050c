// The page of a comparison.

function searchRuns() {
  const rows = [...document.querySelectorAll("table.runs tbody tr")];
  byId("search").addEventListener("input", event => {
    const words = event.target.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) row.hidden = !words.every(word => row.textContent.toLowerCase().includes(word));
  });
}

function sortByHeads(table) {
  const body = table.tBodies[0];
  const key = text => (Number.isFinite(Number.parseFloat(text.replace("−", "-"))) ? Number.parseFloat(text.replace("−", "-")) : text);
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    let up = true;
    const sort = () => {
      const rows = [...body.rows].sort((one, other) => {
        const [a, b] = [one, other].map(row => key(row.cells[column].textContent));
        if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
        return (a < b ? -1 : Number(a > b)) * (up ? 1 : -1);
      });
      body.append(...rows);
      up = !up;
    };
    head.tabIndex = 0;
    head.addEventListener("click", sort);
    head.addEventListener("keydown", event => { if (event.key === "Enter") sort(); });
  });
}

function startComparisonPage() {
  const data = JSON.parse(byId("data").textContent);
  successChart(byId("success"), data);
  for (const host of document.querySelectorAll("[data-pair]")) {
    const pair = data.pairs[Number(host.dataset.pair)];
    for (const quantity of data.quantities) scatterChart(host, data, pair, quantity);
  }
  searchRuns();
  document.querySelectorAll("table.runs").forEach(sortByHeads);
  startTheme();
  document.documentElement.dataset.ready = "comparison";
}

startComparisonPage();
