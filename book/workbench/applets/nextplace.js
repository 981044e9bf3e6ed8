'use strict';
// The reader is the filter: say where the handle will be in the next frame, beside three rules that do the same.
(() => {
  const {draw, path, dots, element, page, signed, scoreboard} = trinolabApplets.shared;
  const FIRST = 8;  // places that are shown before the first guess
  const GUESSES = 15;
  const VIEW_PX = 420;  // of the image, in the picture's width

  const missOf = ([u, v], [a, b]) => Math.hypot(u - a, v - b);
  const mean = values => values.reduce((sum, value) => sum + value, 0) / values.length;

  // The mean miss in px of the reader's guesses, the first for the place FIRST, and of each rule for the same places.
  function scores({places, rules}, guesses) {
    const missed = expected => mean(guesses.map((_, n) => missOf(expected(n), places[FIRST + n])));
    return {
      you: missed(n => guesses[n]),
      ...Object.fromEntries(Object.entries(rules).map(([name, all]) => [name, missed(n => all[FIRST + n])])),
    };
  }

  function start(box, parameters, data) {
    const {places} = data;
    let guesses = [];
    let cursor = places[FIRST - 1];  // for who plays by keys
    let shown = null;  // the picture's scale and its middle
    const isOver = () => guesses.length === GUESSES;

    const surface = element('div', {
      class: 'applet-surface', tabindex: 0, role: 'application',
      'aria-label': 'The image. Click where the handle will be in the next frame; or move the cross by the arrow keys, 5 px at a time, '
        + 'with Shift 25 px, and press Enter.',
    });
    const board = scoreboard();

    function guess(place) {
      if (isOver()) return;
      guesses.push(place);
      cursor = places[FIRST - 1 + guesses.length];
      tell();
      view.redraw();
    }

    function tell() {
      const found = guesses.length ? Object.entries(scores(data, guesses)) : [];
      board.show(['who', 'mean miss / px'], found.map(([name, px]) => [name, px.toFixed(1)]));
    }

    function drawn(svg, width) {
      const height = Math.min(width, 440);
      const zoom = Math.max(width, height) / VIEW_PX;
      const now = FIRST - 1 + guesses.length;
      const middle = places[now];
      shown = {zoom, middle, width, height};
      Object.assign(surface.style, {width: `${width}px`, height: `${height}px`});
      const at = ([u, v]) => [width / 2 + (u - middle[0]) * zoom, height / 2 + (v - middle[1]) * zoom];
      draw(svg, 'rect', {class: 'frame', x: 0.5, y: 0.5, width: width - 1, height: height - 1});
      const way = places.slice(0, now + 1).map(at);
      draw(svg, 'path', {class: 'thin ink', d: path(way)});
      draw(svg, 'path', {class: 'dots ink', d: dots(way)});
      draw(svg, 'circle', {class: 'line ink', cx: at(middle)[0], cy: at(middle)[1], r: 7});
      const cross = (place, kind, size) => {
        const [x, y] = at(place);
        draw(svg, 'path', {class: kind, d: `M${x - size} ${y}h${2 * size}M${x} ${y - size}v${2 * size}`});
      };
      if (guesses.length) {
        Object.values(data.rules).forEach((all, k) => cross(all[now], `line ${['three', 'five', 'two'][k]}`, 5));
        cross(guesses.at(-1), 'line one', 7);
      }
      if (!isOver()) cross(cursor, 'thin dashed one', 10);
      const [du, dv] = [0, 1].map(k => signed((places[now][k] - places[now - 1][k]).toFixed(0)));
      const last = guesses.length
        ? `You were ${missOf(guesses.at(-1), middle).toFixed(0)} px off, the filter ${missOf(data.rules['the filter'][now], middle).toFixed(0)} px. ` : '';
      const says = [
        isOver() ? `${last}That was the last of ${GUESSES} frames. ${verdict()}`
          : `${last}Frame ${guesses.length + 1} of ${GUESSES}: the last step was ${du} px to the right and ${dv} px down. Where is the handle next?`,
      ];
      const alt = `The last places of the handle in the image, the last one in the middle. ${says[0]}`;
      return {height, alt, says};
    }

    function verdict() {
      const {you, ...rules} = scores(data, guesses);
      const beaten = Object.entries(rules).filter(([, px]) => you < px).map(([name]) => name);
      return beaten.length ? `You are better than ${beaten.join(' and ')}.` : 'All three rules are better than you.';
    }

    surface.addEventListener('pointerup', event => {
      if (event.button !== 0) return;
      const frame = surface.getBoundingClientRect();
      const {zoom, middle, width, height} = shown;
      guess([
        middle[0] + (event.clientX - frame.left - width / 2) / zoom,
        middle[1] + (event.clientY - frame.top - height / 2) / zoom,
      ]);
    });
    surface.addEventListener('keydown', event => {
      const way = {ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1]}[event.key];
      if (way) {
        cursor = cursor.map((value, k) => value + way[k] * (event.shiftKey ? 25 : 5));
        view.redraw();
      } else if (event.key === 'Enter' && !event.repeat) guess(cursor);
      else return;
      event.preventDefault();
    });
    const view = page(box, {
      label: 'Game: say where the handle will be in the next frame',
      controls: [],
      legend: [['ink', 'places so far (ring: the last)'], ['one', 'you (dashed: the cross for keys)'], ['three', 'last place'],
        ['five', 'last step'], ['two', 'the filter']],
      handles: [{node: surface}],
      below: [board.node],
      reset: () => {
        guesses = [];
        cursor = places[FIRST - 1];
        tell();
      },
      drawn,
    });
  }

  trinolabApplets.define('nextplace', {scores, start});
})();
