'use strict';
// A pointing task through scale, clutch and an added delay, with the log of workbench.teleop.pointing.
(() => {
  const {element, draw, path, dots, write, axes, button, page, range, signed, table} = trinolabApplets.shared;
  const MM_PX = 25.4 / 96;  // of the page's pixels, as style sheets count them
  const WHOLE = ['task', 'moves'];
  const TAP_MS = 250;  // a shorter press that goes no further than this says that the tool is there
  const TAP_PX = 4;
  const TRACK = {low: -15, high: 185};  // mm, of the picture
  // What a hand does by itself, for who looks on: it takes the tool so far, in strokes that are no longer than it can reach.
  const DEMO = {target: 120, width: 10, reach: 60, forth: 0.9, back: 0.7, seconds: 8, each: 0.02};  // mm, s

  let rule = null;  // targets, columns of the log and the spread of the effective width, of workbench.teleop.pointing

  const mean = values => values.reduce((sum, value) => sum + value, 0) / values.length;

  // The tool after another place of the hand, mm: it goes as far as the hand, times the scale, since the clutch was closed.
  function step({tool, origin}, {hand, closed}, scale) {
    if (!closed) return {tool, origin: null};
    const from = origin || {hand, tool};
    return {tool: from.tool + scale * (hand - from.hand), origin: from};
  }

  // The tool's places for samples of hand and clutch, from 0 on.
  function follow({scale, samples}) {
    let state = {tool: 0, origin: null};
    return samples.map(sample => {
      state = step(state, sample, scale);
      return state.tool;
    });
  }

  // What a picture shows that is late: the last of the places [t, tool] that is old enough, or the first of all.
  function shownAt(history, t, delay) {
    let shown = history[0][1];
    for (const [when, tool] of history) if (when <= t - delay) shown = tool;
    return shown;
  }

  // Hand and clutch of the demonstration, every 20 ms up to a time, s: strokes with the clutch closed, and back with it open.
  function demonstration({scale, until}) {
    const strokes = Math.ceil(DEMO.target / (scale * DEMO.reach) - 1e-9);
    const length = DEMO.target / (scale * strokes);
    const smooth = share => length * (1 - Math.cos(Math.PI * share)) / 2;
    return Array.from({length: Math.floor(until / DEMO.each + 1e-9) + 1}, (_, k) => {
      const t = k * DEMO.each;
      const stroke = Math.min(Math.floor(t / (DEMO.forth + DEMO.back) + 1e-9), strokes - 1);
      const within = t - stroke * (DEMO.forth + DEMO.back);
      const closed = within <= DEMO.forth + 1e-9;
      const back = Math.min((within - DEMO.forth) / DEMO.back, 1);
      return {t, closed, hand: closed ? smooth(within / DEMO.forth) : length - smooth(back)};
    });
  }

  // Distance and width of each trial, mm: every target, so many times.
  const conditions = repeats => rule.targets.flatMap(target => Array.from({length: repeats}, () => target));

  // Index of difficulty, bit.
  const difficulty = (distance, width) => Math.log2(distance / width + 1);

  function grouped(log) {
    const groups = new Map();
    for (const row of log) {
      const key = `${row.distance_mm} ${row.width_mm}`;
      groups.set(key, [...(groups.get(key) || []), row]);
    }
    return [...groups.values()];
  }

  const timeOf = row => row.end_s - row.start_s;

  // Of the trials of one target, bit/s; null if fewer than two have different ends.
  function throughputOf(trials) {
    const ends = trials.map(row => row.error_mm);
    if (new Set(ends).size < 2) return null;
    const middle = mean(ends);
    const deviation = Math.sqrt(ends.reduce((sum, end) => sum + (end - middle) ** 2, 0) / (ends.length - 1));
    const distance = mean(trials.map(row => row.distance_mm + row.error_mm));
    return difficulty(Math.max(distance, 0), rule.spread * deviation) / mean(trials.map(timeOf));
  }

  // Throughput, movement time and misses of a log.
  function performance(log) {
    const known = grouped(log).map(throughputOf).filter(rate => rate !== null);
    return {
      throughput_bit_s: known.length ? mean(known) : null,
      movement_s: mean(log.map(timeOf)),
      error_share: mean(log.map(row => Number(Math.abs(row.error_mm) > row.width_mm / 2))),
      moves: mean(log.map(row => row.moves)),
      n: log.length,
    };
  }

  // The straight line through points by least squares, as a function; null where they have one place.
  function fitted(points) {
    const [x0, y0] = [0, 1].map(k => mean(points.map(point => point[k])));
    const slope = mean(points.map(([x, y]) => (x - x0) * (y - y0))) / mean(points.map(([x]) => (x - x0) ** 2));
    return Number.isFinite(slope) ? x => y0 + slope * (x - x0) : null;
  }

  // The log as workbench.teleop.pointing.write_log writes it.
  function csv(log) {
    const quoted = text => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const cell = (row, name) => {
      if (name === 'operator') return quoted(row.operator);
      return WHOLE.includes(name) ? String(row[name]) : row[name].toFixed(6);
    };
    return [rule.columns, ...log.map(row => rule.columns.map(name => cell(row, name)))].map(row => `${row.join(',')}\n`).join('');
  }

  // The log as the file has it: a download, and what is computed from it, has no more digits than six.
  const sixDigits = value => (typeof value === 'number' ? Number(value.toFixed(6)) : value);
  const rounded = row => Object.fromEntries(rule.columns.map(name => [name, sixDigits(row[name])]));

  function start(box, parameters, data) {
    rule = data;
    const runs = [];  // {settings, log, found}
    let run = null;  // the one that goes on: {settings, trials, log}
    let trial = null;  // {start, moves}
    let state = {tool: 0, origin: null};
    let history = [[0, 0]];
    let hand = 0;  // mm
    let press = null;  // of the pointer that is down
    let frame = null;
    let last = 0;  // when the tool moved last
    let marker = null;  // of the tool in the picture
    let placeOf = Number;

    let current = null;  // what the controls say
    const settings = () => (run ? run.settings : current);  // a run keeps those that it began with
    const delay = () => settings().delay;
    const target = () => (run && run.log.length < run.trials.length ? run.trials[run.log.length] : null);

    // --- the picture

    // What the hand that plays does at the time of its slider; null at 0, where the reader's own is shown.
    function demonstrated() {
      const {until, scale, delay: late} = current;
      if (until === 0) return null;
      const samples = demonstration({scale, until});
      const tools = follow({scale, samples});
      const shown = shownAt(samples.map(({t}, k) => [t, tools[k]]), until, late);
      return {...samples.at(-1), tool: tools.at(-1), shown};
    }

    function drawn(svg, width, values) {
      current = values;
      const at = {left: 10, top: 24, width: width - 20, height: 54};
      const {X, group} = axes(svg, at, {...TRACK, label: 'the picture: tool / mm'}, {low: 0, high: 1, ticks: [], label: ''});
      const middle = at.top + at.height / 2;
      placeOf = X;
      draw(group, 'path', {class: 'thin dashed ink', d: `M${X(0)} ${at.top}v${at.height}`});
      const goal = target();
      const demo = run ? null : demonstrated();
      const aim = demo ? [DEMO.target, DEMO.width] : goal && trial ? goal : null;
      if (aim) {
        const [distance, wide] = aim;
        draw(group, 'rect', {class: 'target', x: X(distance - wide / 2), y: at.top, width: X(wide) - X(0), height: at.height});
      }
      marker = draw(group, 'path', {class: 'tool', d: `M0 ${at.top}v${at.height}M-7 ${middle}h14`});
      moveMarker(demo ? demo.shown : shownAt(history, now(), delay()));
      if (demo) draw(group, 'circle', {class: demo.closed ? 'four solid' : 'four thin', cx: X(demo.hand), cy: at.top + at.height - 9, r: 6});
      draw(svg, 'text', {x: at.left, y: 14}, goal && !trial ? 'Press the pad (or Enter): the target appears.'
        : goal ? `Trial ${run.log.length + 1} of ${run.trials.length}`
          : demo ? `A hand by itself, the clutch ${demo.closed ? 'closed' : 'open'}.` : 'Practice: press the pad and drag.');

      drawTimes(width);
      const says = [words()];
      const alt = `A track of the tool from 0 to ${TRACK.high} mm at scale ${values.scale}. ${says[0]}`;
      return {height: at.top + at.height + 40, alt, says};
    }

    // Movement time over difficulty, of the last two runs.
    function drawTimes(width) {
      timesPlot.replaceChildren();
      const plotAt = {left: 40, top: 24, width: width - 52, height: 130};
      const shownRuns = [...runs.slice(-2, -1).map(one => [one, 'five']), ...runs.slice(-1).map(one => [one, 'one'])];
      const point = rows => [difficulty(rows[0].distance_mm, rows[0].width_mm), mean(rows.map(timeOf))];
      const points = ({log}) => grouped(log).map(point);
      const longest = Math.max(2, ...shownRuns.flatMap(([one]) => points(one).map(([, time]) => time)));
      const bitAxis = {low: 1, high: 5.5, label: 'index of difficulty log₂(D / W + 1) / bit'};
      const timeAxis = {low: 0, high: 1.1 * longest, label: 'mean movement time / s'};
      const {X, Y, group} = axes(timesPlot, plotAt, bitAxis, timeAxis);
      for (const [one, colour] of shownRuns) {
        const some = points(one);
        const places = some.map(([bits, time]) => [X(bits), Y(time)]);
        draw(group, 'path', {class: `dots ${colour}`, style: 'stroke-width: 7', d: dots(places)});
        const line = fitted(some);
        if (line) draw(group, 'path', {class: `thin ${colour}`, d: path([1, 5.5].map(bits => [X(bits), Y(line(bits))]))});
      }
      if (!runs.length) draw(group, 'text', {x: plotAt.left + 10, y: plotAt.top + 24}, 'A dot a target, once a run is done.');
      const height = plotAt.top + plotAt.height + 44;
      timesPlot.setAttribute('width', width);
      timesPlot.setAttribute('height', height);
      timesPlot.setAttribute('viewBox', `0 0 ${width} ${height}`);
      const inWords = ([bits, time]) => `${bits.toFixed(1)} bit in ${time.toFixed(2)} s`;
      const each = shownRuns.map(([one]) => points(one).map(inWords).join(', '));
      const told = each.length ? each.join('; ') : 'No run is done yet';
      timesPlot.setAttribute('aria-label', `Mean movement time over the index of difficulty. ${told}.`);
    }

    function words() {
      const goal = target();
      const shown = signed(shownAt(history, now(), delay()).toFixed(1));
      if (goal) {
        const number = `Trial ${run.log.length + 1} of ${run.trials.length}`;
        const [low, high] = [goal[0] - goal[1] / 2, goal[0] + goal[1] / 2];
        if (trial) return `${number}: the target is from ${low} to ${high} mm, the picture shows the tool at ${shown} mm.`;
        const ended = run.log.at(-1);
        const off = ended && Math.abs(ended.error_mm).toFixed(1);
        const before = ended ? `It took ${timeOf(ended).toFixed(2)} s and ended ${off} mm beside the middle. ` : '';
        return `${before}${number}: press the pad, or Enter, and the target appears.`;
      }
      const demo = demonstrated();
      if (demo) {
        return `At ${current.until.toFixed(1)} s the hand is at ${signed(demo.hand.toFixed(0))} mm with the clutch ${demo.closed ? 'closed' : 'open'}, `
          + `the tool at ${signed(demo.tool.toFixed(0))} mm, and the picture shows it at ${signed(demo.shown.toFixed(0))} mm.`;
      }
      if (!runs.length) return `No run yet. The picture shows the tool at ${shown} mm.`;
      const {found, settings: set} = runs.at(-1);
      const rate = found.throughput_bit_s === null ? 'unknown' : `${found.throughput_bit_s.toFixed(2)} bit/s`;
      return `Run ${runs.length}, scale ${set.scale} and ${Math.round(1000 * set.delay)} ms added: throughput ${rate}, `
        + `${found.movement_s.toFixed(2)} s a trial, `
        + `${(100 * found.error_share).toFixed(0)} % beside the target.`;
    }

    const moveMarker = tool => marker.setAttribute('transform', `translate(${placeOf(tool).toFixed(1)} 0)`);
    const now = () => window.performance.now();

    // Frames are drawn only as long as something moves: until the delay has passed since the tool's last move.
    function animate() {
      if (frame !== null) return;
      frame = requestAnimationFrame(() => {
        frame = null;
        moveMarker(shownAt(history, now(), delay()));
        if (press !== null || now() - last < 1000 * delay() + 100) animate();
        else view.redraw();
      });
    }

    // --- the hand

    function sample(t, closed) {
      state = step(state, {hand, closed}, settings().scale);
      if (state.tool !== history.at(-1)[1]) {
        history.push([t, state.tool]);
        last = t;
        const old = history.findLastIndex(([when]) => when <= t - 2000);  // no delay is longer
        if (old > 0) history = history.slice(old);
      }
      animate();
    }

    function appear(t) {
      trial = {start: t, moves: 0};
      view.redraw();
    }

    function there(t, tool) {
      const [distance, width] = target();
      const {scale, delay: late, operator} = run.settings;
      run.log.push(rounded({
        task: run.log.length,
        operator,
        scale,
        delay_s: late,
        distance_mm: distance,
        width_mm: width,
        start_s: (trial.start - run.begun) / 1000,
        end_s: (t - run.begun) / 1000,
        error_mm: tool - distance,
        moves: trial.moves,
      }));
      trial = null;
      home();
      if (!target()) finish();
      view.redraw();
    }

    function home() {
      state = {tool: 0, origin: null};
      history = [[0, 0]];
    }

    function finish() {
      const {settings: set, log} = run;
      run = null;
      if (log.length) runs.push({settings: set, log, found: performance(log)});
      began();
      tell();
    }

    function began() {
      for (const one of view.panel.querySelectorAll('input, select, button')) one.disabled = run !== null;
      go.disabled = false;
      write(go, run ? 'Stop the run' : 'Start a run');
      here.disabled = run === null;
    }

    const timesPlot = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
    timesPlot.setAttribute('role', 'img');
    // The hand that plays gives way to the reader's.
    const takeOver = () => {
      view.stop();
      if (current.until > 0) view.set({until: 0});
    };
    const go = button('Start a run', () => {
      takeOver();
      trial = null;
      home();
      if (run) finish();
      else {
        const set = settings();
        const kept = {...set, operator: set.operator.trim() || 'person'};
        run = {settings: kept, trials: conditions(Number(set.repeats)), log: [], begun: now()};
        began();
        pad.focus();
      }
      view.redraw();
    });
    const confirm = t => {
      if (trial) there(t, state.tool);
      else if (target()) appear(t);
    };
    const here = button('There (Enter)', event => { confirm(event.timeStamp); });

    const timesBox = element('div', {class: 'applet-drawing'}, timesPlot);
    const pad = element('div', {
      class: 'applet-pad', tabindex: 0, role: 'application',
      'aria-label': 'The hand. Drag to the right or left: the clutch is closed while you press. '
        + 'A short tap says that the tool is there. Arrow keys move the hand by 1 mm, with Shift by 10 mm; Enter says there.',
    }, element('span', {}, 'the hand: press and drag; lift to open the clutch; tap for “there”'));
    pad.addEventListener('pointerdown', event => {
      if (!event.isPrimary || event.button !== 0) return;
      takeOver();
      pad.setPointerCapture(event.pointerId);
      const first = target() !== null && trial === null;
      if (first) appear(event.timeStamp);
      if (trial) trial.moves += 1;
      press = {id: event.pointerId, t: event.timeStamp, x: event.clientX, tool: state.tool, hand, most: 0, first};
      pad.classList.add('held');
      sample(event.timeStamp, true);
    });
    pad.addEventListener('pointermove', event => {
      if (!press || event.pointerId !== press.id) return;
      const moved = event.clientX - press.x;
      press.most = Math.max(press.most, Math.abs(moved));
      hand = press.hand + MM_PX * moved;
      sample(event.timeStamp, true);
    });
    const lift = (event, tapped) => {
      if (!press || event.pointerId !== press.id) return;
      const was = press;
      press = null;
      pad.classList.remove('held');
      sample(event.timeStamp, false);
      if (!tapped || !trial || was.first || was.most > TAP_PX || event.timeStamp - was.t > TAP_MS) return;
      trial.moves -= 1;  // a tap is no move
      there(was.t, was.tool);
    };
    pad.addEventListener('pointerup', event => lift(event, true));
    pad.addEventListener('pointercancel', event => lift(event, false));
    pad.addEventListener('keydown', event => {
      const way = {ArrowRight: 1, ArrowLeft: -1}[event.key];
      if (way && !press) {
        takeOver();
        sample(event.timeStamp, true);
        hand += way * (event.shiftKey ? 10 : 1);
        sample(event.timeStamp, true);
        sample(event.timeStamp, false);
      } else if (event.key === 'Enter' && !event.repeat) confirm(event.timeStamp);
      else return;
      event.preventDefault();
    });

    // --- what was found

    const results = element('div', {class: 'applet-results'});
    function tell() {
      if (!runs.length) return;
      const rows = runs.map(({settings: set, found}, k) => [
        k + 1,
        set.scale,
        Math.round(1000 * set.delay),
        found.n,
        found.throughput_bit_s === null ? '–' : found.throughput_bit_s.toFixed(2),
        found.movement_s.toFixed(2),
        (100 * found.error_share).toFixed(0),
      ]);
      const {log} = runs.at(-1);
      const text = csv(log);
      const file = URL.createObjectURL(new Blob([text], {type: 'text/csv'}));
      const about = {class: 'applet-download', href: file, download: `pointing-${runs.length}.csv`};
      const link = element('a', about, `Download the log of run ${runs.length} (CSV)`);
      const isMeasured = name => name !== 'operator' && !WHOLE.includes(name);
      const cells = log.map(row => rule.columns.map(name => (isMeasured(name) ? row[name].toFixed(3) : row[name])));
      const summary = element('summary', {}, `The log of run ${runs.length}`);
      const details = element('details', {}, summary, table(rule.columns, cells, 'The log of the last run'));
      const heads = ['run', 'scale', 'added delay / ms', 'trials', 'throughput / bit/s', 'time / s', 'beside the target / %'];
      results.replaceChildren(table(heads, rows, 'The runs on this page'), link, details);
    }

    const view = page(box, {
      label: 'Applet: a pointing task through scale, clutch and delay',
      controls: [
        range('scale', 'scale, tool : hand', [0.5, 4, 0.5], parameters.scale, ': 1'),
        range('delay', 'added delay', [0, 0.6, 0.025], 0, 'ms', {format: one => String(Math.round(1000 * one))}),
        range('until', 'a hand by itself, time', [0, DEMO.seconds, 0.1], 0, 's', {format: one => one.toFixed(1)}),
        {kind: 'choice', name: 'repeats', label: 'trials of each of nine targets', value: '3', options: [2, 3, 5, 10].map(n => [n, n])},
        {kind: 'text', name: 'operator', label: 'operator', value: 'person'},
      ],
      buttons: [go, here],
      legend: [['two', 'tool, as the picture shows it'], ['band three', 'target'], ['dot one', 'last run'], ['dot five', 'the run before'],
        ['dot four', 'a hand by itself, filled while the clutch is closed']],
      drawn,
      below: [pad, timesBox],
      play: {name: 'until', ms: 100},
    });
    box.append(results);
    began();
  }

  trinolabApplets.define('pointing', {follow, demonstration, shownAt, conditions, difficulty, performance, csv, start});
})();
