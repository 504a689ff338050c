// A view of a scene in space that turns: rods and surfaces, drawn by WebGL 2; nothing is loaded for it.

const ROD_SHADER = [`#version 300 es
in vec4 corner; in vec4 begin; in vec4 end; in vec4 colour;
uniform mat4 toScreen; uniform vec3 eye; uniform float pixel;
out vec3 place; out vec3 normal; flat out vec4 tint;
void main() {
  vec3 along = end.xyz - begin.xyz;
  float size = length(along);
  vec3 x = size > 0.0 ? along / size : vec3(1.0, 0.0, 0.0);
  vec3 y = normalize(cross(x, abs(x.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0)));
  vec3 n = corner.y * x + corner.z * y + corner.w * cross(x, y);
  vec4 near = mix(begin, end, corner.x);
  // A radius below zero is in pixels.
  float radius = near.w < 0.0 ? -near.w * pixel * distance(eye, near.xyz) : near.w;
  place = near.xyz + radius * n; normal = n; tint = colour;
  gl_Position = toScreen * vec4(place, 1.0);
}`, `#version 300 es
precision highp float;
in vec3 place; in vec3 normal; flat in vec4 tint;
uniform vec3 eye;
out vec4 seen;
void main() {
  vec3 view = normalize(eye - place);
  vec3 n = normalize(normal);
  float light = 0.45 + 0.4 * max(dot(n, view), 0.0) + 0.2 * max(n.z, 0.0);
  seen = vec4(tint.rgb * light, tint.a);
}`];

const SURFACE_SHADER = [`#version 300 es
in vec3 corner;
uniform mat4 toScreen;
out vec3 place;
void main() { place = corner; gl_Position = toScreen * vec4(corner, 1.0); }`, `#version 300 es
precision highp float;
in vec3 place;
uniform vec3 eye; uniform vec4 tint; uniform float flatness; uniform vec4 cut;
out vec4 seen;
void main() {
  if (dot(cut.xyz, place) > cut.w) discard;
  if (flatness > 0.5) {
    seen = tint;
    return;
  }
  vec3 view = normalize(eye - place);
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  float facing = abs(dot(n, view));
  float light = 0.6 + 0.4 * facing;
  // Glass: what is seen edge-on is less clear.
  float opacity = tint.a * (0.6 + 1.4 * (1.0 - facing) * (1.0 - facing));
  seen = vec4(tint.rgb * light, min(opacity, 1.0));
}`];

function program(gl, [vertex, fragment]) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made) ?? "no program");
  return { made, uniform: name => gl.getUniformLocation(made, name), place: name => gl.getAttribLocation(made, name) };
}

// Distance of the eye at which half of the shorter side of the picture is seen, in lengths of that half.
const OPENING = 3;

// A rod with round ends: for every corner which end it is at (0 or 1), and its normal along and across the rod.
function rodCorners(sides, rings) {
  const corners = [];
  const rows = [];
  for (const end of [0, 1]) {
    for (let ring = 0; ring <= rings; ring++) {
      const tilt = ((end === 0 ? ring - rings : ring) / rings) * (Math.PI / 2);
      rows.push([end, Math.sin(tilt), Math.cos(tilt)]);
    }
  }
  for (const [end, along, across] of rows) {
    for (let k = 0; k < sides; k++) {
      const angle = (2 * Math.PI * k) / sides;
      corners.push(end, along, across * Math.cos(angle), across * Math.sin(angle));
    }
  }
  const faces = [];
  for (let row = 0; row + 1 < rows.length; row++) {
    for (let k = 0; k < sides; k++) {
      const [a, b] = [row * sides + k, row * sides + ((k + 1) % sides)];
      faces.push(a, b, a + sides, b, b + sides, a + sides);
    }
  }
  return { corners: new Float32Array(corners), faces: new Uint16Array(faces) };
}

