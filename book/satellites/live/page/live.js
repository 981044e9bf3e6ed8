'use strict';
// The page of `trinolab live`: it draws what comes, says that it has drawn it, and sends what is set.

const $ = id => document.getElementById(id);
const STAGES = [['wait', 'waits'], ['track', 'tracker'], ['arm', 'mapping, arm'], ['draw', 'drawing'], ['page', 'to the screen']];
const NUMBERS = [['x_mm', 'x', 'mm'], ['y_mm', 'y', 'mm'], ['z_mm', 'z', 'mm'], ['alpha_deg', 'α', '°'], ['beta_deg', 'β', '°'],
  ['gamma_deg', 'γ', '°'], ['sigma_mm', 'σ position', 'mm'], ['sigma_deg', 'σ angle', '°'], ['markers', 'markers', ''],
  ['cameras', 'cameras', '']];
const SILENT_MS = 2000;  // without a word the page says so
let socket, scene, last, heard = performance.now(), ended = false, pedal = 'b', asking = false, held = false;
let drawing = Promise.resolve();  // of the frames in their order
const FIRST_VIEWS = {world: {turn: 0.6, tilt: 0.45, zoom: 1}, arm: {turn: 2.5, tilt: 0.35, zoom: 1}};
const views = {world: {...FIRST_VIEWS.world}, arm: {...FIRST_VIEWS.arm}};
const TRAIL_MS = 8000;
const trail = [];  // the frames that were drawn in the last seconds, with their times
const SLOW_MS = 8, BUSY = 3;
let opens = false;  // the clutch, since a replay has begun
const VAST_MM = 150;  // of an ellipsoid: the cameras are some 400 mm apart
let restsUntil = 0, slow = false, turn = 'arm', larger = 1;  // the ellipsoid, than it is

function send(words) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(words));
}

function connect() {
  socket = new WebSocket(new URL('socket', location.href).href.replace(/^http/, 'ws'));
  socket.binaryType = 'arraybuffer';
  socket.onmessage = event => {
    if (typeof event.data === 'string') { listen(JSON.parse(event.data)); return; }
    const frame = opened(event.data);  // while the one before is drawn
    drawing = drawing.then(() => frame).then(draw).catch(console.error);
  };
  socket.onclose = () => {
    heard = -Infinity;
    tell();
    if (!ended) setTimeout(connect, 1000);
  };
}

function listen(words) {
  heard = performance.now();
  if (words.scene) begin(words.scene);
  if (words.bye) { ended = true; last = null; show('banner', words.bye); }
  if (words.refused) console.warn(words.refused);
  $('busy').hidden = !words.busy;
  $('busy-words').textContent = words.busy || '';
  if (words.busy) { last = null; show('banner', ''); }
  tell();
}

function show(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
  $(id).hidden = !words;
}

// How an arm that holds goes on.
function letsGo() {
  return last.demonstration ? 'The demonstration opens the clutch and closes it again.' : 'Open the clutch and close it again.';
}

// What is wrong, in one line above all else.
function tell() {
  const why = ended ? 'trinolab has ended' : !$('busy').hidden ? $('busy-words').textContent
    : performance.now() - heard > SILENT_MS ? 'the connection is lost' : last ? '' : 'no frame has come yet';
  greyAll(why);
  if (ended || !$('busy').hidden) return;
  const words = performance.now() - heard > SILENT_MS
    ? 'No word from trinolab: the connection is lost. The arm holds, and the clutch is open. Trying again.'
    : last ? [...last.troubles.map(one => `${one}; the arm holds`),
      ...(last.held ? [`The arm holds (${last.held}). ${letsGo()}`] : [])].join('. ') : '';
  show('banner', words);
}

// ---- what is grey says why: in its title, and in words below it

const reasons = new Map();  // of each control by itself
let reasonOfAll = '';

function grey(control, why) {
  reasons.set(control, why);
  explain(control, reasonOfAll || why);
  control.dataset.why ||= `why-${control.id}`;
  if (!$(control.dataset.why))
    control.after(Object.assign(document.createElement('p'), {id: control.dataset.why, className: 'why'}));
  control.setAttribute('aria-describedby', control.dataset.why);
  show(control.dataset.why, why);
}

