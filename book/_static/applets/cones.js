'use strict';
// Three solid cones of view and their common space (Eq. 1-4), in the paper's frame OXYZ. Lengths in units of the baseline B.
(() => {
  const {draw, path, axes, page, range, signed, dot} = trinolabApplets.shared;
  const DEGREE = Math.PI / 180;
  const NAMES = ['CCD1', 'CCD2', 'CCD3'];
  const COLOURS = ['one', 'five', 'three'];
  const X_AXIS = {low: -0.6, high: 1.6, ticks: [0, 1]};
  const Y_AXIS = {low: -1.2, high: 2.1, ticks: [-1, 0, 1, 2]};
  const Z_AXIS = {low: -0.2, high: 3.8, ticks: [0, 1, 2, 3]};

  // Apexes and axes of the three cameras, and where the axes meet (Eq. 1-3, corrected). Angles in rad.
  function paperCones({B, beta1, beta2, omega}) {
    const x0 = B * Math.tan(beta2) / (Math.tan(beta1) + Math.tan(beta2));
    const z0 = x0 * Math.tan(beta1);
    const cones = [
      {apex: [0, 0, 0], axis: [Math.cos(beta1), 0, Math.sin(beta1)], omega},
      {apex: [B, 0, 0], axis: [-Math.cos(beta2), 0, Math.sin(beta2)], omega},
      {apex: [x0, Math.hypot(x0, z0), z0], axis: [0, -1, 0], omega},
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

  // All numbers of the applet: angles in deg, lengths in units of B.
  function compute({beta1_deg, beta2_deg, omega_deg, point, n = 120}) {
    const angles = {beta1: beta1_deg * DEGREE, beta2: beta2_deg * DEGREE, omega: omega_deg * DEGREE};
    const {cones, meeting} = paperCones({B: 1, ...angles});
    return {
      cones, meeting,
      angles_deg: cones.map(cone => angleTo(cone, point) / DEGREE),
      inside: cones.map(cone => inCone(cone, point)),
      volume: volume(cones, meeting, n),
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

  function start(box, parameters) {
    function view(svg, at, title, horizontal, letter, cones, point) {
      const axis = letter === 'X' ? 0 : 1;
      const {X, Y, group} = axes(svg, at, {...horizontal, label: `${letter} / B`}, {...Z_AXIS, label: title});
      const outline = some => section(some, point, axis, Z_AXIS.low, Z_AXIS.high).map(([x, z]) => [X(x), Y(z)]);
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
      draw(group, 'path', {class: 'line ink', d: `M${u - 6} ${v}h12M${u} ${v - 6}v12`});
    }

    function drawn(svg, width, {beta1, beta2, omega, x, y, z}) {
      const point = [x, y, z];
      const found = compute({beta1_deg: beta1, beta2_deg: beta2, omega_deg: omega, point});
      const gap = 44;
      const perB = Math.min(110, (width - 34 - gap - 6) / (X_AXIS.high - X_AXIS.low + Y_AXIS.high - Y_AXIS.low));
      const height = perB * (Z_AXIS.high - Z_AXIS.low);
      const first = {left: 34, top: 40, width: perB * (X_AXIS.high - X_AXIS.low), height};
      const second = {...first, left: first.left + first.width + gap, width: perB * (Y_AXIS.high - Y_AXIS.low)};
      draw(svg, 'text', {x: first.left, y: 14}, 'from above');
      draw(svg, 'text', {x: second.left, y: 14}, 'from the side');
      view(svg, first, 'Z / B', X_AXIS, 'X', found.cones, point);
      view(svg, second, 'Z / B', Y_AXIS, 'Y', found.cones, point);
      const beside = found.angles_deg.map((one, k) => `${one.toFixed(1)}° beside the axis of ${NAMES[k]}`);
      const outside = NAMES.filter((_, k) => !found.inside[k]);
      const says = [
        `The three cones share ${found.volume.toFixed(4)} B³. `
        + `The axes meet at X = ${found.meeting[0].toFixed(2)}, Z = ${found.meeting[2].toFixed(2)} B.`,
        `The point lies ${beside.join(', ')}; ω is ${omega}°. `
        + (outside.length ? `It is outside of ${outside.join(' and ')}, and so not in the workspace.` : 'It is in the workspace.'),
      ];
      const alt = `Two cuts through the point (${point.join(', ')}) B: three cones, and what they share. ${says.join(' ')}`;
      return {height: height + 40 + 44, alt, says};
    }

    const place = (name, low, high, value) => range(name, `point ${name.toUpperCase()}`, [low, high, 0.05], value, 'B',
      {format: one => signed(one.toFixed(2))});
    page(box, {
      label: 'Applet: three cones and their common space',
      controls: [
        range('beta1', 'β₁ of CCD1', [30, 75, 1], parameters.beta_deg, '°'),
        range('beta2', 'β₂ of CCD2', [30, 75, 1], parameters.beta_deg, '°'),
        range('omega', 'half angle ω', [4, 30, 1], parameters.half_angle_deg, '°'),
        place('x', -0.5, 1.5, 0.5), place('y', -1, 2, 0.1), place('z', 0, 3.6, 0.5),
      ],
      legend: [...NAMES.map((name, k) => [`band ${COLOURS[k]}`, name]),
        ['band four', 'in all three cones'], ['ink', 'the point (cross)']],
      drawn,
    });
  }

  trinolabApplets.define('cones', {compute, paperCones, chord, volume, start});
})();