function colourOf(name, opacity = 1) {
  const probe = html("span");
  probe.style.color = `var(--${name})`;
  document.body.append(probe);
  const [r, g, b] = getComputedStyle(probe).color.match(/[\d.]+/g).map(Number);
  probe.remove();
  return [r / 255, g / 255, b / 255, opacity];
}

function bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
}

// Corners in steps of the extent of a body, as whole numbers of 16 bits.
function bodyCorners(body) {
  const whole = new Uint16Array(bytes(body.corners));
  return Float32Array.from(whole, (value, k) => body.low[k % 3] + (value * body.span[k % 3]) / 65535);
}

function armRods(arm, points, colour, opacity) {
  const radius = k => arm.radii[k] || -1.5;
  return points.slice(1).map((point, k) => [points[k], point, radius(k), radius(k), colour, opacity]);
}

function goalRods(goal, arm, reach) {
  const size = 0.8 * (arm.radius || 0.01 * reach);
  const rods = [[goal.place, goal.place, size, size, "good", 1]];
  if (goal.direction) {
    const tip = plus(goal.place, goal.direction, 3 * arm.link);
    const neck = plus(goal.place, goal.direction, 2.2 * arm.link);
    rods.push([goal.place, neck, 0.3 * size, 0.3 * size, "good", 1], [neck, tip, 0.9 * size, 0, "good", 1]);
  }
  for (const place of goal.via) rods.push([place, place, size, size, "amber", 1]);
  if (goal.sight.length) {
    const [line, edge] = goal.sight;
    rods.push([line[0], line[1], 0.15 * size, 0.15 * size, "good", 1]);
    for (let k = 1; k < edge.length; k++) rods.push([edge[k - 1], edge[k], 0.1 * size, 0.1 * size, "good", 0.7]);
    for (let k = 0; k + 1 < edge.length; k += 3) rods.push([line[0], edge[k], 0.1 * size, 0.1 * size, "good", 0.7]);
  }
  return rods;
}

function surfaceRods(surface, arm, reach) {
  const size = 0.15 * (arm.radius || 0.01 * reach);
  return Object.entries(surface).flatMap(([look, places]) => places.map(place => [place, place, size, size, look, 1]));
}

function linked(points, radius) {
  return points.slice(1).map((point, k) => [points[k], point, radius, radius, "bad", 1]);
}

// What passes a gap stands inside of what would have to.
const FINDING_RODS = {
  place: ({ place }, arm, size) => [[place, place, size, size, "bad", 0.6]],
  disc: ({ place, radius, room }) => [[place, place, room, room, "amber", 1], [place, place, radius, radius, "bad", 0.35]],
  way: ({ points }) => linked(points, -1.4),
  gap: ({ points }) => linked(points, -2.4),
  arm: ({ points }, arm) => armRods(arm, points, "bad", 0.4),
};

function boxRods([low, high]) {
  const corner = k => [0, 1, 2].map(axis => (k & (1 << axis) ? high : low)[axis]);
  const rods = [];
  for (let k = 0; k < 8; k++) {
    for (const bit of [1, 2, 4]) if (!(k & bit)) rods.push([corner(k), corner(k | bit), -0.8, -0.8, "edge", 1]);
  }
  return rods;
}

class SpaceView {
  constructor(host, { scene }) {
    this.canvas = html("canvas", { class: "space", tabindex: 0, role: "img", "aria-label": host.dataset.label });
    host.append(this.canvas);
    this.gl = this.canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    this.layers = new Map();
    this.surfaces = [];
    this.hidden = new Set();
    this.camera = { target: [0, 0, 0], distance: 1, yaw: -0.9, pitch: 0.5 };
    this.clarity = 0.2;
    this.cut = null;
    this.waiting = false;
    const looks = { "look-x": [0, 0], "look-y": [-Math.PI / 2, 0], "look-z": [-Math.PI / 2, 1.55], "look-slant": [-0.9, 0.5] };
    this.sides = Object.fromEntries(Object.entries(looks).map(([id, look]) => [id, () => {
      this.look(...look);
      this.fit(this.fitted);
    }]));
    this.listenToSliders(scene.extent);
    if (!this.gl) {
      host.append(html("p", { class: "soft" }, "This browser has no WebGL 2; see the picture plan.png."));
      return;
    }
    this.prepare();
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    this.listen();
  }

