'use strict';
// The reader is the matcher: which spot of CCD1 is which of CCD3? Beside three rules that pair the same spots.
(() => {
  const {draw, path, button, element, page, scoreboard} = trinolabApplets.shared;
  const KINDS = ['one', 'two', 'three', 'four', 'five'];

  // How many pairs are right and wrong by the truth, and how many there are to be found.
  function judged({labels: [left, right]}, pairs) {
    const rightOnes = pairs.filter(([a, b]) => left[a] >= 0 && left[a] === right[b]).length;
    return {right: rightOnes, wrong: pairs.length - rightOnes, due: new Set(left.filter(one => one >= 0 && right.includes(one))).size};
  }

  // The sums over shots: of the reader's pairs, a list a shot, and of each rule for the same shots.
  function scores(shots, taken) {
    const total = pairsOf => taken.map((_, n) => judged(shots[n], pairsOf(n)))
      .reduce((sum, one) => ({right: sum.right + one.right, wrong: sum.wrong + one.wrong, due: sum.due + one.due}), {right: 0, wrong: 0, due: 0});
    const names = Object.keys(shots[0].rules);
    return {you: total(n => taken[n]), ...Object.fromEntries(names.map(name => [name, total(n => shots[n].rules[name])]))};
  }

  function start(box, parameters, {shots}) {
    let taken = [];  // the pairs of the shots that are done
    let pairs = [];
    let chosen = null;  // of the left spots
    const isOver = () => taken.length === shots.length;
    const shotNow = () => shots[Math.min(taken.length, shots.length - 1)];
    const spots = element('div', {class: 'applet-spots'});
    const board = scoreboard();

    // The k-th spot of the left or the right view is pressed.
    function press(side, k) {
      if (isOver()) return;
      const kept = pairs.filter(pair => pair[side] !== k);
      if (side === 0) {
        chosen = chosen === k ? null : k;
        if (kept.length < pairs.length) pairs = kept;
      } else if (chosen === null) pairs = kept;
      else {
        pairs = [...kept.filter(([left]) => left !== chosen), [chosen, k]];
        chosen = null;
      }
      view.redraw();
    }

    function tell() {
      const rows = taken.length ? Object.entries(scores(shots, taken)) : [];
      board.show(['who', 'right', 'wrong', 'to be found'], rows.map(([name, {right, wrong, due}]) => [name, right, wrong, due]));
    }

    function drawn(svg, width) {
      const shot = shotNow();
      const gap = 12;
      const scale = Math.min(3, (width - gap) / (shot.views[0].size[0] + shot.views[1].size[0]));
      const starts = [0, shot.views[0].size[0] * scale + gap];
      const place = (side, [u, v]) => shot.views[side].corner.map((from, k) => ([u, v][k] - from + 0.5) * scale).map((one, k) => one + [starts[side], 20][k]);
      shot.views.forEach((one, side) => {
        const size = {width: one.size[0] * scale, height: one.size[1] * scale};
        draw(svg, 'text', {x: starts[side], y: 14}, one.name);
        draw(svg, 'image', {href: one.picture, x: starts[side], y: 20, ...size, preserveAspectRatio: 'none'});
      });
      const right = shot.views[1];
      const inner = draw(svg, 'svg', {x: starts[1], y: 20, width: right.size[0] * scale, height: right.size[1] * scale});
      if (chosen !== null) {
        const [a, b, c] = shot.lines[chosen];
        const along = [[-2000, 0], [2000, 0]].map(([s]) => {
          const foot = [-a * c, -b * c].map((value, k) => value + [-b, a][k] * (s + (right.corner[0] * -b + right.corner[1] * a)));
          return foot.map((value, k) => (value - right.corner[k] + 0.5) * scale);
        });
        draw(inner, 'path', {class: 'on-image one-on-image', d: path(along)});
      }
      pairs.forEach(([a, b], n) => {
        const ends = [place(0, shot.views[0].spots[a]), place(1, shot.views[1].spots[b])];
        draw(svg, 'path', {class: `line on-pair ${KINDS[n % 5]}`, d: path(ends)});
      });
      const nodes = shot.views.flatMap((one, side) => one.spots.map((uv, k) => {
        const number = pairs.findIndex(pair => pair[side] === k) + 1;
        const name = `${one.name}, spot ${k + 1}${number ? `, pair ${number}` : ''}`;
        const node = button(number ? String(number) : side ? 'ABCDEFGHIJKLMNOP'[k] : 'abcdefghijklmnop'[k], () => press(side, k));
        node.setAttribute('aria-label', name);
        node.setAttribute('aria-pressed', side === 0 && chosen === k);
        node.className = number ? 'paired' : '';
        const [x, y] = place(side, uv);
        node.style.translate = `${x}px ${y}px`;
        return node;
      }));
      const focused = [...spots.children].indexOf(document.activeElement);
      spots.replaceChildren(...nodes);
      if (focused >= 0 && nodes[focused]) nodes[focused].focus({preventScroll: true});
      const height = 20 + Math.max(...shot.views.map(one => one.size[1])) * scale;
      const says = [isOver() ? `That were all ${shots.length} instants. ${verdict()}`
        : `Instant ${taken.length + 1} of ${shots.length}: ${chosen === null ? 'press a spot of CCD1' : 'press its partner in CCD3'}. `
          + `Pairs so far: ${pairs.length}.`];
      return {height, alt: `Parts of two images with ${shot.views.map(one => one.spots.length).join(' and ')} spots. ${says[0]}`, says};
    }

    function verdict() {
      const found = scores(shots, taken);
      const worth = ({right, wrong}) => right - wrong;
      const beaten = Object.keys(found).filter(name => name !== 'you' && worth(found.you) > worth(found[name]));
      return beaten.length ? `By right less wrong pairs you are better than ${beaten.join(' and ')}.` : 'No rule is worse than you.';
    }

    const done = button('These are the pairs', () => {
      if (isOver()) return;
      taken.push(pairs);
      pairs = [];
      chosen = null;
      done.disabled = isOver();
      tell();
      view.redraw();
    });
    const view = page(box, {
      label: 'Game: pair the spots of two images',
      controls: [],
      buttons: [done],
      handles: [{node: spots}],
      below: [board.node],
      legend: [['one', 'epipolar line of the spot that is pressed']],
      reset: () => {
        taken = [];
        pairs = [];
        chosen = null;
        done.disabled = false;
        tell();
      },
      drawn,
    });
  }

  trinolabApplets.define('pairs', {judged, scores, start});
})();
