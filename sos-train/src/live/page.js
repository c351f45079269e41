"use strict";
(() => {
  const root = document.documentElement;
  addEventListener("error", (event) => { root.dataset.errors = (root.dataset.errors || "") + event.message + "; "; });
  const $ = (id) => document.getElementById(id);
  const make = (tag, parent, text) => {
    const element = document.createElement(tag);
    if (text !== undefined) element.textContent = text;
    parent.append(element);
    return element;
  };
  let wanted = [], views = [], drawn = -1, missed = 0, notes = 0;
  const strips = new Map();

  const short = (value) => value >= 1e6 ? (value / 1e6).toFixed(1) + " M" : value >= 1e3 ? Math.round(value / 1e3) + " k" : Math.round(value);
  const tiles = (state) => {
    const list = [[`${state.step} / ${state.steps}`, "steps"]];
    if (state.stage && state.stage.left) list.push([state.stage.left.replace(/ left$/, ""), "left"]);
    if (state.psnr != null) list.push([state.psnr.toFixed(1) + " dB", "PSNR of training rays"]);
    if (state.alpha_change != null) list.push([(100 * state.alpha_change).toFixed(2) + " %", "change of the mattes"]);
    if (state.samples_per_second != null) list.push([short(state.samples_per_second), "samples a second"]);
    $("tiles").replaceChildren();
    for (const [figure, what] of list) {
      const tile = make("div", $("tiles"));
      make("b", tile, figure);
      make("span", tile, what);
    }
  };

  const choose = (view) => {
    wanted = wanted.includes(view) ? wanted.filter((one) => one !== view) : wanted.concat(view).slice(-6);
    mark();
    look();
  };
  const mark = () => [...$("cameras").children].forEach((button, i) => button.setAttribute("aria-pressed", wanted.includes(i)));
  const list = (state) => {
    if (views.length === state.views.length) return;
    views = state.views;
    wanted = state.wanted;
    $("cameras").replaceChildren();
    views.forEach((view, i) => {
      const button = make("button", $("cameras"), view.name + (view.masked ? "" : " (no mask)"));
      button.type = "button";
      button.title = `${view.width} x ${view.height}`;
      button.addEventListener("click", () => choose(i));
    });
    mark();
  };

  const show = (state) => {
    for (const [view, strip] of strips) if (!wanted.includes(view)) { strip.figure.remove(); strips.delete(view); }
    for (const view of wanted) {
      if (!views[view]) continue;
      if (!strips.has(view)) {
        const figure = make("figure", $("strips"));
        figure.className = "strip";
        const image = make("img", figure);
        image.alt = "photo, alpha, cut-out and plate of " + views[view].name;
        image.hidden = true;
        const caption = make("figcaption", figure);
        make("span", caption, views[view].name);
        strips.set(view, { figure, image, step: make("span", caption, "not drawn yet"), at: -1 });
      }
      const strip = strips.get(view), at = state.pictures[view];
      if (at === undefined || at === strip.at) continue;
      strip.at = at;
      strip.image.src = `view/${view}.jpg?step=${at}`;
      strip.image.hidden = false;
      strip.step.textContent = "step " + at;
    }
  };

  // Until an object is found there is nothing to save.
  let searching = false;
  const said = { pause: "paused", stop: "stopping", finish: "going to the final pictures", "go on": "" };
  const buttons = Object.fromEntries([...document.querySelectorAll("[data-wish]")].map((b) => [b.dataset.wish, b]));
  const wishes = (state) => {
    const ending = state.wish === "stop" || state.wish === "finish";
    const training = state.stage && state.stage.label === "training";
    searching = Boolean(state.stage) && state.stage.label.startsWith("looking for the object");
    buttons.pause.textContent = state.wish === "pause" ? "go on" : "pause";
    buttons.pause.disabled = ending || !training;
    buttons.finish.disabled = ending || !training || !state.may_finish;
    buttons.stop.disabled = state.wish === "stop";
    $("said").textContent = said[state.wish];
  };
  for (const [wish, button] of Object.entries(buttons)) button.addEventListener("click", async () => {
    const what = wish === "pause" && button.textContent === "go on" ? "go-on" : wish;
    if (what === "stop" && !confirm(searching ? "End the run? The object is still looked for, and nothing is kept." : "Save a checkpoint and end the run?")) return;
    const answer = await fetch(what, { method: "POST" });
    if (!answer.ok) $("said").textContent = await answer.text();
    look();
  });

  const look = async () => {
    let state;
    try {
      state = await (await fetch("state" + (wanted.length ? "?views=" + wanted.join() : ""))).json();
      missed = 0;
    } catch {
      if (++missed > 2) {
        $("said").textContent = "the run has ended; its results and report.html are in its folder";
        Object.values(buttons).forEach((button) => { button.disabled = true; });
      }
      return;
    }
    $("run").textContent = state.run;
    document.title = `${state.step} / ${state.steps} – ${state.run}`;
    const stage = state.stage;
    if (stage) {
      $("stage").textContent = [`${stage.label} ${stage.done} / ${stage.total}`, stage.left].filter(Boolean).join(", ");
      $("bar").value = stage.total ? stage.done / stage.total : 0;
    }
    tiles(state);
    list(state);
    show(state);
    wishes(state);
    if (notes !== state.notes.length) {
      notes = state.notes.length;
      $("notes").replaceChildren();
      state.notes.forEach((note) => make("li", $("notes"), note));
    }
    if (drawn !== state.records) {
      drawn = state.records;
      $("plots").innerHTML = await (await fetch("curves")).text();
    }
    root.dataset.ready = "live";
  };
  look();
  // A page that nobody sees asks for nothing, so that nothing is drawn for it.
  setInterval(() => { if (!document.hidden) look(); }, 1000);
  document.addEventListener("visibilitychange", () => { if (!document.hidden) look(); });
})();
