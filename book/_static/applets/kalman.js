'use strict';
// A point in an image, followed by the paper's filter (Eq. 7-15): gain, covariance and the search window.
(() => {
  const {draw, path, dots, axes, page, range, normals, times, apply, transposed} = trinolabApplets.shared;
  const SIZE = [1280, 1024];  // px
  const MARKERS = [110, 150];  // px, width and height of the markers' rectangle
  const DT_S = 1 / 30;
  const FRAMES = 40;
  const HIDDEN_FROM = 20;
  const GATE_PROBABILITY = 0.999;

  const kron = one => one.flatMap(row => [row.flatMap(value => [value, 0]), row.flatMap(value => [0, value])]);
  const add = (a, b) => a.map((row, i) => row.map((value, j) => value + b[i][j]));
  const H = [0, 1].map(i => Array.from({length: 6}, (_, j) => Number(i === j)));  // Eq. 12
  const diagonal = values => values.map((value, i) => values.map((_, j) => (i === j ? value : 0)));

  // Eq. 11.
  const transition = dt => kron([[1, dt, dt ** 2 / 2], [0, 1, dt], [0, 0, 1]]);

  // Q of a white jerk of density q.
  function processNoise(dt, q) {
    const one = [
      [dt ** 5 / 20, dt ** 4 / 8, dt ** 3 / 6],
      [dt ** 4 / 8, dt ** 3 / 3, dt ** 2 / 2],
      [dt ** 3 / 6, dt ** 2 / 2, dt],
    ];
    return kron(one.map(row => row.map(value => q * value)));
  }

  function inverse2([[a, b], [c, d]]) {
    const det = a * d - b * c;
    return [[d / det, -b / det], [-c / det, a / det]];
  }

  const symmetric = P => P.map((row, i) => row.map((value, j) => (value + P[j][i]) / 2));

  // Eq. 9, 10.
  function predict({X, P}, dt, q) {
    const Phi = transition(dt);
    return {X: apply(Phi, X), P: symmetric(add(times(times(Phi, P), transposed(Phi)), processNoise(dt, q)))};
  }

  // The gain (Eq. 13) and the covariance S of the innovation.
  function gainOf(P, R) {
    const S = add(P.slice(0, 2).map(row => row.slice(0, 2)), R);
    return {S, K: times(P.map(row => row.slice(0, 2)), inverse2(S))};
  }

  // Eq. 14 in Joseph's form, Eq. 15.
  function correct({X, P}, Z, K, R) {
    const r = [Z[0] - X[0], Z[1] - X[1]];
    const rest = add(diagonal([1, 1, 1, 1, 1, 1]), times(K, H).map(row => row.map(value => -value)));
    return {
      X: X.map((value, k) => value + K[k][0] * r[0] + K[k][1] * r[1]),
      P: symmetric(add(times(times(rest, P), transposed(rest)), times(times(K, R), transposed(K)))),
    };
  }

  const gateOf = probability => -2 * Math.log(1 - probability);  // chi-square of two numbers

  // Round as NumPy does, halves to the even number.
  function rint(value) {
    const low = Math.floor(value);
    if (value - low !== 0.5) return Math.round(value);
    return low % 2 === 0 ? low : low + 1;
  }

  // The last window, moved to the predicted centre, grown by the gate, and cut off at the image's edge: u, v, width, height.
  function searchWindow(X, S, [width, height], [imageWidth, imageHeight], probability) {
    const margin = Math.ceil(Math.sqrt(gateOf(probability) * Math.max(S[0][0], S[1][1])));
    const u = rint(X[0] - (width - 1) / 2) - margin;
    const v = rint(X[1] - (height - 1) / 2) - margin;
    const from = [Math.max(u, 0), Math.max(v, 0)];
    const to = [Math.min(u + width + 2 * margin, imageWidth), Math.min(v + height + 2 * margin, imageHeight)];
    return to[0] > from[0] && to[1] > from[1] ? [...from, to[0] - from[0], to[1] - from[1]] : null;
  }

  // Follow observations `uv` (a pair, or null for none) at even times. The first one starts the filter, with the speed and
  // acceleration zero and of the given standard deviations. What lies outside the gate is not used, if `gated`.
  // Gives a record an instant: predicted and corrected state, gain, S, NIS, whether it was used, and the search window.
  function compute({uv, dt, q, sigma, velocitySigma, accelerationSigma, gated}) {
    const probability = GATE_PROBABILITY;
    const R = diagonal([sigma ** 2, sigma ** 2]);
    let state = {
      X: [...uv[0], 0, 0, 0, 0],
      P: diagonal([sigma, sigma, velocitySigma, velocitySigma, accelerationSigma, accelerationSigma].map(one => one ** 2)),
    };
    const track = [{predicted: state, updated: state, K: null, S: null, nis: null, used: true, window: null}];
    for (const Z of uv.slice(1)) {
      const predicted = predict(state, dt, q);
      const {S, K} = gainOf(predicted.P, R);
      const r = Z && [Z[0] - predicted.X[0], Z[1] - predicted.X[1]];
      const nis = r && apply(inverse2(S), r).reduce((sum, value, k) => sum + value * r[k], 0);
      const used = r !== null && (!gated || nis <= gateOf(probability));
      state = used ? correct(predicted, Z, K, R) : predicted;
      const window = searchWindow(predicted.X, S, MARKERS, SIZE, probability);
      track.push({predicted, updated: state, K, S, nis, used, window});
    }
    return track;
  }

  // A hand's way through the image, px: it sets out at once, turns round and comes back.
  function place(k) {
    const t = k * DT_S;
    return [330 + 620 * Math.sin(2.4 * t) ** 2, 620 - 330 * Math.sin(3.1 * t)];
  }

  // What is observed: the way with noise, and nothing while the target is hidden.
  function observations(sigma, hidden, seed) {
    const normal = normals(seed);
    return Array.from({length: FRAMES}, (_, k) => {
      const [u, v] = place(k);
      const Z = [u + sigma * normal(), v + sigma * normal()];
      return k >= HIDDEN_FROM && k < HIDDEN_FROM + hidden ? null : Z;
    });
  }

  const exponent = value => {
    const [digits, power] = value.toExponential(2).split('e');
    const letters = [...power.replace('+', '')].map(letter => '⁰¹²³⁴⁵⁶⁷⁸⁹'[letter]).join('');
    return `${digits}·10${letters}`;
  };

  function start(box, parameters) {
    function drawn(svg, width, {q, sigma, hidden, zero, gated, k}) {
      const uv = observations(sigma, hidden, parameters.seed);
      const track = compute({
        uv, dt: DT_S, q, sigma, gated,
        velocitySigma: zero ? 0 : parameters.velocity_sigma,
        accelerationSigma: zero ? 0 : parameters.acceleration_sigma,
      });
      const wide = width > 560;
      const left = 44;
      const room = wide ? (width - 60) / 2 : width - left - 8;
      const frames = {low: 0, high: FRAMES, label: ''};
      const later = track.slice(1);
      const shade = (group, {X}, at) => {
        if (hidden) {
          const span = {x: X(HIDDEN_FROM - 0.5), y: at.top, width: X(hidden) - X(0), height: at.height};
          draw(group, 'rect', {class: 'area ink', ...span});
        }
        draw(group, 'path', {class: 'thin dashed ink', d: `M${X(k)} ${at.top}v${at.height}`});
      };

      const gainAt = {left, top: 24, width: wide ? room - 30 : room, height: 100};
      const gains = axes(svg, gainAt, {...frames, label: ' '}, {low: 0, high: 1, label: 'gain K of the position'});
      shade(gains.group, gains, gainAt);
      const way = (some, {X, Y}, value) => some.map((one, n) => [X(n + 1), Y(value(one))]);
      draw(gains.group, 'path', {class: 'line one', d: path(way(later, gains, one => one.K[0][0]))});
      draw(gains.group, 'path', {class: 'dots one', d: dots(way(later, gains, one => one.K[0][0]))});

      const sigmaAt = {...gainAt, top: gainAt.top + gainAt.height + 54, height: 118};
      const deviations = axes(svg, sigmaAt, {...frames, label: 'frame k'},
        {low: 0.1, high: 1000, log: true, ticks: [0.1, 1, 10, 100, 1000], label: 'deviation of the position / px'});
      shade(deviations.group, deviations, sigmaAt);
      const root = P => Math.max(Math.sqrt(P[0][0]), 1e-9);
      const saw = later.flatMap((one, n) => [[n + 1, root(one.predicted.P)], [n + 1, root(one.updated.P)]]);
      draw(deviations.group, 'path', {class: 'thin three', d: path(saw.map(([n, value]) => [deviations.X(n), deviations.Y(value)]))});
      draw(deviations.group, 'path', {class: 'dots two', d: dots(way(later, deviations, one => root(one.predicted.P)))});
      draw(deviations.group, 'path', {class: 'dots three', d: dots(way(later, deviations, one => root(one.updated.P)))});

      const imageAt = wide ? {left: left + room + 14, top: 24, width: room - 14}
        : {left, top: sigmaAt.top + sigmaAt.height + 70, width: room};
      imageAt.height = imageAt.width * SIZE[1] / SIZE[0];
      const u = {low: 0, high: SIZE[0], label: 'u / px'};
      const v = {low: SIZE[1], high: 0, label: `image at frame ${k}: v / px`, ticks: [0, 500, 1000]};  // downwards
      const {X, Y: V, group} = axes(svg, imageAt, u, v);
      const now = track[k];
      const truth = Array.from({length: FRAMES}, (_, n) => place(n));
      draw(group, 'path', {class: 'thin dashed ink', d: path(truth.map(([a, b]) => [X(a), V(b)]))});
      const outline = ([a, b, w, h], name) => {
        draw(group, 'rect', {class: name, x: X(a), y: V(b), width: X(w) - X(0), height: V(h) - V(0)});
      };
      const [a, b] = truth[k];
      outline([a - MARKERS[0] / 2, b - MARKERS[1] / 2, ...MARKERS], 'area ink');
      if (now.window) {
        outline(now.window, 'area two');
        outline(now.window, 'line two');
      }
      const [pu, pv] = now.predicted.X;
      draw(group, 'path', {class: 'line two', d: `M${X(pu) - 6} ${V(pv)}h12M${X(pu)} ${V(pv) - 6}v12`});
      if (uv[k]) draw(group, 'circle', {class: 'line one', cx: X(uv[k][0]), cy: V(uv[k][1]), r: 5});

      const used = later.filter(one => one.used).length;
      const seen = uv.slice(1).filter(Boolean).length;
      const off = Math.hypot(pu - a, pv - b);
      const end = track[FRAMES - 1];
      const area = now.window && 100 * now.window[2] * now.window[3] / (SIZE[0] * SIZE[1]);
      const says = [
        `At the last frame K is ${end.K[0][0].toFixed(3)}, and the position's deviation goes from ${root(end.predicted.P).toFixed(2)} px `
        + `(predicted) to ${root(end.updated.P).toFixed(2)} px (corrected). Used: ${used} of ${seen} observations.`,
        `Frame ${k}: K is ${now.K[0][0].toFixed(3)}, the prediction is ${off.toFixed(0)} px off, `
        + (now.window ? `and the search window has ${now.window[2]} × ${now.window[3]} px, ${area.toFixed(1)} % of the image.`
          : 'and the target is expected outside the image.'),
      ];
      const alt = `Over ${FRAMES} frames the gain and the standard deviation of the position, and the image at frame ${k} with `
        + `the target's way, the predicted place and the search window. ${says.join(' ')}`;
      return {height: wide ? sigmaAt.top + sigmaAt.height + 44 : imageAt.top + imageAt.height + 44, alt, says};
    }

    page(box, {
      label: 'Applet: gain, covariance and search window of a Kalman filter',
      controls: [
        range('q', 'q of Q', [1e4, 1e13, 0.02], parameters.jerk_intensity, 'px²/s⁵', {log: true, format: exponent}),
        range('sigma', 'σ of an observation', [0.3, 30, 0.02], parameters.sigma_px, 'px', {log: true}),
        range('hidden', `hidden from frame ${HIDDEN_FROM} on`, [0, 9, 1], 0, 'frames'),
        range('k', 'frame k of the image', [1, FRAMES - 1, 1], 12),
        {kind: 'check', name: 'zero', label: 'speed and acceleration known to be 0 at the start (the paper)', value: false},
        {kind: 'check', name: 'gated', label: 'refuse what lies outside the gate', value: true},
      ],
      legend: [['one', 'gain; observation (ring)'], ['dot two', 'predicted (cross, window)'], ['dot three', 'corrected'],
        ['dashed ink', 'true way; frame k'], ['band ink', 'markers; hidden frames']],
      drawn,
    });
  }

  trinolabApplets.define('kalman', {compute, observations, start});
})();
