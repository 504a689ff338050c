// Sends what keyboard and gamepad ask of the tip, 25 times a second while the arm is driven; a page that is hidden or
// closed sends nothing, so that the arm is braked.
(() => {
  const KEYS = {
    ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1],
    PageDown: [2, -1], KeyS: [2, -1], PageUp: [2, 1], KeyW: [2, 1],
  };
  const DEAD_ZONE = 0.15; // of a stick
  const held = new Set();
  let driving = false;
  let turning = false;
  let socket;

  function connect() {
    socket = new WebSocket(`ws://${location.host}${location.pathname.replace(/\/+$/, "")}/hand`);
    socket.onmessage = (event) => { driving = event.data === "driving"; };
    socket.onclose = () => { driving = false; setTimeout(connect, 1000); };
  }

  function onKey(event) {
    const writes = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName) && event.target.type !== "checkbox";
    turning = event.shiftKey;
    if (event.type === "keyup") held.delete(event.code);
    if (!driving || writes || !(event.code in KEYS)) return;
    if (event.type === "keydown") held.add(event.code);
    event.preventDefault();
    event.stopImmediatePropagation(); // these keys move the camera otherwise
  }

  function asked() {
    const hand = [0, 0, 0];
    for (const code of held) hand[KEYS[code][0]] += KEYS[code][1];
    let turns = turning;
    for (const pad of navigator.getGamepads()) {
      if (!pad) continue;
      const stick = (axis) => (Math.abs(pad.axes[axis] || 0) > DEAD_ZONE ? pad.axes[axis] : 0);
      hand[0] += stick(0);
      hand[1] -= stick(1);
      hand[2] -= stick(3);
      turns = turns || pad.buttons.slice(4, 6).some((button) => button.pressed); // the shoulders
    }
    return { hand: hand.map((value) => Math.max(-1, Math.min(1, value))), turns };
  }

  let waited = 0;
  function send() {
    waited = (waited + 1) % 10;
    if (document.hidden || socket.readyState !== WebSocket.OPEN || (!driving && waited)) return;
    socket.send(JSON.stringify(asked()));
  }

  for (const kind of ["keydown", "keyup"]) window.addEventListener(kind, onKey, true);
  window.addEventListener("blur", () => held.clear());
  connect();
  setInterval(send, 40);
})();
