'use strict';
// Three solid cones of view and their common space (Eq. 1-4), in the paper's frame OXYZ. Lengths in units of the baseline B.
(() => {
  const {draw, path, axes, page, range, signed, handle, dot} = trinolabApplets.shared;
  const DEGREE = Math.PI / 180;
  const NAMES = ['CCD1', 'CCD2', 'CCD3'];
  const COLOURS = ['one', 'five', 'three'];
  const X_SPAN = [-0.2, 1.2];  // of the picture at least: both cameras of the baseline
  const HIGHEST = 3.8;
  const REACH = 0.35;  // from a camera to the handle that turns it

  // Apexes and axes of the three cameras, and where the axes of the first two meet (Eq. 1-3, corrected; or Eq. 3 as printed, whose
  // camera looks along the baseline). Angles in rad.
  function paperCones({B, beta1, beta2, omega, printed3 = false}) {
    const x0 = B * Math.tan(beta2) / (Math.tan(beta1) + Math.tan(beta2));
    const z0 = x0 * Math.tan(beta1);
    const cones = [
      {apex: [0, 0, 0], axis: [Math.cos(beta1), 0, Math.sin(beta1)], omega},
      {apex: [B, 0, 0], axis: [-Math.cos(beta2), 0, Math.sin(beta2)], omega},
      printed3 ? {apex: [B / 2, B / Math.SQRT2, B / 2], axis: [-1, 0, 0], omega}
        : {apex: [x0, Math.hypot(x0, z0), z0], axis: [0, -1, 0], omega},
    ];
    return {cones, meeting: [x0, 0, z0]};
  }

  // The angle between the axis of a cone and the direction from its apex to a point, rad.
  function angleTo({apex, axis}, point) {
    const x = point.map((value, k) => value - apex[k]);
    return Math.acos(Math.min(1, Math.max(-1, dot(x, axis) / Math.hypot(...x))));
  }

  // Whether a point lies in a solid cone, surface included.
  function inCone({apex, axis, omega}, point) {
    const x = point.map((value, k) => value - apex[k]);
    return dot(x, axis) >= Math.cos(omega) * Math.hypot(...x);
  }

  // Of a solid cone: the function from a direction to the part [low, high] of the line start + s direction that lies inside;
  // low > high where the line misses the cone.
  function chords({apex, axis, omega}, start) {
    const m = start.map((value, k) => value - apex[k]);
    const cos2 = Math.cos(omega) ** 2;
    const depth = dot(m, axis);
    const c = depth ** 2 - cos2 * dot(m, m);
    return ([x, y, z]) => {
      const along = x * axis[0] + y * axis[1] + z * axis[2];
      const a = along ** 2 - cos2;  // inside both nappes: a s^2 + 2 b s + c >= 0
      const b = depth * along - cos2 * (x * m[0] + y * m[1] + z * m[2]);
      const square = b * b - a * c;
      if (a < 0 && square < 0) return [Infinity, -Infinity];
      const q = -(b + (b < 0 ? -1 : 1) * Math.sqrt(Math.max(square, 0)));
      const [first, second] = [q === 0 ? 0 : c / q, q / (a === 0 ? -1e-30 : a)];
      const [near, far] = first < second ? [first, second] : [second, first];
      if (a > 0) return along > 0 ? [far, Infinity] : [-Infinity, near];
      return depth + first * along >= 0 ? [near, far] : [Infinity, -Infinity];  // the nappe that both roots lie on
    };
  }

  const chord = (cone, start, direction) => chords(cone, start)(direction);

  // The part of a line inside all cones.
  function common(cones, start, direction) {
    const parts = cones.map(cone => chord(cone, start, direction));
    return [Math.max(...parts.map(([low]) => low)), Math.min(...parts.map(([, high]) => high))];
  }

  // The volume around a point inside all cones: a third of the cubed distance to the surface, over n x 2n directions of
  // equal solid angle. Infinite if a direction has no end.
  function volume(cones, inside, n) {
    const ways = cones.map(cone => chords(cone, inside));
    let sum = 0;
    for (let i = 0; i < n; i++) {
      const z = (2 * i + 1) / n - 1;
      const across = Math.sqrt(1 - z * z);
      for (let j = 0; j < 2 * n; j++) {
        const turn = Math.PI * (j + 0.5) / n;
        const direction = [across * Math.cos(turn), across * Math.sin(turn), z];
        let end = Infinity;
        for (const way of ways) end = Math.min(end, way(direction)[1]);
        sum += end ** 3;
      }
    }
    return sum * 4 * Math.PI / (3 * 2 * n * n);
  }

  // All numbers of the applet: angles in deg, lengths in units of B. By Eq. 3 as printed the cones share nothing.
  function compute({beta1_deg, beta2_deg, omega_deg, point, printed3 = false, n = 120}) {
    const angles = {beta1: beta1_deg * DEGREE, beta2: beta2_deg * DEGREE, omega: omega_deg * DEGREE};
    const {cones, meeting} = paperCones({B: 1, ...angles, printed3});
    return {
      cones, meeting,
      angles_deg: cones.map(cone => angleTo(cone, point) / DEGREE),
      inside: cones.map(cone => inCone(cone, point)),
      volume: cones.every(cone => inCone(cone, meeting)) ? volume(cones, meeting, n) : 0,
    };
  }

  // The outline of what some cones share in a plane: a line across it for each height z of the picture.
  function section(cones, through, axis, low, high) {
    const direction = [0, 0, 0];
    direction[axis] = 1;
    const left = [];
    const right = [];
    for (let k = 0; k <= 240; k++) {
      const z = low + (high - low) * k / 240;
      const start = [...through];
      start[axis] = 0;
      start[2] = z;
      const [from, to] = common(cones, start, direction);
      if (from > to) continue;
      left.push([Math.max(from, -9), z]);
      right.push([Math.min(to, 9), z]);
    }
    return [...left, ...right.reverse()];
  }

  // How high the picture is: all that the cones share, and the third camera's foot, in tenths of B.
  function heightOf({cones, meeting}) {
    const tops = [0, 1].map(axis => Math.max(...section(cones, meeting, axis, 0, HIGHEST).map(([, z]) => z), meeting[2]));
    return Math.min(HIGHEST, Math.max(1, Math.ceil(10.5 * Math.max(...tops)) / 10));
  }

  // Where both pictures stand, and what they span across: beside each other in one scale; on a narrow screen below each other.
  // What is left of the width goes to both.
  function framesOf(width, [low, high], xSpan, ySpan) {
    const [left, gap, top] = [34, 44, 40];
    const long = ([from, to]) => to - from;
    const wider = ([from, to], by) => [from - by / 2, to + by / 2];
    if (width < 520) {
      const room = width - left - 6;
      const perB = Math.min(300 / (high - low), room / Math.max(long(xSpan), long(ySpan)));
      const height = perB * (high - low);
      const across = span => wider(span, room / perB - long(span));
      const first = {left, top, width: room, height, across: across(xSpan)};
      return [first, {...first, top: top + height + 84, across: across(ySpan)}];
    }
    const room = width - left - gap - 6;
    const perB = Math.min(440 / (high - low), room / (long(xSpan) + long(ySpan)));
    const rest = (room / perB - long(xSpan) - long(ySpan)) / 2;
    const [x, y] = [wider(xSpan, rest), wider(ySpan, rest)];
    const first = {left, top, width: perB * long(x), height: perB * (high - low), across: x};
    return [first, {...first, left: left + first.width + gap, width: perB * long(y), across: y}];
  }

  function start(box, parameters) {
    let views = null;  // of both pictures: from places to values, for the pointer

    function view(svg, at, title, span, letter, [low, high], cones, point) {
      const axis = letter === 'X' ? 0 : 1;
      const {X, Y, group} = axes(svg, at, {low: span[0], high: span[1], label: `${letter} / B`}, {low, high, label: title});
      const outline = some => section(some, point, axis, low, high).map(([x, z]) => [X(x), Y(z)]);
      cones.forEach((cone, k) => {
        const line = outline([cone]);
        if (line.length) draw(group, 'path', {class: `area ${COLOURS[k]}`, d: `${path(line)}Z`});
        if (line.length) draw(group, 'path', {class: `thin ${COLOURS[k]}`, d: `${path(line)}Z`});
      });
      const shared = outline(cones);
      if (shared.length) draw(group, 'path', {class: 'common', d: `${path(shared)}Z`});
      cones.forEach((cone, k) => {
        const [x, z] = [X(cone.apex[axis]), Y(cone.apex[2])];
        const flat = Math.abs(cone.apex[1 - axis] - point[1 - axis]) < 1e-9;
        draw(group, 'circle', {cx: x, cy: z, r: 5, class: flat ? `solid ${COLOURS[k]}` : `thin ${COLOURS[k]}`});
      });
      const [u, v] = [X(point[axis]), Y(point[2])];
      draw(group, 'path', {class: 'line ink', d: `M${u - 8} ${v}h16M${u} ${v - 8}v16`});
      const value = (x, y) => [span[0] + (x - at.left) * (span[1] - span[0]) / at.width, high - (y - at.top) * (high - low) / at.height];
      const inside = (x, y) => [Math.min(at.left + at.width, Math.max(at.left, x)), Math.min(at.top + at.height, Math.max(at.top, y))];
      return {X, Y, group, value, put: (grip, x, z) => grip.put(...inside(X(x), Y(z)))};
    }

    function drawn(svg, width, {beta1, beta2, omega, x, y, z, printed3}) {
      const point = [x, y, z];
      const found = compute({beta1_deg: beta1, beta2_deg: beta2, omega_deg: omega, point, printed3});
      const {cones, meeting} = found;
      const span = [-0.1, heightOf(found)];
      const far = cones[2].apex[1];
      const ySpan = [-0.5 * (span[1] - span[0]), Math.max(0.5 * (span[1] - span[0]), far + 0.15)];
      const [first, second] = framesOf(width, span, X_SPAN, ySpan);
      draw(svg, 'text', {x: first.left, y: first.top - 26}, 'from above');
      draw(svg, 'text', {x: second.left, y: second.top - 26}, 'from the side');
      views = [
        view(svg, first, 'Z / B', first.across, 'X', span, cones, point),
        view(svg, second, 'Z / B', second.across, 'Y', span, cones, point),
      ];
      const [above, side] = views;
      above.put(grips.above, x, z);
      side.put(grips.side, y, z);
      [grips.ccd1, grips.ccd2].forEach((grip, k) => {
        const {apex, axis} = cones[k];
        const [tx, tz] = [apex[0] + REACH * axis[0], apex[2] + REACH * axis[2]];
        draw(above.group, 'path', {class: `line ${COLOURS[k]}`, d: path([[above.X(apex[0]), above.Y(apex[2])], [above.X(tx), above.Y(tz)]])});
        draw(above.group, 'circle', {class: `solid ${COLOURS[k]}`, cx: above.X(tx), cy: above.Y(tz), r: 6});
        above.put(grip, tx, tz);
      });
      const beside = found.angles_deg.map((one, k) => `${one.toFixed(1)}° beside the axis of ${NAMES[k]}`);
      const outside = NAMES.filter((_, k) => !found.inside[k]);
      const says = [
        (found.volume ? `The three cones share ${found.volume.toFixed(4)} B³. ` : 'The three cones share nothing. ')
        + `The axes of CCD1 and CCD2 meet at X = ${meeting[0].toFixed(2)}, Z = ${meeting[2].toFixed(2)} B`
        + (printed3 ? ', and CCD3 looks along the baseline, past that place.' : ', and so does that of CCD3.'),
        `The point lies ${beside.join(', ')}; ω is ${omega}°. `
        + (outside.length ? `It is outside of ${outside.join(' and ')}, and so not in the workspace.` : 'It is in the workspace.'),
      ];
      const alt = `Two cuts through the point (${point.join(', ')}) B: three cones, and what they share. ${says.join(' ')}`;
      return {height: second.top + second.height + 44, alt, says};
    }

    const kept = (value, low, high, step) => Number((step * Math.round(Math.min(high, Math.max(low, value)) / step)).toFixed(2));
    const turned = (sign, from) => (u, v) => {
      const [x, z] = views[0].value(u, v);
      return kept(Math.atan2(z, sign * (x - from)) / DEGREE, 30, 75, 1);
    };
    const grips = {
      above: handle('above', (u, v) => {
        const [x, z] = views[0].value(u, v);
        panel.set({x: kept(x, -0.5, 1.5, 0.05), z: kept(z, 0, 3.6, 0.05)});
      }),
      side: handle('side', (u, v) => {
        const [y, z] = views[1].value(u, v);
        panel.set({y: kept(y, -1, 2, 0.05), z: kept(z, 0, 3.6, 0.05)});
      }),
      ccd1: handle('ccd1', (u, v) => panel.set({beta1: turned(1, 0)(u, v)})),
      ccd2: handle('ccd2', (u, v) => panel.set({beta2: turned(-1, 1)(u, v)})),
    };
    const place = (name, low, high, value) => range(name, `point ${name.toUpperCase()}`, [low, high, 0.05], value, 'B',
      {format: one => signed(one.toFixed(2))});
    const panel = page(box, {
      label: 'Applet: three cones and their common space',
      controls: [
        range('beta1', 'β₁ of CCD1', [30, 75, 1], parameters.beta_deg, '°'),
        range('beta2', 'β₂ of CCD2', [30, 75, 1], parameters.beta_deg, '°'),
        range('omega', 'half angle ω', [4, 30, 1], parameters.half_angle_deg, '°'),
        place('x', -0.5, 1.5, 0.5), place('y', -1, 2, 0.1), place('z', 0, 3.6, 0.5),
        {kind: 'check', name: 'printed3', label: 'Eq. 3 as printed: CCD3 is turned about Y, not about X', value: false},
      ],
      legend: [...NAMES.map((name, k) => [`band ${COLOURS[k]}`, name]),
        ['band four', 'in all three cones'], ['ink', 'the point (cross)']],
      handles: [grips.ccd1, grips.ccd2, grips.above, grips.side],
      play: {name: 'omega', ms: 120},
      drawn,
    });
  }

  trinolabApplets.define('cones', {compute, paperCones, chord, volume, start});
})();
