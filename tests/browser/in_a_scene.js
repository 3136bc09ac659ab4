// Run in the page of examples/sun, once it shows its landing: its frames are drawn here from then on, one when asked for.
//
// `drawn(points)` draws a frame and returns for each point of the scene the colours of its pixel and those around it.
(async () => {
  renderer.setAnimationLoop(null);
  // What the example has set of its own is set by each test.
  window.HAS_ALL = { lit: true, receiveShadow: true, castShadow: true };
  window.plain = () => {
    scene.fog = null;
    renderer.toneMapping = three.NoToneMapping;
    renderer.toneMappingExposure = 1;
    renderer.outputColorSpace = three.SRGBColorSpace;
    renderer.clippingPlanes = [];
    renderer.localClippingEnabled = false;
    box.visible = false;
    sun.color.set(0xffffff);
    sun.intensity = 0;
    sky.color.set(0xffffff);
    sky.groundColor.set(0xffffff);
    sky.intensity = Math.PI;
    camera.position.set(24, 18, 26);
    camera.lookAt(0, 4, 0);
    ground.setShading({});
    ground.setSplit(null);
    ground.setMode({ kind: "colour" });
    ground.highlightRegion(null);
  };
  window.sky = scene.children.find((child) => child.isHemisphereLight);
  window.drawn = (points) => {
    ground.update();
    camera.updateMatrixWorld();
    renderer.render(scene, camera);
    const gl = renderer.getContext();
    const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const side = 5;
    return points.map((point) => {
      const at = new three.Vector3(...point).project(camera);
      const rgba = new Uint8Array(4 * side * side);
      const [x, y] = [(at.x + 1) * 0.5 * width, (at.y + 1) * 0.5 * height].map((p) => Math.floor(p) - (side >> 1));
      gl.readPixels(x, y, side, side, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
      return Array.from({ length: side * side }, (_, i) => [...rgba.subarray(4 * i, 4 * i + 3)]);
    });
  };
  /** Metres before the camera. */
  window.depthsOf = (points) =>
    points.map((point) => -new three.Vector3(...point).applyMatrix4(camera.matrixWorldInverse).z);
  /** Names of the uniforms of the ground's programs, as the driver left them in, that a frame is drawn by. */
  window.uniformsOfGround = () => {
    drawn([]);
    const gl = renderer.getContext();
    const used = new Set();
    const use = gl.useProgram;
    gl.useProgram = (program) => {
      used.add(program);
      use.call(gl, program);
    };
    renderer.state.useProgram(null);
    drawn([]);
    gl.useProgram = use;
    const names = [...used]
      .filter((program) => program !== null)
      .map((program) =>
        Array.from(
          { length: gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) },
          (_, i) => gl.getActiveUniform(program, i).name.replace("[0]", ""),
        ),
      );
    return names.filter((own) => own.includes("pushM")).flat();
  };
  window.placeAt = (x, z) => ground.groundAt(x, z, 100).position;
  sun.shadow.mapSize.set(512, 512);
  sun.shadow.map.dispose();
  sun.shadow.map = null;
  while (ground.busy) {
    drawn([]);
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
  plain();
  camera.updateMatrixWorld();
  // Level ground in sight: of a segment in the east, of the base in the west.
  const eye = camera.position;
  const inSight = (x, z) => {
    const { position, normal, segment } = ground.groundAt(x, z, 100);
    const ray = new three.Vector3(...position).sub(eye);
    const met = ground.cast(eye.toArray(), ray.toArray(), 100);
    return normal[1] > 0.999 && Math.abs(met.distanceM - ray.length()) < 0.05 ? { position, segment } : null;
  };
  const places = [];
  for (let x = -14; x < 12; x += 1) for (let z = -6; z < 8; z += 1) places.push(inSight(x + 0.3, z + 0.4));
  window.DETAIL = places.findLast((place) => place !== null && place.segment >= 0).position;
  window.BASE = places.find((place) => place !== null && place.segment < 0).position;
})();
