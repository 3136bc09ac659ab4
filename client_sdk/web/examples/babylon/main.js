// A scene in an engine of your choice, here Babylon.js, by the core alone: `npm i @babylonjs/core` next to the package.

import { ArcRotateCamera } from "@babylonjs/core/Cameras/arcRotateCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { StandardMaterial } from "@babylonjs/core/Materials/standardMaterial.js";
import { DynamicTexture } from "@babylonjs/core/Materials/Textures/dynamicTexture.js";
import "@babylonjs/core/Engines/Extensions/engine.dynamicTexture.js";
import { Color3, Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Mesh } from "@babylonjs/core/Meshes/mesh.js";
import { VertexData } from "@babylonjs/core/Meshes/mesh.vertexData.js";
import { Scene } from "@babylonjs/core/scene.js";
import { loadSceneInWorker, openStream } from "@terraport/client/core";

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";
const canvas = document.querySelector("#view");
const engine = new Engine(canvas, true);
const scene = new Scene(engine);
scene.useRightHandedSystem = true; // Y up, metres, as terraport's frame.
scene.clearColor = new Color4(0.73, 0.8, 0.85, 1);
const camera = new ArcRotateCamera("camera", Math.PI / 3, Math.PI / 3, 40, Vector3.Zero(), scene);
camera.maxZ = 4000;
camera.attachControl(canvas, true);

/** A drawn mesh of decoded data, hidden. */
function meshOf(data, name) {
  const width = data.positions.length / data.vertexCount; // Some come with padding.
  const positions = new Float32Array(3 * data.vertexCount);
  for (let at = 0; at < positions.length; at += 1)
    positions[at] = data.positions[Math.floor(at / 3) * width + (at % 3)] * data.stepM + data.translation[at % 3];
  const vertices = new VertexData();
  vertices.positions = positions;
  vertices.indices = data.indices;
  // Linear light; Babylon's standard material expects sRGB. The fourth entry is padding.
  if (data.colours !== null)
    vertices.colors = Float32Array.from(data.colours, (code, at) => (at % 4 === 3 ? 1 : (code / 65535) ** (1 / 2.2)));
  if (data.uvs !== null) vertices.uvs = Float32Array.from(data.uvs, (code, at) => code * data.uvScale[at % 2]);
  const mesh = new Mesh(name, scene);
  vertices.applyToMesh(mesh, true);
  const material = new StandardMaterial(name, scene);
  material.disableLighting = true; // The survey's colours have their light.
  material.emissiveColor = Color3.White();
  material.sideOrientation = 1; // Counter-clockwise faces look out.
  if (data.image?.pixels instanceof ImageBitmap) {
    const texture = new DynamicTexture(name, data.image, scene);
    texture.getContext().drawImage(data.image.pixels, 0, 0);
    texture.update(false); // The first row is at v = 0.
    data.image.pixels.close();
    material.emissiveTexture = texture;
    material.emissiveColor = Color3.Black();
  }
  mesh.material = material;
  mesh.setEnabled(false);
  return mesh;
}

const { manifest, base } = await loadSceneInWorker(sceneUrl);
const ground = meshOf(base, "base");
ground.setEnabled(true);
const drawn = new Map(); // Meshes of segments by key.

/** In one frame: a segment and the faces of the base under it are never both there, nor both missing. */
function show(keys, hidden) {
  for (const [key, mesh] of drawn) {
    if (keys.includes(key)) mesh.setEnabled(true);
    else if (drawn.delete(key)) mesh.dispose(false, true);
  }
  const isHidden = (face) => (hidden[face >> 3] >> (face & 7)) & 1;
  ground.setIndices(base.indices.filter((_, at) => !isHidden(Math.floor(at / 3))));
}

const stream = openStream({ sceneUrl, budgets: { maxTriangles: 2_000_000 } });
let newest = stream.land([0, 0, 0], 10);
stream.onEvent = async (event) => {
  if (event.type !== "ready" || event.landing !== newest) return;
  // Every payload is here: decode what is not drawn yet. A segment that cannot be decoded comes again, with another `ready`.
  const missing = event.visible.filter((key) => !drawn.has(key));
  const decoding = Promise.all(missing.map((key) => stream.mesh(key, manifest.attributes)));
  const meshes = await decoding.catch(() => null);
  if (meshes === null || event.landing !== newest) return;
  for (const [at, key] of missing.entries()) drawn.set(key, meshOf(meshes[at], key));
  show(event.visible, event.hidden);
  Object.assign(window, { shown: event }); // To look at from the console.
};
const land = (position, radiusM) => {
  newest = stream.land(position, radiusM);
};
engine.runRenderLoop(() => scene.render());
addEventListener("resize", () => engine.resize());
Object.assign(window, { land, drawn, ground });
