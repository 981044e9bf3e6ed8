'use strict';
// A point in an image, followed by the paper's filter (Eq. 7-15): gain, covariance and the search window; and what becomes of
// them by Eq. 10, 12 and 14 as printed.
(() => {
  const {draw, path, dots, axes, page, range, signed, handle, normals, times, apply, transposed} = trinolabApplets.shared;
  const SIZE = [1280, 1024];  // px
  const MARKERS = [110, 150];  // px, width and height of the markers' rectangle
  const DT_S = 1 / 30;
  const FRAMES = 40;
  const HIDDEN_FROM = 20;
  const MOVED = 12;  // the frame whose observation the reader may move
  const GATE_PROBABILITY = 0.999;
  const GATES = {1: 10.827566170662733, 2: -2 * Math.log(1 - GATE_PROBABILITY)};  // chi-square of one number and of two

  const kron = one => one.flatMap(row => [row.flatMap(value => [value, 0]), row.flatMap(value => [0, value])]);
  const add = (a, b) => a.map((row, i) => row.map((value, j) => value + b[i][j]));
  const H = [0, 1].map(i => Array.from({length: 6}, (_, j) => Number(i === j)));  // Eq. 12
  const PRINTED_H = [[1, 1, 0, 0, 0, 0]];
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

  // The inverse of S, of one number or two by two.
  function inverse(S) {
    if (S.length === 1) return [[1 / S[0][0]]];
    const [[a, b], [c, d]] = S;
    const det = a * d - b * c;
    return [[d / det, -b / det], [-c / det, a / det]];
  }

  const symmetric = P => P.map((row, i) => row.map((value, j) => (value + P[j][i]) / 2));

  // Eq. 9, 10; as printed without the transpose.
  function predict({X, P}, dt, q, printed) {
    const Phi = transition(dt);
    const carried = times(times(Phi, P), printed.eq10 ? Phi : transposed(Phi));
    return {X: apply(Phi, X), P: add(carried, processNoise(dt, q))};
  }

  // The gain (Eq. 13) and the covariance S of the innovation.
  function gainOf(P, H, R) {
    const PHt = times(P, transposed(H));
    const S = add(times(H, PHt), R);
    return {S, K: times(PHt, inverse(S))};
  }

  // Eq. 14 in Joseph's form, Eq. 15. As printed, Eq. 14 takes the covariance that was predicted a frame `before`; its 1 is read as
  // the unit matrix.
  function correct({X, P}, r, K, H, R, before, printed) {
    const rest = add(diagonal([1, 1, 1, 1, 1, 1]), times(K, H).map(row => row.map(value => -value)));
    const joseph = () => add(times(times(rest, P), transposed(rest)), times(times(K, R), transposed(K)));
    const moved = apply(K, r);
    return {
      X: X.map((value, k) => value + moved[k]),
      P: printed.eq14 ? times(rest, before) : joseph(),
    };
  }

  // What keeps P from being a covariance: 'negative' for a negative eigenvalue of its symmetric part, beyond 1e-6 of its own
  // scale, 'skew' for a matrix that is not symmetric; null for a covariance.
  function faultOf(P) {
    const scale = P.map((row, i) => Math.sqrt(Math.max(row[i], 1e-200)));
    const C = P.map((row, i) => row.map((value, j) => value / scale[i] / scale[j]));
    if (!isPositive(symmetric(C).map((row, i) => row.map((value, j) => value + (i === j ? 1e-6 : 0))))) return 'negative';
    return C.some((row, i) => row.some((value, j) => Math.abs(value - C[j][i]) > 1e-9)) ? 'skew' : null;
  }

  // Whether a symmetric matrix has a Cholesky factor.
  function isPositive(C) {
    const L = C.map(row => row.map(() => 0));
    for (let i = 0; i < C.length; i++) {
      for (let j = 0; j <= i; j++) {
        let rest = C[i][j];
        for (let k = 0; k < j; k++) rest -= L[i][k] * L[j][k];
        if (i === j && !(rest > 0)) return false;
        L[i][j] = i === j ? Math.sqrt(rest) : rest / L[j][j];
      }
    }
    return true;
  }

  // Round as NumPy does, halves to the even number.
  function rint(value) {
    const low = Math.floor(value);
    if (value - low !== 0.5) return Math.round(value);
    return low % 2 === 0 ? low : low + 1;
  }

  // The last window, moved to the predicted centre, grown by the gate, and cut off at the image's edge: u, v, width, height.
  // Null where it lies outside the image, or where both variances in `S`, the covariance of the expected place, are negative.
  function searchWindow(X, S, [width, height], [imageWidth, imageHeight]) {
    const margin = Math.ceil(Math.sqrt(GATES[2] * Math.max(S[0][0], S[1][1])));
    const u = rint(X[0] - (width - 1) / 2) - margin;
    const v = rint(X[1] - (height - 1) / 2) - margin;
    const from = [Math.max(u, 0), Math.max(v, 0)];
    const to = [Math.min(u + width + 2 * margin, imageWidth), Math.min(v + height + 2 * margin, imageHeight)];
    return to[0] > from[0] && to[1] > from[1] ? [...from, to[0] - from[0], to[1] - from[1]] : null;
  }

  // Follow observations `uv` (a pair, or null for none) at even times. The first one starts the filter, with the speed and
  // acceleration zero and of the given standard deviations. What lies outside the gate is not used, if `gated`. `printed` has
  // true under eq10, eq12 and eq14 for those that are taken as printed. By Eq. 12 as printed x + y is observed, so that the sum
  // of the pair, with the noise of a sum, stands for Z.
  // Gives a record an instant: predicted and corrected state, gain, S, NIS, whether it was used, the search window, and the fault
  // of P.
  function compute({uv, dt, q, sigma, velocitySigma, accelerationSigma, gated, printed = {}}) {
    const pair = diagonal([sigma ** 2, sigma ** 2]);
    const R = printed.eq12 ? [[2 * sigma ** 2]] : pair;
    const observed = printed.eq12 ? PRINTED_H : H;
    const isExact = !printed.eq10 && !printed.eq12 && !printed.eq14;
    const round = ({X, P}) => ({X, P: isExact ? symmetric(P) : P});  // rounding alone makes these skew
    let state = {
      X: [...uv[0], 0, 0, 0, 0],
      P: diagonal([sigma, sigma, velocitySigma, velocitySigma, accelerationSigma, accelerationSigma].map(one => one ** 2)),
    };
    let before = state.P;
    const track = [{predicted: state, updated: state, K: null, S: null, nis: null, used: true, window: null, fault: null}];
    for (const place of uv.slice(1)) {
      const predicted = round(predict(state, dt, q, printed));
      const {S, K} = gainOf(predicted.P, observed, R);
      const Z = place && (printed.eq12 ? [place[0] + place[1]] : place);
      const r = Z && apply(observed, predicted.X).map((value, k) => Z[k] - value);
      const nis = r && apply(inverse(S), r).reduce((sum, value, k) => sum + value * r[k], 0);
      const used = r !== null && (!gated || nis <= GATES[r.length]);
      state = used ? round(correct(predicted, r, K, observed, R, before, printed)) : predicted;
      before = predicted.P;
      const expected = add(predicted.P.slice(0, 2).map(row => row.slice(0, 2)), pair);
      const window = searchWindow(predicted.X, expected, MARKERS, SIZE);
      track.push({predicted, updated: state, K, S, nis, used, window, fault: faultOf(state.P)});
    }
    return track;
  }

  // A hand's way through the image, px: it sets out at once, turns round and comes back.
  function place(k) {
    const t = k * DT_S;
    return [330 + 620 * Math.sin(2.4 * t) ** 2, 620 - 330 * Math.sin(3.1 * t)];
  }

  // What is observed: the way with noise, one place moved by the reader, and nothing while the target is hidden.
  function observations(sigma, hidden, seed, [du, dv] = [0, 0]) {
    const normal = normals(seed);
    return Array.from({length: FRAMES}, (_, k) => {
      const [u, v] = place(k);
      const Z = [u + sigma * normal(), v + sigma * normal()];
      if (k === MOVED) return [Z[0] + du, Z[1] + dv];
      return k >= HIDDEN_FROM && k < HIDDEN_FROM + hidden ? null : Z;
    });
  }

  // How far the predictions are from the truth, px: the median over the frames.
  function medianMiss(track) {
    const misses = track.slice(1).map(({predicted: {X}}, n) => Math.hypot(X[0] - place(n + 1)[0], X[1] - place(n + 1)[1]));
    return misses.sort((a, b) => a - b)[Math.floor(misses.length / 2)];
  }

  const exponent = value => {
    const [digits, power] = value.toExponential(1).split('e');
    const letters = [...power.replace('+', '')].map(letter => '⁰¹²³⁴⁵⁶⁷⁸⁹'[letter]).join('');
    return `${digits}·10${letters}`;
  };

  function start(box, parameters) {
    let image = null;  // from a place of the image to a value, for the pointer

    function drawn(svg, width, {q, sigma, hidden, k, du, dv, zero, gated, eq10, eq12, eq14}) {
      const uv = observations(sigma, hidden, parameters.seed, [du, dv]);
      const track = compute({
        uv, dt: DT_S, q, sigma, gated,
        velocitySigma: zero ? 0 : parameters.velocity_sigma,
        accelerationSigma: zero ? 0 : parameters.acceleration_sigma,
        printed: {eq10, eq12, eq14},
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
      const gains = axes(svg, gainAt, {...frames, label: ' '}, {low: -0.1, high: 1.1, ticks: [0, 0.5, 1], label: 'gain K of the position'});
      shade(gains.group, gains, gainAt);
      const way = (some, {X, Y}, value) => some.map((one, n) => [X(n + 1), Y(value(one))]);
      draw(gains.group, 'path', {class: 'line one', d: path(way(later, gains, one => one.K[0][0]))});
      draw(gains.group, 'path', {class: 'dots one', d: dots(way(later, gains, one => one.K[0][0]))});

      const sigmaAt = {...gainAt, top: gainAt.top + gainAt.height + 54, height: 118};
      const deviations = axes(svg, sigmaAt, {...frames, label: 'frame k'},
        {low: 0.3, high: 3000, log: true, ticks: [1, 10, 100, 1000], label: 'deviation of the position / px'});
      shade(deviations.group, deviations, sigmaAt);
      const root = P => (P[0][0] > 0 ? Math.max(Math.sqrt(P[0][0]), 1e-9) : 1e-9);
      const saw = later.flatMap((one, n) => [[n + 1, root(one.predicted.P)], [n + 1, root(one.updated.P)]]);
      draw(deviations.group, 'path', {class: 'thin three', d: path(saw.map(([n, value]) => [deviations.X(n), deviations.Y(value)]))});
      draw(deviations.group, 'path', {class: 'dots two', d: dots(way(later, deviations, one => root(one.predicted.P)))});
      draw(deviations.group, 'path', {class: 'dots three', d: dots(way(later, deviations, one => root(one.updated.P)))});

      const crosses = later.map((one, n) => [deviations.X(n + 1), one.fault === 'negative']).filter(([, isOne]) => isOne);
      const foot = sigmaAt.top + sigmaAt.height - 8;
      draw(deviations.group, 'path', {class: 'line five', d: crosses.map(([x]) => `M${x - 3} ${foot - 3}l6 6m0 -6l-6 6`).join('')});

      const imageAt = wide ? {left: left + room + 14, top: 24, width: room - 14}
        : {left, top: sigmaAt.top + sigmaAt.height + 70, width: room};
      imageAt.height = imageAt.width * SIZE[1] / SIZE[0];
      const u = {low: 0, high: SIZE[0], label: 'u / px'};
      const v = {low: SIZE[1], high: 0, label: `image at frame ${k}: v / px`, ticks: [0, 500, 1000]};  // downwards
      const {X, Y: V, group} = axes(svg, imageAt, u, v);
      const now = track[k];
      const truth = Array.from({length: FRAMES}, (_, n) => place(n));
      draw(group, 'path', {class: 'thin dashed ink', d: path(truth.map(([a, b]) => [X(a), V(b)]))});
      image = {X, V, perPx: X(1) - X(0)};
      const estimate = track.slice(0, k + 1).map(({updated}) => [X(updated.X[0]), V(updated.X[1])]);
      draw(group, 'path', {class: 'line three', d: path(estimate)});
      const seenSoFar = uv.slice(0, k + 1).filter(Boolean).map(([a, b]) => [X(a), V(b)]);
      draw(group, 'path', {class: 'dots one', d: dots(seenSoFar)});
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
      const [mu, mv] = [X(uv[MOVED][0]), V(uv[MOVED][1])];
      draw(group, 'circle', {class: 'thin dashed one', cx: mu, cy: mv, r: 10});
      grip.put(Math.min(imageAt.left + imageAt.width, Math.max(imageAt.left, mu)),
        Math.min(imageAt.top + imageAt.height, Math.max(imageAt.top, mv)));

      const used = later.filter(one => one.used).length;
      const seen = uv.slice(1).filter(Boolean).length;
      const off = Math.hypot(pu - a, pv - b);
      const end = track[FRAMES - 1];
      const area = now.window && 100 * now.window[2] * now.window[3] / (SIZE[0] * SIZE[1]);
      const whole = now.window && now.window[2] === SIZE[0] && now.window[3] === SIZE[1];
      const says = [
        `At the last frame K is ${number(end.K[0][0])}, and the position's deviation goes from ${deviation(end.predicted.P)} `
        + `(predicted) to ${deviation(end.updated.P)} (corrected). Used: ${used} of ${seen} observations. Half of the predictions `
        + `are more than ${medianMiss(track).toFixed(0)} px off.`,
        `Frame ${k}: K is ${number(now.K[0][0])}, the prediction is ${off.toFixed(0)} px off, `
        + (whole ? 'and the search window is the whole image.'
          : now.window ? `and the search window has ${now.window[2]} × ${now.window[3]} px, ${area.toFixed(1)} % of the image.`
            : 'and there is no search window: the target is expected outside the image, or with a negative variance.'),
        health(later, {eq10, eq12, eq14}),
      ];
      const alt = `Over ${FRAMES} frames the gain and the standard deviation of the position, and the image at frame ${k} with `
        + `the target's way, the estimate, the predicted place and the search window. ${says.join(' ')}`;
      const bottom = Math.max(imageAt.top + imageAt.height, wide ? sigmaAt.top + sigmaAt.height : 0);
      return {height: bottom + 44, alt, says};
    }

    const number = value => (Math.abs(value) < 1000 ? signed(value.toFixed(3)) : signed(value.toExponential(1)));
    const deviation = P => (P[0][0] > 0 ? `${Number(Math.sqrt(P[0][0]).toPrecision(3))} px` : 'the root of a negative variance');

    // What P is, in a sentence.
    function health(later, printed) {
      const names = Object.keys(printed).filter(name => printed[name]).map(name => name.slice(2));
      const which = names.length ? `Eq. ${names.join(', ')} as printed: ` : 'All equations corrected: ';
      const first = kind => later.findIndex(one => one.fault === kind) + 1;
      const negative = first('negative');
      const count = later.filter(one => one.fault === 'negative').length;
      const skew = first('skew');
      const faults = [
        ...(negative ? [`has a negative eigenvalue in ${count} of ${later.length} frames, from frame ${negative} on`] : []),
        ...(skew ? ['is not even symmetric'] : []),
      ];
      const drawn = printed.eq12 ? ' Only x + y is observed: across, nothing corrects the estimate.' : '';
      return `${which}P ${faults.length ? `is no covariance: it ${faults.join(', and ')}.` : 'is a covariance in each frame.'}${drawn}`;
    }

    const kept = value => Math.round(Math.min(400, Math.max(-400, value)));
    const grip = handle('observation', (x, y) => {
      const {sigma, hidden} = view.values();
      const [u, v] = observations(sigma, hidden, parameters.seed)[MOVED];
      view.set({du: kept((x - image.X(u)) / image.perPx), dv: kept((y - image.V(v)) / image.perPx)});
    });
    const misprint = (no, words) => ({kind: 'check', name: `eq${no}`, label: `Eq. ${no} as printed: ${words}`, value: false});

    const view = page(box, {
      label: 'Applet: gain, covariance and search window of a Kalman filter',
      controls: [
        range('q', 'q of Q', [1e4, 1e13, 0.02], Math.max(1e4, parameters.jerk_intensity / 30), 'px²/s⁵', {log: true, format: exponent}),
        range('sigma', 'σ of an observation', [0.3, 30, 0.02], Math.min(30, 10 * parameters.sigma_px), 'px', {log: true}),
        range('hidden', `hidden from frame ${HIDDEN_FROM} on`, [0, 9, 1], 4, 'frames'),
        range('k', 'frame k of the image', [1, FRAMES - 1, 1], 22),
        range('du', `observation ${MOVED}, moved right`, [-400, 400, 10], 0, 'px', {format: signed}),
        range('dv', `observation ${MOVED}, moved down`, [-400, 400, 10], 0, 'px', {format: signed}),
        {kind: 'check', name: 'zero', label: 'speed and acceleration known to be 0 at the start (the paper)', value: false},
        {kind: 'check', name: 'gated', label: 'refuse what lies outside the gate', value: true},
        misprint(10, 'Φ P Φ + Q, without the transpose'),
        misprint(12, 'H observes x + y'),
        misprint(14, 'the P⁻ of the frame before'),
      ],
      handles: [grip],
      play: {name: 'k', ms: 120},
      legend: [['one', 'gain; observations (ring: frame k; dashed ring: to be dragged)'], ['dot two', 'predicted (cross, window)'],
        ['dot three', 'corrected; the estimate'], ['dot five', 'P has a negative eigenvalue (crosses)'],
        ['dashed ink', 'true way; frame k'], ['band ink', 'markers; hidden frames']],
      drawn,
    });
  }

  trinolabApplets.define('kalman', {compute, observations, start});
})();