  draw(data, motion) {
    const { arm, bodies, room, start, goals } = data.scene;
    const reach = arm.links * arm.link;
    for (const body of bodies) {
      const faces = new Uint32Array(bytes(body.faces));
      const colour = data.blocking?.includes(body.name) ? "bad" : "edge";
      this.addSurface("bodies", bodyCorners(body), faces, new Uint32Array(bytes(body.edges)), colour);
    }
    if (room) this.setRods("room", boxRods(room));
    this.setRods("surface", surfaceRods(data.scene.surface ?? {}, arm, reach));
    this.setRods("goals", goals.flatMap(goal => goalRods(goal, arm, reach)));
    if (!motion) {
      this.setRods("start", armRods(arm, start, "arm", 1));
      const size = 1.3 * (arm.radius || 0.01 * reach);
      this.setRods("findings", data.marks.flatMap(mark => FINDING_RODS[mark.kind]?.(mark, arm, size) ?? []));
      return null;
    }
    this.setRods("start", armRods(arm, start, "start", 0.4));
    this.setRods("end", armRods(arm, motion.pointsAt(motion.duration), "good", 0.3));
    const tips = motion.tips(300);
    this.setRods("tip", tips.slice(1).map((tip, k) => [tips[k], tip, -1.1, -1.1, "tip", 1]));
    const pose = time => {
      this.setRods("arm", armRods(arm, motion.pointsAt(time), "arm", 1));
      if (motion.tracking) this.setRods("simulated", armRods(arm, motion.simulatedPointsAt(time), "tip", 0.4));
    };
    pose(0);
    return pose;
  }

  // How clear obstacles are, and a plane across the direction that is chosen, from beyond everything to before it.
  listenToSliders([low, high]) {
    byId("clarity").addEventListener("input", event => {
      this.clarity = Number(event.target.value);
      this.redraw();
    });
    const cut = () => {
      const axis = Number(byId("cut-axis").value);
      const share = Number(byId("cut").value);
      const normal = [0, 1, 2].map(k => (k === axis ? 1 : 0));
      this.cut = share >= 1 ? null : [...normal, low[axis] + share * (high[axis] - low[axis])];
      this.redraw();
    };
    for (const id of ["cut", "cut-axis"]) byId(id).addEventListener("input", cut);
  }

