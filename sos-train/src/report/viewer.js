// The mesh, turned with the mouse or a finger, enlarged with wheel or two fingers.
"use strict";
(() => {
  const root = document.documentElement;
  const place = document.getElementById("viewer");
  if (!place) return;
  const numbers = (text) => text.split(" ").map(Number);
  const count = { vertices: +place.dataset.vertices, triangles: +place.dataset.triangles };
  const low = numbers(place.dataset.low), high = numbers(place.dataset.high);
  const text = document.getElementById("mesh").textContent;

  const bar = document.createElement("div");
  bar.className = "bar";
  const title = document.createElement("span");
  title.textContent = "mesh";
  const steps = document.createElement("div");
  steps.className = "steps";
  bar.append(title, steps);
  const stage = document.createElement("div");
  stage.className = "stage";
  const canvas = document.createElement("canvas");
  canvas.tabIndex = 0;
  canvas.setAttribute("aria-label", "the object's surface; drag to turn it");
  stage.append(canvas);
  place.append(bar, stage);

  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) {
    stage.textContent = "This browser shows no WebGL; mesh.ply is in the run's folder.";
    stage.classList.add("empty");
    root.dataset.ready = (root.dataset.ready || "") + "no-webgl ";
    return;
  }
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

  const shader = (kind, source) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, source);
    gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `
    attribute vec3 position; attribute vec3 normal; attribute vec3 colour;
    uniform vec3 low; uniform vec3 high; uniform mat3 turn; uniform vec3 eye; uniform vec2 lens;
    varying vec3 n; varying vec3 c; varying vec3 p;
    void main() {
      p = turn * mix(low, high, position) - eye;
      n = turn * normal; c = colour;
      float near = 0.01, far = 20.0;
      gl_Position = vec4(p.xy * lens, -p.z * (far + near) / (far - near) - 2.0 * far * near / (far - near), -p.z);
    }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `
    precision mediump float;
    varying vec3 n; varying vec3 c; varying vec3 p;
    uniform float plain;
    void main() {
      vec3 up = normalize(n), view = normalize(-p);
      // The inside of an open surface is lit like its outside.
      if (dot(up, view) < 0.0) up = -up;
      float light = 0.35 + 0.5 * max(dot(up, normalize(view + vec3(0.4, 0.6, 0.2))), 0.0) + 0.15 * up.y;
      vec3 photo = c * (0.82 + 0.22 * dot(up, view));
      gl_FragColor = vec4(mix(photo, vec3(0.86, 0.85, 0.82) * light * 1.15, plain), 1.0);
    }`));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);

  const columns = [["position", gl.UNSIGNED_SHORT, 6, Uint16Array], ["normal", gl.BYTE, 3, Int8Array], ["colour", gl.UNSIGNED_BYTE, 3, Uint8Array]];
  let at = 0;
  for (const [name, kind, size] of columns) {
    const packed = new Uint8Array(bytes, at, size * count.vertices);
    at += packed.length;
    // Attributes have to begin at multiples of four.
    const wide = size === 6 ? 8 : 4;
    const padded = new Uint8Array(wide * count.vertices);
    for (let i = 0; i < count.vertices; i++) padded.set(packed.subarray(size * i, size * i + size), wide * i);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, padded, gl.STATIC_DRAW);
    const slot = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(slot);
    gl.vertexAttribPointer(slot, 3, kind, true, wide, 0);
  }
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(bytes.slice(at)), gl.STATIC_DRAW);
  gl.enable(gl.DEPTH_TEST);
  gl.uniform3fv(uniform("low"), low);
  gl.uniform3fv(uniform("high"), high);

  const start = () => ({ around: 0, above: 0.25, distance: 2.7, x: 0, y: 0, plain: 0 });
  let look = start(), asked = false;
  const draw = () => {
    asked = false;
    const dense = Math.min(devicePixelRatio || 1, 2);
    const [w, h] = [canvas.clientWidth * dense, canvas.clientHeight * dense].map((side) => Math.max(1, Math.round(side)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [ca, sa, ce, se] = [Math.cos(look.around), Math.sin(look.around), Math.cos(look.above), Math.sin(look.above)];
    // Column by column: around y first, then around x.
    gl.uniformMatrix3fv(uniform("turn"), false, [ca, se * sa, -ce * sa, 0, ce, se, sa, -se * ca, ce * ca]);
    gl.uniform3f(uniform("eye"), look.x, look.y, look.distance);
    const focal = 2.4;
    gl.uniform2f(uniform("lens"), focal * Math.min(1, h / w), focal * Math.min(1, w / h));
    gl.uniform1f(uniform("plain"), look.plain);
    canvas.dataset.look = [look.around, look.above, look.distance].map((v) => v.toFixed(3)).join(" ");
    gl.drawElements(gl.TRIANGLES, 3 * count.triangles, gl.UNSIGNED_SHORT, 0);
  };
  const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };

  const button = (label, hint, action) => {
    const element = document.createElement("button");
    element.type = "button";
    element.textContent = label;
    element.title = hint;
    element.addEventListener("click", () => { action(element); redraw(); });
    steps.append(element);
  };
  button("shape", "without colours", (element) => {
    look.plain = 1 - look.plain;
    element.setAttribute("aria-pressed", look.plain === 1);
  });
  button("reset", "as at the start", () => { look = { ...start(), plain: look.plain }; });

  const pointers = new Map();
  let armed = false;
  canvas.addEventListener("pointerdown", (event) => {
    if (event.isTrusted) canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    armed = true;
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    pointers.set(event.pointerId, now);
    if (other) {
      const apart = (at) => Math.hypot(at[0] - other[1][0], at[1] - other[1][1]) || 1;
      approach(apart(before) / apart(now));
    } else if (event.shiftKey || event.buttons & 6) {
      const unit = look.distance / (1.2 * Math.min(canvas.clientWidth, canvas.clientHeight));
      look.x -= dx * unit;
      look.y += dy * unit;
    } else {
      look.around += 0.008 * dx;
      look.above = Math.max(-1.5, Math.min(1.5, look.above + 0.008 * dy));
    }
    redraw();
  });
  const end = (event) => pointers.delete(event.pointerId);
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  const approach = (factor) => { look.distance = Math.max(0.3, Math.min(10, look.distance * factor)); };
  addEventListener("scroll", () => { armed = false; }, { passive: true });
  canvas.addEventListener("wheel", (event) => {
    if (!armed) return;
    event.preventDefault();
    approach(Math.exp(0.0012 * event.deltaY * (event.deltaMode ? 24 : 1)));
    redraw();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] || [0, 0];
    if (!dx && !dy) return;
    event.preventDefault();
    look.around += 0.1 * dx;
    look.above = Math.max(-1.5, Math.min(1.5, look.above + 0.1 * dy));
    redraw();
  });
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  new ResizeObserver(redraw).observe(canvas);
  draw();
  // Whether anything was drawn at all: the middle third has something that is not clear.
  const pixels = new Uint8Array(4 * canvas.width * canvas.height);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  place.dataset.drawn = pixels.some((value) => value > 0);
  root.dataset.ready = (root.dataset.ready || "") + "viewer ";
})();
