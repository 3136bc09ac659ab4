// Run in a page before its own scripts: watches what is really handed to WebGL, whatever the page says of itself.
//
// `glWatch` tells what the newest frame drew (a call of WEBGL_multi_draw is so many ranges), the bytes of all buffers and
// textures that live, and what is in an index buffer. It can also do harm (leave out a range, blank a face), so that a check
// can be shown to fail.
(() => {
  const proto = WebGL2RenderingContext.prototype;
  const NONE = {};
  const states = new WeakMap();
  const buffers = new Map();
  const textures = new Map();
  let nextId = 1;
  let bytesCreated = 0;
  let bytesFreed = 0;
  const watch = {
    frame: [],
    frames: 0,
    /** Draw calls of the ground in the newest frame. */
    draws: 0,
    /** Ranges that are left out, by what `ground` calls them. */
    omitted: new Set(),
    /** Draw calls of other programs than the ground's (lines on it) are left out. */
    groundOnly: false,
    context: null,
    get bufferBytes() {
      return sum(buffers);
    },
    get textureBytes() {
      return sum(textures);
    },
    get bytesCreated() {
      return bytesCreated;
    },
    get bytesFreed() {
      return bytesFreed;
    },
    /**
     * What of the ground the newest frame drew: [[index buffer, indices], ...]. A range that does not begin with its buffer is
     * called "buffer@byte".
     */
    ground: () => watch.frame.filter((call) => call.ground).map((call) => [call.index, call.count]),
    bytesOf: (id) => [...buffers.values()].find((one) => one.id === id).bytes,
    /** Indices in an index buffer of the ground, read back from the GPU. */
    indices(id, size) {
      const gl = watch.context;
      const { buffer, bytes } = [...buffers.values()].find((one) => one.id === id);
      const out = size === 2 ? new Uint16Array(bytes / 2) : new Uint32Array(bytes / 4);
      gl.bindBuffer(gl.COPY_READ_BUFFER, buffer);
      gl.getBufferSubData(gl.COPY_READ_BUFFER, 0, out);
      gl.bindBuffer(gl.COPY_READ_BUFFER, null);
      return out;
    },
    /** Overwrite a face of an index buffer. */
    writeFace(id, face, corners) {
      const gl = watch.context;
      const { buffer } = [...buffers.values()].find((one) => one.id === id);
      gl.bindBuffer(gl.COPY_WRITE_BUFFER, buffer);
      gl.bufferSubData(gl.COPY_WRITE_BUFFER, face * 3 * corners.BYTES_PER_ELEMENT, corners);
      gl.bindBuffer(gl.COPY_WRITE_BUFFER, null);
    },
  };
  window.glWatch = watch;

  // Milliseconds that each frame's callback kept the main thread, and between frames; tasks of more than 50 ms.
  watch.frameMs = [];
  watch.gapMs = [];
  watch.longTasks = [];
  /** Bytes written to buffers and textures, by frame. */
  watch.uploads = [];
  let uploaded = 0;
  let lastFrameMs = 0;
  const requestFrame = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (callback) =>
    requestFrame((timeMs) => {
      const startMs = performance.now();
      if (lastFrameMs > 0) watch.gapMs.push(timeMs - lastFrameMs);
      lastFrameMs = timeMs;
      callback(timeMs);
      watch.frameMs.push(performance.now() - startMs);
      watch.uploads.push(uploaded);
      uploaded = 0;
    });
  new PerformanceObserver((list) => {
    for (const { startTime, duration } of list.getEntries()) watch.longTasks.push([startTime, duration]);
  }).observe({ type: "longtask", buffered: true });

  function sum(things) {
    let bytes = 0;
    for (const one of things.values()) bytes += one.bytes;
    return bytes;
  }

  function stateOf(gl) {
    let state = states.get(gl);
    if (!state) {
      state = {
        // Stands for no vertex array.
        arrays: NONE,
        program: null,
        bound: new Map(),
        // Weak: what is watched must not be kept alive by that.
        indexOf: new WeakMap(),
        isGround: new Map(),
        texture: null,
      };
      states.set(gl, state);
      watch.context = gl;
    }
    return state;
  }

  function wrap(name, before, after) {
    const inner = proto[name];
    proto[name] = function (...args) {
      if (before && before(this, stateOf(this), args) === false) return undefined;
      const result = inner.apply(this, args);
      if (after) after(this, stateOf(this), args, result);
      return result;
    };
  }

  function isGround(gl, state) {
    if (!state.program) return false;
    if (!state.isGround.has(state.program)) {
      state.isGround.set(state.program, gl.getAttribLocation(state.program, "code") >= 0);
    }
    return state.isGround.get(state.program);
  }

  function grow(store, key, bytes, id) {
    const before = store.get(key)?.bytes ?? 0;
    store.set(key, { id: store.get(key)?.id ?? id, buffer: key, bytes });
    bytesCreated += bytes;
    bytesFreed += before;
  }

  function drop(store, key) {
    const one = store.get(key);
    if (!one) return;
    bytesFreed += one.bytes;
    store.delete(key);
  }

  wrap("createBuffer", null, (_gl, _state, _args, buffer) => buffer && buffers.set(buffer, { id: nextId++, buffer, bytes: 0 }));
  wrap("deleteBuffer", (_gl, _state, [buffer]) => drop(buffers, buffer));
  wrap("createTexture", null, (_gl, _state, _args, texture) => texture && textures.set(texture, { id: nextId++, bytes: 0 }));
  wrap("deleteTexture", (_gl, _state, [texture]) => drop(textures, texture));
  wrap("bindTexture", (_gl, state, [, texture]) => {
    state.texture = texture;
  });
  wrap("bindVertexArray", (_gl, state, [array]) => {
    state.arrays = array ?? NONE;
  });
  wrap("useProgram", (_gl, state, [program]) => {
    state.program = program;
  });
  wrap("bindBuffer", (gl, state, [target, buffer]) => {
    if (target === gl.ELEMENT_ARRAY_BUFFER) state.indexOf.set(state.arrays, buffer);
    else state.bound.set(target, buffer);
  });
  wrap("bufferData", null, (gl, state, [target, data, , offset, length]) => {
    const key = target === gl.ELEMENT_ARRAY_BUFFER ? state.indexOf.get(state.arrays) : state.bound.get(target);
    const size = typeof data === "number" ? data : length ? length * data.BYTES_PER_ELEMENT : (data?.byteLength ?? 0);
    if (key) grow(buffers, key, size);
    if (typeof data !== "number") uploaded += size;
  });
  wrap("bufferSubData", null, (_gl, _state, [, , data, , length]) => {
    uploaded += length ? length * data.BYTES_PER_ELEMENT : data.byteLength;
  });
  const pixels = (width, height, levels, layers = 1) => {
    let bytes = 0;
    for (let level = 0; level < levels; level += 1) {
      bytes += 4 * Math.max(1, width >> level) * Math.max(1, height >> level);
    }
    return layers * bytes;
  };
  wrap("texStorage2D", null, (_gl, state, [, levels, , width, height]) => {
    if (state.texture) grow(textures, state.texture, pixels(width, height, levels));
  });
  wrap("texStorage3D", null, (_gl, state, [, levels, , width, height, layers]) => {
    if (state.texture) grow(textures, state.texture, pixels(width, height, levels, layers));
  });
  wrap("texImage2D", null, (_gl, state, args) => {
    if (!state.texture || args[1] !== 0) return;
    const source = args.length === 6 ? args[5] : { width: args[3], height: args[4] };
    grow(textures, state.texture, pixels(source?.width ?? 0, source?.height ?? 0, 1));
  });
  wrap("clear", (gl, _state, [bits]) => {
    if (bits & gl.COLOR_BUFFER_BIT) {
      watch.frame = [];
      watch.draws = 0;
      watch.frames += 1;
    }
  });
  /** Notes one range; false where it is to be left out. */
  function note(state, ground, start, count) {
    const id = buffers.get(state.indexOf.get(state.arrays))?.id ?? null;
    const index = start > 0 ? `${id}@${start}` : id;
    if (ground && watch.omitted.has(index)) return false;
    if (count > 0) watch.frame.push({ ground, index, count });
    return true;
  }
  function begins(gl, state) {
    const ground = isGround(gl, state);
    if (ground) watch.draws += 1;
    return ground || !watch.groundOnly ? ground : null;
  }
  const draw = (countAt, startAt) => (gl, state, args) => {
    const ground = begins(gl, state);
    return ground !== null && note(state, ground, args[startAt] ?? 0, args[countAt]);
  };
  wrap("drawElements", draw(1, 3));
  wrap("drawElementsInstanced", draw(1, 3));
  wrap("drawArrays", draw(2));
  wrap("drawArraysInstanced", draw(2));

  // The extension's functions are its own object's.
  const watched = new WeakSet();
  wrap("getExtension", null, (gl, state, [name], extension) => {
    if (name !== "WEBGL_multi_draw" || !extension || watched.has(extension)) return;
    watched.add(extension);
    const inner = extension.multiDrawElementsWEBGL.bind(extension);
    extension.multiDrawElementsWEBGL = (mode, counts, countsAt, type, starts, startsAt, drawCount) => {
      const ground = begins(gl, state);
      if (ground === null) return;
      const kept = counts.slice(countsAt, countsAt + drawCount);
      for (let at = 0; at < drawCount; at += 1) if (!note(state, ground, starts[startsAt + at], kept[at])) kept[at] = 0;
      inner(mode, kept, 0, type, starts, startsAt, drawCount);
    };
  });
})();