  prepare() {
    const gl = this.gl;
    this.rod = program(gl, ROD_SHADER);
    this.surface = program(gl, SURFACE_SHADER);
    const { corners, faces } = rodCorners(14, 4);
    this.rodFaces = faces.length;
    this.rodArray = gl.createVertexArray();
    gl.bindVertexArray(this.rodArray);
    this.fill(gl.ARRAY_BUFFER, corners);
    gl.enableVertexAttribArray(this.rod.place("corner"));
    gl.vertexAttribPointer(this.rod.place("corner"), 4, gl.FLOAT, false, 0, 0);
    this.fill(gl.ELEMENT_ARRAY_BUFFER, faces);
    this.instances = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    ["begin", "end", "colour"].forEach((name, k) => {
      const place = this.rod.place(name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 4, gl.FLOAT, false, 48, 16 * k);
      gl.vertexAttribDivisor(place, 1);
    });
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  fill(target, values) {
    const buffer = this.gl.createBuffer();
    this.gl.bindBuffer(target, buffer);
    this.gl.bufferData(target, values, this.gl.STATIC_DRAW);
    return buffer;
  }

  // Corners [x, y, z, …], faces and sharp edges as numbers of corners.
  addSurface(layer, corners, faces, edges, colour) {
    this.layers.set(layer, []);
    if (!this.gl) return;
    const gl = this.gl;
    const vertices = this.fill(gl.ARRAY_BUFFER, corners);
    const array = indices => {
      const made = gl.createVertexArray();
      gl.bindVertexArray(made);
      gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
      gl.enableVertexAttribArray(this.surface.place("corner"));
      gl.vertexAttribPointer(this.surface.place("corner"), 3, gl.FLOAT, false, 0, 0);
      this.fill(gl.ELEMENT_ARRAY_BUFFER, indices);
      gl.bindVertexArray(null);
      return made;
    };
    this.surfaces.push({ layer, colour, faces: array(faces), count: faces.length, edges: array(edges), lines: edges.length });
  }

  // Rods of a layer: [begin, end, radius at the begin, radius at the end, colour name, opacity].
  setRods(layer, rods) {
    this.layers.set(layer, rods);
    this.redraw();
  }

  show(layer, on) {
    if (on) this.hidden.delete(layer);
    else this.hidden.add(layer);
    this.redraw();
  }

  // Seen from the chosen side, a box fills the picture but for a margin.
  fit(box) {
    this.fitted = box;
    const { right, up, back } = this.frame();
    const seen = [...Array(8).keys()].map(n => {
      const corner = [0, 1, 2].map(k => box[(n >> k) & 1][k]);
      return [right, up, back].map(axis => dot(axis, corner));
    });
    const middle = [0, 1, 2].map(k => {
      const places = seen.map(corner => corner[k]);
      return 0.5 * (Math.min(...places) + Math.max(...places));
    });
    const aspect = this.canvas.clientWidth / this.canvas.clientHeight || 1;
    const zoom = 1.1 * OPENING * Math.min(1, aspect);
    this.camera.distance = Math.max(1e-9, ...seen.map(corner => {
      const [x, y, z] = plus(corner, middle, -1);
      return z + zoom * Math.max(Math.abs(x) / aspect, Math.abs(y));
    }));
    this.camera.target = plus(plus(scaled(right, middle[0]), up, middle[1]), back, middle[2]);
    this.redraw();
  }

  zoom(factor) {
    this.camera.distance /= factor;
    this.redraw();
  }

  look(yaw, pitch) {
    this.camera.yaw = yaw;
    this.camera.pitch = pitch;
    this.redraw();
  }

  frame() {
    const { target, distance, yaw, pitch } = this.camera;
    const back = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    return { eye: plus(target, back, distance), back, right, up: cross(back, right) };
  }

  matrix({ eye, back, right, up }) {
    const aspect = this.canvas.width / this.canvas.height;
    const zoom = OPENING * Math.min(1, aspect);
    const [near, far] = [0.01 * this.camera.distance, 20 * this.camera.distance];
    const [a, b] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
    const rows = [[right, zoom / aspect], [up, zoom]];
    const [x, y] = rows.map(([axis, s]) => [...scaled(axis, s), -s * dot(axis, eye)]);
    const depth = [...back, -dot(back, eye)];
    const z = [a * depth[0], a * depth[1], a * depth[2], a * depth[3] + b];
    const w = depth.map(value => -value);
    return new Float32Array([0, 1, 2, 3].flatMap(k => [x[k], y[k], z[k], w[k]]));
  }

  redraw() {
    if (!this.gl || this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
    });
  }

  paint() {
    const gl = this.gl;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map(side => Math.round(ratio * side));
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(...colourOf("ground"));
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const frame = this.frame();
    const toScreen = this.matrix(frame);
    this.drawRods(toScreen, frame.eye, 2 / (3 * height), false);
    gl.enable(gl.BLEND);
    // Clear rods hide each other, or their joints would be seen twice; surfaces hide nothing.
    this.drawRods(toScreen, frame.eye, 2 / (3 * height), true);
    this.drawEdges(toScreen, frame.eye);
    gl.depthMask(false);
    this.drawSurfaces(toScreen, frame.eye);
    gl.disable(gl.BLEND);
  }

