'use strict';
// Shaded solids. One WebGL context draws both spaces, one after the other; each takes its picture from there.

const Solids = (() => {
  const LIGHT = [0.35, -0.55, 0.75];  // towards it; z is up
  const SHADOW = 0.2;
  const VERTEX = `#version 300 es
    in vec3 place;
    in vec3 normal;
    in vec4 tint;
    uniform mat4 body, view;
    uniform mat3 turned, eye;
    out vec3 facing;
    out vec4 ink;
    void main() {
      gl_Position = view * (body * vec4(place, 1.0));
      facing = eye * (turned * normal);
      ink = tint;
    }`;
  const FRAGMENT = `#version 300 es
    precision mediump float;
    in vec3 facing;
    in vec4 ink;
    uniform vec3 light, between;  // to the light, and half way from there to the viewer
    uniform int kind;  // 0 plain, 1 solid, 2 glass
    out vec4 colour;
    void main() {
      if (kind == 0) { colour = vec4(ink.rgb * ink.a, ink.a); return; }
      vec3 n = normalize(facing);
      float lit = 0.36 + 0.46 * max(dot(n, light), 0.0) + 0.24 * max(n.z, 0.0);
      float shine = max(dot(n, between), 0.0);
      shine *= shine; shine *= shine; shine *= shine; shine *= shine; shine *= shine;
      float rim = 1.0 - abs(n.z);
      float a = kind == 2 ? mix(0.22, 0.8, rim * sqrt(rim)) : ink.a;
      colour = vec4((ink.rgb * lit + 0.16 * shine) * a, a);
    }`;
  const NAMES = ['body', 'view', 'turned', 'eye', 'light', 'between', 'kind'];
  const PLACE = 0, NORMAL = 1, TINT = 2;

  const canvas = document.createElement('canvas');
  let gl = null, meshes, uniforms, ribbon;

  function begin() {
    gl = canvas.getContext('webgl2', {alpha: true, antialias: true, stencil: true});
    if (!gl) return;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ['place', 'normal', 'tint'].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {  // lines are drawn instead
      console.warn(gl.getProgramInfoLog(program));
      gl = null;
      return;
    }
    gl.useProgram(program);
    uniforms = Object.fromEntries(NAMES.map(name => [name, gl.getUniformLocation(program, name)]));
    meshes = Object.fromEntries(Object.entries({box: box(), tube: round(false), drum: round(true), ball: ball(), hood: hood()})
      .map(([name, corners]) => [name, uploaded(corners)]));
    ribbon = gl.createVertexArray();
    gl.bindVertexArray(ribbon);
    gl.bindBuffer(gl.ARRAY_BUFFER, ribbon.buffer = gl.createBuffer());
    gl.enableVertexAttribArray(PLACE);
    gl.vertexAttribPointer(PLACE, 3, gl.FLOAT, false, 28, 0);
    gl.enableVertexAttribArray(TINT);
    gl.vertexAttribPointer(TINT, 4, gl.FLOAT, false, 28, 12);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // ---- meshes: triangles of a place and a normal each

  function uploaded(corners) {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    for (const [which, at] of [[PLACE, 0], [NORMAL, 12]]) {
      gl.enableVertexAttribArray(which);
      gl.vertexAttribPointer(which, 3, gl.FLOAT, false, 24, at);
    }
    return {array, count: corners.length / 6};
  }

  // Of a grid of points, two triangles a cell.
  function woven(rows, columns, at) {
    const corners = [];
    for (let r = 0; r < rows; r++)
      for (let c = 0; c < columns; c++)
        for (const [i, j] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) corners.push(...at(r + i, c + j));
    return corners;
  }

  function box() {
    const corners = [];
    for (let axis = 0; axis < 3; axis++)
      for (const side of [-1, 1])
        corners.push(...woven(1, 1, (i, j) => {
          const place = [0, 0, 0], normal = [0, 0, 0];
          place[axis] = normal[axis] = side;
          place[(axis + 1) % 3] = 2 * i - 1;
          place[(axis + 2) % 3] = 2 * j - 1;
          return [...place, ...normal];
        }));
    return corners;
  }

  const TURNS = 20;
  const on = (k, n) => [Math.cos(2 * Math.PI * k / n), Math.sin(2 * Math.PI * k / n)];

  function round(closed) {
    const corners = woven(1, TURNS, (r, c) => {
      const [x, y] = on(c, TURNS);
      return [x, y, 2 * r - 1, x, y, 0];
    });
    if (closed)
      for (const side of [-1, 1])
        corners.push(...woven(1, TURNS, (r, c) => {
          const [x, y] = on(c, TURNS);
          return [r * x, r * y, side, 0, 0, side];
        }));
    return corners;
  }

  function ball() {
    return woven(TURNS / 2, TURNS, (r, c) => {
      const [x, y] = on(c, TURNS), [high, wide] = on(r, TURNS);
      const place = [wide * x, wide * y, high];
      return [...place, ...place];
    });
  }

  // A camera's hood: from the point through which it sees, forward along z.
  function hood() {
    const corners = [];
    const rim = [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];
    rim.forEach((one, k) => {
      const other = rim[(k + 1) % 4];
      const normal = [[0, -1, -1], [1, 0, -1], [0, 1, -1], [-1, 0, -1]][k];
      for (const place of [[0, 0, 0], one, other]) corners.push(...place, ...normal);
    });
    return corners;
  }

  // ---- matrices: sixteen numbers, column by column

  const affine = (x, y, z, at) => [...x, 0, ...y, 0, ...z, 0, ...at, 1];
  const ofRows = T => [T[0], T[4], T[8], 0, T[1], T[5], T[9], 0, T[2], T[6], T[10], 0, T[3], T[7], T[11], 1];

  function times(A, B) {
    const C = new Array(16).fill(0);
    for (let c = 0; c < 4; c++)
      for (let r = 0; r < 4; r++)
        for (let k = 0; k < 4; k++) C[4 * c + r] += A[4 * k + r] * B[4 * c + k];
    return C;
  }

  function ofPose([x, y, z, w, i, j, k]) {
    return [
      1 - 2 * (j * j + k * k), 2 * (i * j + w * k), 2 * (i * k - w * j), 0,
      2 * (i * j - w * k), 1 - 2 * (i * i + k * k), 2 * (j * k + w * i), 0,
      2 * (i * k + w * j), 2 * (j * k - w * i), 1 - 2 * (i * i + j * j), 0,
      x, y, z, 1];
  }

  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

  // How normals turn: the cofactors.
  function ofNormals(M) {
    const [x, y, z] = [0, 4, 8].map(k => M.slice(k, k + 3));
    return [...cross(y, z), ...cross(z, x), ...cross(x, y)];
  }

  const scaled = (a, b, c) => affine([a, 0, 0], [0, b, 0], [0, 0, c], [0, 0, 0]);
  const moved = (M, z) => times(M, affine([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, z]));

  // What a shape of the scene is drawn with: meshes, each with its matrix.
  function partsOf({kind, size: [a, b, c], T}) {
    const M = ofRows(T);
    if (kind === 'capsule') {
      return [{mesh: 'tube', M: times(M, scaled(a, b, c))},
        ...[-c, c].map(z => ({mesh: 'ball', M: times(moved(M, z), scaled(a, b, a))}))];
    }
    return [{mesh: {box: 'box', cylinder: 'drum', ellipsoid: 'ball'}[kind], M: times(M, scaled(a, b, c))}];
  }

  // ---- drawing

  function colourOf(text) {  // #rrggbb
    return [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16) / 255);
  }

  function put(solid, M, kind, tint) {
    const {array, count} = meshes[solid.mesh];
    gl.bindVertexArray(array);
    gl.vertexAttrib4f(TINT, ...tint);
    gl.uniformMatrix4fv(uniforms.body, false, M);
    gl.uniformMatrix3fv(uniforms.turned, false, ofNormals(M));
    gl.uniform1i(uniforms.kind, kind);
    gl.drawArrays(gl.TRIANGLES, 0, count);
  }

  // Ribbons turn to the viewer and are as wide everywhere: points, colours (rgba, one a point or one for all), width in mm.
  function putRibbons(ribbons, towards) {
    const corners = [];
    for (const {points, tints, wide} of ribbons)
      for (let k = 0; k + 1 < points.length; k++) {
        const [p, q] = [points[k], points[k + 1]];
        const side = cross(q.map((x, i) => x - p[i]), towards);
        const length = Math.hypot(...side);
        if (length < 1e-9) continue;
        const off = side.map(x => x * wide / 2 / length);
        const at = (point, way, tint) => [...point.map((x, i) => x + way * off[i]), ...tint];
        const [s, t] = [tints[k] || tints[0], tints[k + 1] || tints[0]];
        const [a, b, c, d] = [at(p, -1, s), at(p, 1, s), at(q, 1, t), at(q, -1, t)];
        corners.push(...a, ...b, ...c, ...a, ...c, ...d);
      }
    if (!corners.length) return;
    gl.bindVertexArray(ribbon);
    gl.bindBuffer(gl.ARRAY_BUFFER, ribbon.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.DYNAMIC_DRAW);
    gl.uniformMatrix4fv(uniforms.body, false, scaled(1, 1, 1));
    gl.uniform1i(uniforms.kind, 0);
    gl.drawArrays(gl.TRIANGLES, 0, corners.length / 7);
  }

  /* Draw a space. `sight` says how it is seen: across, up and towards (the viewer's axes in the space), middle, scale (px
     a mm), distance, deep (mm), and how the space's z lies that is up. `solids` have mesh, M, tint, and may be ground (on
     which shadows fall), casting (a shadow) or glass. */
  function draw(width, height, sight, solids, ribbons) {
    if (canvas.width < width || canvas.height < height)
      [canvas.width, canvas.height] = [Math.max(canvas.width, width), Math.max(canvas.height, height)];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clearStencil(0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const {across, up, towards, middle, scale, distance, deep} = sight;
    const row = (way, factor, last) => [...way.map(x => x * factor), last - factor * way.reduce((sum, x, k) => sum + x * middle[k], 0)];
    const rows = [row(across, 2 * scale / width, 0), row(up, 2 * scale / height, 0),
      row(towards, -1 / deep, deep / distance), row(towards, -1 / distance, 1)];
    gl.uniformMatrix4fv(uniforms.view, false, [0, 1, 2, 3].flatMap(c => rows.map(r => r[c])));
    gl.uniformMatrix3fv(uniforms.eye, false, [0, 1, 2].flatMap(c => [across[c], up[c], towards[c]]));
    const light = sight.upright(LIGHT), long = Math.hypot(...light);
    const seen = [across, up, towards].map(way => way.reduce((sum, x, k) => sum + x * light[k], 0) / long);
    const between = [seen[0], seen[1], seen[2] + 1], half = Math.hypot(...between) || 1;
    gl.uniform3f(uniforms.light, ...seen);
    gl.uniform3f(uniforms.between, ...between.map(x => x / half));

    gl.enable(gl.STENCIL_TEST);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
    for (const one of solids.filter(one => !one.glass)) {
      gl.stencilFunc(gl.ALWAYS, one.ground ? 1 : 0, 255);
      put(one, one.M, 1, one.tint);
    }
    gl.stencilFunc(gl.EQUAL, 1, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);  // no place is shaded twice
    const flat = affine([1, 0, 0], [0, 1, 0], [-light[0] / light[2], -light[1] / light[2], 0], [0, 0, 0.5]);
    for (const one of solids.filter(one => one.casting)) put(one, times(flat, one.M), 0, [0, 0, 0, SHADOW]);
    gl.disable(gl.STENCIL_TEST);
    putRibbons(ribbons, towards);
    gl.depthMask(false);
    for (const one of solids.filter(one => one.glass)) put(one, one.M, 2, one.tint);
    gl.depthMask(true);
    return {canvas, top: canvas.height - height};
  }

  canvas.addEventListener('webglcontextlost', event => { gl = null; event.preventDefault(); });
  canvas.addEventListener('webglcontextrestored', begin);
  begin();
  return {ready: () => gl !== null, context: () => gl, draw, affine, ofRows, ofPose, times, cross, partsOf, colourOf};
})();