// All is grey for the reason that stands in the line at the bottom.
function greyAll(why) {
  if (why === reasonOfAll) return;
  reasonOfAll = why;
  for (const control of document.querySelectorAll('main :is(button, input):not(#replay *)')) explain(control, why || reasons.get(control) || '');
}

function explain(control, why) {
  if (control.disabled !== !!why) control.disabled = !!why;
  if (control.title !== why) control.title = why;
}

function begin(what) {
  scene = what;
  $('cameras').replaceChildren(...scene.cameras.map((camera, c) => {
    const canvas = document.createElement('canvas');
    canvas.id = `camera-${c}`;
    canvas.tabIndex = 0;
    canvas.setAttribute('aria-label', `Camera ${camera.name}`);
    [canvas.width, canvas.height] = camera.size;
    canvas.style.aspectRatio = `${camera.size[0]} / ${camera.size[1]}`;
    handled(canvas, c);
    const name = document.createElement('span');  // over the picture: in it, it would shrink with it
    name.className = 'name';
    name.textContent = camera.name;
    name.ariaHidden = 'true';  // the picture's label has it
    const place = document.createElement('div');
    place.append(canvas, name);
    return place;
  }));
  for (const shape of scene.shapes) shape.parts = Solids.partsOf(shape);
  for (const paper of [false, true])
    $(paper ? 'paper-sliders' : 'sliders').replaceChildren(...scene.sliders.filter(one => one.paper === paper).map(slider));
  $('pose').tBodies[0].replaceChildren(...NUMBERS.map(([name, label, unit]) => {
    const row = document.createElement('tr');
    row.innerHTML = '<th scope="row"></th><td></td>';
    row.cells[0].textContent = label + (unit ? ` (${unit})` : '');
    row.cells[1].id = `pose-${name}`;
    return row;
  }));
  $('stages').replaceChildren(...STAGES.map(([name, label]) => {
    const item = document.createElement('li');
    item.innerHTML = `<i class="${name}"></i>${label} <b id="stage-${name}">–</b>`;
    return item;
  }));
  $('strip').replaceChildren(...STAGES.map(([name]) => {
    const part = document.createElement('span');
    part.className = name;
    return part;
  }));
}

function slider(s) {
  const box = document.createElement('div');
  box.className = 'slider';
  box.innerHTML = '<label></label><output></output><input type="range">';
  const [label, output, input] = box.children;
  label.textContent = s.label;
  label.htmlFor = input.id = `set-${s.name}`;
  Object.assign(input, {min: s.low, max: s.high, step: s.step, value: s.value});
  const write = () => {
    output.value = `${Number(input.value)}${s.unit && ' ' + s.unit}`;
    input.setAttribute('aria-valuetext', output.value);
  };
  input.write = write;
  if (s.paper) input.dataset.why = 'why-paper';
  input.oninput = () => { write(); send({set: [s.name, Number(input.value)]}); };
  write();
  return box;
}

// A frame: the length of the text in four bytes, the text, and a JPEG a camera.
async function opened(data) {
  const length = new DataView(data).getUint32(0);
  const now = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  let at = 4 + length;
  const jpegs = now.pictures.map(size => {
    const jpeg = new Blob([new Uint8Array(data, at, size)], {type: 'image/jpeg'});
    at += size;
    return jpeg;
  });
  return {now, jpegs, pictures: await Promise.all(jpegs.map(one => createImageBitmap(one)))};
}

async function draw({now, jpegs, pictures}) {
  await new Promise(requestAnimationFrame);  // a page that nobody sees draws nothing, and asks for nothing
  heard = performance.now();
  if (!$('busy').hidden) return;
  const first = !last;
  last = now;
  trail.push({ms: heard, now});
  while (heard - trail[0].ms > TRAIL_MS) trail.shift();
  Replay.keep(now, jpegs);
  if (Replay.on()) pictures.forEach(one => one.close());
  else picture(pictures);
  write(now, first);
  if (!Replay.on()) paintInTurn();
  if (now.task) front(now.task);
  document.dispatchEvent(new CustomEvent('drawn', {detail: now}));
  send({drawn: now.number});
}

function picture(pictures) {
  pictures.forEach((one, c) => {
    const canvas = $(`camera-${c}`);
    if (canvas.width !== one.width || canvas.height !== one.height) [canvas.width, canvas.height] = [one.width, one.height];
    canvas.getContext('2d').drawImage(one, 0, 0);
    one.close();
  });
}

