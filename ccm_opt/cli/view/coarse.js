// Where no graphics card renders the page, draws what moves with fewer pixels, and sharply again once it rests.
(() => {
  const SHARE = 0.55; // of the pixels along each side, while something moves
  const REST = 700; // time without a frame after which the next one is sharp, below the second between frames at rest [ms]
  const native = HTMLCanvasElement.prototype.getContext;
  const probe = native.call(document.createElement("canvas"), "webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? probe.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer)) return;

  function coarsen(canvas, gl) {
    const size = { width: canvas.width, height: canvas.height };
    let [share, onScreen, seen, last] = [1, true, [0, 0, canvas.width, canvas.height], -Infinity];
    const resize = {};
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
    const { viewport, bindFramebuffer, clear } = gl;
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
        const wanted = whole() * (now - last > REST ? 1 : SHARE);
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
