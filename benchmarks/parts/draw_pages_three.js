// What three.js makes of a page: a mesh marked isBatchedMesh, with ranges of its own and traits by gl_DrawID. Answers with the
// draw calls and a hash of the picture of each way, in one renderer with WEBGL_multi_draw and in one that is told it has none.
async ({ side }) => {
  const THREE = await import("/three.module.js");
  const { BufferAttribute, BufferGeometry, GLSL3, Mesh, PerspectiveCamera, Scene, ShaderMaterial, Sphere, Vector3, Vector4 } = THREE;
  const MAX_RANGES = 64;
  const COUNT = side * side;
  const traits = Array.from({ length: MAX_RANGES }, (_, i) => new Vector4(i % side, 0, Math.floor(i / side), i));
  const fragmentShader = `precision highp float; flat in float vNumber; out vec4 outColour;
    void main() { outColour = vec4(fract(vNumber / 7.0), fract(vNumber / 11.0), fract(vNumber / 13.0), 1.0); }`;
  const vertexOf = (own) => `flat out float vNumber; void main() { vec4 own = ${own};
    vNumber = own.w; gl_Position = projectionMatrix * viewMatrix * vec4(position + own.xyz, 1.0); }`;
  const materialOf = (head, own, uniforms) =>
    new ShaderMaterial({ glslVersion: GLSL3, vertexShader: head + vertexOf(own), fragmentShader, uniforms });
  const corner = [0, 0, 0, 0.9, 0, 0, 0.9, 0, 0.9, 0, 0, 0.9];
  const faces = [0, 2, 1, 0, 3, 2];
  const geometryOf = (copies) => {
    const geometry = new BufferGeometry();
    const places = new Float32Array(12 * copies);
    const indices = new Uint16Array(6 * copies);
    for (let i = 0; i < copies; i += 1) {
      places.set(corner, 12 * i);
      indices.set(faces.map((at) => at + 4 * i), 6 * i);
    }
    geometry.setAttribute("position", new BufferAttribute(places, 3));
    geometry.index = new BufferAttribute(indices, 1);
    geometry.boundingSphere = new Sphere(new Vector3(side / 2, 0, side / 2), side);
    return geometry;
  };
  const run = (isTold) => {
    const canvas = document.createElement("canvas");
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    const ask = gl.getExtension.bind(gl);
    gl.getExtension = (name) => (name === "WEBGL_multi_draw" && !isTold ? null : ask(name));
    let draws = 0;
    const count = (owner, name) => {
      const inner = owner[name].bind(owner);
      owner[name] = (...args) => {
        draws += 1;
        return inner(...args);
      };
    };
    count(gl, "drawElements");
    const multi = gl.getExtension("WEBGL_multi_draw");
    if (multi) count(multi, "multiDrawElementsWEBGL");
    const renderer = new THREE.WebGLRenderer({ canvas, context: gl });
    renderer.setSize(256, 256, false);
    renderer.debug.onShaderError = (context, program, vertex) => {
      throw new Error(context.getShaderInfoLog(vertex) || context.getProgramInfoLog(program));
    };
    const camera = new PerspectiveCamera(50, 1, 0.1, 100);
    camera.position.set(side / 2, side, side * 1.4);
    camera.lookAt(side / 2, 0, side / 2);
    camera.updateMatrixWorld();
    const single = materialOf("uniform vec4 trait;", "trait", { trait: { value: traits[0] } });
    // As three.js's own chunk says it: without the extension, range by range, with this uniform for the number.
    const number = "\n#ifndef GL_ANGLE_multi_draw\n#define gl_DrawID _gl_DrawID\nuniform int _gl_DrawID;\n#endif\n";
    const paged = materialOf(`${number}uniform vec4 traits[${MAX_RANGES}];\n`, "traits[gl_DrawID]", { traits: { value: traits } });
    const one = geometryOf(1);
    one.boundingSphere.radius = 3 * side;
    const all = geometryOf(COUNT);
    const meshes = Array.from({ length: COUNT }, (_, i) => {
      const mesh = new Mesh(one, single);
      mesh.onBeforeRender = () => {
        single.uniforms.trait.value = traits[i];
        single.uniformsNeedUpdate = true;
      };
      return mesh;
    });
    const page = new Mesh(all, paged);
    Object.assign(page, {
      isBatchedMesh: true,
      _multiDrawStarts: new Int32Array(MAX_RANGES).map((_, i) => 12 * i), // bytes
      _multiDrawCounts: new Int32Array(MAX_RANGES).fill(6),
      _multiDrawCount: COUNT,
      _matricesTexture: null,
      _indirectTexture: null,
      _colorsTexture: null,
    });
    const told = {};
    for (const [name, some] of Object.entries({ "one draw each": meshes, "a page": [page] })) {
      const scene = new Scene();
      scene.add(...some);
      draws = 0;
      renderer.render(scene, camera);
      const pixels = new Uint8Array(4 * 256 * 256);
      gl.readPixels(0, 0, 256, 256, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      const drawn = pixels.reduce((sum, value, i) => sum + (i % 4 !== 3 && value > 0 ? 1 : 0), 0);
      told[name] = { draws, drawn, picture: pixels.reduce((hash, value) => (Math.imul(hash, 31) + value) | 0, 7), error: gl.getError() };
    }
    renderer.dispose();
    return { hasMultiDraw: multi !== null, ...told };
  };
  return [run(true), run(false)];
}
