// Watches one hop, frame by frame, in whichever page it is: when the picture changed, and how long frames took.

window.watchHop = (begin, digest, isDone, quietMs) =>
  new Promise((resolve) => {
    let shown = digest();
    const startMs = performance.now();
    let beforeMs = startMs;
    let lastChange = { atMs: startMs, frame: 0 };
    let changes = 0;
    const gapsMs = [];
    begin();
    const look = () => {
      const nowMs = performance.now();
      gapsMs.push(nowMs - beforeMs);
      beforeMs = nowMs;
      const now = digest();
      if (now !== shown) {
        shown = now;
        changes += 1;
        lastChange = { atMs: nowMs, frame: gapsMs.length };
      }
      if (isDone() && nowMs - lastChange.atMs > quietMs && gapsMs.length > 4) {
        const until = gapsMs.slice(0, lastChange.frame);
        resolve({
          allMs: lastChange.atMs - startMs,
          frames: lastChange.frame,
          changes,
          slow: until.filter((gapMs) => gapMs > 50).length,
        });
      } else requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  });

/** Frames while nothing happens, milliseconds: what this machine makes of one, before anything is asked of it. */
window.watchRest = (count) =>
  new Promise((resolve) => {
    const gapsMs = [];
    let beforeMs = performance.now();
    const look = () => {
      const nowMs = performance.now();
      gapsMs.push(nowMs - beforeMs);
      beforeMs = nowMs;
      if (gapsMs.length < count) requestAnimationFrame(look);
      else resolve(gapsMs.sort((a, b) => a - b)[Math.floor(count / 2)]);
    };
    requestAnimationFrame(look);
  });
