"use strict";
// The controls of the robot that moves: one time for it and for the plots.
const robotMoving = async ({read, unpacked}) => {
  const place = document.getElementById("moving");
  if (!place) return () => {};
  const {scenes, motions} = await read("scenes", {scenes: [], motions: []});
  for (const scene of scenes) {
    for (const mesh of scene.meshes) mesh.vertices = mesh.vertices.map(unpacked);
  }
  for (const motion of motions) {
    motion.time = unpacked(motion.time);
    for (const which of ["measured", "before", "after"]) {
      motion[which] = motion[which]?.map(unpacked);
    }
  }
  const [canvas, slider, play, now, factor, told] = [
    "robot", "time", "play", "now", "factor", "told"].map((id) => document.getElementById(id));
  const view = robotView(canvas);
  const recordings = document.getElementById("recording");
  const boxes = [...place.querySelectorAll("input[type=checkbox]")];
  place.classList.add(view ? "live" : "still");
  place.querySelector(".controls").hidden = false;
  let motion = null;
  const rgb = (name) => {
    const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  };
  const cursor = document.createElement("div");
  cursor.className = "cursor";
  const comparison = document.getElementById("comparison");
  comparison.append(cursor);
  const pointed = () => {
    const axis = comparison._fullLayout?.xaxis;
    const size = comparison._fullLayout?._size;
    const at = motion && axis ? axis.l2p(motion.time[slider.value]) : -1;
    const inside = axis && at >= 0 && at <= axis._length;
    cursor.hidden = !inside;
    if (inside) {
      Object.assign(cursor.style, {
        left: `${axis._offset + at}px`, top: `${size.t}px`, height: `${size.h}px`});
    }
  };
  const NAMES = {measured: "the measured robot", before: "the model as given", after: "the mended model"};
  const draw = () => {
    pointed();
    if (!motion) return;
    const frame = Number(slider.value);
    now.textContent = `${motion.time[frame].toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", now.textContent);
    if (!view) return;
    const mended = boxes.some((one) => one.value === "after");
    const looks = {
      after: {color: rgb("--after"), alpha: 1, behind: 0},
      before: {color: rgb("--before"), alpha: mended ? 0.5 : 1, behind: 1},
      measured: {color: rgb("--ghost"), alpha: 0.4, behind: -1},
    };
    const robots = ["after", "before", "measured"]
      .filter((which) => boxes.some((one) => one.value === which && one.checked))
      .map((which) => ({which, ...looks[which]}));
    const lacking = view.draw(frame, {
      shown: {robots, ground: rgb("--ground")}, factor: Number(factor.value)});
    told.textContent = [...notes, ...lacking.map(
      (which) => `At this time ${NAMES[which]} has no position.`)].join(" ");
  };
  let notes = [];
  const choose = () => {
    const recording = recordings.value;
    motion = motions.find((one) => one.recording === recording) ?? null;
    slider.disabled = play.disabled = !motion;
    canvas.hidden = !motion;
    notes = [];
    if (!motion) {
      told.textContent = `The motion of ${recording} is not in this page, which would be too large with it.`;
      pointed();
      return;
    }
    if (!motion.whole) {
      const [first, last] = [motion.time[0], motion.time[motion.time.length - 1]];
      notes.push(`Shown from ${first.toFixed(1)} to ${last.toFixed(1)} s, where the model as given is furthest off.`);
    }
    if (motion.absent.length) notes.push(`Not logged, and so drawn at rest: ${motion.absent.join(", ")}.`);
    if (motion.estimated) notes.push("Where the base is and where it heads was not measured: all are drawn at the estimate.");
    slider.max = motion.time.length - 1;
    slider.value = 0;
    view?.choose(scenes[motion.scene], motion);
    draw();
  };
  const go = (time) => {
    if (!motion || Number.isNaN(time)) return;
    const off = motion.time.map((t) => Math.abs(t - time));
    slider.value = off.indexOf(Math.min(...off));
    draw();
  };

  let started = null;
  const step = (stamp) => {
    if (started === null || !motion) return;
    const {time} = motion;
    const length = time[time.length - 1] - time[0];
    const at = time[0] + (stamp - started) / 1000 % (length || 1);
    let frame = time.findIndex((t) => t > at) - 1;
    if (frame < 0) frame = time.length - 1;
    if (frame !== Number(slider.value)) {
      slider.value = frame;
      draw();
    }
    requestAnimationFrame(step);
  };
  const stop = () => {
    started = null;
    play.textContent = "Play";
  };
  play.addEventListener("click", () => {
    if (started !== null) return stop();
    play.textContent = "Pause";
    started = performance.now() - 1000 * (motion.time[slider.value] - motion.time[0]);
    return requestAnimationFrame(step);
  });
  slider.addEventListener("input", () => { stop(); draw(); });
  for (const control of [...boxes, factor]) control.addEventListener("change", draw);
  recordings.addEventListener("change", () => { stop(); choose(); });
  comparison.on("plotly_click", ({points}) => { stop(); go(points[0].x); });
  for (const event of ["plotly_relayout", "plotly_afterplot"]) comparison.on(event, pointed);
  // report.html#t=1.5&errors=5 is a place in the page, too.
  const linked = () => {
    const wanted = new URLSearchParams(window.location.hash.slice(1));
    const options = [...factor.options].map((option) => option.value);
    if (options.includes(wanted.get("errors"))) factor.value = wanted.get("errors");
    if (!wanted.has("t")) return;
    go(parseFloat(wanted.get("t")));
    place.scrollIntoView();
  };
  window.addEventListener("hashchange", linked);
  new ResizeObserver(draw).observe(canvas);

  if (view) {
    const held = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const [x, y] = [event.clientX - before[0], event.clientY - before[1]];
      const others = [...held].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      held.set(event.pointerId, [event.clientX, event.clientY]);
      const far = ([u, v]) => Math.hypot(u - others[0][0], v - others[0][1]);
      const zoom = others.length ? far([event.clientX, event.clientY]) / (far(before) || 1) : 1;
      const share = 0.01 / held.size;
      view.moved({azimuth: -x * share, elevation: y * share, zoom});
      draw();
    });
    for (const event of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(event, ({pointerId}) => held.delete(pointerId));
    }
    canvas.addEventListener("wheel", (event) => { // without Ctrl it scrolls the page
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      view.moved({zoom: Math.exp(-0.01 * event.deltaY)});
      draw();
    }, {passive: false});
    canvas.addEventListener("dblclick", () => { view.home(); draw(); });
    const KEYS = {
      ArrowLeft: {azimuth: 0.1}, ArrowRight: {azimuth: -0.1}, ArrowUp: {elevation: 0.1},
      ArrowDown: {elevation: -0.1}, "+": {zoom: 1.1}, "-": {zoom: 1 / 1.1},
    };
    canvas.addEventListener("keydown", (event) => {
      if (!KEYS[event.key]) return;
      event.preventDefault();
      view.moved(KEYS[event.key]);
      draw();
    });
  }
  choose();
  linked();
  return draw;
};
