// A scene in an engine of one's own choice, here Babylon.js, by the core alone: `npm i @babylonjs/core` beside the package.

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
import { loadSceneInWorker, openStream, passOn, Residency } from "@terraport/client/core";

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
  const width = data.positions.length / data.vertexCount; // Whole steps come with padding.
  const positions = new Float32Array(3 * data.vertexCount);
  for (let at = 0; at < positions.length; at += 1) {
    const code = data.positions[Math.floor(at / 3) * width + (at % 3)];
    positions[at] = data.positions instanceof Uint16Array ? code * data.stepM + data.translation[at % 3] : code;
  }
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
    texture.update(false); // glTF's first row is at v = 0.
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
const drawn = new Map();
const residency = new Residency({ maxInFlight: 8, maxInFlightBytes: 1 << 26, spareBytes: 1 << 27 });
const stream = openStream({ sceneUrl, budgets: { maxTriangles: 2_000_000 }, cacheBytes: 1 << 27 });
stream.onEvent = (event) => passOn(event, residency);

/** Land: full detail within the radius, once all of it is here. */
function land(position, radiusM) {
  residency.land(stream.land(position, radiusM), position, radiusM, performance.now());
}

function put(segment, epoch, data) {
  if (!residency.decoded(segment, epoch, data.vertexCount * 32 + data.indices.byteLength)) return;
  drawn.set(segment, meshOf(data, `segment ${segment}`));
  residency.uploaded(segment);
  residency.warmed(segment);
}

/** In one frame: a segment and the faces of the base under it are never both there, nor both missing. */
function swap({ shown, hidden: gone, hiddenFaces }) {
  for (const segment of shown) drawn.get(segment).setEnabled(true);
  for (const segment of gone) drawn.get(segment).setEnabled(false);
  const isHidden = (face) => (hiddenFaces[face >> 3] >> (face & 7)) & 1;
  ground.setIndices(base.indices.filter((_, at) => !isHidden(Math.floor(at / 3))));
}

engine.runRenderLoop(() => {
  for (const { segment, epoch } of residency.takeDecodes())
    stream.mesh(segment, manifest.attributes).then(
      (data) => put(segment, epoch, data),
      () => residency.decodeFailed(segment, epoch),
    );
  for (const segment of residency.takeFreed()) {
    drawn.get(segment)?.dispose(false, true);
    drawn.delete(segment);
  }
  residency.basePrepared(residency.comingRevision); // Its faces are hidden in the swap itself.
  const next = residency.swap();
  if (next !== null) swap(next);
  scene.render();
});
addEventListener("resize", () => engine.resize());
land([0, 0, 0], 10);
Object.assign(window, { land, residency, drawn, ground }); // To look at from the console.
