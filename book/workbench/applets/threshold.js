'use strict';
// The reader is the threshold: which pixels have moved? Beside the chapter's T and Otsu's.
(() => {
  const {draw, button, element, page, picture, bytes, range, scoreboard} = trinolabApplets.shared;
  const BRUSH = 2;  // pixels of the coarse image, to either side

  // A round with its greys, and the truth as true and false.
  function decoded(round) {
    const packed = bytes(round.moves);
    const [frame, background] = [bytes(round.frame), bytes(round.background)];
    const moves = Array.from(frame, (_, k) => Boolean(packed[k >> 3] & (128 >> (k & 7))));
    return {...round, frame, background, moves};
  }

  // Eq. 5.
  const maskOf = ({frame, background}, T) => Array.from(frame, (grey, k) => Math.abs(grey - background[k]) > T);

  // How well a mask agrees with the truth: what both have, by what one of them has.
  function agreement(mask, moves) {
    let both = 0;
    let either = 0;
    mask.forEach((one, k) => {
      both += one && moves[k];
      either += one || moves[k];
    });
    return both / either;
  }

  // The best T of a round, in whole grey levels, and its agreement.
  function bestOf(round) {
    const all = Array.from({length: 120}, (_, T) => agreement(maskOf(round, T), round.moves));
    const share = Math.max(...all);
    return {T: all.indexOf(share), share};
  }

  function start(box, parameters, data) {
    const rounds = data.rounds.map(decoded);
    let taken = [];  // the agreement of each round that is done, and of the rules
    let painted = null;  // the mask that the reader has painted, until T is moved
    let at = null;  // where the mask lies in the drawing
    const isOver = () => taken.length === rounds.length;
    const round = () => rounds[Math.min(taken.length, rounds.length - 1)];
    const maskNow = T => (painted && painted.T === T ? painted.mask : maskOf(round(), T));
    const board = scoreboard();
    const easel = element('div', {class: 'applet-easel', 'aria-hidden': 'true'});

    function results(mask) {
      const now = round();
      const rules = Object.entries(now.rules).map(([name, T]) => [name, agreement(maskOf(now, T), now.moves)]);
      return {you: agreement(mask, now.moves), ...Object.fromEntries(rules), 'the best T': bestOf(now).share};
    }

    function tell() {
      const names = taken.length ? Object.keys(taken[0]) : [];
      const mean = name => taken.reduce((sum, one) => sum + one[name], 0) / taken.length;
      const rows = names.map(name => [name, ...taken.map(one => (100 * one[name]).toFixed(1)), (100 * mean(name)).toFixed(1)]);
      const heads = ['agreement with the truth / %', ...taken.map((_, n) => `image ${n + 1}`), 'mean'];
      board.show(heads, rows);
    }

    function drawn(svg, width, {T}) {
      const now = round();
      const [w, h] = now.size;
      const gap = 12;
      const scale = Math.min(5, (width - gap) / 2 / w);
      const mask = maskNow(T);
      const second = w * scale + gap;
      at = {x: second, y: 20, scale};
      Object.assign(easel.style, {left: `${second}px`, top: '20px', width: `${w * scale}px`, height: `${h * scale}px`});
      draw(svg, 'text', {x: 0, y: 14}, `${now.name}, twice as bright`);
      draw(svg, 'text', {x: second, y: 14}, 'the mask');
      const size = {width: w * scale, height: h * scale, style: 'image-rendering: pixelated'};
      draw(svg, 'image', {href: picture(Array.from(now.frame, grey => Math.min(255, 2 * grey)), w, h), x: 0, y: 20, ...size});
      draw(svg, 'image', {href: picture(mask.map(one => (one ? 255 : 0)), w, h), x: second, y: 20, ...size});
      const share = (100 * mask.filter(Boolean).length / mask.length).toFixed(1);
      const last = taken.at(-1);
      const before = last ? `Your mask agreed to ${Object.entries(last).map(([name, one]) => `${(100 * one).toFixed(1)} % (${name})`).join(', ')}. ` : '';
      const says = [
        isOver() ? `${before}That was the last image.`
          : `${before}Image ${taken.length + 1} of ${rounds.length}: by ${painted && painted.T === T ? 'your painting' : `T = ${T}`}, ${share} % of it have moved. Is that the handle, with hand and arm?`,
      ];
      return {height: 20 + h * scale, alt: `A frame, and the mask of what has moved in it. ${says[0]}`, says};
    }

    // Painting: what was black where the brush is put down becomes white, and the other way round.
    let brush = null;
    function paint(event) {
      const {T} = view.values();
      const frame = easel.getBoundingClientRect();
      const [w, h] = round().size;
      const x = Math.floor((event.clientX - frame.left) / at.scale);
      const y = Math.floor((event.clientY - frame.top) / at.scale);
      if (x < 0 || y < 0 || x >= w || y >= h) return;
      const mask = [...maskNow(T)];
      if (brush === null) brush = !mask[y * w + x];
      for (let v = Math.max(0, y - BRUSH); v <= Math.min(h - 1, y + BRUSH); v++) {
        for (let u = Math.max(0, x - BRUSH); u <= Math.min(w - 1, x + BRUSH); u++) mask[v * w + u] = brush;
      }
      painted = {T, mask};
      view.redraw();
    }
    easel.addEventListener('pointerdown', event => {
      if (isOver()) return;
      easel.setPointerCapture(event.pointerId);
      paint(event);
      event.preventDefault();
    });
    easel.addEventListener('pointermove', event => { if (brush !== null) paint(event); });
    for (const end of ['pointerup', 'pointercancel']) easel.addEventListener(end, () => { brush = null; });

    const take = button('This is the mask', () => {
      if (isOver()) return;
      taken.push(results(maskNow(view.values().T)));
      painted = null;
      take.disabled = isOver();
      tell();
      view.redraw();
    });
    const view = page(box, {
      label: 'Game: choose the threshold, or paint the mask',
      controls: [range('T', 'threshold T', [0, 100, 1], 30, 'grey levels')],
      buttons: [take],
      handles: [{node: easel}],
      below: [board.node],
      reset: () => {
        taken = [];
        painted = null;
        take.disabled = false;
        tell();
      },
      drawn,
    });
  }

  trinolabApplets.define('threshold', {decoded, maskOf, agreement, bestOf, start});
})();