function writePose(pose) {
  for (const [name, , unit] of NUMBERS) {
    const value = pose[name];
    $(`pose-${name}`).textContent = value === null ? '–' : unit ? value.toFixed(name.startsWith('sigma') ? 3 : 1) : value;
  }
}

function write(now, first) {
  $('status').textContent = now.status;
  $('status').dataset.status = now.status;
  const state = now.held ? 'hold' : now.clutch ? 'closed' : 'open';
  $('coupled').dataset.state = state;
  $('coupled').textContent = state === 'hold' ? 'arm holds' : `clutch ${state}`;
  $('rate').textContent = `${now.rate.toFixed(0)} frames/s` + (now.spread ? `, cameras ${now.spread} ms apart` : '') +
    (now.limits.length ? `, at the limit: ${now.limits.join(', ')}` : '') +
    (now.force ? `, force ${now.force.toFixed(1)} N` : '');
  if (!Replay.on()) writePose(now.pose);
  else if (!now.clutch) opens = false;
  else if (!opens) Replay.leave();  // who moves the arm sees it
  $('clutch').setAttribute('aria-pressed', now.clutch);
  $('clutch').textContent = now.clutch ? 'Open clutch' : 'Close clutch';
  $('record').setAttribute('aria-pressed', now.recording);
  $('record').textContent = now.recording ? 'Stop recording' : 'Record';
  show('said', now.said);
  const paper = now.tracker === 'paper';
  for (const one of scene.sliders.filter(one => one.paper))
    grey($(`set-${one.name}`), paper ? '' : 'Grey: only the paper’s windows ask for these two. Choose them under Tracker.');
  $('paper-help').hidden = !paper;
  if (first || now.demonstration) {  // what another tab has set, or the demonstration
    for (const radio of document.getElementsByName('tracker')) radio.checked = radio.value === now.tracker;
    for (const [name, value] of Object.entries(now.values)) {
      const input = $(`set-${name}`);
      if (Number(input.value) !== value) { input.value = value; input.write(); }
    }
  }
  if ($('pointing').hidden && now.task) {
    $('pointing').hidden = false;
    if (!now.demonstration) $('front').focus();
  }
  $('pointing').hidden = !now.task;
  grey($('begin'), now.task && !now.demonstration ? 'Grey: a task goes on. “End task” ends it.' : '');
  $('demonstration').hidden = !now.demonstration;
  $('task-buttons').hidden = now.demonstration;
  show('points', now.points);
  if (now.task) $('doing').textContent = doing(now.task);
  logWords(now.folder);
  $('simulation').hidden = $('hand-help').hidden = !now.simulated;
  for (const canvas of document.querySelectorAll('#cameras canvas')) canvas.classList.toggle('movable', now.simulated);
  const notes = now.notes.slice().reverse();
  if (notes.join('\n') !== $('notes').dataset.text) {
    $('notes').dataset.text = notes.join('\n');
    $('notes').replaceChildren(...notes.map(words => Object.assign(document.createElement('li'), {textContent: words})));
  }
  if (now.way.whole) {
    $('whole').textContent = `${now.way.whole.toFixed(0)} ms`;
    STAGES.forEach(([name], k) => {
      $(`stage-${name}`).textContent = `${now.way[name].toFixed(1)} ms`;
      $('strip').children[k].style.width = `${Math.min(100 * now.way[name] / Math.max(250, now.way.whole), 100)}%`;
    });
  }
  tell();
}

function doing(task) {
  const where = task.aim < task.at[0] ? 'left' : 'right';
  const words = {
    'close the clutch': 'close the clutch (c)',
    'go to the mark': `bring the tool to the mark on the ${where}, and rest`,
    'go to the target': `to the target on the ${where}, then t`,
  };
  if (last.demonstration) words['close the clutch'] = 'the hand goes to the middle, and the clutch is closed';
  return `${task.done + 1} of ${task.of}: ${words[task.what]}`;
}

