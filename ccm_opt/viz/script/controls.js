// Buttons and switches of the scene, and what every page with a scene does.

function startSceneControls(scene, roomBounds) {
  const view = scene.view;
  const buttons = { "zoom-in": () => view.zoom(1.4), "zoom-out": () => view.zoom(1 / 1.4),
    fit: () => view.fit(scene.data.look), room: () => view.fit(roomBounds) };
  for (const [id, act] of Object.entries(buttons)) byId(id).addEventListener("click", act);
  const keys = { "+": () => view.zoom(1.4), "=": () => view.zoom(1.4), "-": () => view.zoom(1 / 1.4),
    0: () => view.fit(scene.data.look), r: () => view.fit(roomBounds) };
  document.addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select")) return;
    if (event.key in keys) keys[event.key]();
  });
  const place = byId("place");
  scene.drawing.addEventListener("pointermove", event => {
    const [x, y] = view.toPlane(view.pixelOf(event)).map(value => value / scene.unit.metres);
    place.textContent = `x ${threeDigits(x, 1)}, y ${threeDigits(y, 1)} ${scene.unit.name}`;
  });
  scene.drawing.addEventListener("pointerleave", () => { place.textContent = ""; });
}

// A switch for every layer that there is, with a swatch as it looks in the scene.
function addSwitches(scene, layers) {
  for (const { name, words, look, on } of layers) {
    if (!scene.layers.has(name)) continue;
    const box = html("input", { type: "checkbox", checked: on });
    box.addEventListener("change", () => scene.show(name, box.checked));
    byId("layers").append(html("label", {}, box, html("i", { class: `swatch ${look}` }), words));
    scene.show(name, on);
  }
}

function unfoldForPrint() {
  window.addEventListener("beforeprint", () => {
    for (const details of document.querySelectorAll("main details")) details.open = true;
  });
}

function readData() {
  return JSON.parse(byId("data").textContent);
}
