// Two pictures on top of each other with a slider between them, to be enlarged with wheel or two
// fingers and moved by dragging; in the page, and as large as the window.
"use strict";
(() => {
  const root = document.documentElement;
  const make = (tag, name, parent, text) => {
    const element = document.createElement(tag);
    if (name) element.className = name;
    if (text) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  };
  const views = [...document.querySelectorAll(".views section")].map((section) => ({
    id: section.id,
    name: section.querySelector("h3").firstChild.textContent.trim(),
    pictures: Object.fromEntries([...section.querySelectorAll("figure")].map((figure) => {
      const image = figure.querySelector("img"), link = figure.querySelector("a");
      return [figure.dataset.column, image && { image, file: link && link.getAttribute("href") }];
    })),
  }));
  const columns = [...document.querySelectorAll(".row.head span")].map((span) => span.textContent);
  const pairs = [["photo", "cut-out"], ["photo", "plate"], ["coarse mask", "alpha"], ["photo", "uncertainty"]]
    .filter((pair) => pair.every((column) => columns.includes(column)));
  if (!views.length || !pairs.length) return;

  class Stage {
    constructor(parent) {
      this.element = make("div", "stage", parent);
      this.frame = make("div", "frame", this.element);
      this.layers = [0, 1].map(() => make("img", "", this.frame));
      this.layers.forEach((image) => { image.draggable = false; image.alt = ""; });
      this.line = make("div", "line", this.element);
      this.line.tabIndex = 0;
      this.line.setAttribute("role", "slider");
      this.line.setAttribute("aria-label", "share of the left picture");
      this.labels = ["left", "right"].map((side) => make("span", "label " + side, this.element));
      this.none = make("span", "nothing", this.element, "no picture");
      this.share = 0.5;
      this.pointers = new Map();
      this.reset();
      this.listen();
    }

    // One or two of a view's columns; `files`: take the files beside the page where they are there.
    show(view, chosen, files) {
      this.two = chosen.length > 1;
      const first = view.pictures[chosen[0]] || view.pictures[chosen[1]] || null;
      const size = first && first.image;
      if (size) this.aspect = size.width / size.height || size.naturalWidth / size.naturalHeight;
      this.layers.forEach((layer, i) => {
        const picture = view.pictures[chosen[i]];
        layer.hidden = !picture;
        this.labels[i].textContent = chosen[i] ? chosen[i] + (picture ? "" : ": none") : "";
        this.labels[i].hidden = !chosen[i];
        if (!picture) return;
        layer.src = picture.image.src;
        if (!files || !picture.file) return;
        const full = new Image(), wanted = picture.image.src;
        full.onload = () => { if (layer.src === wanted && full.naturalWidth > picture.image.naturalWidth && !/cut-out|uncertainty/.test(chosen[i])) layer.src = full.src; };
        full.src = picture.file;
      });
      this.none.hidden = !!first;
      this.line.hidden = !this.two;
      this.fit();
    }

    fit() {
      if (!this.aspect) return;
      const box = this.element.getBoundingClientRect();
      const width = Math.min(box.width, box.height * this.aspect);
      this.frame.style.width = width + "px";
      this.frame.style.height = width / this.aspect + "px";
      this.draw();
    }

    reset() { this.zoom = 1; this.x = 0; this.y = 0; this.draw(); }

    draw() {
      // No further than that the middle still shows the picture.
      const box = this.frame.getBoundingClientRect();
      const reach = [this.frame.offsetWidth, this.frame.offsetHeight].map((side) => side * (this.zoom - 1) / 2);
      this.x = Math.max(-reach[0], Math.min(reach[0], this.x));
      this.y = Math.max(-reach[1], Math.min(reach[1], this.y));
      this.frame.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.zoom})`;
      const stage = this.element.getBoundingClientRect();
      const at = this.share * stage.width;
      this.line.style.left = at + "px";
      this.line.setAttribute("aria-valuenow", Math.round(100 * this.share));
      // The second picture begins where the line crosses it.
      const width = this.frame.offsetWidth * this.zoom || 1;
      const left = stage.width / 2 + this.x - width / 2;
      const cut = Math.max(0, Math.min(1, (at - left) / width));
      this.layers[1].style.clipPath = this.two ? `inset(0 0 0 ${100 * cut}%)` : "none";
      this.layers[0].style.clipPath = this.two ? `inset(0 ${100 * (1 - cut)}% 0 0)` : "none";
      void box;
    }

    enlarge(factor, x, y) {
      const box = this.element.getBoundingClientRect();
      const from = this.zoom;
      this.zoom = Math.max(1, Math.min(24, from * factor));
      const by = this.zoom / from;
      const [dx, dy] = [x - box.left - box.width / 2, y - box.top - box.height / 2];
      this.x = dx - by * (dx - this.x);
      this.y = dy - by * (dy - this.y);
      this.element.classList.toggle("pixels", this.zoom > 5);
      this.draw();
    }

    slide(x) {
      const box = this.element.getBoundingClientRect();
      this.share = Math.max(0, Math.min(1, (x - box.left) / box.width));
      this.draw();
    }

    listen() {
      const element = this.element;
      // A page that is scrolled past the picture scrolls on: the wheel is ours after a move in it.
      let armed = false;
      element.addEventListener("pointermove", () => { armed = true; });
      addEventListener("scroll", () => { armed = false; }, { passive: true });
      element.addEventListener("wheel", (event) => {
        if (!armed && !this.large) return;
        event.preventDefault();
        this.enlarge(Math.exp(-0.0016 * event.deltaY * (event.deltaMode ? 24 : 1)), event.clientX, event.clientY);
      }, { passive: false });
      element.addEventListener("dblclick", () => this.reset());
      element.addEventListener("pointerdown", (event) => {
        if (event.button) return;
        if (event.isTrusted) element.setPointerCapture(event.pointerId);
        this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
        const near = Math.abs(event.clientX - this.line.getBoundingClientRect().left) < 28;
        this.sliding = this.two && (near || this.zoom === 1);
        this.moved = 0;
        if (this.sliding && !near && event.pointerType !== "touch") this.slide(event.clientX);
      });
      element.addEventListener("pointermove", (event) => {
        const before = this.pointers.get(event.pointerId);
        if (!before) return;
        const now = [event.clientX, event.clientY];
        this.moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
        const other = [...this.pointers].find(([id]) => id !== event.pointerId);
        this.pointers.set(event.pointerId, now);
        if (other) {
          const apart = (at) => Math.hypot(at[0] - other[1][0], at[1] - other[1][1]) || 1;
          this.enlarge(apart(now) / apart(before), (now[0] + other[1][0]) / 2, (now[1] + other[1][1]) / 2);
        } else if (this.sliding) {
          this.slide(now[0]);
        } else if (this.zoom > 1) {
          this.x += now[0] - before[0];
          this.y += now[1] - before[1];
          this.draw();
        }
      });
      const end = (event) => this.pointers.delete(event.pointerId);
      element.addEventListener("pointerup", end);
      element.addEventListener("pointercancel", end);
      this.line.addEventListener("keydown", (event) => {
        const by = { ArrowLeft: -0.05, ArrowRight: 0.05 }[event.key];
        if (!by) return;
        this.share = Math.max(0, Math.min(1, this.share + by));
        this.draw();
        event.preventDefault();
        event.stopPropagation();
      });
      new ResizeObserver(() => this.fit()).observe(element);
    }
  }

  const button = (parent, text, title, action) => {
    const element = make("button", "", parent, text);
    element.type = "button";
    if (title) element.title = title;
    element.addEventListener("click", action);
    return element;
  };

  // A stage with its choice of pictures and views, in `parent`.
  const panel = (parent, files) => {
    const bar = make("div", "bar", parent);
    const choice = make("div", "choice", bar);
    const steps = make("div", "steps", bar);
    const stage = new Stage(parent);
    stage.large = files;
    const state = { stage, at: 0, chosen: pairs[0] };
    const options = files ? pairs.concat(columns.map((column) => [column])) : pairs;
    const buttons = options.map((option) => button(choice, option.join(" | "), "", () => state.show(state.at, option)));
    button(steps, "‹", "previous view", () => state.show(state.at - 1));
    const list = make("select", "", steps);
    list.setAttribute("aria-label", "view");
    views.forEach((view, i) => { const option = make("option", "", list, view.name); option.value = i; });
    list.addEventListener("change", () => state.show(+list.value));
    button(steps, "›", "next view", () => state.show(state.at + 1));
    state.show = (at, chosen) => {
      state.at = (at + views.length) % views.length;
      state.chosen = chosen || state.chosen;
      list.value = state.at;
      buttons.forEach((b, i) => b.setAttribute("aria-pressed", options[i].join() === state.chosen.join()));
      stage.show(views[state.at], state.chosen, files);
    };
    return state;
  };

  const dialog = make("dialog", "large", document.body);
  const large = panel(dialog, true);
  button(dialog.querySelector(".steps"), "×", "close", () => dialog.close());
  const open = (at, chosen) => {
    dialog.showModal();
    large.stage.reset();
    large.show(at, chosen);
  };
  dialog.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by && event.target.tagName !== "SELECT") large.show(large.at + by);
  });
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });

  const compare = document.getElementById("compare");
  compare.hidden = false;
  const inline = panel(compare, false);
  button(compare.querySelector(".steps"), "⤢", "as large as the window", () => open(inline.at, inline.chosen));
  const masked = views.findIndex((view) => view.pictures.photo);
  inline.show(Math.max(0, masked));

  // A click with a key held still leads to the file.
  document.querySelectorAll(".views section").forEach((section, at) => section.addEventListener("click", (event) => {
    const figure = event.target.closest("figure");
    if (!figure || event.ctrlKey || event.metaKey || event.shiftKey || !figure.querySelector("img")) return;
    event.preventDefault();
    open(at, [figure.dataset.column]);
  }));
  document.querySelectorAll(".card").forEach((card) => card.addEventListener("click", (event) => {
    const at = views.findIndex((view) => view.id === card.dataset.view);
    if (at < 0 || event.target.tagName === "A") return;
    open(at, ["coarse mask", "alpha"]);
  }));
  root.dataset.ready = (root.dataset.ready || "") + "slider ";
})();
