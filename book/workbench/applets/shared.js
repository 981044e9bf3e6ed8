'use strict';
// What the applets of the chapters share: where they are registered, their controls, and axes in SVG.
// An applet is a file of its own: functions of numbers, which the tests call, and a `start` that draws with them.
window.trinolabApplets = window.trinolabApplets || (() => {
  const applets = {};
  const SVG = 'http://www.w3.org/2000/svg';
  let count = 0;

  // --- elements

  function element(tag, attributes = {}, ...children) {
    const one = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
    one.append(...children);
    return one;
  }

  function draw(parent, tag, attributes = {}, text = null) {
    const one = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
    if (text !== null) one.textContent = text;
    parent.append(one);
    return one;
  }

  // A place in the drawing needs no more than a tenth of a pixel.
  const path = points => points.map(([x, y], k) => `${k ? 'L' : 'M'}${x.toFixed(1)} ${y.toFixed(1)}`).join('');

  // Dots of one kind are one path: lines of no length with round ends.
  const dots = points => points.map(([x, y]) => `M${x.toFixed(1)} ${y.toFixed(1)}h0`).join('');

  function write(node, text) {
    if (node.textContent !== text) node.textContent = text;  // nothing is read aloud twice
  }

  // --- axes

  function ticksOf(low, high, most) {
    const rough = (high - low) / most;
    const ten = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(one => one * ten).find(one => one >= rough * 0.999);
    const ticks = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
      ticks.push(Number((k * step).toPrecision(12)));
    }
    return ticks;
  }

  const LETTERS = {'-': '⁻', 0: '⁰', 1: '¹', 2: '²', 3: '³', 4: '⁴', 5: '⁵', 6: '⁶', 7: '⁷', 8: '⁸', 9: '⁹'};
  const power = exponent => `10${[...String(exponent)].map(letter => LETTERS[letter]).join('')}`;

  // Axes of a panel. `at` is its frame in px, `x` and `y` have low, high, label, perhaps ticks; log with ticks where they are
  // logarithmic.
  // Gives the functions from values to places, and the group that curves are drawn into, cut off at the frame.
  function axes(svg, at, x, y) {
    const along = (axis, from, length) => {
      const scale = axis.log ? Math.log10 : value => value;
      const low = scale(axis.low);
      const high = scale(axis.high);
      return value => from + length * (scale(value) - low) / (high - low);
    };
    const X = along(x, at.left, at.width);
    const Y = along(y, at.top + at.height, -at.height);
    const inner = draw(svg, 'g');
    const ticks = (axis, most) => axis.ticks || ticksOf(axis.low, axis.high, most);
    const name = (axis, value) => (axis.log && (value < 0.01 || value > 1000) ? power(Math.round(Math.log10(value))) : signed(value));
    for (const value of ticks(x, Math.max(2, at.width / 55))) {
      draw(inner, 'path', {class: 'grid', d: path([[X(value), at.top], [X(value), at.top + at.height]])});
      if (x.label !== '') draw(svg, 'text', {x: X(value), y: at.top + at.height + 16, 'text-anchor': 'middle'}, name(x, value));
    }
    for (const value of ticks(y, Math.max(2, at.height / 30))) {
      draw(inner, 'path', {class: 'grid', d: path([[at.left, Y(value)], [at.left + at.width, Y(value)]])});
      draw(svg, 'text', {x: at.left - 5, y: Y(value) + 4, 'text-anchor': 'end'}, name(y, value));
    }
    const clip = `applet-clip-${count++}`;
    const frame = {x: at.left, y: at.top, width: at.width, height: at.height};
    draw(draw(svg, 'clipPath', {id: clip}), 'rect', frame);
    const group = draw(svg, 'g', {'clip-path': `url(#${clip})`});
    draw(svg, 'rect', {...frame, class: 'frame'});
    if (x.label) draw(svg, 'text', {x: at.left + at.width / 2, y: at.top + at.height + 34, 'text-anchor': 'middle'}, x.label);
    if (y.label) draw(svg, 'text', {x: at.left, y: at.top - 8, 'text-anchor': 'start'}, y.label);
    return {X, Y, group};
  }

  // --- controls

  function slider(c, changed) {
    const id = `applet-${count++}`;
    const label = element('label', {for: id}, c.label);
    const output = element('output', {for: id});
    const input = element('input', {id, type: 'range', name: c.name});
    const inner = c.log ? Math.log10 : value => value;
    const outer = c.log ? value => Number((10 ** value).toPrecision(c.precision || 3)) : value => value;
    let exact = null;  // what the program has set, as it is, until the reader moves the slider
    const get = () => (exact === null ? outer(Number(input.value)) : exact);
    const show = () => {
      const words = c.format(get()) + (c.unit === '°' ? '°' : c.unit ? ` ${c.unit}` : '');
      write(output, words);
      input.setAttribute('aria-valuetext', words);
    };
    Object.assign(input, {min: inner(c.low), max: inner(c.high), step: c.step});
    input.addEventListener('input', () => {
      exact = null;
      show();
      changed();
    });
    const set = value => {
      exact = value;
      input.value = inner(value);
      show();
    };
    const move = place => {
      exact = null;
      input.value = place;
      show();
    };
    const isAtEnd = () => Number(input.value) >= Number(input.max) - c.step / 2;
    const advance = stops => move(Number(input.value) + stops * c.step);
    const toStart = () => move(input.min);
    return {node: element('div', {class: 'applet-slider'}, label, output, input), get, set, isAtEnd, advance, toStart};
  }

  // What `page` needs to know of a slider; `signed` writes a number with a minus sign.
  const range = (name, label, [low, high, step], value, unit = '', more = {}) => (
    {kind: 'slider', name, label, low, high, step, value, unit, format: String, ...more});
  const signed = text => String(text).replace('-', '−');

  function check(c, changed) {
    const id = `applet-${count++}`;
    const input = element('input', {id, type: 'checkbox', name: c.name});
    input.addEventListener('change', changed);
    return {
      node: element('div', {class: 'applet-check'}, input, element('label', {for: id}, c.label)),
      get: () => input.checked,
      set: value => { input.checked = value; },
    };
  }

  // What holds a text, with its label before it.
  function labelled(input, event, {name, label}, changed) {
    Object.assign(input, {id: `applet-${count++}`, name});
    input.addEventListener(event, changed);
    return {
      node: element('div', {class: 'applet-choice'}, element('label', {for: input.id}, label), input),
      get: () => input.value,
      set: value => { input.value = value; },
    };
  }

  function choice(c, changed) {
    const options = c.options.map(([value, text]) => element('option', {value}, text));
    return labelled(element('select', {}, ...options), 'change', c, changed);
  }

  const text = (c, changed) => labelled(element('input', {type: 'text', maxlength: 40, autocomplete: 'off'}), 'input', c, changed);

  function button(text, pressed) {
    const one = element('button', {type: 'button'}, text);
    one.addEventListener('click', pressed);
    return one;
  }

  // The frame of an applet: controls with a reset button, a drawing that fits the width, and what it says.
  // `drawn(svg, width, values)` draws, and gives `height`, `alt` (the drawing in words) and `says` (lines of text). What stands
  // `below` the drawing is the applet's own. `play` names a slider that a button moves through its range, so many `stops` at
  // a time, one after so many `ms`; for who wants no motion the button makes one step. `reset` begins anew what is no slider's.
  function page(box, {label, controls, drawn, buttons = [], legend = [], below = [], handles = [], play = null, reset = null}) {
    const makers = {slider, check, choice, text};
    const made = {};
    const sliders = element('div', {class: 'applet-controls'});
    const checks = element('div', {class: 'applet-checks'});
    const svg = document.createElementNS(SVG, 'svg');
    svg.setAttribute('role', 'img');
    const says = element('div', {class: 'applet-says', 'aria-live': 'polite'});
    const values = () => Object.fromEntries(Object.entries(made).map(([name, one]) => [name, one.get()]));
    const redraw = () => {
      const width = Math.floor(svg.parentNode.clientWidth);
      if (width === 0) return;  // nobody sees it
      svg.replaceChildren();
      const {height, alt, says: lines} = drawn(svg, width, values());
      svg.setAttribute('width', width);
      svg.setAttribute('height', height);
      svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
      svg.setAttribute('aria-label', alt);
      while (says.children.length < lines.length) says.append(element('p'));
      while (says.children.length > lines.length) says.lastChild.remove();
      lines.forEach((line, k) => write(says.children[k], line));
    };
    const set = some => {
      for (const [name, value] of Object.entries(some)) made[name].set(value);
      redraw();
    };
    for (const c of controls) {
      made[c.name] = makers[c.kind](c, redraw);
      (c.kind === 'slider' ? sliders : checks).append(made[c.name].node);
    }
    const defaults = Object.fromEntries(controls.map(c => [c.name, c.value]));
    const player = play && playing(play, made, redraw, says, svg);
    const back = button('Reset', () => {
      if (player) player.stop();
      if (reset) reset();
      set(defaults);
    });
    const row = element('div', {class: 'applet-buttons'}, ...(player ? [player.node] : []), ...buttons, back);
    const panel = element('div', {}, sliders, checks, row);
    const keys = legend.map(([kind, words]) => element('li', {}, element('i', {class: kind}), words));
    const key = element('ul', {class: 'applet-legend'}, ...keys);
    const drawing = element('div', {class: 'applet-drawing'}, svg, ...handles.map(one => one.node));
    box.replaceChildren(panel, drawing, ...below, key, says);
    // JupyterLab takes the keys of whatever has the focus for commands of the notebook, unless that says so itself.
    box.addEventListener('focusin', event => event.target.setAttribute('data-lm-suppress-shortcuts', 'true'));
    box.setAttribute('role', 'group');
    box.setAttribute('aria-label', label);
    for (const [name, value] of Object.entries(defaults)) made[name].set(value);
    new ResizeObserver(redraw).observe(drawing);
    redraw();
    return {values, set, redraw, stop: player ? player.stop : () => {}, svg, panel, says, defaults};
  }

  // The button that plays: it moves a slider by itself until it is pressed again, or the slider is at its end.
  function playing({name, stops = 1, ms = 100, words = 'Play'}, made, redraw, says, svg) {
    let timer = null;
    const still = window.matchMedia('(prefers-reduced-motion: reduce)').matches;
    const show = () => {
      const on = timer !== null;
      write(node, on ? 'Pause' : still ? 'One step' : words);
      says.setAttribute('aria-live', on ? 'off' : 'polite');  // nobody hears a sentence ten times a second
    };
    const stop = () => {
      clearInterval(timer);
      timer = null;
      show();
    };
    const step = () => {
      if (!svg.isConnected || made[name].isAtEnd()) return stop();
      made[name].advance(stops);
      return redraw();
    };
    const node = button(words, () => {
      if (timer !== null) return stop();
      if (made[name].isAtEnd()) made[name].toStart();
      step();
      if (!still) timer = setInterval(step, ms);
      return show();
    });
    node.classList.add('applet-play');
    show();
    return {node, stop};
  }

  // A table of numbers; a narrow screen scrolls it.
  function table(names, rows, label) {
    const head = element('tr', {}, ...names.map(name => element('th', {scope: 'col'}, name)));
    const body = rows.map(row => element('tr', {}, ...row.map(value => element('td', {}, value))));
    const one = element('table', {}, element('thead', {}, head), element('tbody', {}, ...body));
    return element('div', {class: 'applet-table', tabindex: 0, role: 'region', 'aria-label': label}, one);
  }

  // The score of a game, once there is one.
  function scoreboard() {
    const node = element('div', {});
    const show = (names, rows) => node.replaceChildren(...(rows.length ? [table(names, rows, 'The score')] : []));
    return {node, show};
  }

  // Grey levels, row by row, as a picture's address.
  function picture(greys, width, height) {
    const canvas = element('canvas', {width, height});
    const context = canvas.getContext('2d');
    const pixels = context.createImageData(width, height);
    greys.forEach((value, k) => pixels.data.set([value, value, value, 255], 4 * k));
    context.putImageData(pixels, 0, 0);
    return canvas.toDataURL();
  }

  // Bytes in base64.
  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));

  // A place of a drawing that can be dragged, for those who point; `moved(x, y)` is in px of the drawing. It lies over the
  // drawing, which is made anew all the time, and a finger must not lose what it holds.
  function handle(name, moved) {
    const node = element('div', {class: 'applet-handle', 'data-drag': name, 'aria-hidden': 'true'});
    let held = null;
    node.addEventListener('pointerdown', event => {
      held = event.pointerId;
      node.setPointerCapture(held);
      event.preventDefault();
    });
    node.addEventListener('pointermove', event => {
      if (event.pointerId !== held) return;
      const frame = node.parentNode.getBoundingClientRect();
      moved(event.clientX - frame.left, event.clientY - frame.top);
    });
    const end = () => { held = null; };
    node.addEventListener('pointerup', end);
    node.addEventListener('pointercancel', end);
    const put = (x, y) => { node.style.translate = `${x}px ${y}px`; };
    return {node, put};
  }

  // --- numbers

  // A random number generator that gives the same on each page (mulberry32), and normal numbers by Box and Muller.
  function normals(seed) {
    let state = seed >>> 0;
    const uniform = () => {
      state = (state + 0x6D2B79F5) >>> 0;
      let t = state;
      t = Math.imul(t ^ (t >>> 15), t | 1);
      t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
    return () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
  }

  const times = (a, b) => a.map(row => b[0].map((_, j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));
  const apply = (a, x) => a.map(row => row.reduce((sum, value, k) => sum + value * x[k], 0));
  const transposed = a => a[0].map((_, j) => a.map(row => row[j]));
  const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);

  // Register an applet, and start it wherever the page has a place for it.
  // What the applet needs to know lies in its place until then; it is kept for whoever asks, under `known`.
  function define(name, applet) {
    applets[name] = applet;
    for (const box of document.querySelectorAll(`.applet[data-applet="${name}"]`)) {
      const script = box.querySelector('script[type="application/json"]');
      if (!script) continue;  // it has started
      applet.known = JSON.parse(script.textContent);
      applet.start(box, applet.known.parameters, applet.known.data);
    }
  }

  return Object.assign(applets, {
    shared: {element, draw, path, dots, write, axes, button, page, picture, range, signed, table, scoreboard, bytes, handle, normals, times, apply, transposed, dot},
    define,
  });
})();
