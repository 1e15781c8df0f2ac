"use strict";
/* Motion as the page carries it: unpacked, measured, and its errors. Nothing here draws. */
const motionTools = (() => {
  const RUNS = ["before", "after", "base", "with_effect", "fit"];

  /* Numbers travel as differences in time, zigzag, low bytes before high bytes, deflate, base64. */
  async function unpack(pack) {
    if (!pack) return null;
    const bytes = Uint8Array.from(atob(pack.data), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(stream).arrayBuffer());
    const count = planes.length / 2, width = pack.count * 3, raw = new Int16Array(count), out = new Float32Array(count);
    for (let i = 0; i < count; i++) {
      const coded = planes[i] | (planes[count + i] << 8);
      raw[i] = ((coded >>> 1) ^ -(coded & 1)) + (i >= width ? raw[i - width] : 0);
      out[i] = raw[i] === -32768 ? NaN : raw[i] * pack.step + pack.centre[i % 3];
    }
    return { values: out, count: pack.count, every: pack.every, frames: count / width };
  }

  async function load(given) {
    const motion = { ...given, points: {}, meshes: {} };
    motion.real = await unpack(given.real);
    motion.held = await unpack(given.held);
    for (const run of RUNS) {
      motion.points[run] = await unpack(given.points[run]);
      motion.meshes[run] = await unpack(given.meshes[run]);
    }
    motion.triangles = given.triangles;
    Object.assign(motion, linesOf(given.triangles));
    measure(motion);
    Object.assign(motion, reachOfColours(motion));
    return motion;
  }

  /* Centre, size, floor and the direction along the held edge, so that "front" means the same for every take. */
  function measure(motion) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const track of [motion.real, motion.held, ...Object.values(motion.meshes)]) {
      if (!track) continue;
      track.values.forEach((v, i) => { if (v < low[i % 3]) low[i % 3] = v; if (v > high[i % 3]) high[i % 3] = v; });
    }
    motion.centre = low.map((v, i) => (v + high[i]) / 2);
    motion.radius = Math.max(0.05, Math.hypot(...low.map((v, i) => high[i] - v)) / 2);
    motion.floor = low[2] - 0.06;
    let x = 0, y = 0;
    if (motion.held) for (let f = 0; f < motion.held.frames; f++) {
      const a = at(motion.held, f, 0), b = at(motion.held, f, 1);
      if (Number.isFinite(a[0] + b[0])) { x += b[0] - a[0]; y += b[1] - a[1]; }
    }
    motion.heading = Math.hypot(x, y) > 1e-9 ? Math.atan2(y, x) : 0;
  }

  /* The garment's own lines: sides of its quadrilaterals (two triangles that follow one another), and its outline. */
  function linesOf(triangles) {
    const count = new Map(), diagonals = new Set(), key = (a, b) => (a < b ? `${a} ${b}` : `${b} ${a}`);
    triangles.forEach(([a, b, c], n) => {
      const sides = [key(a, b), key(b, c), key(c, a)];
      for (const side of sides) count.set(side, (count.get(side) || 0) + 1);
      if (n % 2 === 1) {
        const [x, y, z] = triangles[n - 1];
        for (const side of sides) if ([key(x, y), key(y, z), key(z, x)].includes(side)) diagonals.add(side);
      }
    });
    const pairs = (found) => found.map((side) => side.split(" ").map(Number)), every = [...count.keys()];
    return { wire: pairs(every.filter((side) => !diagonals.has(side))), rim: pairs(every.filter((side) => count.get(side) === 1)) };
  }

  /* Error [m] that the darkest colour stands for: exceeded by one in twenty, over all runs, rounded up; and the largest. */
  function reachOfColours(motion) {
    const found = [];
    for (const run of Object.values(motion.points)) {
      if (run) for (let f = 0; f < run.frames; f++) for (let i = 0; i < run.count; i++) if (motion.free[i]) found.push(distance(motion, run, f, i));
    }
    const known = found.filter(Number.isFinite).sort((a, b) => a - b);
    const size = known.length ? known[Math.floor(0.95 * (known.length - 1))] : 0.01;
    const worst = [0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5].find((step) => step >= size) || 1;
    return { worst, isExceeded: known.length > 0 && known[known.length - 1] > worst };
  }

  function distance(motion, run, frame, point) {
    const real = at(motion.real, frame, point), model = at(run, frame, point);
    return Math.hypot(...real.map((v, k) => v - model[k]));
  }

  /* Root mean square distance of the free points that are seen in a frame, and the farthest of them. */
  function errorOf(motion, run, frame) {
    let sum = 0, count = 0, largest = -1, name = "";
    for (let i = 0; i < run.count; i++) {
      const size = motion.free[i] ? distance(motion, run, frame, i) : NaN;
      if (!Number.isFinite(size)) continue;
      sum += size * size; count += 1;
      if (size > largest) { largest = size; name = motion.point_names[i]; }
    }
    return { rms: count ? Math.sqrt(sum / count) : NaN, count, largest, name };
  }

  /* Error between the points: mean of theirs, weighted by the inverse fourth power of the distance (Shepard 1968).
     Not a number, which is drawn see-through, where points that are not seen weigh more than those that are. */
  function errorsBetween(motion, run, frame, places) {
    const known = [];
    let isSeen = false;
    for (let i = 0; i < run.count; i++) {
      const size = distance(motion, run, frame, i);
      known.push([at(run, frame, i), size]);
      isSeen = isSeen || (motion.free[i] && Number.isFinite(size));
    }
    if (!isSeen) return places.map(() => NaN);
    return places.map((p) => {
      let sum = 0, weights = 0, all = 0;
      for (const [q, size] of known) {
        const square = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2 + 1e-6, weight = 1 / (square * square);
        all += weight;
        if (Number.isFinite(size)) { sum += weight * size; weights += weight; }
      }
      return weights > 0.5 * all ? sum / weights : NaN;
    });
  }

  /* Position of one point at a frame that may lie between two stored ones. */
  function at(track, frame, point) {
    const place = Math.min(frame / track.every, track.frames - 1), first = Math.floor(place);
    const second = Math.min(first + 1, track.frames - 1), share = place - first;
    const a = (first * track.count + point) * 3, b = (second * track.count + point) * 3, v = track.values;
    if (share === 0) return [v[a], v[a + 1], v[a + 2]];
    return [0, 1, 2].map((i) => v[a + i] * (1 - share) + v[b + i] * share);
  }

  function frameAt(motion, time) {
    let low = 0, high = motion.time.length - 1;
    while (low < high) { const mid = (low + high + 1) >> 1; if (motion.time[mid] <= time + 1e-9) low = mid; else high = mid - 1; }
    return low;
  }

  return { RUNS, load, at, frameAt, errorOf, errorsBetween };
})();