// How the last recording becomes a log that other programs open.
function logWords(folder) {
  const name = folder || 'RECORDING';
  if ($('log').dataset.folder === name) return;
  $('log').dataset.folder = name;
  const quoted = end => /[^\w./\\:-]/.test(name) ? `"${name}${end}"` : name + end;
  const bag = name.split(/[\\/]/).pop() + '-bag.mcap';
  $('log-commands').textContent = `trinolab track ${quoted('')} --out ${quoted('.csv')}\n`
    + `trinolab bag ${quoted('')} --poses ${quoted('.csv')} --out ${quoted('-bag')}`;
  $('log-file').textContent = bag;
  $('log-rerun').textContent = `rerun ${quoted('-bag/' + bag)}`;
}

// ---- 3-D: seen by a camera that turns about a middle

const inks = new Map();  // of the style sheet, until the scheme changes
function colour(name) {
  if (!inks.has(name)) inks.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return inks.get(name);
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// How a space is seen, in a canvas of so many pixels: the viewer's axes in the space, and what goes with them.
function sightOf(view, width, height, middle, size, up) {
  const upright = ([x, y, z]) => up === 'z' ? [x, y, z] : [x, -z, y];  // the world's y points down
  const [cs, sn, ct, st] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
  return {
    across: upright([cs, sn, 0]), up: upright([-st * sn, st * cs, ct]), towards: upright([ct * sn, -ct * cs, st]),
    scale: view.zoom * Math.min(width, height) / size, distance: 4 * size, deep: 2 * size, middle, upright, width, height,
  };
}

function placeOf(sight, point) {
  const off = point.map((x, k) => x - sight.middle[k]);
  const near = sight.scale / (1 - dot(sight.towards, off) / sight.distance);
  return [sight.width / 2 + near * dot(sight.across, off), sight.height / 2 - near * dot(sight.up, off)];
}

// A canvas that is cleared, and how its space is seen.
function opened2d(id, middle, size, up) {
  const canvas = $(id), ratio = devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const pen = canvas.getContext('2d');
  pen.clearRect(0, 0, width, height);
  return {pen, ratio, sight: sightOf(views[id], width, height, middle, size, up)};
}

// Ribbons, points and words of a space, which come behind what is shaded, or stand alone.
function sheet({pen, ratio, sight}) {
  const ribbons = [], afterwards = [];
  const line = (points, ink, wide = 1, closed = false) => {
    ribbons.push({points: closed ? [...points, points[0]] : points, tints: [[...Solids.colourOf(colour(ink)), 1]], px: wide * ratio});
  };
  const trace = (points, ink, wide) => {  // older ends fade
    const rgb = Solids.colourOf(colour(ink));
    ribbons.push({points, tints: points.map((_, k) => [...rgb, (k + 1) / points.length]), px: wide * ratio});
  };
  const spot = (point, ink, radius) => afterwards.push(() => {
    pen.beginPath();
    pen.arc(...placeOf(sight, point), radius * ratio, 0, 7);
    pen.fillStyle = colour(ink);
    pen.fill();
  });
  const words = (point, text) => afterwards.push(() => {
    const [u, v] = placeOf(sight, point);
    pen.fillStyle = colour('quiet');
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    pen.fillText(text, u + 12 * ratio, v - 10 * ratio);
  });
  const finish = solids => {
    const {width, height} = sight;
    if (solids) {
      const {canvas, top} = Solids.draw(width, height, sight, solids, ribbons.map(one => ({...one, wide: one.px / sight.scale})));
      pen.drawImage(canvas, 0, top, width, height, 0, 0, width, height);
    } else {
      pen.lineJoin = pen.lineCap = 'round';
      for (const {points, tints, px} of ribbons)
        for (let k = 0; k + 1 < points.length; k++) {
          const [r, g, b, a] = tints[k] || tints[0];
          pen.strokeStyle = `rgba(${255 * r}, ${255 * g}, ${255 * b}, ${a})`;
          pen.lineWidth = px;
          pen.beginPath();
          pen.moveTo(...placeOf(sight, points[k]));
          pen.lineTo(...placeOf(sight, points[k + 1]));
          pen.stroke();
        }
    }
    for (const one of afterwards) one();
  };
  return {line, trace, spot, words, finish};
}

// Where a computer shades in software, the spaces take turns, and then rest for some times as long as one took.
function paintInTurn() {
  const begin = performance.now();
  if (begin < restsUntil) return;
  if (slow) turn = turn === 'arm' ? 'world' : 'arm';
  paint(slow ? turn : '');
  const took = performance.now() - begin;
  slow = took > SLOW_MS;
  restsUntil = begin + (1 + BUSY) * took;
}

// Both spaces or one, of the frame that is shown: the present one, or one of the replay.
function paint(only = '') {
  const now = Replay.on() ? Replay.frame() : last;
  if (!scene || !now) return;
  const frames = Replay.on() ? Replay.past(TRAIL_MS) : trail;
  if (only !== 'arm') paintWorld(now, frames.map(one => one.now).filter(one => one.T));
  if (only !== 'world') paintArm(now, frames.map(one => one.now));
}

const putBy = (T, p) => [0, 1, 2].map(r => T[4 * r] * p[0] + T[4 * r + 1] * p[1] + T[4 * r + 2] * p[2] + T[4 * r + 3]);

function paintWorld(now, past) {
  const view = opened2d('world', [0, -130, 320], 660, 'y'), world = sheet(view), shaded = Solids.ready();
  const solids = [];
  for (const {name, field: [centre, ...corners]} of scene.cameras) {
    for (const corner of corners) world.line([centre, corner], 'line');
    world.line(corners, 'line', 1, true);
    world.words(centre, name);
    if (shaded) solids.push(...cameraSolids(centre, corners));
    else world.spot(centre, 'accent', 4);
  }
  const {ends: [low, high]} = scene.handle;
  world.trace(past.map(one => putBy(one.T, [0, high, 0])), 'accent', 2.5);
  if (now.T) {
    if (shaded) solids.push(...rodSolids(now));
    else rodLines(now.T, world);
    if (now.ellipsoid && !isVast(now)) ellipsoid(now, world, shaded ? solids : null);
  }
  world.finish(shaded ? solids : null);
  const words = isVast(now) ? `no ellipsoid: the position is uncertain by more than ${VAST_MM} mm`
    : 'ellipsoid: the position is in it with 95 %, drawn '
      + (larger > 1 ? `${larger.toLocaleString('en')} times as large` : 'as large as it is');
  if ($('larger').textContent !== words) $('larger').textContent = words;
}

function rodLines(T, world) {
  const [low, high] = scene.handle.rings.map(ring => ring.map(p => putBy(T, p)));
  for (const k of [0, 6, 12, 18]) world.line([low[k], high[k]], 'rod', 2);
  world.line(low, 'rod', 2);
  world.line(high, 'rod', 2);
  for (const marker of scene.handle.markers) world.spot(putBy(T, marker), 'ink', 2);
}

function rodSolids(now) {
  const {radius, ends: [low, high], markers, disc, bright} = scene.handle;
  const body = Solids.ofRows(now.T), inks = [[0.93, 0.93, 0.9, 1], [0.16, 0.17, 0.19, 1]];
  const rod = Solids.affine([radius, 0, 0], [0, 0, -radius], [0, (high - low) / 2, 0], [0, (low + high) / 2, 0]);
  const tint = bright ? [...Solids.colourOf(colour('rod')), 1] : inks[0];
  const discs = markers.map(marker => {
    const out = [marker[0], 0, marker[2]].map(x => x / Math.hypot(marker[0], marker[2]));
    const along = [0, disc, 0];
    return Solids.affine(along, Solids.cross(out, along), out.map(x => 0.5 * x), marker);
  });
  return [{mesh: 'drum', M: Solids.times(body, rod), tint},
    ...discs.map(M => ({mesh: 'drum', M: Solids.times(body, M), tint: inks[bright ? 0 : 1]}))];
}

function cameraSolids(centre, [first, right, , down]) {
  const less = (a, b) => a.map((x, k) => x - b[k]);
  const forward = less(right.map((x, k) => (x + down[k]) / 2), centre);
  const far = Math.hypot(...forward), unit = v => v.map(x => x / Math.hypot(...v));
  const [x, y, z] = [less(right, first), less(down, first), forward];
  const by = (v, mm) => v.map(one => one * mm);
  const tint = [...Solids.colourOf(colour('accent')), 1], hood = 42 / far;
  return [
    {mesh: 'hood', M: Solids.affine(by(x, hood / 2), by(y, hood / 2), by(z, hood), centre), tint},
    {mesh: 'box', M: Solids.affine(by(unit(x), 15), by(unit(y), 13), by(unit(z), 20), less(centre, by(unit(z), 20))), tint},
  ];
}

// Just found again after a pause, the position may be known so badly that its ellipsoid would hide the cameras.
function isVast(now) {
  return Boolean(now.ellipsoid) && Math.hypot(...now.ellipsoid) > VAST_MM;
}

// The ellipsoid of the position, as many times as large as makes it seen.
function ellipsoid(now, world, solids) {
  const S = now.ellipsoid, size = Math.hypot(...S), at = [now.T[3], now.T[7], now.T[11]];
  if (size * larger > 80 || size * larger < 14) {
    const decade = 10 ** Math.floor(Math.log10(60 / size));
    larger = Math.max(1, decade * [5, 2, 1].find(k => k * decade * size <= 60));
  }
  const columns = [0, 1, 2].map(c => [S[c], S[3 + c], S[6 + c]].map(x => x * larger));
  if (solids) {
    solids.push({mesh: 'ball', M: Solids.affine(...columns, at), tint: [...Solids.colourOf(colour('good')), 1], glass: true});
    return;
  }
  for (const [a, b] of [[0, 1], [1, 2], [2, 0]])
    world.line(Array.from({length: 24}, (_, k) => {
      const [p, q] = [Math.cos(k * Math.PI / 12), Math.sin(k * Math.PI / 12)];
      return at.map((x, i) => x + p * columns[a][i] + q * columns[b][i]);
    }), 'good', 1, true);
}

function paintArm(now, past) {
  const view = opened2d('arm', [-420, 0, 170], 1080, 'z'), arm = sheet(view), shaded = Solids.ready();
  if (!shaded) armLines(now, arm);
  arm.trace(past.map(one => one.arm[one.arm.length - 1]), now.held ? 'bad' : 'accent', 2.5);
  const [x, y, z] = now.target;
  for (const [a, b, c] of [[40, 0, 0], [0, 40, 0], [0, 0, 40]])
    arm.line([[x - a, y - b, z - c], [x + a, y + b, z + c]], 'rod', 2);
  if (now.task) point(now.task, arm);
  arm.finish(shaded ? armSolids(now) : null);
}

function armLines(now, arm) {
  const box = (x, y, z, a, b, c, ink) => {
    const ring = h => [[-a, -b], [a, -b], [a, b], [-a, b]].map(([p, q]) => [x + p, y + q, h]);
    arm.line(ring(z - c), ink, 1, true);
    arm.line(ring(z + c), ink, 1, true);
    ring(z - c).forEach((p, k) => arm.line([p, ring(z + c)[k]], ink));
  };
  box(-450, 0, -20, 600, 600, 20, 'line');
  box(-500, 200, 30, 60, 40, 30, 'rod');
  arm.line(now.arm, now.held ? 'bad' : 'accent', 6);
  for (const joint of now.arm) arm.spot(joint, 'ink', 3);
}

// The arm that holds is red.
function armSolids(now) {
  const bodies = Array.from({length: now.bodies.length / 7}, (_, k) => Solids.ofPose(now.bodies.slice(7 * k, 7 * k + 7)));
  const red = Solids.colourOf(colour('bad'));
  return scene.shapes.flatMap(({parts, colour: [r, g, b, a], body, T}) => {
    const still = body < 0;
    const rgb = [r, g, b].map((x, k) => now.held && !still ? 0.45 * x + 0.55 * red[k] : x);
    return parts.map(({mesh, M}) => ({mesh, M: still ? M : Solids.times(bodies[body], M), tint: [...rgb, a],
      ground: still, casting: !still || T[11] > 0}));
  });
}

// The mark, or the target, as an upright plate that is as thick as it is wide.
function point(task, arm) {
  const along = way => [0, 1, 2].map(k => task.middle[k] + way * task.right[k]);
  const plate = way => [-40, 40].map(high => along(way).map((x, k) => x + high * task.up[k]));
  const ink = task.what === 'go to the target' ? 'good' : 'warn';
  const sides = [-1, 1].map(side => plate(task.aim + side * task.width_mm / 2));
  arm.line([...sides[0], ...sides[1].slice().reverse()], ink, 3, true);
  arm.line([along(-task.reach_mm), along(task.reach_mm)], 'line', 1);
}

// From the front: the line across, the tool, and where it shall go.
function front(task) {
  const canvas = $('front'), ratio = devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const pen = canvas.getContext('2d'), scale = width / frontWide(task);
  const u = along => width / 2 + scale * along, v = up => height / 2 - scale * up;
  pen.clearRect(0, 0, width, height);
  pen.strokeStyle = colour('line');
  pen.lineWidth = ratio;
  pen.font = `${12 * ratio}px system-ui, sans-serif`;
  pen.textAlign = 'center';
  pen.beginPath();
  pen.moveTo(0, v(0));
  pen.lineTo(width, v(0));
  for (let mm = -Math.floor(frontWide(task) / 40) * 20; mm <= frontWide(task) / 2; mm += 20) {
    pen.moveTo(u(mm), v(0) - 4 * ratio);
    pen.lineTo(u(mm), v(0) + 4 * ratio);
  }
  pen.stroke();
  const label = (at, text, y) => pen.fillText(text, Math.min(Math.max(at, 40 * ratio), width - 40 * ratio), y);
  const target = task.what === 'go to the target';
  const left = u(task.aim - task.width_mm / 2), wide = scale * task.width_mm;
  if (task.what !== 'close the clutch') {
    pen.strokeStyle = pen.fillStyle = colour(target ? 'good' : 'warn');
    pen.lineWidth = 2 * ratio;
    pen.strokeRect(left, ratio, wide, height - 2 * ratio);
    if (target) {
      pen.globalAlpha = 0.3;  // the tool is seen before it
      pen.fillRect(left, 0, wide, height);
      pen.globalAlpha = 1;
    }
    label(left + wide / 2 + (task.at[0] < task.aim ? 1 : -1) * (wide / 2 + 24 * ratio), target ? 'target' : 'mark', 16 * ratio);
  }
  pen.strokeStyle = colour(last.held ? 'bad' : 'ink');
  pen.lineWidth = 2 * ratio;
  const [x, y, r] = [u(task.at[0]), Math.min(Math.max(v(task.at[1]), 0), height), 12 * ratio];
  pen.beginPath();
  pen.moveTo(x, 0);
  pen.lineTo(x, height);
  pen.moveTo(x - r, y);
  pen.lineTo(x + r, y);
  pen.stroke();
  pen.fillStyle = colour('quiet');
  label(x + (task.at[0] < task.aim ? -1 : 1) * 22 * ratio, 'tool', height - 8 * ratio);
}

const frontWide = task => 2 * task.reach_mm + 80;  // mm

for (const id of ['world', 'arm']) {
  const canvas = $(id), view = views[id];
  const turn = (across, down) => { view.turn += across; view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + down)); paint(id); };
  canvas.onpointerdown = event => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = event => { if (event.buttons) turn(event.movementX / 100, event.movementY / 100); };
  canvas.onkeydown = event => {
    const way = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]}[event.key];
    const nearer = {'+': 1.2, '=': 1.2, '-': 1 / 1.2}[event.key];
    if (way) turn(...way);
    else if (nearer) zoom(nearer);
    else if (event.key === '0') { Object.assign(view, FIRST_VIEWS[id]); paint(id); }
    else return;
    event.preventDefault();
  };
  const zoom = factor => {
    view.zoom = Math.max(0.3, Math.min(8, view.zoom * factor));
    paint(id);
  };
  canvas.addEventListener('wheel', event => {
    zoom(Math.exp(-event.deltaY / 500));
    event.preventDefault();
  }, {passive: false});
}

