// Run in the viewer's page: renders many poses and compares what each picture covers.
(() => {
  const size = () => {
    const gl = glWatch.context;
    return [gl.drawingBufferWidth, gl.drawingBufferHeight];
  };
  /** Bits of the pixels that are not wholly ground: their samples are not all opaque. */
  function uncovered() {
    const gl = glWatch.context;
    const [width, height] = size();
    const rgba = new Uint8Array(width * height * 4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
    const bits = new Uint8Array(Math.ceil((width * height) / 8));
    for (let at = 0; at < width * height; at += 1) if (rgba[at * 4 + 3] < 255) bits[at >> 3] |= 1 << (at & 7);
    return bits;
  }
  /** Whether a pixel or one of those around it is set. */
  function isNear(bits, at, width, height) {
    const x = at % width;
    const y = (at - x) / width;
    for (let dy = -1; dy <= 1; dy += 1) {
      for (let dx = -1; dx <= 1; dx += 1) {
        const [nx, ny] = [x + dx, y + dy];
        if (nx < 0 || ny < 0 || nx >= width || ny >= height) continue;
        const near = ny * width + nx;
        if (bits[near >> 3] & (1 << (near & 7))) return true;
      }
    }
    return false;
  }
  const kept = { base: [], detail: [] };
  window.viewerPoses = {
    /** Render poses and keep what each leaves uncovered, as `base` or `detail`. */
    async keep(name, poses) {
      for (const pose of poses) {
        await terraport.look(pose);
        kept[name].push(uncovered());
      }
    },
    clear() {
      kept.base.length = 0;
      kept.detail.length = 0;
    },
    /** Render poses of the mixed model and count, from pose `first` of those kept. */
    async compare(first, poses) {
      const found = { pixels: 0, ground: 0, holes: 0, atOutline: 0, baseOnly: 0, detailOnly: 0, inner: 0, worst: null };
      const [width, height] = size();
      for (const [number, pose] of poses.entries()) {
        await terraport.look(pose);
        const mixed = uncovered();
        const base = kept.base[first + number];
        const detail = kept.detail[first + number];
        let holes = 0;
        found.pixels += width * height;
        for (let at = 0; at < width * height; at += 1) {
          const [byte, bit] = [at >> 3, 1 << (at & 7)];
          const inBase = (base[byte] & bit) === 0;
          const inDetail = (detail[byte] & bit) === 0;
          if (inBase && inDetail) found.ground += 1;
          if ((mixed[byte] & bit) === 0) continue;
          if (inBase && inDetail) {
            // Where the outlines of the two cross, each covers a pixel by another piece of ground.
            if (isNear(base, at, width, height) || isNear(detail, at, width, height)) found.atOutline += 1;
            else holes += 1;
          } else if (inBase || inDetail) {
            if (inBase) found.baseOnly += 1;
            else found.detailOnly += 1;
            // Not beside a pixel where the one that covers shows the sky itself: no outline.
            if (!isNear(inBase ? base : detail, at, width, height)) found.inner += 1;
          }
        }
        found.holes += holes;
        if (holes > 0 && holes > (found.worst?.holes ?? 0)) found.worst = { holes, pose };
      }
      return found;
    },
    /** Look from poses, and draw one in so many; tells how often what is visible was another than at first. */
    async changes(poses, drawnEvery) {
      const before = terraport.visibleDigest;
      let changes = 0;
      let drawn = 0;
      for (const [number, pose] of poses.entries()) {
        const frame = terraport.look(pose);
        if (number % drawnEvery === 0) {
          await frame;
          drawn += 1;
        }
        if (terraport.visibleDigest !== before) changes += 1;
      }
      return { changes, drawn, stray: terraport.state.strayChanges };
    },
  };
})();
