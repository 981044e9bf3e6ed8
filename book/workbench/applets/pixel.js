'use strict';
// One pixel and its background (Eq. 5-6): what the rate alpha, the threshold T and the cures do to three stories.
(() => {
  const {draw, path, dots, axes, page, range, handle, normals} = trinolabApplets.shared;
  const RATE_HZ = 30;
  const FRAMES = 210;
  const STORIES = [
    {name: 'lamp', title: 'lamp, 1.5 times the light from 1 s on', from: 1, to: 99, before: 45, during: 67.5},
    {name: 'hand', title: 'hand, rests here from 1 s to 5 s', from: 1, to: 5, before: 45, during: 90},
    {name: 'shadow', title: 'shadow, from 1 s to 4 s', from: 1, to: 4, before: 67.5, during: 47},
  ];
  const GREYS = {low: 20, high: 120};

  // Whether a pixel has moved (Eq. 5); a shadow may take a share of the light.
  function hasMoved(frame, background, threshold, shadowShare) {
    const change = frame - background;
    return change > threshold || change < -shadowShare * background - threshold;
  }

  // The background takes in a share of the frame (Eq. 6).
  function renewed(background, frame, rate) {
    return rate * frame + (1 - rate) * background;
  }

  // A pixel's history. `levels` are the frames f_k, `alpha` and `T` those of Eq. 5-6, `maskedRate` the rate where something
  // moves, null for Eq. 6 as printed. The first frame is the first background.
  // Gives for each frame the background that it is compared with, whether it counts as moving, and the last background.
  function compute({levels, alpha, T, shadowShare = 0, maskedRate = null}) {
    const before = [];
    const moving = [];
    let B = levels[0];
    for (const frame of levels) {
      const moved = hasMoved(frame, B, T, shadowShare);
      before.push(B);
      moving.push(moved);
      B = renewed(B, frame, moved && maskedRate !== null ? maskedRate : alpha);
    }
    return {before, moving, last: B};
  }

  // How long a jump of the grey level counts as moving, by Eq. 5-6 as printed: until d (1 - alpha)^k <= T.
  function secondsSeen({jump, alpha, T}) {
    if (jump <= T) return 0;
    return Math.log(jump / T) / -Math.log(1 - alpha) / RATE_HZ;
  }

  // The three stories with the camera's noise, of variance 0.05 f + 1.5^2.
  function stories(seed) {
    const normal = normals(seed);
    return STORIES.map(story => ({...story, levels: Array.from({length: FRAMES}, (_, k) => {
      const t = k / RATE_HZ;
      const grey = t >= story.from && t < story.to ? story.during : story.before;
      return grey + Math.sqrt(0.05 * grey + 1.5 ** 2) * normal();
    })}));
  }

  const seconds = frames => (frames / RATE_HZ).toFixed(1);

  function start(box, parameters) {
    const told = stories(parameters.seed);
    let greyAt = null;  // of a height in the first panel's last frame, less its background

    function drawn(svg, width, {alpha, T, until, masked, shadow}) {
      const shown = Math.min(FRAMES, Math.round(until * RATE_HZ) + 1);
      const panel = 128;
      const counts = {};
      told.forEach((story, k) => {
        const {before, moving} = compute({
          levels: story.levels.slice(0, shown), alpha, T,
          shadowShare: shadow ? parameters.shadow_share : 0,
          maskedRate: masked ? 0 : null,
        });
        const at = {left: 34, top: 24 + k * (panel + 34), width: width - 42, height: panel};
        const x = {low: 0, high: 7, label: k === 2 ? 'time t / s' : ''};
        const {X, Y, group} = axes(svg, at, {...x, ...(k < 2 ? {label: ''} : {})}, {...GREYS, label: ''});
        draw(svg, 'text', {x: at.left, y: at.top - 8}, `grey level: ${story.title}`);
        const place = (f, n) => [X(n / RATE_HZ), Y(f)];
        const band = [...before.map((B, n) => place(B + T, n)), ...before.map((B, n) => place(B - T, n)).reverse()];
        draw(group, 'path', {class: 'area two', d: `${path(band)}Z`});
        draw(group, 'path', {class: 'line two', d: path(before.map(place))});
        if (k === 0) {
          const last = before[shown - 1];
          greyAt = v => GREYS.high + (v - at.top) * (GREYS.low - GREYS.high) / at.height - last;
          grip.put(X((shown - 1) / RATE_HZ), Math.max(at.top, Y(last + T)));
        }
        const some = wanted => story.levels.slice(0, shown).map(place).filter((_, n) => moving[n] === wanted);
        draw(group, 'path', {class: 'dots ink', d: dots(some(false))});
        const crosses = some(true).map(([u, v]) => `M${(u - 3).toFixed(1)} ${(v - 3).toFixed(1)}l6 6m0 -6l-6 6`).join('');
        draw(group, 'path', {class: 'thin one', d: crosses});
        const inside = (_, n) => n / RATE_HZ >= story.from && n / RATE_HZ < story.to;
        counts[story.name] = {
          during: moving.filter((moved, n) => moved && inside(0, n)).length,
          after: moving.filter((moved, n) => moved && n / RATE_HZ >= story.to).length,
        };
      });
      const lamp = secondsSeen({jump: 22.5, alpha, T});
      const hand = secondsSeen({jump: 45, alpha, T});
      const {lamp: l, hand: h, shadow: s} = counts;
      const says = [
        `Lamp: ${seconds(l.during)} s of false alarm. Hand: seen for ${seconds(h.during)} s of the 4 s that it rests, and as a ghost `
        + `for ${seconds(h.after)} s after it has gone. Shadow: taken for motion for ${seconds(s.during)} s of 3 s.`,
        masked || shadow ? 'With a cure the formula of Eq. 6 as printed does not apply.'
          : `By the formula, as printed and without noise: lamp ${lamp.toFixed(1)} s, hand ${hand.toFixed(1)} s`
            + (lamp > 0 ? `, ${(hand / lamp).toFixed(1)} times as long.` : '.'),
      ];
      const alt = `Three graphs of grey level over 7 seconds, for alpha ${alpha} and T ${T}. ${says[0]}`;
      return {height: 24 + 3 * (panel + 34) + 14, alt, says};
    }

    const grip = handle('threshold', (_, v) => view.set({T: Math.min(44, Math.max(2, Math.round(greyAt(v))))}));
    const view = page(box, {
      label: 'Applet: one pixel and its background',
      controls: [
        range('alpha', 'rate α', [0.001, 0.5, 0.05], parameters.update_rate, 'a frame', {log: true, precision: 2}),
        range('T', 'threshold T', [2, 44, 1], parameters.difference_threshold, 'grey levels'),
        range('until', 'shown until', [0, 7, 0.1], 7, 's', {format: one => one.toFixed(1)}),
        {kind: 'check', name: 'masked', label: 'Eq. 6 corrected: renew only what does not move (as printed: everything)', value: false},
        {kind: 'check', name: 'shadow', label: `a shadow may take ${100 * parameters.shadow_share} % of the light`, value: false},
      ],
      legend: [['dot ink', 'frame'], ['one', 'counts as moving (crosses)'], ['two', 'background B'], ['band two', 'within T of B (drag its edge)']],
      handles: [grip],
      play: {name: 'until', ms: 80},
      drawn,
    });
  }

  trinolabApplets.define('pixel', {compute, secondsSeen, stories, start});
})();
