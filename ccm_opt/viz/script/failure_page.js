// The page of a problem without a plan: the scene with what stands in the way.

const LAYERS = [
  { name: "start", words: "start", look: "arm", on: true },
  { name: "goals", words: "goals", look: "goal", on: true },
  { name: "findings", words: "what stands in the way", look: "least", on: true },
  { name: "names", words: "names", look: "names", on: true },
];

const DRAWN = {
  circle: (scene, mark) => scene.circle("findings", mark.place, mark.radius, "reach"),
  disc: (scene, mark) => scene.circle("findings", mark.place, mark.radius, "too-thick"),
  way: (scene, mark) => scene.polyline("findings", mark.points, "long-way"),
  gap: (scene, mark) => scene.polyline("findings", mark.points, "narrow-gap"),
  arm: (scene, mark) => scene.body("findings", "curled")(mark.points),
  place: (scene, mark) => drawRing(scene, "findings", mark.place, mark.words),
  words: (scene, mark, goals) => { if (mark.at) drawWords(scene, "findings", mark.at, mark.words, "bad", goals); },
};

function startFailurePage() {
  const data = readData();
  const scene = new Scene(byId("scene"), data.scene, data.unit);
  if (data.start) scene.body("start", "arm")(data.start);
  for (const name of data.blocking) scene.walls.get(name)?.classList.add("blocking");
  for (const mark of data.marks) DRAWN[mark.kind](scene, mark, data.goals);
  drawGoals(scene, data.goals);
  addSwitches(scene, LAYERS.map(layer => (layer.name === "names" ? { ...layer, on: data.scene.named } : layer)));
  startSceneControls(scene, data.scene.bounds);
  scene.refresh();
  startTheme();
  unfoldForPrint();
  document.documentElement.dataset.ready = "failure";
}

startFailurePage();