  drawRods(toScreen, eye, pixel, clear) {
    const gl = this.gl;
    const shown = [...this.layers].filter(([layer]) => !this.hidden.has(layer)).flatMap(([, rods]) => rods);
    const some = shown.filter(rod => rod[5] < 1 === clear);
    if (!some.length) return;
    const colours = new Map();
    const values = new Float32Array(12 * some.length);
    some.forEach(([begin, end, first, last, name, opacity], k) => {
      if (!colours.has(name)) colours.set(name, colourOf(name));
      values.set([...begin, first, ...end, last, ...colours.get(name).slice(0, 3), opacity], 12 * k);
    });
    gl.useProgram(this.rod.made);
    gl.uniformMatrix4fv(this.rod.uniform("toScreen"), false, toScreen);
    gl.uniform3fv(this.rod.uniform("eye"), eye);
    gl.uniform1f(this.rod.uniform("pixel"), pixel);
    gl.bindVertexArray(this.rodArray);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.drawElementsInstanced(gl.TRIANGLES, this.rodFaces, gl.UNSIGNED_SHORT, 0, some.length);
    gl.bindVertexArray(null);
  }

  useSurfaces(toScreen, eye, flatness) {
    const gl = this.gl;
    gl.useProgram(this.surface.made);
    gl.uniformMatrix4fv(this.surface.uniform("toScreen"), false, toScreen);
    gl.uniform3fv(this.surface.uniform("eye"), eye);
    gl.uniform1f(this.surface.uniform("flatness"), flatness);
    gl.uniform4fv(this.surface.uniform("cut"), this.cut ?? [0, 0, 0, 1]);
  }

  drawSurfaces(toScreen, eye) {
    const gl = this.gl;
    this.useSurfaces(toScreen, eye, 0);
    for (const surface of this.surfaces) {
      if (this.hidden.has(surface.layer)) continue;
      gl.uniform4fv(this.surface.uniform("tint"), colourOf(surface.colour, this.clarity));
      gl.bindVertexArray(surface.faces);
      gl.drawElements(gl.TRIANGLES, surface.count, gl.UNSIGNED_INT, 0);
    }
    gl.bindVertexArray(null);
  }

  drawEdges(toScreen, eye) {
    const gl = this.gl;
    this.useSurfaces(toScreen, eye, 1);
    gl.uniform4fv(this.surface.uniform("tint"), colourOf("edge", 0.7));
    for (const surface of this.surfaces) {
      if (this.hidden.has(surface.layer)) continue;
      gl.bindVertexArray(surface.edges);
      gl.drawElements(gl.LINES, surface.lines, gl.UNSIGNED_INT, 0);
    }
    gl.bindVertexArray(null);
  }

  // Drag turns; with Shift, the right button or two fingers it moves; the wheel with Ctrl, or pinching, zooms.
  listen() {
    const fingers = new Map();
    const canvas = this.canvas;
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    const lift = event => fingers.delete(event.pointerId);
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, lift);
    canvas.addEventListener("pointermove", event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const moved = [now[0] - before[0], now[1] - before[1]];
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const span = point => Math.max(Math.hypot(point[0] - other[0], point[1] - other[1]), 1);
        this.camera.distance *= span(before) / span(now);
        this.move(0.5 * moved[0], 0.5 * moved[1]);
      } else if (event.shiftKey || event.buttons & 2) {
        this.move(...moved);
      } else {
        this.turn(...moved);
      }
      fingers.set(event.pointerId, now);
    });
    canvas.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.0025 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.zoom(1.6));
  }

  turn(right, down) {
    const pitch = this.camera.pitch + 0.008 * down;
    this.look(this.camera.yaw - 0.008 * right, Math.min(Math.max(pitch, -1.55), 1.55));
  }

  move(right, down) {
    const frame = this.frame();
    const step = (0.67 * this.camera.distance) / this.canvas.clientHeight;
    this.camera.target = plus(plus(this.camera.target, frame.right, -step * right), frame.up, step * down);
    this.redraw();
  }
}
