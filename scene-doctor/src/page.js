"use strict";
// Draws the scene in perspective on a plain canvas: a few thousand points need nothing more.
(() => {
  const scene = JSON.parse(document.getElementById("drawing").textContent);
  const canvas = document.getElementById("scene");
  const label = document.getElementById("name");
  const context = canvas.getContext("2d");
  const add = (a, b, s) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) =>
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };

  // The scene's own axes: up, and two across.
  const up = unit(scene.up);
  const east = unit(cross(up, Math.abs(up[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0]));
  const north = cross(up, east);
  // Seen from outside the ring of cameras, a little above them.
  const mean = scene.cameras.reduce((sum, camera) => add(sum, camera.centre, 1 / scene.cameras.length), [0, 0, 0]);
  const side = Math.hypot(dot(mean, east), dot(mean, north)) > 0.2 * scene.radius
    ? Math.atan2(dot(mean, north), dot(mean, east)) + 0.9 : 0.9;
  const start = () => ({ turn: side, tilt: 0.5, far: 2.8 * scene.radius, at: [0, 0, 0] });
  let view = start();
  let eye, right, above, ahead, focal;

  function aim() {
    const [c, s] = [Math.cos(view.turn), Math.sin(view.turn)];
    const flat = add([c * east[0], c * east[1], c * east[2]], north, s);
    const outward = add(flat.map((v) => v * Math.cos(view.tilt)), up, Math.sin(view.tilt));
    eye = add(view.at, outward, view.far);
    ahead = outward.map((v) => -v);
    right = unit(cross(ahead, up));
    above = cross(right, ahead);
    focal = 1.1 * Math.min(canvas.width, canvas.height);
  }

  // In the eye's axes: across, up, along.
  const seen = (p) => { const d = add(p, eye, -1); return [dot(d, right), dot(d, above), dot(d, ahead)]; };
  const near = () => 0.01 * scene.radius;
  const onScreen = (q) => [canvas.width / 2 + focal * q[0] / q[2], canvas.height / 2 - focal * q[1] / q[2]];

  function line(a, b) {
    let [p, q] = [seen(a), seen(b)];
    if (p[2] < near() && q[2] < near()) return;
    if (p[2] > q[2]) [p, q] = [q, p];
    if (p[2] < near()) {
      const t = (near() - p[2]) / (q[2] - p[2]);
      p = [0, 1, 2].map((i) => p[i] + t * (q[i] - p[i]));
    }
    context.moveTo(...onScreen(p));
    context.lineTo(...onScreen(q));
  }

  function stroke(colour, width, lines) {
    context.beginPath();
    for (const [a, b] of lines) line(a, b);
    context.strokeStyle = colour;
    context.lineWidth = width * devicePixelRatio;
    context.stroke();
  }

  function points() {
    const { points: p, colours } = scene;
    const size = Math.max(1, 1.6 * devicePixelRatio);
    for (let i = 0; i < p.length; i += 3) {
      const q = seen([p[i], p[i + 1], p[i + 2]]);
      if (q[2] < near()) continue;
      const [x, y] = onScreen(q);
      context.fillStyle = `rgb(${colours[i]},${colours[i + 1]},${colours[i + 2]})`;
      context.fillRect(x, y, size, size);
    }
  }

  function groundLines() {
    const [a, b, c, d] = scene.ground;
    const between = (p, q, t) => [0, 1, 2].map((i) => p[i] + t * (q[i] - p[i]));
    const lines = [];
    for (let i = 0; i <= 10; i++) {
      lines.push([between(a, b, i / 10), between(d, c, i / 10)], [between(a, d, i / 10), between(b, c, i / 10)]);
    }
    return lines;
  }

  function draw() {
    const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
    canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
    aim();
    context.clearRect(0, 0, canvas.width, canvas.height);
    if (scene.ground.length === 4) {
      context.globalAlpha = 0.45;
      stroke(colour("--ground"), 1, groundLines());
      context.globalAlpha = 1;
    }
    points();
    if (scene.corners.length === 8) {
      const edges = [];
      for (let i = 0; i < 8; i++) {
        for (const bit of [1, 2, 4]) if (!(i & bit)) edges.push([scene.corners[i], scene.corners[i | bit]]);
      }
      stroke(colour("--box"), 2, edges);
    }
    for (const flagged of [false, true]) {
      const lines = [];
      for (const { centre, corners, checks } of scene.cameras) {
        if ((checks.length > 0) !== flagged) continue;
        corners.forEach((corner, i) => lines.push([centre, corner], [corner, corners[(i + 1) % corners.length]]));
      }
      stroke(colour(flagged ? "--flagged" : "--camera"), flagged ? 2 : 1.1, lines);
    }
  }

  let waiting = false;
  function redraw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  }

  // The camera under the pointer says its name.
  function point(event) {
    const box = canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = null, least = 14;
    for (const camera of scene.cameras) {
      const q = seen(camera.centre);
      if (q[2] < near()) continue;
      const at = onScreen(q).map((v) => v / devicePixelRatio);
      const distance = Math.hypot(at[0] - x, at[1] - y);
      if (distance < least) [best, least] = [camera, distance];
    }
    label.hidden = !best;
    if (best) {
      label.textContent = best.checks.length ? `${best.name}: ${best.checks.join(", ")}` : best.name;
      label.style.left = `${Math.min(x + 14, box.width - label.offsetWidth - 4)}px`;
      label.style.top = `${y + 14}px`;
    }
  }

  const held = new Map();
  function move(dx, dy, shift) {
    if (shift) {
      const scale = view.far / focal * devicePixelRatio;
      view.at = add(add(view.at, right, -dx * scale), above, dy * scale);
    } else {
      view.turn -= 0.006 * dx;
      view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + 0.006 * dy));
    }
    redraw();
  }
  function zoom(factor) {
    view.far = Math.max(0.05, Math.min(40, view.far / scene.radius * factor)) * scene.radius;
    redraw();
  }
  const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return point(event);
    const before = held.size === 2 ? spread() : 0;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (held.size === 2) zoom(before / Math.max(spread(), 1));
    else move(event.clientX - last[0], event.clientY - last[1], event.shiftKey || event.buttons === 2);
    label.hidden = true;
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", () => { label.hidden = true; });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.0012 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { view = start(); redraw(); });
  canvas.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };
    if (steps[event.key]) move(...steps[event.key], event.shiftKey);
    else if (event.key === "+") zoom(0.85);
    else if (event.key === "-") zoom(1 / 0.85);
    else return;
    event.preventDefault();
  });
  addEventListener("resize", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  draw();
})();
