'use strict';
// What baseline, vergence, distance and pixel noise do to a point of two cameras (Eq. 20, 21).
(() => {
  const {draw, path, axes, page, range, handle, times, transposed, apply} = trinolabApplets.shared;
  const DEGREE = Math.PI / 180;
  const STEP_PX = 1e-3;  // of the differences, as in trinolab.triangulation
  const BASELINES = {low: 20, high: 400};

  // The camera at (x, 0, 0) whose axis is turned about y, towards +x for a positive angle; f in px, pixels counted from the middle.
  function cameraAt(x, angle, focal) {
    const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
    return {centre: [x, 0, 0], rotation: [[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]], focal};  // world to camera
  }

  // Two cameras side by side, each turned inwards by half of the vergence.
  function pairOf({baseline_mm, vergence_deg, focal_px}) {
    const half = vergence_deg / 2 * DEGREE;
    return [cameraAt(-baseline_mm / 2, half, focal_px), cameraAt(baseline_mm / 2, -half, focal_px)];
  }

  function project({centre, rotation, focal}, point) {
    const [x, y, z] = apply(rotation, point.map((value, k) => value - centre[k]));
    return z > 0 ? [focal * x / z, focal * y / z] : null;
  }

  // The point of two pixels: both forms of z of Eq. 20 together by least squares, then Eq. 21. Null where it lies behind a camera.
  function triangulate([left, right], [Xl, Yl], [Xr, Yr]) {
    const R = times(right.rotation, transposed(left.rotation));
    const t = apply(right.rotation, left.centre.map((value, k) => value - right.centre[k]));
    const ray = [Xl / left.focal, Yl / left.focal, 1];
    const [x, y] = [Xr / right.focal, Yr / right.focal];
    const [a, b, c] = apply(R, ray);
    const n = [t[0] - x * t[2], t[1] - y * t[2]];
    const d = [x * c - a, y * c - b];
    const square = d[0] ** 2 + d[1] ** 2;
    if (square < 1e-18) return null;
    const z = (n[0] * d[0] + n[1] * d[1]) / square;
    if (!(z > 0) || !(z * c + t[2] > 0)) return null;
    return apply(transposed(left.rotation), ray.map(value => z * value)).map((value, k) => value + left.centre[k]);
  }

  // The pair's cameras, a point straight ahead at a distance, its pixels, and the standard deviations of its x, y, z for
  // independent noise of sigma_px in each coordinate, by central differences.
  function compute({baseline_mm, vergence_deg, focal_px, width_px, distance_mm, sigma_px}) {
    const cameras = pairOf({baseline_mm, vergence_deg, focal_px});
    const point = [0, 0, distance_mm];
    const pixels = cameras.map(camera => project(camera, point));
    if (!pixels.every(Boolean)) return {cameras, point, pixels, seen: false, covariance: null, sigmas_mm: null};
    const seen = pixels.every(([u]) => Math.abs(u) <= width_px / 2);
    const slopes = [];
    for (let k = 0; k < 4; k++) {
      const moved = [1, -1].map(sign => {
        const uv = pixels.map(one => [...one]);
        uv[k >> 1][k & 1] += sign * STEP_PX;
        return triangulate(cameras, ...uv);
      });
      slopes.push(moved[0].map((value, i) => (value - moved[1][i]) / (2 * STEP_PX)));
    }
    const product = (i, j) => slopes.reduce((sum, one) => sum + one[i] * one[j], 0);
    const covariance = [0, 1, 2].map(i => [0, 1, 2].map(j => sigma_px ** 2 * product(i, j)));
    return {cameras, point, pixels, seen, covariance, sigmas_mm: covariance.map((row, i) => Math.sqrt(row[i]))};
  }

  // The ellipse of one deviation about a point, from above: pairs (x, z), enlarged as the reader says and by nothing else, so that a
  // larger error is a larger ellipse.
  function ellipse([, , z], covariance, enlarged) {
    const [[xx, , xz], , [, , zz]] = covariance;
    const low = Math.sqrt(Math.max(zz - xz * xz / xx, 0));  // of the Cholesky factor
    return Array.from({length: 61}, (_, k) => {
      const t = 2 * Math.PI * k / 60;
      const dx = Math.sqrt(xx) * Math.cos(t);
      const dz = xz / Math.sqrt(xx) * Math.cos(t) + low * Math.sin(t);
      return [enlarged * dx, z + enlarged * dz];
    });
  }

  function start(box, parameters, data) {
    let value = null;  // of a place in the plan: x and z, mm

    function plan(svg, at, values, found) {
      const {baseline, vergence, distance} = values;
      const deep = 1000;
      const reach = deep * at.width / at.height / 2;
      const across = {low: -reach, high: reach, label: 'x / mm'};
      const {X, Y, group} = axes(svg, at, across, {low: -60, high: deep - 60, label: 'from above: z / mm'});
      const half = Math.atan(data.width_px / 2 / data.focal_px);
      [['one', -1], ['five', 1]].forEach(([colour, sign]) => {
        const x = sign * baseline / 2;
        const axis = -sign * vergence / 2 * DEGREE;
        const far = 1600;
        const edge = angle => [X(x + far * Math.sin(axis + angle)), Y(far * Math.cos(axis + angle))];
        draw(group, 'path', {class: `area ${colour}`, d: `${path([[X(x), Y(0)], edge(-half), edge(half)])}Z`});
        draw(group, 'path', {class: `thin dashed ${colour}`, d: path([[X(x), Y(0)], edge(0)])});
        draw(group, 'path', {class: `line ${colour}`, d: path([[X(x), Y(0)], [X(0), Y(distance)]])});
        draw(group, 'circle', {class: `solid ${colour}`, cx: X(x), cy: Y(0), r: 5});
      });
      value = (u, v) => [-reach + (u - at.left) * 2 * reach / at.width, deep - 60 - (v - at.top) * deep / at.height];
      grips.point.put(X(0), Y(distance));
      grips.right.put(X(baseline / 2), Y(0));
      if (!found.sigmas_mm) return;
      const outline = ellipse(found.point, found.covariance, values.enlarged).map(([x, z]) => [X(x), Y(z)]);
      draw(group, 'path', {class: 'common', d: `${path(outline)}Z`});
      draw(group, 'circle', {class: 'solid ink', cx: X(0), cy: Y(distance), r: 3});
    }

    function curves(svg, at, values, inputs, found) {
      const x = {low: BASELINES.low, high: BASELINES.high, log: true, label: 'baseline / mm', ticks: [20, 50, 100, 200, 400]};
      const y = {low: 0.001, high: 30, log: true, label: 'standard deviation / mm', ticks: [0.001, 0.01, 0.1, 1, 10]};
      const {X, Y, group} = axes(svg, at, x, y);
      const all = Array.from({length: 61}, (_, k) => BASELINES.low * (BASELINES.high / BASELINES.low) ** (k / 60));
      const rows = all.map(one => [one, compute({...inputs, baseline_mm: one})]).filter(([, row]) => row.sigmas_mm);
      [[2, 'line four'], [0, 'line three']].forEach(([axis, kind]) => {
        for (const seen of [false, true]) {
          const some = rows.filter(([, row]) => !seen || row.seen);
          const d = path(some.map(([one, row]) => [X(one), Y(row.sigmas_mm[axis])]));
          draw(group, 'path', {class: seen ? kind : `${kind.replace('line', 'thin')} dashed`, d});
        }
      });
      if (!found.sigmas_mm) return;
      draw(group, 'circle', {class: 'solid four', cx: X(values.baseline), cy: Y(found.sigmas_mm[2]), r: 5});
      draw(group, 'circle', {class: 'solid three', cx: X(values.baseline), cy: Y(found.sigmas_mm[0]), r: 5});
    }

    function drawn(svg, width, values) {
      const inputs = {
        baseline_mm: values.baseline,
        vergence_deg: values.vergence,
        distance_mm: values.distance,
        sigma_px: values.sigma,
        focal_px: data.focal_px, width_px: data.width_px,
      };
      const found = compute(inputs);
      const wide = width > 560;
      const room = wide ? (width - 128) / 2 : width - 64;
      const tall = wide ? 330 : 300;
      plan(svg, {left: 44, top: 24, width: room, height: tall}, values, found);
      const beside = {left: room + 100, top: 24, width: room, height: tall};
      const below = {left: 44, top: tall + 104, width: room, height: 210};
      curves(svg, wide ? beside : below, values, inputs, found);
      const says = [];
      if (found.sigmas_mm) {
        const [sx, sy, sz] = found.sigmas_mm.map(one => one.toPrecision(3));
        const ratio = found.sigmas_mm[2] / found.sigmas_mm[0];
        says.push(`Standard deviations: ${sz} mm in depth, ${sx} mm along x and ${sy} mm along y. `
          + `Depth is ${ratio.toFixed(1)} times as uncertain as x. `
          + `The rays meet at ${(2 * Math.atan(values.baseline / 2 / values.distance) / DEGREE).toFixed(1)}°.`);
      }
      says.push(found.seen ? `Both images show the point. The ellipse is enlarged ${values.enlarged} times.`
        : 'The point is outside the images: nobody measures it.');
      const alt = `A plan of two cameras ${values.baseline} mm apart and their rays to a point at ${values.distance} mm, `
        + `and the deviations over the baseline. ${says.join(' ')}`;
      return {height: wide ? tall + 68 : tall + 104 + 210 + 44, alt, says};
    }

    const kept = (one, low, high, digits) => Number(Math.min(high, Math.max(low, one)).toFixed(digits));
    const grips = {
      point: handle('point', (u, v) => view.set({distance: kept(value(u, v)[1], 300, 900, 0)})),
      right: handle('right', (u, v) => view.set({baseline: kept(2 * value(u, v)[0], BASELINES.low, BASELINES.high, 1)})),
    };
    const view = page(box, {
      label: 'Applet: baseline, vergence and the error of depth',
      controls: [
        range('baseline', 'baseline', [BASELINES.low, BASELINES.high, 0.1], data.baseline_mm, 'mm',
          {format: one => one.toFixed(1)}),
        range('vergence', 'vergence, angle between the axes', [0, 60, 0.5], data.vergence_deg, '°'),
        range('distance', 'distance of the point', [300, 900, 1], data.distance_mm, 'mm'),
        range('sigma', 'σ of a pixel coordinate', [0.01, 2, 0.05], parameters.sigma_px, 'px', {log: true, precision: 2}),
        range('enlarged', 'ellipse enlarged', [1, 1000, 0.05], 500, 'times', {log: true, precision: 2}),
      ],
      handles: [grips.point, grips.right],
      play: {name: 'baseline', stops: 40, ms: 80},
      legend: [['one', 'left camera'], ['five', 'right camera'], ['four', 'depth z; the ellipse'],
        ['three', 'across, x'], ['dashed ink', 'outside the images']],
      drawn,
    });
  }

  trinolabApplets.define('depth', {compute, triangulate, ellipse, start});
})();
