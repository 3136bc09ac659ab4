// Segments of vertex colours and of textures, drawn with the ground's own shader in two ways: one draw call each, or in
// pages of common buffers. Answers with what it made, and leaves `runBlock(way, pose, isTextured)` and `shot()`.
//
// As the viewer does, a page takes what differs between its segments by gl_DrawID out of an array of uniforms, and its images
// from one texture array. Indices stay 16 bits wide: a page has at most 65,535 vertices.
async (given) => {
  const {v, f, columns, rows, cells, texSide, width, height, frames, eyeM} = given;
  const canvas = document.createElement("canvas"); canvas.width = width; canvas.height = height;
  const gl = canvas.getContext("webgl2", {antialias: false});
  const multi = gl.getExtension("WEBGL_multi_draw");
  if (!multi) return {error: "no WEBGL_multi_draw"};
  gl.getExtension("EXT_texture_filter_anisotropic");
  const COUNT = columns * rows, TILE = 10, STEP = 2 ** -9;
  const vPerSeg = (cells + 1) ** 2, fPerSeg = 2 * cells * cells;
  const PER_PAGE = Math.min(64, Math.floor(65535 / vPerSeg));
  const height_of = (x, z) => 3 * Math.sin(x * .11) * Math.cos(z * .13) + 1.2 * Math.sin(x * .5 + z * .3) + 4 * Math.max(0, Math.sin((x + z) * .045)) ;
  // ---- programs
  const HEAD = "#version 300 es\n#extension GL_ANGLE_multi_draw : require\nprecision highp float;precision highp int;precision highp sampler2DArray;\nuniform mat4 projectionMatrix;uniform mat4 modelViewMatrix;\n";
  const FHEAD = "#version 300 es\nprecision highp float;precision highp int;precision highp sampler2DArray;\nvec4 linearToOutputTexel(vec4 c){return vec4(mix(pow(c.rgb,vec3(0.41666))*1.055-vec3(0.055),c.rgb*12.92,vec3(lessThanEqual(c.rgb,vec3(0.0031308)))),c.a);}\n";
  function program(vs, fs) {
    const p = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vs], [gl.FRAGMENT_SHADER, fs]]) {
      const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s);
      if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
      gl.attachShader(p, s);
    }
    ["code", "tilt", "tint", "spot", "region", "measure"].forEach((n, i) => gl.bindAttribLocation(p, i, n));
    gl.linkProgram(p);
    if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));
    const u = {}; const n = gl.getProgramParameter(p, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < n; i++) { const a = gl.getActiveUniform(p, i); u[a.name.replace("[0]", "")] = gl.getUniformLocation(p, a.name); }
    return {p, u};
  }
  const single = program(HEAD.replace("#extension GL_ANGLE_multi_draw : require\n", "") + v, FHEAD + f);
  const paged = program(HEAD + "#define PAGED\n" + v, FHEAD + "#define PAGED\n" + f);
  // ---- meshes
  const segs = [];
  for (let s = 0; s < COUNT; s++) {
    const [cx, cz] = [(s % columns) * TILE, Math.floor(s / columns) * TILE];
    const code = new Uint16Array(vPerSeg * 4), tilt = new Int8Array(vPerSeg * 4), tint = new Uint16Array(vPerSeg * 4), spot = new Uint16Array(vPerSeg * 2), region = new Uint16Array(vPerSeg * 2);
    let low = 1e9;
    for (let i = 0; i <= cells; i++) for (let j = 0; j <= cells; j++) low = Math.min(low, height_of(cx + i * TILE / cells, cz + j * TILE / cells));
    low = Math.floor(low / STEP) * STEP;
    for (let i = 0, k = 0; i <= cells; i++) for (let j = 0; j <= cells; j++, k++) {
      const x = i * TILE / cells, z = j * TILE / cells, y = height_of(cx + x, cz + z) - low, e = .05;
      code.set([x / STEP, y / STEP, z / STEP, 0], 4 * k);
      const dx = (height_of(cx + x + e, cz + z) - height_of(cx + x - e, cz + z)) / (2 * e), dz = (height_of(cx + x, cz + z + e) - height_of(cx + x, cz + z - e)) / (2 * e), l = Math.hypot(dx, 1, dz);
      tilt.set([-dx / l * 127, 127 / l, -dz / l * 127, 0], 4 * k);
      tint.set([20000 + (k * 7919 + s * 31) % 20000, 18000 + (k * 104729) % 20000, 15000 + (k * 1299709) % 20000, 65535], 4 * k);
      spot.set([i / cells * 65535, j / cells * 65535], 2 * k); region.set([s % 7, 0], 2 * k);
    }
    const indices = new Uint16Array(fPerSeg * 3); let at = 0;
    for (let i = 0; i < cells; i++) for (let j = 0; j < cells; j++) { const a = i * (cells + 1) + j, b = a + cells + 1; indices.set([a, a + 1, b + 1, a, b + 1, b], at); at += 6; }
    segs.push({s, translation: [cx, low, cz], centre: [cx + 5, low + 2, cz + 5], code, tilt, tint, spot, region, indices});
  }
  let bytesSingle = 0, bytesPages = 0;
  const buffer = (target, data) => { const b = gl.createBuffer(); gl.bindBuffer(target, b); gl.bufferData(target, data, gl.STATIC_DRAW); return b; };
  const layout = [["code", 4, gl.UNSIGNED_SHORT, false], ["tilt", 4, gl.BYTE, true], ["tint", 4, gl.UNSIGNED_SHORT, true], ["spot", 2, gl.UNSIGNED_SHORT, true], ["region", 2, gl.UNSIGNED_SHORT, false]];
  function vao(parts, indices) {
    const a = gl.createVertexArray(); gl.bindVertexArray(a);
    layout.forEach(([name, size, type, norm], i) => { buffer(gl.ARRAY_BUFFER, parts[name]); gl.enableVertexAttribArray(i); gl.vertexAttribPointer(i, size, type, norm, 0, 0); });
    buffer(gl.ELEMENT_ARRAY_BUFFER, indices); gl.bindVertexArray(null); return a;
  }
  const sizeOf = (g) => layout.reduce((n, [name]) => n + g[name].byteLength, g.indices.byteLength);
  for (const g of segs) { g.vao = vao(g, g.indices); bytesSingle += sizeOf(g); }
  const pages = [];
  // By place: blocks of tiles, so that a page has a distance of its own.
  const bySide = Math.floor(Math.sqrt(PER_PAGE)), blocks = new Map();
  for (const g of segs) { const k = Math.floor((g.s % columns) / bySide) + 1000 * Math.floor(Math.floor(g.s / columns) / bySide); if (!blocks.has(k)) blocks.set(k, []); blocks.get(k).push(g); }
  for (const some of blocks.values()) {
    const parts = {}; for (const [name] of layout) { const k = segs[0][name].length; parts[name] = new segs[0][name].constructor(k * some.length); some.forEach((g, i) => parts[name].set(g[name], k * i)); }
    const indices = new Uint16Array(fPerSeg * 3 * some.length); some.forEach((g, i) => indices.set(g.indices.map((n) => n + vPerSeg * i), fPerSeg * 3 * i));
    bytesPages += sizeOf({...parts, indices});
    pages.push({some, vao: vao(parts, indices), starts: new Int32Array(some.length), counts: new Int32Array(some.length).fill(fPerSeg * 3), traits: new Float32Array(12 * PER_PAGE), centre: [0, 1, 2].map((k) => some.reduce((n, g) => n + g.centre[k], 0) / some.length)});
  }
  // ---- textures
  const pixels = (s) => { const p = new Uint8Array(texSide * texSide * 4); for (let i = 0; i < p.length; i++) p[i] = i % 4 === 3 ? 255 : (i * 2654435761 + s * 977) >>> 24; return p; };
  const levels = Math.log2(texSide) + 1;
  const filter = (t) => { gl.texParameteri(t, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR); gl.texParameteri(t, gl.TEXTURE_MAG_FILTER, gl.LINEAR); gl.texParameteri(t, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE); gl.texParameteri(t, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE); gl.texParameteri(t, 0x84FE, 4); };
  gl.activeTexture(gl.TEXTURE0);
  const whole = gl.createTexture(); gl.bindTexture(gl.TEXTURE_2D_ARRAY, whole); gl.texStorage3D(gl.TEXTURE_2D_ARRAY, levels, gl.SRGB8_ALPHA8, texSide, texSide, COUNT); filter(gl.TEXTURE_2D_ARRAY);
  for (const g of segs) {
    const p = pixels(g.s); g.texture = gl.createTexture(); gl.bindTexture(gl.TEXTURE_2D_ARRAY, g.texture); gl.texStorage3D(gl.TEXTURE_2D_ARRAY, levels, gl.SRGB8_ALPHA8, texSide, texSide, 1); filter(gl.TEXTURE_2D_ARRAY);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, 0, texSide, texSide, 1, gl.RGBA, gl.UNSIGNED_BYTE, p); gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, whole); gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, g.s, texSide, texSide, 1, gl.RGBA, gl.UNSIGNED_BYTE, p);
  }
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, whole); gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
  const small = (unit) => { gl.activeTexture(gl.TEXTURE0 + unit); const t = gl.createTexture(); gl.bindTexture(gl.TEXTURE_2D, t); gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 2, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(2048).fill(128)); gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST); };
  small(1); small(2); small(3);
  // ---- views: eye height and from above
  const perspective = () => { const t = 1 / Math.tan(Math.PI / 6), a = width / height, n = .1, far = 2000; return new Float32Array([t / a, 0, 0, 0, 0, t, 0, 0, 0, 0, (far + n) / (n - far), -1, 0, 0, 2 * far * n / (n - far), 0]); };
  const view = (pitch) => { const c = Math.cos(pitch), s = Math.sin(pitch); return new Float32Array([1, 0, 0, 0, 0, c, s, 0, 0, -s, c, 0, 0, 0, 0, 1]); };
  const poses = {eye: {eye: [columns * 5, 0, rows * 10 - 1], pitch: .05}, above: {eye: [columns * 5, 90, rows * 10 + 40], pitch: .75}};
  poses.eye.eye[1] = height_of(poses.eye.eye[0], poses.eye.eye[2]) + eyeM;
  gl.viewport(0, 0, width, height); gl.enable(gl.DEPTH_TEST);
  let calls = 0;
  function common({p, u}, pose, textured) {
    gl.useProgram(p); gl.uniformMatrix4fv(u.projectionMatrix, false, perspective()); gl.uniformMatrix4fv(u.modelViewMatrix, false, view(pose.pitch));
    const [x, y, z] = pose.eye; gl.uniform3f(u.eyeCoarse, Math.round(x), Math.round(y), Math.round(z)); gl.uniform3f(u.eyeFine, x - Math.round(x), y - Math.round(y), z - Math.round(z));
    if (u.stepM) { gl.uniform1f(u.stepM, STEP); gl.uniform2f(u.uvScale, 1, 1); } gl.uniform1i(u.mode, 0); gl.uniform1i(u.hasMap, textured); gl.uniform1i(u.hasTint, !textured); gl.uniform1i(u.hasRegion, 1);
    gl.uniform1i(u.map, 0); gl.uniform1i(u.regionColours, 1); gl.uniform1i(u.ramps, 2); gl.uniform1i(u.taught, 3); gl.uniform1f(u.relief, 1); gl.uniform1f(u.mapRelief, 0); gl.uniform1f(u.highlight, -1); gl.uniform1i(u.side, 1); gl.uniform1f(u.taughtShare, 0);
    gl.uniform3f(u.plain, .5, .5, .5); calls += 22;
  }
  const near = (pose) => (a, b) => Math.hypot(...a.centre.map((c, k) => c - pose.eye[k])) - Math.hypot(...b.centre.map((c, k) => c - pose.eye[k]));
  const ways = {
    "one draw each, near first": (pose, textured) => each(pose, textured, true),
    "one draw each, as they came": (pose, textured) => each(pose, textured, false),
    "pages, near first": (pose, textured) => inPages(pose, textured, true),
    "pages, as they came": (pose, textured) => inPages(pose, textured, false),
  };
  let draws = 0;
  function each(pose, textured, sorted) {
    common(single, pose, textured); const {u} = single; gl.activeTexture(gl.TEXTURE0);
    for (const g of sorted ? [...segs].sort(near(pose)) : segs) {
      gl.uniform3f(u.translation, ...g.translation); 
      if (textured) { gl.bindTexture(gl.TEXTURE_2D_ARRAY, g.texture); calls++; }
      gl.bindVertexArray(g.vao); gl.drawElements(gl.TRIANGLES, fPerSeg * 3, gl.UNSIGNED_SHORT, 0); draws++; calls += 4;
    }
  }
  function inPages(pose, textured, sorted) {
    common(paged, pose, textured); const {u} = paged; gl.activeTexture(gl.TEXTURE0);
    if (textured) gl.bindTexture(gl.TEXTURE_2D_ARRAY, whole);
    for (const page of sorted ? [...pages].sort(near(pose)) : pages) {
      const order = sorted ? [...page.some].sort(near(pose)) : page.some;
      order.forEach((g, i) => { page.starts[i] = page.some.indexOf(g) * fPerSeg * 6; page.traits.set([...g.translation, STEP, 1, 1, 0, 0, .5, .5, .5, 2 * g.s], 12 * i); });
      gl.uniform4fv(u.traits, page.traits); gl.bindVertexArray(page.vao);
      multi.multiDrawElementsWEBGL(gl.TRIANGLES, page.counts, 0, gl.UNSIGNED_SHORT, page.starts, 0, page.some.length); draws++; calls += 3;
    }
  }
  const pixel = new Uint8Array(4), out = [];
  const frame = (way, pose, textured) => { gl.clearColor(.7, .8, .9, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT); ways[way](pose, textured); gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); };
  const picture = () => { const p = new Uint8Array(width * height * 4); gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, p); let h = 0; for (let i = 0; i < p.length; i += 4) h = (Math.imul(h, 31) + p[i] + p[i + 1] * 3 + p[i + 2] * 7) | 0; return h; };
  window.runBlock = (way, poseName, textured) => { draws = 0; calls = 0; const ms = []; for (let i = 0; i < frames; i++) { const t = performance.now(); frame(way, poses[poseName], textured); ms.push(performance.now() - t); } return {ms, draws: draws / frames, calls: calls / frames, picture: picture()}; };
  window.shot = () => canvas.toDataURL();
  for (const w of Object.keys(ways)) for (const t of [0, 1]) frame(w, poses.eye, t); // compiled, uploaded
  return {pages: pages.length, perPage: PER_PAGE, bytesSingle, bytesPages, faces: COUNT * fPerSeg, glError: gl.getError(), ways: Object.keys(ways)};
}
