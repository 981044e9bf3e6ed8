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
const views = {world: {turn: 0.6, tilt: 0.45, zoom: 1}, arm: {turn: 2.5, tilt: 0.35, zoom: 1}};

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
  for (const one of document.querySelectorAll('main button, main input')) one.disabled = !!words.busy;
  if (words.busy) { last = null; show('banner', ''); }
}

function show(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
  $(id).hidden = !words;
}

// What is wrong, in one line above all else.
function tell() {
  if (ended || !$('busy').hidden) return;
  const words = performance.now() - heard > SILENT_MS
    ? 'No word from trinolab: the connection is lost. The arm holds, and the clutch is open. Trying again.'
    : last ? [...last.troubles.map(one => `${one}; the arm holds`),
      ...(last.held ? [`The arm holds (${last.held}). Open the clutch and close it again.`] : [])].join('. ') : '';
  show('banner', words);
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
    return canvas;
  }));
  $('sliders').replaceChildren(...scene.sliders.map(slider));
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
  input.oninput = () => { write(); send({set: [s.name, Number(input.value)]}); };
  box.dataset.paper = s.paper;
  write();
  return box;
}

// A frame: the length of the text in four bytes, the text, and a JPEG a camera.
async function opened(data) {
  const length = new DataView(data).getUint32(0);
  const now = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  let at = 4 + length;
  const pictures = await Promise.all(now.pictures.map(size => {
    const picture = createImageBitmap(new Blob([new Uint8Array(data, at, size)], {type: 'image/jpeg'}));
    at += size;
    return picture;
  }));
  return {now, pictures};
}

async function draw({now, pictures}) {
  await new Promise(requestAnimationFrame);  // a page that nobody sees draws nothing, and asks for nothing
  heard = performance.now();
  if (!$('busy').hidden) return;
  pictures.forEach((picture, c) => {
    const canvas = $(`camera-${c}`);
    if (canvas.width !== picture.width || canvas.height !== picture.height)
      [canvas.width, canvas.height] = [picture.width, picture.height];
    canvas.getContext('2d').drawImage(picture, 0, 0);
    picture.close();
  });
  const first = !last;
  last = now;
  write(now, first);
  paint();
  document.dispatchEvent(new CustomEvent('drawn', {detail: now}));
  send({drawn: now.number});
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
  for (const [name, , unit] of NUMBERS) {
    const value = now.pose[name];
    $(`pose-${name}`).textContent = value === null ? '–' : unit ? value.toFixed(name.startsWith('sigma') ? 3 : 1) : value;
  }
  $('clutch').setAttribute('aria-pressed', now.clutch);
  $('clutch').textContent = now.clutch ? 'Open clutch' : 'Close clutch';
  $('record').setAttribute('aria-pressed', now.recording);
  $('record').textContent = now.recording ? 'Stop recording' : 'Record';
  show('said', now.said);
  const paper = now.tracker === 'paper';
  for (const box of $('sliders').children) {
    const idle = box.dataset.paper === 'true' && !paper;
    box.classList.toggle('idle', idle);
    box.lastElementChild.disabled = idle;
    box.title = idle ? "of the paper's tracker; choose it below" : '';
  }
  $('paper-help').hidden = !paper;
  if (first) {  // what another tab has set
    for (const radio of document.getElementsByName('tracker')) radio.checked = radio.value === now.tracker;
    for (const [name, value] of Object.entries(now.values)) {
      const input = $(`set-${name}`);
      if (Number(input.value) !== value) { input.value = value; input.previousElementSibling.value = value; }
    }
  }
  if ($('pointing').hidden && now.task) {
    $('pointing').hidden = false;
    $('front').focus();
  }
  $('pointing').hidden = !now.task;
  $('begin').disabled = !!now.task;
  show('points', now.points);
  if (now.task) $('doing').textContent = doing(now.task);
  $('simulation').hidden = $('hand-help').hidden = !now.simulated;
  for (const canvas of $('cameras').children) canvas.classList.toggle('movable', now.simulated);
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
  return `${task.done + 1} of ${task.of}: ${words[task.what]}`;
}

// ---- 3-D: lines seen by a camera that turns about a middle

function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(); }

