// The interactive view: the CAD surface in the colours of the deviations, by WebGL 2 and nothing else.
//
// The camera is orthographic, as in the still pictures, so that a length in mm is the same everywhere and the
// scale bar holds. It turns about z. Besides the picture, the scene is drawn into a buffer of integers that
// says for every other pixel how deep the surface lies and what was measured there: pointing at the part and
// hiding labels that lie behind it only look that up.
(() => {
  'use strict';

  const stage = document.getElementById('viewer-stage');
  const canvas = document.createElement('canvas');
  const gl = canvas.getContext('webgl2', { antialias: true, alpha: true, premultipliedAlpha: true });
  const note = document.getElementById('viewer-note');
  if (!gl) {
    note.textContent = 'This browser offers no WebGL 2: a still picture stands in for the interactive view.';
    return;
  }

  // ---- What the report wrote ----------------------------------------------------------------------------

  const data = JSON.parse(document.getElementById('viewer-data').textContent);

  function bytesOf(base64) {
    const text = atob(base64);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
    return bytes;
  }
  const array = (Type, base64) => new Type(bytesOf(base64).buffer);

  /** Corners of triangles: differences, 7 bits a byte, the sign in bit 0. */
  function cornersOf(base64, count) {
    const bytes = bytesOf(base64);
    const corners = new Uint32Array(count);
    let previous = 0;
    for (let i = 0, at = 0; i < count; ++i) {
      let value = 0, shift = 0, byte;
      do {
        byte = bytes[at++];
        value |= (byte & 127) << shift;
        shift += 7;
      } while (byte > 127);
      previous += (value >>> 1) ^ -(value & 1);
      corners[i] = previous;
    }
    return corners;
  }

  // ---- Shaders ------------------------------------------------------------------------------------------

  const COMMON = `#version 300 es
    precision highp float;
    precision highp int;
    uniform vec3 low, size, right, up, towards, target;
    uniform vec2 scale;      // clip units per mm
    uniform float depth;     // mm from the target to either end of the depth range
    uniform float bias;      // mm towards the viewer, for lines that lie in a surface
    vec4 place(vec3 p) {
      vec3 d = p - target;
      return vec4(dot(d, right) * scale.x, dot(d, up) * scale.y, -(dot(d, towards) + bias) / depth, 1.0);
    }`;

  const SURFACE = COMMON + `
    layout(location = 0) in vec3 aPosition;
    layout(location = 1) in float aDeviation;
    layout(location = 2) in float aUncertainty;
    layout(location = 3) in float aDefect;
    layout(location = 4) in float aShare;       // of the defect, 0 to 254; 255: not seen
    uniform float deviationStep, uncertaintyStep;
    out vec3 vPosition;
    out vec4 vMeasured;                         // deviation, uncertainty, share, seen
    flat out float vDefect;
    void main() {
      vPosition = low + aPosition * size;
      float seen = aShare > 254.5 ? 0.0 : 1.0;
      vMeasured = vec4(aDeviation * deviationStep, aUncertainty * uncertaintyStep, aShare / 254.0 * seen, seen);
      vDefect = aDefect;
      gl_Position = place(vPosition);
    }`;

  const DISC = COMMON + `
    layout(location = 0) in vec3 aPosition;
    layout(location = 1) in float aDeviation;
    layout(location = 2) in float aUncertainty;
    layout(location = 3) in float aDefect;
    layout(location = 4) in vec3 aNormal;
    layout(location = 5) in vec2 aCorner;
    uniform float deviationStep, uncertaintyStep, radius;
    out vec3 vPosition;
    out vec4 vMeasured;
    out vec2 vCorner;
    flat out vec3 vNormal;
    flat out float vDefect;
    void main() {
      vNormal = normalize(aNormal);
      vec3 side = normalize(abs(vNormal.z) < 0.9 ? cross(vNormal, vec3(0, 0, 1)) : cross(vNormal, vec3(1, 0, 0)));
      vPosition = low + aPosition * size + radius * (aCorner.x * side + aCorner.y * cross(vNormal, side));
      vMeasured = vec4(aDeviation * deviationStep, aUncertainty * uncertaintyStep, 0.0, 1.0);
      vCorner = aCorner;
      vDefect = aDefect;
      gl_Position = place(vPosition);
    }`;

  // `disc` pieces are round and bring their normal; triangles have that of their plane.
  const paint = (disc) => `#version 300 es
    precision highp float;
    precision highp int;
    ${disc ? '#define DISC' : ''}
    in vec3 vPosition;
    in vec4 vMeasured;
    flat in float vDefect;
    #ifdef DISC
    in vec2 vCorner;
    flat in vec3 vNormal;
    #endif
    uniform vec3 towards, light;
    uniform float limit, stripe;
    uniform sampler2D colours;
    out vec4 colour;
    void main() {
      #ifdef DISC
      if (dot(vCorner, vCorner) > 1.0) discard;
      vec3 normal = vNormal;
      #else
      vec3 normal = normalize(cross(dFdx(vPosition), dFdy(vPosition)));
      #endif
      if (dot(normal, towards) < 0.0) normal = -normal;
      float share = vMeasured.z, slope = max(fwidth(share), 1e-4);
      vec3 c = texture(colours, vec2(clamp(0.5 + 0.5 * vMeasured.x / limit, 0.002, 0.998), 0.5)).rgb;
      if (vMeasured.w < 0.5) {
        float along = (gl_FragCoord.x + gl_FragCoord.y) / stripe;
        c = mix(vec3(0.55, 0.57, 0.60), vec3(0.70, 0.72, 0.74), step(0.5, fract(along)));
      }
      #ifndef DISC
      if (!gl_FrontFacing) c = vec3(0.36, 0.37, 0.39);
      else c = mix(c, vec3(0.07, 0.08, 0.10), 0.8 * clamp(1.3 - abs(share - 0.5) / slope, 0.0, 1.0));
      #endif
      colour = vec4(c * min(0.62 + 0.42 * max(dot(normal, light), 0.0), 1.04), 1.0);
    }`;

  const look = (disc) => `#version 300 es
    precision highp float;
    precision highp int;
    in vec4 vMeasured;
    flat in float vDefect;
    ${disc ? 'in vec2 vCorner;' : ''}
    out uvec4 found;       // depth, deviation, uncertainty as the bits of floats; defect + 1, 0 where unseen
    void main() {
      ${disc ? 'if (dot(vCorner, vCorner) > 1.0) discard;' : ''}
      uint defect = ${disc ? 'true' : 'gl_FrontFacing && vMeasured.w >= 0.5'} ? uint(vDefect + 0.5) + 1u : 0u;
      found = uvec4(floatBitsToUint(gl_FragCoord.z), floatBitsToUint(vMeasured.x), floatBitsToUint(vMeasured.y), defect);
    }`;

  const LINE = COMMON + `
    layout(location = 0) in vec3 aPosition;
    void main() { gl_Position = place(low + aPosition * size); }`;
  const LINE_PAINT = `#version 300 es
    precision highp float;
    uniform vec4 ink;
    out vec4 colour;
    void main() { colour = vec4(ink.rgb * ink.a, ink.a); }`;

  function program(vertex, fragment) {
    const p = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(p, shader);
    }
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(p));
    const at = {};
    for (let i = gl.getProgramParameter(p, gl.ACTIVE_UNIFORMS) - 1; i >= 0; --i) {
      const { name } = gl.getActiveUniform(p, i);
      at[name] = gl.getUniformLocation(p, name);
    }
    return { p, at };
  }

  // ---- The scene ----------------------------------------------------------------------------------------

  function attribute(location, values, width, normalised, instances = 0) {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    const type = values instanceof Uint16Array ? gl.UNSIGNED_SHORT
      : values instanceof Int16Array ? gl.SHORT
      : values instanceof Uint8Array ? gl.UNSIGNED_BYTE
      : values instanceof Int8Array ? gl.BYTE : gl.FLOAT;
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, width, type, normalised, 0, 0);
    gl.vertexAttribDivisor(location, instances);
  }

  function vertexArray(fill) {
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    fill();
    gl.bindVertexArray(null);
    return vao;
  }

  let scene, pick;

  function build() {
    const { surface, discs } = data;
    const measured = (of, instances) => {
      attribute(0, array(Uint16Array, of.positions), 3, true, instances);
      attribute(1, array(Int16Array, of.deviations), 1, false, instances);
      attribute(2, array(Uint16Array, of.uncertainties), 1, false, instances);
      attribute(3, array(Uint16Array, of.defects), 1, false, instances);
    };
    const lines = (base64) => {
      const values = array(Uint16Array, base64);
      return { vao: vertexArray(() => attribute(0, values, 3, true)), count: values.length / 3 };
    };
    scene = {
      surfacePaint: program(SURFACE, paint(false)),
      surfaceLook: program(SURFACE, look(false)),
      discPaint: program(DISC, paint(true)),
      discLook: program(DISC, look(true)),
      line: program(LINE, LINE_PAINT),
      surface: vertexArray(() => {
        measured(surface, 0);
        attribute(4, array(Uint8Array, surface.shares), 1, false);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, cornersOf(surface.corners, 3 * surface.triangles), gl.STATIC_DRAW);
      }),
      discs: vertexArray(() => {
        measured(discs, 1);
        attribute(4, array(Int8Array, discs.normals), 3, true, 1);
        attribute(5, new Int8Array([-1, -1, 1, -1, -1, 1, 1, 1]), 2, false, 0);
      }),
      creases: lines(surface.creases),
      sections: data.sections.map((s) => lines(s.ends)),
      colours: gl.createTexture(),
    };
    const table = bytesOf(data.colours);
    gl.bindTexture(gl.TEXTURE_2D, scene.colours);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, table.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, table);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    pick = { frame: gl.createFramebuffer(), found: gl.createRenderbuffer(), depth: gl.createRenderbuffer(),
             width: 0, height: 0, bits: null, floats: null };
  }

  // ---- Camera -------------------------------------------------------------------------------------------

  const low = data.low, size = data.size;
  const centre = low.map((v, k) => v + size[k] / 2);
  const diagonal = Math.hypot(...size);
  const HOME = { azimuth: -Math.PI / 4, elevation: 0.525 };
  const camera = { ...HOME, target: centre.slice(), mmPerPixel: 1 };

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const minus = (a, b) => a.map((v, k) => v - b[k]);

  function axes() {
    const ca = Math.cos(camera.azimuth), sa = Math.sin(camera.azimuth);
    const ce = Math.cos(camera.elevation), se = Math.sin(camera.elevation);
    const towards = [ce * ca, ce * sa, se], right = [-sa, ca, 0];
    return { towards, right, up: cross(towards, right) };
  }

  /** Where a point of the part appears, in CSS pixels of the stage, and how far before the target (mm). */
  function project(p, view = axes()) {
    const d = minus(p, camera.target);
    return [width / 2 + dot(d, view.right) / camera.mmPerPixel, height / 2 - dot(d, view.up) / camera.mmPerPixel,
            dot(d, view.towards)];
  }

  function fit() {
    const view = axes();
    let across = 0, along = 0;
    for (let i = 0; i < 8; ++i) {
      const d = size.map((v, k) => (i >> k & 1 ? v : -v) / 2);
      across = Math.max(across, Math.abs(dot(d, view.right)));
      along = Math.max(along, Math.abs(dot(d, view.up)));
    }
    camera.target = centre.slice();
    camera.mmPerPixel = Math.max(2 * across / Math.max(width - 90, 60), 2 * along / Math.max(height - 120, 60), 1e-6);
  }

  function zoomAt(x, y, factor) {
    const view = axes(), old = camera.mmPerPixel;
    camera.mmPerPixel = Math.min(Math.max(old * factor, diagonal / 2e5), diagonal / 50);
    const shift = old - camera.mmPerPixel;
    for (let k = 0; k < 3; ++k)
      camera.target[k] += shift * ((x - width / 2) * view.right[k] - (y - height / 2) * view.up[k]);
  }

  function pan(dx, dy) {
    const view = axes();
    for (let k = 0; k < 3; ++k) camera.target[k] += camera.mmPerPixel * (dy * view.up[k] - dx * view.right[k]);
  }

  function orbit(dx, dy) {
    camera.azimuth -= 0.008 * dx;
    camera.elevation = Math.min(Math.max(camera.elevation + 0.008 * dy, -Math.PI / 2), Math.PI / 2);
  }

  const VIEWS = { iso: [-Math.PI / 4, 0.525], front: [-Math.PI / 2, 0], back: [Math.PI / 2, 0], left: [Math.PI, 0],
                  right: [0, 0], top: [-Math.PI / 2, Math.PI / 2], bottom: [-Math.PI / 2, -Math.PI / 2] };

  // ---- Drawing ------------------------------------------------------------------------------------------

  let width = 0, height = 0, waiting = false;
  let stale = true, lookedUp = -Infinity, lookUpTook = 0, later = 0;  // of what `pick` holds
  const sectionsShown = document.getElementById('viewer-sections');

  function use({ p, at }, bias = 0) {
    const view = axes(), m = camera.mmPerPixel;
    gl.useProgram(p);
    const light = view.towards.map((v, k) => v + 0.28 * view.up[k] - 0.2 * view.right[k]);
    const length = Math.hypot(...light);
    const values = {
      low, size, target: camera.target, right: view.right, up: view.up, towards: view.towards,
      light: light.map((v) => v / length), scale: [2 / (m * width), 2 / (m * height)], depth: reach(), bias,
      deviationStep: data.deviation_step_mm, uncertaintyStep: data.uncertainty_step_mm, limit: data.limit_mm,
      radius: data.discs.radius_mm, stripe: 9 * devicePixelRatio,
    };
    for (const [name, location] of Object.entries(at)) {
      const value = values[name];
      if (value === undefined) continue;
      if (!Array.isArray(value)) gl.uniform1f(location, value);
      else if (value.length === 2) gl.uniform2fv(location, value);
      else gl.uniform3fv(location, value);
    }
    return at;
  }

  /** Half of the depth range: the whole part lies within, wherever the target was moved. */
  const reach = () => diagonal + Math.hypot(...minus(camera.target, centre));

  function drawSolid(surfaceProgram, discProgram) {
    gl.bindVertexArray(scene.surface);
    use(surfaceProgram);
    gl.drawElements(gl.TRIANGLES, 3 * data.surface.triangles, gl.UNSIGNED_INT, 0);
    if (data.discs.count === 0) return;
    gl.bindVertexArray(scene.discs);
    use(discProgram);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, data.discs.count);
  }

  function drawLines({ vao, count }, ink) {
    if (count === 0) return;
    const at = use(scene.line, 1.5 * camera.mmPerPixel);
    gl.uniform4fv(at.ink, ink);
    gl.bindVertexArray(vao);
    gl.drawArrays(gl.LINES, 0, count);
  }

  function draw() {
    waiting = false;
    if (gl.isContextLost() || width === 0) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.bindTexture(gl.TEXTURE_2D, scene.colours);
    drawSolid(scene.surfacePaint, scene.discPaint);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    drawLines(scene.creases, [0.07, 0.08, 0.10, 0.55]);
    if (sectionsShown.checked) for (const section of scene.sections) drawLines(section, [0.85, 0.1, 0.75, 1]);
    // Looking up reads back from the graphics card: where that is slow, ten times a second while the part moves.
    clearTimeout(later);
    if (lookUpTook < 12 || performance.now() - lookedUp > 100) lookUp();
    else later = setTimeout(redraw, 120);
    overlay();
  }

  function redraw() {
    stale = true;
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(draw);
  }

  /** Draws what lies where into `pick`, at half the resolution of the stage. */
  function lookUp() {
    const began = performance.now();
    const w = Math.ceil(width / 2), h = Math.ceil(height / 2);
    gl.bindFramebuffer(gl.FRAMEBUFFER, pick.frame);
    if (pick.width !== w || pick.height !== h) {
      Object.assign(pick, { width: w, height: h, bits: new Uint32Array(4 * w * h) });
      pick.floats = new Float32Array(pick.bits.buffer);
      gl.bindRenderbuffer(gl.RENDERBUFFER, pick.found);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA32UI, w, h);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, pick.found);
      gl.bindRenderbuffer(gl.RENDERBUFFER, pick.depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, w, h);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, pick.depth);
    }
    gl.viewport(0, 0, w, h);
    gl.disable(gl.BLEND);
    gl.clearBufferuiv(gl.COLOR, 0, new Uint32Array(4));
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    drawSolid(scene.surfaceLook, scene.discLook);
    gl.readPixels(0, 0, w, h, gl.RGBA_INTEGER, gl.UNSIGNED_INT, pick.bits);
    stale = false;
    lookedUp = performance.now();
    lookUpTook = lookedUp - began;
  }

  /** What lies at a place of the stage (CSS pixels): position, deviation, ...; null where nothing does. */
  function found(x, y) {
    const column = Math.floor(x * pick.width / width), row = pick.height - 1 - Math.floor(y * pick.height / height);
    if (!pick.bits || column < 0 || row < 0 || column >= pick.width || row >= pick.height) return null;
    const i = 4 * (row * pick.width + column);
    if (pick.bits[i] === 0) return null;
    const view = axes();
    const before = (1 - 2 * pick.floats[i]) * reach();      // mm towards the viewer
    const dx = ((column + 0.5) / pick.width - 0.5) * width * camera.mmPerPixel;
    const dy = ((row + 0.5) / pick.height - 0.5) * height * camera.mmPerPixel;
    return {
      before,
      position: camera.target.map((v, k) => v + before * view.towards[k] + dx * view.right[k] + dy * view.up[k]),
      seen: pick.bits[i + 3] > 0, deviation: pick.floats[i + 1], uncertainty: pick.floats[i + 2],
      defect: pick.bits[i + 3] - 1,
    };
  }

  // ---- What is written over the picture -----------------------------------------------------------------

  const SVG = document.querySelector('svg').namespaceURI;
  const drawing = document.createElementNS(SVG, 'svg');
  drawing.setAttribute('class', 'over');
  const tip = document.createElement('div');
  tip.className = 'tip';
  tip.hidden = true;

  function element(parent, name, attributes, text) {
    const e = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    if (text !== undefined) e.textContent = text;
    parent.appendChild(e);
    return e;
  }

  const number = (v, decimals) => v.toFixed(decimals).replace('-', '\u2212');
  const signed = (v, decimals) => (v > 0 ? '+' : '') + number(v, decimals);

  /** The defects that can be seen, their labels set apart from each other. */
  function labels() {
    const view = axes(), shown = [];
    for (const defect of data.defects) {
      const [x, y, before] = project(defect.at, view);
      if (x < 0 || y < 0 || x > width || y > height) continue;
      if (!stale) {
        const most = before + Math.abs(defect.peak_mm) + 0.5 + 6 * camera.mmPerPixel;
        defect.hidden = [[0, 0], [3, 0], [-3, 0], [0, 3], [0, -3]].every(([dx, dy]) => {
          const there = found(x + dx, y + dy);
          return there && there.before > most;
        });
      }
      if (defect.hidden) continue;
      const out = [x - width / 2, y - height / 2], length = Math.hypot(...out) || 1;
      shown.push({ defect, x, y, bx: x + 40 * out[0] / length, by: y + 40 * out[1] / length });
    }
    for (let round = 0; round < 40; ++round)
      for (const a of shown)
        for (const b of shown) {
          const dx = a.bx - b.bx, dy = a.by - b.by, d = Math.hypot(dx, dy) || 1;
          if (a === b || d >= 30) continue;
          a.bx += (30 - d) / 2 * dx / d;
          a.by += (30 - d) / 2 * (dy / d || 1);
        }
    for (const a of shown) {
      a.bx = Math.min(Math.max(a.bx, 16), width - 16);
      a.by = Math.min(Math.max(a.by, 16), height - 16);
    }
    return shown;
  }

  function overlay() {
    const view = axes();
    drawing.replaceChildren();
    for (const l of labels()) {
      const line = { x1: l.x, y1: l.y, x2: l.bx, y2: l.by };
      element(drawing, 'line', { ...line, class: 'halo' });
      element(drawing, 'line', { ...line, class: 'leader' });
      element(drawing, 'circle', { cx: l.x, cy: l.y, r: 3, class: 'dot' });
      const link = element(drawing, 'a', { href: '#defect-' + l.defect.id });
      element(link, 'title', {}, 'Defect ' + l.defect.id + ': ' + signed(l.defect.peak_mm, 3) + ' mm');
      element(link, 'circle', { cx: l.bx, cy: l.by, r: 12, class: 'badge' });
      element(link, 'text', { x: l.bx, y: l.by + 4.5, class: 'number' }, l.defect.id);
    }
    // A bar of a round length, 1, 2 or 5 times a power of ten.
    const most = 0.25 * width * camera.mmPerPixel, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((f) => f * power).find((v) => v <= most) || power;
    const pixels = length / camera.mmPerPixel;
    element(drawing, 'path', { class: 'bar', d: `M18,${height - 24}v8h${pixels}v-8` });
    element(drawing, 'text', { x: 18 + pixels / 2, y: height - 28, 'text-anchor': 'middle', class: 'small' },
            Number(length.toPrecision(1)) + ' mm');
    view.right.forEach((r, k) => {
      const step = [r, -view.up[k]], reachOf = Math.hypot(...step), ox = width - 48, oy = height - 46;
      if (reachOf < 0.2) return;
      element(drawing, 'path', { class: 'axis', d: `M${ox},${oy}l${26 * step[0]},${26 * step[1]}` });
      element(drawing, 'text', { x: ox + 26 * step[0] + 9 * step[0] / reachOf, y: oy + 26 * step[1] + 9 * step[1] / reachOf + 4,
                                 'text-anchor': 'middle', class: 'small' }, 'xyz'[k]);
    });
  }

  function showTip(x, y) {
    if (stale) lookUp();
    const there = found(x, y);
    tip.hidden = !there;
    if (!there) return;
    const lines = [];
    if (there.seen) {
      lines.push(['strong', signed(there.deviation, 3) + ' \u00b1 ' + number(2 * there.uncertainty, 3) + ' mm']);
      if (there.defect > 0) lines.push(['span', 'defect ' + there.defect]);
    } else {
      lines.push(['strong', 'not seen']);
    }
    lines.push(['span', 'x ' + number(there.position[0], 2) + '  y ' + number(there.position[1], 2) + '  z ' +
                        number(there.position[2], 2) + ' mm']);
    tip.replaceChildren(...lines.map(([tag, text]) => {
      const e = document.createElement(tag);
      e.textContent = text;
      return e;
    }));
    const box = tip.getBoundingClientRect();
    tip.style.left = Math.max(4, Math.min(x + 16, width - box.width - 4)) + 'px';
    tip.style.top = (y + 20 + box.height > height ? y - box.height - 12 : y + 20) + 'px';
  }

  // ---- Mouse, touch, keys -------------------------------------------------------------------------------

  const pointers = new Map();
  let travelled = 0;

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener('pointerdown', (event) => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    travelled = 0;
    tip.hidden = true;
  });
  canvas.addEventListener('pointermove', (event) => {
    const now = place(event), before = pointers.get(event.pointerId);
    if (!before) {
      showTip(...now);
      return;
    }
    const dx = now[0] - before[0], dy = now[1] - before[1];
    travelled += Math.hypot(dx, dy);
    if (pointers.size === 1) {
      if (event.pointerType === 'mouse' && (event.buttons & 6 || event.shiftKey)) pan(dx, dy);
      else orbit(dx, dy);
    } else if (pointers.size === 2) {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
      const far = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
      pan(dx / 2, dy / 2);
      zoomAt((now[0] + other[0]) / 2, (now[1] + other[1]) / 2, far(before) / far(now));
    }
    pointers.set(event.pointerId, now);
    redraw();
  });
  for (const name of ['pointerup', 'pointercancel'])
    canvas.addEventListener(name, (event) => {
      pointers.delete(event.pointerId);
      if (name === 'pointerup' && travelled < 5) showTip(...place(event));
    });
  canvas.addEventListener('pointerleave', (event) => {
    if (event.pointerType === 'mouse') tip.hidden = true;
  });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  // The wheel is the page's, unless the reader has clicked into the view: no trap on the way down.
  canvas.addEventListener('wheel', (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    tip.hidden = true;
    zoomAt(...place(event), Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0018));
    redraw();
  }, { passive: false });
  canvas.addEventListener('keydown', (event) => {
    const keys = {
      ArrowLeft: () => orbit(-12, 0), ArrowRight: () => orbit(12, 0), ArrowUp: () => orbit(0, -12),
      ArrowDown: () => orbit(0, 12), '+': () => zoomAt(width / 2, height / 2, 0.8),
      '-': () => zoomAt(width / 2, height / 2, 1.25), Escape: () => canvas.blur(), 0: () => setView('iso'),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    tip.hidden = true;
    keys[event.key]();
    redraw();
  });

  function setView(name) {
    [camera.azimuth, camera.elevation] = VIEWS[name];
    fit();
  }
  for (const button of document.querySelectorAll('[data-view]'))
    button.addEventListener('click', () => {
      setView(button.dataset.view);
      redraw();
    });
  for (const button of document.querySelectorAll('[data-zoom]'))
    button.addEventListener('click', () => {
      zoomAt(width / 2, height / 2, Number(button.dataset.zoom));
      redraw();
    });
  sectionsShown.addEventListener('change', redraw);

  // ---- Beginning ----------------------------------------------------------------------------------------

  canvas.tabIndex = 0;
  canvas.setAttribute('role', 'img');
  canvas.setAttribute('aria-label', 'Interactive view of the deviations; arrow keys turn it, plus and minus zoom');
  canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => {
    build();
    redraw();
  });
  try {
    build();
  } catch (error) {
    note.textContent = 'The interactive view could not start: a still picture stands in for it.';
    return;
  }
  stage.replaceChildren(canvas, drawing, tip);
  stage.classList.add('live');
  document.getElementById('viewer-tools').hidden = false;
  note.textContent = matchMedia('(pointer: coarse)').matches
    ? 'One finger turns, two fingers move and zoom, a tap shows the deviation.'
    : 'Drag to turn, drag with the right button or Shift to move, click and then scroll to zoom. Point at the part for its deviation \u00b1 U (95\u202f%).';
  function resize() {
    const box = stage.getBoundingClientRect();
    if (box.width === 0 || (box.width === width && box.height === height)) return;
    const first = width === 0, fitted = camera.mmPerPixel * width;
    [width, height] = [box.width, box.height];
    canvas.width = Math.round(width * devicePixelRatio);
    canvas.height = Math.round(height * devicePixelRatio);
    drawing.setAttribute('viewBox', `0 0 ${width} ${height}`);
    if (first) fit();
    else camera.mmPerPixel = fitted / width;
    pick.width = 0;
    stale = true;
    lookedUp = -Infinity;
    draw();
  }
  new ResizeObserver(resize).observe(stage);
  resize();
})();
