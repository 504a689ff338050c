// Where no graphics card renders the page, draws matt surfaces, what moves with fewer pixels, and sharply what rests.
(() => {
  const SHARES = [0.75, 0.55, 0.4]; // of the pixels along each side, while something moves: as many as come in time
  const [SOON, USUAL, LATE] = [20, 30, 40]; // mean time of a frame: with more pixels next time, at first, with fewer [ms]
  const REST = 700; // time without a frame after which the next one is sharp, below the second between frames at rest [ms]
  const native = HTMLCanvasElement.prototype.getContext;
  const probe = native.call(document.createElement("canvas"), "webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? probe.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer)) return;

  // Lights surfaces as matt ones, in two thirds of the time: those of the scene reflect little.
  function matt(text) {
    if (!/define RE_Direct\s+RE_Direct_Physical[^]*material\.diffuseContribution/.test(text)) return text;
    return text.replace(/#define RE_\w+\s+RE_\w+_Physical/g, "").replace("void main() {", `
      #define MATT BRDF_Lambert(material.diffuseContribution)
      #define RE_Direct(L, p, n, v, c, m, sum) sum.directDiffuse += saturate(dot(n, L.direction)) * L.color * MATT
      #define RE_IndirectDiffuse(light, p, n, v, c, m, sum) sum.indirectDiffuse += light * MATT
      void main() {`);
  }

  // Returns what chooses the share of the pixels for a frame, given the time since the one before [ms].
  function pacing() {
    let [level, mean] = [1, USUAL];
    return (time) => {
      const rests = time > REST;
      if (!rests) mean += 0.1 * (Math.min(time, 2 * LATE) - mean);
      if (mean > LATE && level + 1 < SHARES.length) [level, mean] = [level + 1, USUAL];
      if (rests && mean < SOON && level) [level, mean] = [level - 1, USUAL];
      return rests ? 1 : SHARES[level];
    };
  }

  function coarsen(canvas, gl) {
    const size = { width: canvas.width, height: canvas.height };
    let [share, onScreen, seen, last] = [1, true, [0, 0, canvas.width, canvas.height], -Infinity];
    const [resize, chosen] = [{}, pacing()];
    for (const side of ["width", "height"]) {
      const { set } = Object.getOwnPropertyDescriptor(HTMLCanvasElement.prototype, side);
      resize[side] = () => set.call(canvas, Math.max(1, Math.round(share * size[side])));
      Object.defineProperty(canvas, side, {
        get: () => size[side],
        set: (value) => { size[side] = value; resize[side](); },
      });
    }
    // viser draws slow scenes with three quarters of the pixels, and goes on so when they rest.
    const whole = () => (canvas.clientWidth * Math.min(devicePixelRatio, 2)) / size.width || 1;
    const { viewport, bindFramebuffer, clear, shaderSource } = gl;
    gl.shaderSource = (shader, text) => shaderSource.call(gl, shader, matt(text));
    const look = () => viewport.apply(gl, onScreen ? seen.map((value) => Math.round(share * value)) : seen);
    gl.viewport = (...box) => { seen = box; look(); };
    gl.bindFramebuffer = (target, buffer) => {
      bindFramebuffer.call(gl, target, buffer);
      if (target === gl.READ_FRAMEBUFFER || onScreen === !buffer) return;
      onScreen = !buffer;
      look();
    };
    gl.clear = (bits) => {
      const now = document.timeline.currentTime; // the same for all of a frame
      if (onScreen && now !== last) {
        const wanted = whole() * chosen(now - last);
        last = now;
        if (wanted !== share) {
          share = wanted;
          resize.width();
          resize.height();
          look();
        }
      }
      clear.call(gl, bits);
    };
  }

  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    if (kind !== "webgl2") return native.call(this, kind, options);
    const gl = native.call(this, kind, { ...options, antialias: false });
    if (gl && !Object.hasOwn(gl, "clear")) coarsen(this, gl);
    return gl;
  };
})();
