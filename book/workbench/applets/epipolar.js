'use strict';
// The epipolar line of a spot (Eq. 17), and the correlation of two windows (Eq. 18), in rendered images.
(() => {
  const {draw, path, axes, button, page, picture, range, signed, handle, times, apply, transposed} = trinolabApplets.shared;
  const FIRST = 2;  // of the markers that the left camera sees, in the middle of the handle
  const REACH_PX = 75;  // of the curve of S along the line, to either side

  function inverse3(m) {
    const [[a, b, c], [d, e, f], [g, h, i]] = m;
    const cofactors = [[e * i - f * h, c * h - b * i, b * f - c * e], [f * g - d * i, a * i - c * g, c * d - a * f],
      [d * h - e * g, b * g - a * h, a * e - b * d]];
    const det = a * cofactors[0][0] + b * cofactors[1][0] + c * cofactors[2][0];
    return cofactors.map(row => row.map(value => value / det));
  }

  // F of two cameras without distortion: A_r^-T [T]x R A_l^-1, with R, T from the left camera's frame to the right one's.
  function fundamentalMatrix(left, right) {
    const R = times(right.rotation, transposed(left.rotation));
    const turned = apply(R, left.translation);
    const [x, y, z] = right.translation.map((value, k) => value - turned[k]);
    const cross = [[0, -z, y], [z, 0, -x], [-y, x, 0]];
    return times(times(transposed(inverse3(right.matrix)), times(cross, R)), inverse3(left.matrix));
  }

  // The line a u + b v + c = 0 of a left pixel in the right image, with a^2 + b^2 = 1.
  function epipolarLine(F, [u, v]) {
    const line = apply(F, [u, v, 1]);
    const length = Math.hypot(line[0], line[1]);
    return line.map(value => value / length);
  }

  // D of Eq. 17, px.
  const distance = ([a, b, c], [u, v]) => Math.abs(a * u + b * v + c);

  // The window of an odd side around a pixel, row by row, interpolated between pixels; the edge's pixels repeat beyond it.
  function cut({width, height, grey}, [u, v], side) {
    const at = (x, y) => grey[Math.min(Math.max(y, 0), height - 1) * width + Math.min(Math.max(x, 0), width - 1)];
    const first = [u - (side - 1) / 2, v - (side - 1) / 2];
    const [x0, y0] = first.map(Math.floor);
    const [p, q] = [first[0] - x0, first[1] - y0];
    const window = [];
    for (let y = y0; y < y0 + side; y++) {
      for (let x = x0; x < x0 + side; x++) {
        const upper = (1 - p) * at(x, y) + p * at(x + 1, y);
        const lower = (1 - p) * at(x, y + 1) + p * at(x + 1, y + 1);
        window.push((1 - q) * upper + q * lower);
      }
    }
    return window;
  }

  // The window of I for a place: about it; or from it on, as Eq. 18 is printed.
  function windowOf(image, [u, v], side, eq18) {
    const shift = eq18 === 'corner' ? (side - 1) / 2 : 0;
    return cut(image, [u + shift, v + shift], side);
  }

  // A window with mean 0 and length 1; zeros if it is flat.
  function unit(window) {
    const mean = window.reduce((sum, value) => sum + value, 0) / window.length;
    const rest = window.map(value => value - mean);
    const length = Math.hypot(...rest);
    const flat = 1e-6 * Math.max(...window.map(Math.abs));
    return length > flat ? rest.map(value => value / length) : rest.map(() => 0);
  }

  // S of two windows of one size (Eq. 18). By its last sum as printed, over y' alone (x' stays 0), the window's length is that of
  // its first column.
  function correlation(template, window, eq18) {
    const [t, i] = [unit(template), unit(window)];
    const S = t.reduce((sum, value, k) => sum + value * i[k], 0);
    if (eq18 !== 'sum') return S;
    const side = Math.sqrt(i.length);
    const column = Math.hypot(...i.filter((_, k) => k % side === 0));
    return column > 0 ? S / column : 0;
  }

  // A camera of the page's data, its part of the image decoded. Pixels are counted as in the whole image.
  function decoded(camera) {
    const [width, height] = camera.size;
    const grey = Uint8Array.from(atob(camera.grey), letter => letter.charCodeAt(0));
    return {...camera, image: {width, height, grey}};
  }

  const inPart = (camera, [u, v]) => [u - camera.corner[0], v - camera.corner[1]];

  // All numbers of the applet for a left and a right pixel: the line, D, both windows and S.
  function compute({left, right, uvLeft, uvRight, windowPx, eq18 = 'corrected'}) {
    const line = epipolarLine(fundamentalMatrix(left, right), uvLeft);
    const windows = [
      cut(left.image, inPart(left, uvLeft), windowPx),
      windowOf(right.image, inPart(right, uvRight), windowPx, eq18),
    ];
    return {line, D: distance(line, uvRight), windows, S: correlation(...windows, eq18)};
  }

  // The foot of a pixel on a line, and the direction of the line, to the right or down.
  function footOn([a, b, c], [u, v]) {
    const off = a * u + b * v + c;
    const sign = Math.abs(b) >= Math.abs(a) ? Math.sign(b) : -Math.sign(a);
    return {foot: [u - off * a, v - off * b], along: [sign * b, -sign * a]};
  }

  function start(box, parameters, data) {
    const cameras = data.cameras.map(decoded);
    const side = data.window_px;
    const pictures = cameras.map(({image}) => picture(image.grey, image.width, image.height));
    const [left] = cameras;
    let frames = null;  // where both images are drawn, for the pointer
    let told = false;  // whether the true partner is shown
    let marker = FIRST;  // of those that the left camera sees, the one that was shown last

    const rightOf = values => cameras[Number(values.right)];
    const uvOf = ({u, v}) => [left.corner[0] + u, left.corner[1] + v];

    // The middle of the right part, projected onto the line: from there the place along it is counted.
    function lineOf(values) {
      const right = rightOf(values);
      const line = epipolarLine(fundamentalMatrix(left, right), uvOf(values));
      const middle = [right.corner[0] + right.size[0] / 2, right.corner[1] + right.size[1] / 2];
      const {foot, along} = footOn(line, middle);
      return {right, line, at: (s, beside) => foot.map((value, k) => value + s * along[k] + beside * line[k]), foot, along};
    }

    // Which marker's image a pixel is nearest to, within 4 px; -1 for none.
    const markerAt = (camera, [u, v]) => camera.markers.findIndex(one => one && Math.hypot(one[0] - u, one[1] - v) <= 4);

    // What the truth says of the markers under both windows.
    function verdict(right, a, b) {
      if (a < 0) return 'There is no marker under the left window.';
      if (!right.markers[a]) return `The truth: marker ${a} of the left window does not face ${right.name}.`;
      if (b < 0) return `The truth: marker ${a}. The right window is on none.`;
      return a === b ? `The truth: both windows are on marker ${a}. The pair is right.`
        : `The truth: marker ${a} on the left, ${b} on the right. The pair is wrong.`;
    }

    function drawn(svg, width, values) {
      const {right, line, at} = lineOf(values);
      const uvLeft = uvOf(values);
      const uvRight = at(values.s, values.beside);
      const {eq18} = values;
      const found = compute({left, right, uvLeft, uvRight, windowPx: side, eq18});
      const gap = 12;
      const wide = width > 480;
      const zoom = Math.min(2.4, (width - gap) / 2 / left.size[0]);
      const [w, h] = left.size.map(one => one * zoom);
      frames = {zoom, rightAt: w + gap, top: 20};
      const top = frames.top;
      const imageOf = (camera, k, x, name) => {
        draw(svg, 'text', {x, y: 14}, name);
        draw(svg, 'image', {href: pictures[k], x, y: top, width: w, height: h, style: 'image-rendering: pixelated'});
        const clip = draw(svg, 'svg', {x, y: top, width: w, height: h});
        const place = pixel => inPart(camera, pixel).map(one => (one + 0.5) * zoom);
        return {clip, place, mark: (kind, pixel, held, corner) => {
          const [a, b] = place(pixel);
          const size = side * zoom;
          const from = corner ? zoom / 2 : size / 2;
          draw(clip, 'rect', {class: kind, x: a - from, y: b - from, width: size, height: size});
          draw(clip, 'path', {class: kind, d: `M${a - 4} ${b}h8M${a} ${b - 4}v8`});
          held.put(x + Math.min(w, Math.max(0, a)), top + Math.min(h, Math.max(0, b)));
        }};
      };
      const title = wide ? `${left.name}: a part of the image, ${left.size.join(' × ')} px` : left.name;
      const one = imageOf(left, 0, 0, title);
      const two = imageOf(right, Number(values.right), w + gap, right.name);
      one.mark('on-image two-on-image', uvLeft, grips.left);
      for (const gate of [-parameters.epipolar_gate_px, 0, parameters.epipolar_gate_px]) {
        const [from, to] = [at(-300, gate), at(300, gate)].map(two.place);
        draw(two.clip, 'path', {class: `on-image ${gate ? 'faint' : 'one'}-on-image`, d: path([from, to])});
      }
      if (told) {
        const partner = markerAt(left, uvLeft);
        if (partner >= 0 && right.markers[partner]) {
          const [a, b] = two.place(right.markers[partner]);
          draw(two.clip, 'circle', {class: 'on-image three-on-image', cx: a, cy: b, r: 12});
        }
      }
      two.mark('on-image two-on-image', uvRight, grips.right, eq18 === 'corner');

      // both windows, enlarged, beside the curve of S along the line
      const below = top + h + 18;
      const big = Math.min(84, (width - 44) / 4);
      found.windows.forEach((window, k) => {
        const x = k * (big + 8);
        draw(svg, 'text', {x, y: below + 8}, k ? right.name : left.name);
        const square = {x, y: below + 16, width: big, height: big};
        draw(svg, 'image', {...square, href: picture(window, side, side), style: 'image-rendering: pixelated'});
      });
      const [words, wordsTop] = wide ? [0, below + big + 34] : [2 * big + 24, below + 28];
      draw(svg, 'text', {x: words, y: wordsTop}, `S = ${signed(found.S.toFixed(2))}`);
      draw(svg, 'text', {x: words, y: wordsTop + 18}, `D = ${found.D.toFixed(1)} px`);
      const curve = [];
      for (let s = -REACH_PX; s <= REACH_PX; s++) {
        const window = windowOf(right.image, inPart(right, at(s, values.beside)), side, eq18);
        curve.push([s, correlation(found.windows[0], window, eq18)]);
      }
      const plotAt = wide ? {left: 2 * big + 60, top: below + 16, width: width - 2 * big - 68, height: 110}
        : {left: 34, top: below + big + 60, width: width - 42, height: 110};
      const across = {low: -REACH_PX, high: REACH_PX, label: 'along the line / px'};
      const {X, Y, group} = axes(svg, plotAt, across, 
        eq18 === 'sum' ? {low: -6, high: 10, label: 'S by the last sum over y′ alone'} : {low: -0.6, high: 1, label: 'correlation S'});
      const threshold = Y(parameters.ncc_threshold);
      draw(group, 'path', {class: 'thin dashed ink', d: `M${plotAt.left} ${threshold}h${plotAt.width}`});
      draw(group, 'path', {class: 'line one', d: path(curve.map(([s, S]) => [X(s), Y(S)]))});
      draw(group, 'circle', {class: 'solid two', cx: X(values.s), cy: Y(found.S), r: 5});

      const passes = found.D < parameters.epipolar_gate_px && found.S > parameters.ncc_threshold;
      const above = curve.map(([, S]) => S > parameters.ncc_threshold);
      const stretches = above.filter((one, k) => one && !above[k - 1]).length;
      const says = [
        `D = ${found.D.toFixed(1)} px, S = ${signed(found.S.toFixed(2))}: ${passes ? 'a candidate' : 'no candidate'} `
        + `(D₀ = ${parameters.epipolar_gate_px} px, ε₀ = ${parameters.ncc_threshold}). `
        + `Along the line S exceeds ε₀ in ${stretches} ${stretches === 1 ? 'place' : 'places'}.`,
        ...(eq18 === 'corner' ? ['Eq. 18 as printed: the right window begins at its place, so S looks for the marker beside it.'] : []),
        ...(eq18 === 'sum' ? ['Eq. 18 as printed: S is no correlation any more, since it may exceed 1.'] : []),
        ...(told ? [verdict(right, markerAt(left, uvLeft), markerAt(right, uvRight))] : []),
      ];
      const spot = uvLeft.map(one2 => one2.toFixed(1)).join(', ');
      const alt = `Left the image of ${left.name} with a window at (${spot}) px, right that of ${right.name} with the epipolar `
        + `line and a window. ${says.join(' ')}`;
      return {height: plotAt.top + Math.max(wide ? big : 0, plotAt.height) + 40, alt, says};
    }

    const clamped = (value, low, high) => Math.min(high, Math.max(low, Math.round(2 * value) / 2));
    const grips = {
      left: handle('left', (x, y) => view.set({
        u: clamped(x / frames.zoom - 0.5, 0, left.size[0] - 1),
        v: clamped((y - frames.top) / frames.zoom - 0.5, 0, left.size[1] - 1),
      })),
      right: handle('right', (x, y) => {
        const {right, foot, along, line} = lineOf(view.values());
        const places = [x - frames.rightAt, y - frames.top];
        const off = places.map((place, k) => right.corner[k] + place / frames.zoom - 0.5 - foot[k]);
        view.set({
          s: clamped(off[0] * along[0] + off[1] * along[1], -REACH_PX, REACH_PX),
          beside: clamped(off[0] * line[0] + off[1] * line[1], -20, 20),
        });
      }),
    };

    const seen = left.markers.map((uv, k) => [uv, k]).filter(([uv]) => uv);
    const goTo = n => {
      marker = n;
      const [[u, v]] = seen[n];
      view.set({u: Math.round(2 * (u - left.corner[0])) / 2, v: Math.round(2 * (v - left.corner[1])) / 2});
    };
    const next = button('Next marker', () => { goTo((marker + 1) % seen.length); });
    const truth = button('Show the truth', () => {
      told = !told;
      truth.setAttribute('aria-pressed', told);
      view.redraw();
    });
    truth.setAttribute('aria-pressed', 'false');
    const [[u0, v0]] = seen[FIRST];
    const half = value => Math.round(2 * value) / 2;
    const view = page(box, {
      label: 'Applet: epipolar line and two windows',
      controls: [
        {kind: 'choice', name: 'right', label: 'right image', value: '2', options: [['1', cameras[1].name], ['2', cameras[2].name]]},
        {kind: 'choice', name: 'eq18', label: 'Eq. 18', value: 'corrected', options: [
          ['corrected', 'corrected'],
          ['corner', 'as printed: the window of I begins at its place'],
          ['sum', 'as printed: the last sum is over y′ alone']]},
        range('u', 'left window, u in the part', [0, left.size[0] - 1, 0.5], half(u0 - left.corner[0]), 'px'),
        range('v', 'left window, v in the part', [0, left.size[1] - 1, 0.5], half(v0 - left.corner[1]), 'px'),
        range('s', 'right window, along the line', [-REACH_PX, REACH_PX, 0.5], 0, 'px', {format: signed}),
        range('beside', 'right window, beside the line', [-20, 20, 0.5], 0, 'px', {format: signed}),
      ],
      buttons: [next, truth],
      handles: [grips.left, grips.right],
      play: {name: 's', stops: 2, ms: 60},
      legend: [['two', 'windows'], ['one', 'epipolar line; S along it'], ['dashed ink', 'ε₀'], ['three', 'the true partner']],
      drawn,
    });
  }

  trinolabApplets.define('epipolar', {compute, decoded, fundamentalMatrix, epipolarLine, distance, cut, correlation, start});
})();