function canvasOf(id, middle, size, up) {
  const canvas = $(id), ratio = devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const pen = canvas.getContext('2d'), view = views[id];
  pen.clearRect(0, 0, width, height);
  const scale = view.zoom * Math.min(width, height) / size;
  const [cs, sn, ct, st] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
  const place = point => {
    const [a, b, c] = point.map((x, k) => x - middle[k]);
    const [x, y, z] = up === 'z' ? [a, b, c] : [a, c, -b];  // the world's y points down
    const across = cs * x + sn * y, away = -sn * x + cs * y;
    return [width / 2 + scale * across, height / 2 - scale * (ct * z + st * away)];
  };
  const line = (points, ink, wide = 1, closed = false) => {
    pen.beginPath();
    for (const point of points) pen.lineTo(...place(point));
    if (closed) pen.closePath();
    pen.strokeStyle = colour(ink);
    pen.lineWidth = wide * ratio;
    pen.lineJoin = pen.lineCap = 'round';
    pen.stroke();
  };
  const dot = (point, ink, radius) => {
    const [u, v] = place(point);
    pen.beginPath();
    pen.arc(u, v, radius * ratio, 0, 7);
    pen.fillStyle = colour(ink);
    pen.fill();
  };
  const words = (point, text) => {
    const [u, v] = place(point);
    pen.fillStyle = colour('quiet');
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    pen.fillText(text, u + 5 * ratio, v - 4 * ratio);
  };
  return {line, dot, words};
}

function paint() {
  if (!scene || !last) return;
  const world = canvasOf('world', [0, -110, 370], 620, 'y');
  for (const {name, field: [centre, ...corners]} of scene.cameras) {
    for (const corner of corners) world.line([centre, corner], 'line');
    world.line(corners, 'line', 1, true);
    world.dot(centre, 'accent', 4);
    world.words(centre, name);
  }
  if (last.T) {
    const T = last.T, put = p => [0, 1, 2].map(r => T[4 * r] * p[0] + T[4 * r + 1] * p[1] + T[4 * r + 2] * p[2] + T[4 * r + 3]);
    const [low, high] = scene.handle.rings.map(ring => ring.map(put));
    for (const k of [0, 6, 12, 18]) world.line([low[k], high[k]], 'rod', 2);
    world.line(low, 'rod', 2);
    world.line(high, 'rod', 2);
    for (const marker of scene.handle.markers) world.dot(put(marker), 'ink', 2);
  }
  const arm = canvasOf('arm', [-400, 0, 180], 1050, 'z');
  const box = (x, y, z, a, b, c, ink) => {
    const ring = h => [[-a, -b], [a, -b], [a, b], [-a, b]].map(([p, q]) => [x + p, y + q, h]);
    arm.line(ring(z - c), ink, 1, true);
    arm.line(ring(z + c), ink, 1, true);
    ring(z - c).forEach((p, k) => arm.line([p, ring(z + c)[k]], ink));
  };
  box(-450, 0, -20, 600, 600, 20, 'line');
  box(-500, 200, 30, 60, 40, 30, 'rod');
  arm.line(last.arm, last.held ? 'bad' : 'accent', 6);
  for (const point of last.arm) arm.dot(point, 'ink', 3);
  const [x, y, z] = last.target;
  for (const [a, b, c] of [[40, 0, 0], [0, 40, 0], [0, 0, 40]])
    arm.line([[x - a, y - b, z - c], [x + a, y + b, z + c]], 'rod', 2);
  if (last.task) {
    point(last.task, arm);
    front(last.task);
  }
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
  pen.beginPath();
  pen.moveTo(0, v(0));
  pen.lineTo(width, v(0));
  pen.stroke();
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
}

const frontWide = task => 2 * task.reach_mm + 80;  // mm

for (const id of ['world', 'arm']) {
  const canvas = $(id), view = views[id];
  const turn = (across, down) => { view.turn += across; view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + down)); paint(); };
  canvas.onpointerdown = event => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = event => { if (event.buttons) turn(event.movementX / 100, event.movementY / 100); };
  canvas.onkeydown = event => {
    const way = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]}[event.key];
    if (way) { turn(...way); event.preventDefault(); }
  };
  canvas.addEventListener('wheel', event => {
    view.zoom = Math.max(0.3, Math.min(8, view.zoom * Math.exp(-event.deltaY / 500)));
    paint();
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

// ---- buttons and keys

const clutch = on => send({clutch: on});
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
  else if (!event.repeat && event.key === 't' && last && last.task) $('there').click();
}, true);
const release = () => { if (held) { held = false; clutch(false); } };
addEventListener('keyup', event => { if (event.key === pedal) release(); }, true);
addEventListener('blur', release);
addEventListener('resize', paint);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', paint);
setInterval(tell, 500);
connect();
