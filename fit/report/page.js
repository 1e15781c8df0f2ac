"use strict";
/* The motion player: real points against the simulated cloth, drawn on one canvas. No library, no network. */
(() => {
  const box = document.getElementById("player");
  const source = JSON.parse(document.getElementById("motions").textContent);
  if (!box || !source.length) return;
  const canvas = box.querySelector("canvas"), ink = canvas.getContext("2d");
  const part = (name) => box.querySelector(`[data-part="${name}"]`);
  const { RUNS, at, frameAt, errorOf, errorsBetween } = motionTools;
  const TRAIL = 0.7; // s of the past that a trail shows
  const VIEWS = { front: [0, 0.04], side: [Math.PI / 2, 0.04], oblique: [0.65, 0.28] };
  const state = { motion: 0, run: "", other: "", compare: "", trails: true, time: 0, playing: false, speed: 1, yaw: 0.65, pitch: 0.28, zoom: 1, cloth: "error", errors: true };
  const motions = [];
  let colours = {}, drawn = 0;

  function readColours() {
    const style = getComputedStyle(document.documentElement), get = (name) => style.getPropertyValue(name).trim();
    for (const name of ["ink", "soft", "line", "real", "before", "after", "effect", "fit", "cloth", "cloth-back", "low", "high", "unknown", "faint"]) colours[name] = get(`--${name}`);
    colours.with_effect = colours.effect; colours.base = colours.after;
  }

  function projector(motion, width, height) {
    const yaw = motion.heading + state.yaw, sy = Math.sin(yaw), cy = Math.cos(yaw);
    const sp = Math.sin(state.pitch), cp = Math.cos(state.pitch);
    const head = 28, room = height - head; // px: the run's name stands above the cloth
    const scale = (0.5 * Math.min(width, room * 1.25) / motion.radius) * state.zoom, far = 6 * motion.radius;
    return (p) => {
      const x = p[0] - motion.centre[0], y = p[1] - motion.centre[1], z = p[2] - motion.centre[2];
      const right = x * cy + y * sy, away = -x * sy + y * cy;
      const depth = away * cp - z * sp, up = away * sp + z * cp, near = far / (far + depth);
      return [width / 2 + right * scale * near, head + room / 2 - up * scale * near, depth, scale * near];
    };
  }

  function line(points, colour, thickness, dash = []) {
    ink.strokeStyle = colour; ink.lineWidth = thickness; ink.setLineDash(dash); ink.beginPath();
    points.forEach((p, i) => (i ? ink.lineTo(p[0], p[1]) : ink.moveTo(p[0], p[1])));
    ink.stroke(); ink.setLineDash([]);
  }

  function drawFloor(motion, project) {
    const reach = Math.ceil(motion.radius * 8) / 10, step = reach > 1.2 ? 0.5 : 0.2, lines = Math.ceil(reach / step);
    const cos = Math.cos(motion.heading), sin = Math.sin(motion.heading);
    const spot = (a, b) => project([motion.centre[0] + a * cos - b * sin, motion.centre[1] + a * sin + b * cos, motion.floor]);
    for (let i = -lines; i <= lines; i++) {
      line([spot(i * step, -lines * step), spot(i * step, lines * step)], colours.line, 1);
      line([spot(-lines * step, i * step), spot(lines * step, i * step)], colours.line, 1);
    }
  }

  /* Lines of the mesh, given the vertices on the canvas. */
  function drawLines(lines, seen, colour, thickness) {
    ink.strokeStyle = colour; ink.lineWidth = thickness; ink.beginPath();
    for (const [a, b] of lines) { ink.moveTo(seen[a][0], seen[a][1]); ink.lineTo(seen[b][0], seen[b][1]); }
    ink.stroke();
  }

  function drawGhost(motion, name, frame, project) {
    const mesh = motion.meshes[name], points = motion.points[name];
    if (mesh && state.cloth !== "none") {
      const seen = [];
      for (let i = 0; i < mesh.count; i++) seen.push(project(at(mesh, frame, i)));
      ink.globalAlpha = 0.35; drawLines(motion.wire, seen, colours[name], 0.7);
      ink.globalAlpha = 0.9; drawLines(motion.rim, seen, colours[name], 1.6); ink.globalAlpha = 1;
    }
    for (let i = 0; points && i < points.count; i++) {
      const q = project(at(points, frame, i));
      ink.strokeStyle = colours[name]; ink.lineWidth = 1.6; ink.beginPath(); ink.arc(q[0], q[1], 4, 0, 7); ink.stroke();
    }
  }

  function drawCloth(motion, name, frame, project) {
    const triangles = motion.triangles, mesh = motion.meshes[name];
    if (!mesh || !triangles.length || state.cloth === "none") return;
    const world = [], seen = [];
    for (let i = 0; i < mesh.count; i++) { world.push(at(mesh, frame, i)); seen.push(project(world[i])); }
    if (state.cloth === "wire") {
      drawLines(motion.wire, seen, `rgb(${colours.cloth} / .65)`, 0.8);
      drawLines(motion.rim, seen, `rgb(${colours.cloth})`, 2);
      return;
    }
    const run = motion.points[name], isError = state.cloth === "error" && run;
    const errors = isError ? errorsBetween(motion, run, frame, world) : [];
    const low = rgb(colours.low), high = rgb(colours.high), unknown = rgb(colours.unknown);
    const order = triangles.map((t) => [seen[t[0]][2] + seen[t[1]][2] + seen[t[2]][2], t]).sort((p, q) => q[0] - p[0]);
    const front = colours.cloth.split(" ").map(Number), back = colours["cloth-back"].split(" ").map(Number);
    ink.lineWidth = 0.7; ink.lineJoin = "round";
    for (const [, [a, b, c]] of order) {
      const u = world[b].map((v, i) => v - world[a][i]), w = world[c].map((v, i) => v - world[a][i]);
      const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const size = Math.hypot(...n);
      if (!(size > 0)) continue;
      const side = (seen[b][0] - seen[a][0]) * (seen[c][1] - seen[a][1]) - (seen[b][1] - seen[a][1]) * (seen[c][0] - seen[a][0]);
      const light = 0.62 + 0.45 * Math.abs(n[0] * 0.35 + n[1] * -0.55 + n[2] * 0.76) / size;
      const share = isError ? Math.min(1, (errors[a] + errors[b] + errors[c]) / 3 / motion.worst) : NaN;
      const isKnown = Number.isFinite(share), isBare = isError && !isKnown, fabric = side < 0 ? front : back;
      const plain = isKnown ? low.map((v, i) => v + share * (high[i] - v)) : isBare ? unknown : fabric;
      const tint = plain.map((v) => Math.min(255, Math.round(v * light)));
      ink.fillStyle = ink.strokeStyle = `rgb(${tint.join(" ")} / ${isBare ? 0.18 : 0.93})`;
      ink.beginPath(); ink.moveTo(seen[a][0], seen[a][1]); ink.lineTo(seen[b][0], seen[b][1]); ink.lineTo(seen[c][0], seen[c][1]); ink.closePath();
      ink.fill(); if (!isBare) ink.stroke();
    }
    if (isError) box.dataset.bare = (errors.filter((size) => !Number.isFinite(size)).length / errors.length).toFixed(2);
    ink.globalAlpha = 0.14; drawLines(motion.wire, seen, colours.ink, 0.6);
    ink.globalAlpha = 0.8; drawLines(motion.rim, seen, colours.ink, 1.4); ink.globalAlpha = 1;
  }

  const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

  /* The scale of the colours stands below the picture, where it covers nothing of it. */
  function showRamp(motion) {
    part("ramp").hidden = state.cloth !== "error" || !motion.points[state.run] || !motion.meshes[state.run];
    part("most").textContent = `${Math.round(1e3 * motion.worst)}\u00a0mm${motion.isExceeded ? " and more" : ""}`;
  }

  function drawScale(motion, project, height) {
    const pixels = project(motion.centre)[3] * 0.1;
    line([[14, height - 16], [14 + pixels, height - 16]], colours.ink, 2);
    ink.fillStyle = colours.soft; ink.font = "12px system-ui, sans-serif"; ink.fillText("10 cm", 14, height - 22);
  }

  /* Where a point was in the last moments; a place that was not seen breaks the line. */
  function drawTrail(motion, track, point, frame, project, colour) {
    const first = frameAt(motion, motion.time[frame] - TRAIL);
    ink.strokeStyle = colour; ink.lineWidth = 1.4; ink.globalAlpha = 0.6; ink.beginPath();
    let isOn = false;
    for (let f = first; f <= frame; f++) {
      const place = at(track, f, point), isSeen = place.every(Number.isFinite);
      if (isSeen) { const p = project(place); if (isOn) ink.lineTo(p[0], p[1]); else ink.moveTo(p[0], p[1]); }
      isOn = isSeen;
    }
    ink.stroke(); ink.globalAlpha = 1;
  }

  const millimetres = (size) => (Number.isFinite(size) ? `${(1e3 * size).toFixed(1)}\u00a0mm` : "no free point seen");
  const nameOf = (run) => box.querySelector(`[data-run="${run}"]`).textContent;

  function drawPane(motion, name, frame, width, height, label) {
    const project = projector(motion, width, height), run = motion.points[name];
    drawFloor(motion, project);
    if (state.compare === "ghost" && state.other !== name && motion.points[state.other]) drawGhost(motion, state.other, frame, project);
    drawCloth(motion, name, frame, project);
    if (motion.held) {
      const ends = [at(motion.held, frame, 0), at(motion.held, frame, 1)];
      if (ends.flat().every(Number.isFinite)) line(ends.map(project), colours.ink, 5);
    }
    for (let i = 0; i < motion.real.count; i++) {
      const real = at(motion.real, frame, i), model = run && at(run, frame, i);
      const isSeen = real.every(Number.isFinite), p = project(real), q = model && project(model);
      if (state.trails && motion.free[i]) {
        drawTrail(motion, motion.real, i, frame, project, colours.real);
        if (run) drawTrail(motion, run, i, frame, project, colours[name]);
      }
      if (model && model.every(Number.isFinite)) {
        if (isSeen && state.errors) line([p, q], colours.real, 1.6);
        ink.strokeStyle = colours[name]; ink.lineWidth = 2.2; ink.strokeRect(q[0] - 4.5, q[1] - 4.5, 9, 9);
      }
      if (isSeen) { ink.fillStyle = colours.real; ink.beginPath(); ink.arc(p[0], p[1], 5, 0, 7); ink.fill(); }
    }
    if (label && run) {
      ink.font = "600 14px system-ui, sans-serif"; ink.fillStyle = colours[name];
      ink.fillText(`${nameOf(name)}: ${millimetres(errorOf(motion, run, frame).rms)}`, 14, 22);
      const ghost = state.compare === "ghost" && state.other !== name && motion.points[state.other];
      if (ghost) {
        ink.fillStyle = colours[state.other];
        ink.fillText(`ghost, ${nameOf(state.other)}: ${millimetres(errorOf(motion, ghost, frame).rms)}`, 14, 42);
      }
    }
    return project;
  }

  function draw() {
    const motion = motions[state.motion];
    if (!motion) return;
    const isPair = state.compare === "both" && motion.points[state.other] && state.other !== state.run;
    canvas.classList.toggle("is-pair", Boolean(isPair));
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    const frame = frameAt(motion, state.time), isWide = width >= 620, shown = isPair ? [state.run, state.other] : [state.run];
    const across = isPair && isWide ? width / 2 : width, down = isPair && !isWide ? height / 2 : height;
    ink.setTransform(ratio, 0, 0, ratio, 0, 0); ink.clearRect(0, 0, width, height);
    let project = null;
    shown.forEach((name, n) => {
      const left = isWide ? n * across : 0, top = isWide ? 0 : n * down;
      ink.save(); ink.translate(left, top); ink.beginPath(); ink.rect(0, 0, across, down); ink.clip();
      project = drawPane(motion, name, frame, across, down, shown.length > 1 || state.compare === "ghost");
      ink.restore();
      if (n) line(isWide ? [[left, 0], [left, height]] : [[0, top], [width, top]], colours.line, 2);
    });
    drawScale(motion, project, height);
    showRamp(motion);
    const end = motion.time[motion.time.length - 1], now = motion.time[frame];
    part("clock").textContent = `${now.toFixed(2)} of ${end.toFixed(2)} s`;
    part("scrub").value = String(frame);
    box.dataset.worst = String(motion.worst);
    part("scrub").setAttribute("aria-valuetext", `${now.toFixed(2)} seconds`);
    tell(motion, frame);
    for (const plot of document.querySelectorAll(".plot[data-motion]")) {
      const cursor = plot.querySelector(".cursor"), span = Number(plot.dataset.end) - Number(plot.dataset.start);
      cursor.hidden = Number(plot.dataset.motion) !== state.motion;
      cursor.style.left = `${Math.max(0, Math.min(100, 100 * (now - Number(plot.dataset.start)) / span))}%`;
    }
  }

  /* Say the error of the frame in words, of the run that is shown and of the one it is compared with. */
  function tell(motion, frame) {
    const run = motion.points[state.run], other = state.compare !== "one" && state.other !== state.run && motion.points[state.other];
    const found = run ? errorOf(motion, run, frame) : { count: 0 };
    let text = "No free point is seen in this frame.";
    if (found.count) {
      text = `Error now, ${nameOf(state.run)}: ${millimetres(found.rms)} (root mean square of ${found.count} free point${found.count > 1 ? "s" : ""}), largest ${millimetres(found.largest)} at ${found.name.replaceAll("_", " ")}`;
      text += other ? `; ${nameOf(state.other)}: ${millimetres(errorOf(motion, other, frame).rms)}.` : ".";
    }
    part("readout").textContent = text;
  }

  function press(group, value) {
    for (const button of box.querySelectorAll(`[data-${group}]`)) button.setAttribute("aria-pressed", String(button.dataset[group] === value));
  }

  function show(changes = {}) {
    Object.assign(state, changes);
    state.pitch = Math.max(-1.5, Math.min(1.5, state.pitch)); state.zoom = Math.max(0.4, Math.min(5, state.zoom));
    press("run", state.run); press("cloth", state.cloth); press("compare", state.compare);
    if (part("other")) part("other").value = state.other;
    part("errors").checked = state.errors; part("trails").checked = state.trails;
    const view = Object.keys(VIEWS).find((v) => Math.abs(VIEWS[v][0] - state.yaw) < 1e-6 && Math.abs(VIEWS[v][1] - state.pitch) < 1e-6);
    press("view", view || "");
    part("play").textContent = state.playing ? "Pause" : "Play";
    if (!drawn) drawn = requestAnimationFrame(() => { drawn = 0; draw(); });
  }

  async function choose(index, changes = {}) {
    const motion = motions[index] || (motions[index] = await motionTools.load(source[index])), scrub = part("scrub");
    scrub.max = String(motion.time.length - 1);
    for (const button of box.querySelectorAll("[data-run]")) button.disabled = !motion.points[button.dataset.run], button.hidden = button.disabled;
    const runs = RUNS.filter((run) => motion.points[run]);
    for (const button of box.querySelectorAll("[data-cloth]")) button.disabled = !Object.values(motion.meshes).some(Boolean);
    if (part("motion")) part("motion").value = String(index);
    const keep = (wanted, other) => (runs.includes(wanted) ? wanted : other);
    const run = keep(changes.run, keep(state.run, runs[0] || ""));
    const other = keep(changes.other, keep(state.other, runs.find((name) => name !== run) || run));
    const compare = runs.length < 2 ? "one" : changes.compare || state.compare || "both";
    show({ time: motion.time[motion.worst_frame], ...changes, motion: index, run, other, compare });
  }

  /* Runs are compared with one another: one that takes the other's place gives it its own. */
  function pick(run) { show({ run, other: run === state.other ? state.run : state.other }); }
  const COMPARE = ["one", "both", "ghost"];
  const turnPage = () => part("other") && show({ compare: COMPARE[(COMPARE.indexOf(state.compare) + 1) % COMPARE.length] });
  const worst = () => show({ playing: false, time: motions[state.motion].time[motions[state.motion].worst_frame] });

  let before = 0;
  function tick(now) {
    if (!state.playing) return;
    const motion = motions[state.motion], end = motion.time[motion.time.length - 1];
    let time = state.time + (before ? Math.min(0.2, (now - before) / 1000) * state.speed : 0);
    before = now;
    if (time > end) time = motion.time[0];
    show({ time }); requestAnimationFrame(tick);
  }
  function play(wanted) { before = 0; show({ playing: wanted }); if (wanted) requestAnimationFrame(tick); }
  function step(frames) {
    const motion = motions[state.motion], frame = frameAt(motion, state.time) + frames;
    show({ playing: false, time: motion.time[Math.max(0, Math.min(motion.time.length - 1, frame))] });
  }
  const turn = (view) => show({ yaw: VIEWS[view][0], pitch: VIEWS[view][1] });

  box.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    if (button.dataset.part === "play") play(!state.playing);
    if (button.dataset.part === "worst") worst();
    if (button.dataset.run) pick(button.dataset.run);
    if (button.dataset.compare) show({ compare: button.dataset.compare });
    if (button.dataset.view) turn(button.dataset.view);
    if (button.dataset.cloth) show({ cloth: button.dataset.cloth });
    if (button.dataset.zoom) show({ zoom: state.zoom * Number(button.dataset.zoom) });
  });
  part("scrub").addEventListener("input", (event) => show({ playing: false, time: motions[state.motion].time[Number(event.target.value)] }));
  part("speed").addEventListener("change", (event) => show({ speed: Number(event.target.value) }));
  part("errors").addEventListener("change", (event) => show({ errors: event.target.checked }));
  part("trails").addEventListener("change", (event) => show({ trails: event.target.checked }));
  if (part("other")) part("other").addEventListener("change", (event) => show({ other: event.target.value, compare: state.compare === "one" ? "both" : state.compare }));
  if (part("motion")) part("motion").addEventListener("change", (event) => choose(Number(event.target.value)));
  let held = null;
  canvas.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    const [x, y] = held; held = [event.clientX, event.clientY];
    show({ yaw: state.yaw - (event.clientX - x) * 0.008, pitch: state.pitch + (event.clientY - y) * 0.008 });
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { held = null; });
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault(); show({ zoom: state.zoom * Math.exp(-event.deltaY * 0.004) });
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const key = event.key, turned = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (key === " ") play(!state.playing);
    else if (turned && event.shiftKey) show({ yaw: state.yaw + turned[0], pitch: state.pitch + turned[1] });
    else if (key === "ArrowLeft") step(-1);
    else if (key === "ArrowRight") step(1);
    else if (key === "w") worst();
    else if (key === "c") turnPage();
    else if (key === "t") show({ trails: !state.trails });
    else if (key === "f") turn("front");
    else if (key === "s") turn("side");
    else if (key === "+" || key === "-") show({ zoom: state.zoom * (key === "+" ? 1.2 : 1 / 1.2) });
    else return;
    event.preventDefault();
  });
  for (const plot of document.querySelectorAll(".plot[data-motion]")) {
    plot.classList.add("is-seekable");
    plot.addEventListener("click", (event) => {
      const frame = plot.getBoundingClientRect(), start = Number(plot.dataset.start), span = Number(plot.dataset.end) - start;
      choose(Number(plot.dataset.motion), { playing: false, time: start + span * (event.clientX - frame.left) / frame.width });
    });
  }

  /* An address such as report.html#t=1.2&view=side&run=base&other=fit&compare=ghost&motion=0&cloth=wire opens the player in that state. */
  function fromAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1)), changes = {};
    if (wanted.get("view") in VIEWS) [changes.yaw, changes.pitch] = VIEWS[wanted.get("view")];
    for (const which of ["run", "other"]) if (RUNS.includes(wanted.get(which))) changes[which] = wanted.get(which);
    if (COMPARE.includes(wanted.get("compare"))) changes.compare = wanted.get("compare");
    if (["error", "shaded", "wire", "none"].includes(wanted.get("cloth"))) changes.cloth = wanted.get("cloth");
    if (wanted.has("t") && Number.isFinite(Number(wanted.get("t")))) changes.time = Number(wanted.get("t"));
    const motion = Math.max(0, Math.min(source.length - 1, Math.trunc(Number(wanted.get("motion"))) || 0));
    return choose(motion, changes);
  }
  readColours();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); show(); });
  window.addEventListener("resize", () => show());
  window.addEventListener("hashchange", () => { if (location.hash.includes("=")) fromAddress(); });
  window.addEventListener("beforeprint", draw);
  fromAddress().then(
    () => { box.dataset.ready = "yes"; },
    (error) => { part("readout").textContent = `This browser cannot unpack the motion (${error.message}); any browser from 2023 on can.`; part("readout").className = "readout warning"; },
  );
})();

/* Paper shows what the screen folds away. */
(() => {
  const folded = [];
  window.addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details:not([open])")) { folded.push(part); part.open = true; }
  });
  window.addEventListener("afterprint", () => { for (const part of folded.splice(0)) part.open = false; });
})();