// ---- the simulated hand: right, down, away as the camera sees it

function handled(canvas, c) {
  const move = (mm, rad) => {
    if (!last || !last.simulated) return;
    $('alone').checked = false;
    send({hand: {camera: c, mm, rad}});
  };
  const go = (right, down, away, tilt) => tilt ? move([0, 0, 0], [-down / 60, right / 60, away / 60]) : move([right, down, away], [0, 0, 0]);
  canvas.onpointerdown = event => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = event => {
    if (!event.buttons) return;
    const mm = 120 / canvas.clientWidth;  // about what the picture is wide at the handle
    go(event.movementX * mm, event.movementY * mm, 0, event.shiftKey);
  };
  canvas.addEventListener('wheel', event => {
    if (!last || !last.simulated) return;
    go(0, 0, -Math.sign(event.deltaY || event.deltaX) * 5, event.shiftKey);
    event.preventDefault();
  }, {passive: false});
  canvas.onkeydown = event => {
    const way = {ArrowLeft: [-4, 0, 0], ArrowRight: [4, 0, 0], ArrowUp: [0, -4, 0], ArrowDown: [0, 4, 0],
      PageUp: [0, 0, 4], PageDown: [0, 0, -4]}[event.key];
    if (way && last && last.simulated) { go(...way, event.shiftKey); event.preventDefault(); }
  };
}

// In the front view a pixel is as far for the tool; a key that is held down goes further.
$('front').onpointerdown = event => event.target.setPointerCapture(event.pointerId);
$('front').onpointermove = event => {
  if (!event.buttons || !last || !last.task) return;
  const mm = frontWide(last.task) / event.target.clientWidth / last.values.scale;
  push(event.movementX * mm, event.movementY * mm);
};
$('front').onkeydown = event => {
  const mm = (event.repeat ? 6 : 2) / (last ? last.values.scale : 1);
  const way = {ArrowLeft: [-mm, 0], ArrowRight: [mm, 0], ArrowUp: [0, -mm], ArrowDown: [0, mm]}[event.key];
  if (way && last && last.simulated) { push(...way); event.preventDefault(); }
};
function push(right, down) {
  if (!last.simulated) return;
  $('alone').checked = false;
  send({hand: {camera: 0, mm: [right, down, 0], rad: [0, 0, 0]}});
}

// ---- replay

document.addEventListener('replay', () => {
  opens = !!last && (last.clutch || last.demonstration);
  if (opens) clutch(false);
});
document.addEventListener('replayed', ({detail: {now, pictures}}) => {
  picture(pictures);
  writePose(now.pose);
  paint();
});
document.addEventListener('live', () => { if (last) { writePose(last.pose); paint(); } });

// ---- buttons and keys

const clutch = on => {
  if (on) Replay.leave();
  send({clutch: on});
};
$('clutch').onclick = () => last && clutch(!last.clutch);
$('record').onclick = () => last && send({record: !last.recording});
$('take').onclick = () => { last = null; send({take: true}); };
$('background').onclick = () => send({tracker: 'paper'});
$('home').onclick = () => { $('alone').checked = false; send({hand: {home: true}}); };
$('alone').onchange = event => send({hand: {alone: event.target.checked}});
$('drawn').onchange = event => send({hand: {drawn: event.target.checked}});
$('ask').onsubmit = event => {
  event.preventDefault();
  $('alone').checked = false;
  send({task: {operator: $('operator').value, times: Number($('times').value)}});
};
$('there').onclick = () => send({there: true});
$('end').onclick = () => send({end: true});
$('mine').onclick = () => send({end: true});
$('see').onclick = () => { $('alone').checked = true; send({hand: {alone: true}, show: true}); };
for (const radio of document.getElementsByName('tracker')) radio.onchange = () => send({tracker: radio.value});
$('pedal').onclick = () => { asking = true; $('pedal').textContent = 'press it'; };

addEventListener('keydown', event => {
  if (asking) {
    if (event.key !== 'Escape' && event.key !== 'Tab') pedal = event.key;
    asking = false;
    $('pedal').textContent = pedal === ' ' ? 'Space' : pedal;
    event.preventDefault();
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.id === 'operator') return;
  if (event.key === pedal) {
    event.preventDefault();
    if (!event.repeat && !held) { held = true; clutch(true); }
  } else if (!event.repeat && event.key === 'c') $('clutch').click();
  else if (!event.repeat && event.key === 'r') $('record').click();
  else if (!event.repeat && event.key === 'p') $('play').click();
  else if (!event.repeat && event.key === 't' && last && last.task) $('there').click();
}, true);
const release = () => { if (held) { held = false; clutch(false); } };
addEventListener('keyup', event => { if (event.key === pedal) release(); }, true);
addEventListener('blur', release);
const afresh = () => { inks.clear(); paint(); Replay.band(); };
addEventListener('resize', afresh);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', afresh);
setInterval(tell, 500);
addEventListener('DOMContentLoaded', () => { Replay.tell(); logWords(''); connect(); });  // all scripts are there
