// 3DTilesRendererJS with its LoadRegion plugin, as a page of ours would use it: a sphere that is moved, full detail within.
// Bundled by esbuild (benchmarks/peer.py). Meshes are decoded in workers; lights are those of the library's examples.
// The camera refines nothing: what is loaded and drawn is the region's affair alone, as a landing's is.

import { LoadRegionPlugin, SphereRegion } from "3d-tiles-renderer/three/plugins";
import { TilesRenderer } from "3d-tiles-renderer/three";
import {
  AmbientLight,
  DirectionalLight,
  Matrix4,
  PerspectiveCamera,
  Scene,
  Sphere,
  Vector3,
  WebGLRenderer,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";

/** Only the base: segments outside the landing are not loaded if segments are added one by one. */
class BaseRegion extends SphereRegion {
  intersectsTile(volume, tile) {
    return !tile.content?.uri?.includes("segments/");
  }
}

const parameters = new URLSearchParams(location.hash.slice(1));
const renderer = new WebGLRenderer({ canvas: document.querySelector("#view"), antialias: true });
renderer.setPixelRatio(devicePixelRatio);
renderer.setSize(innerWidth, innerHeight, false);
const scene = new Scene();
const sun = new DirectionalLight(0xffffff, 3);
sun.position.set(1, 2, 3);
scene.add(sun, new AmbientLight(0xffffff, 1));
const camera = new PerspectiveCamera(55, innerWidth / innerHeight, 0.1, 1e6);
const tiles = new TilesRenderer(parameters.get("tileset"));
const regions = new LoadRegionPlugin();
tiles.registerPlugin(regions);
// Geometric errors of a landing's tiles are metres; the camera's are pixels and never reach this.
tiles.errorTarget = 1e5;
MeshoptDecoder.useWorkers(Math.min(4, navigator.hardwareConcurrency));
const loader = new GLTFLoader(tiles.manager).setMeshoptDecoder(MeshoptDecoder);
tiles.manager.addHandler(/\.(glb|gltf)(\?.*)?$/, loader);
// If a cell is replaced as a whole, all of its segments must be loaded, else the ground has a hole. If segments are added,
// only the regions select them: with a camera, everything visible in a refined cell would be loaded.
const isAdded = parameters.get("tileset").endsWith("/added.json");
if (!isAdded) {
  tiles.setCamera(camera);
  tiles.setResolutionFromRenderer(camera, renderer);
}
scene.add(tiles.group);

const failures = [];
tiles.addEventListener("load-error", ({ url, error }) => failures.push(`${url}: ${error}`));
const placed = new Matrix4();
let isPlaced = false;
let isSettled = false;
let landing = null;

function frame() {
  requestAnimationFrame(frame);
  if (!isPlaced && tiles.root) {
    // Earth-centred metres are no place for float32: the tileset is brought back to its own east, north and up.
    placed.fromArray(tiles.root.transform);
    tiles.group.matrixAutoUpdate = false;
    tiles.group.matrix.copy(placed).invert();
    tiles.group.updateMatrixWorld(true);
    // The base everywhere: the root has no content, so it must be refined, and its children need not be.
    const baseErrorM = Math.max(...tiles.root.children.map((cell) => cell.geometricError));
    const everywhere = new Sphere(new Vector3().applyMatrix4(placed), 1e6);
    const Region = isAdded ? BaseRegion : SphereRegion;
    regions.addRegion(new Region({ sphere: everywhere, errorTarget: baseErrorM }));
    isPlaced = true;
  }
  camera.updateMatrixWorld(true);
  tiles.update();
  const { downloading, parsing, queued } = tiles.stats;
  isSettled = isPlaced && tiles.loadProgress === 1 && downloading + parsing + (queued ?? 0) === 0;
  renderer.render(scene, camera);
}

/** Scene frame (Y up, north -Z) to the tileset's (Z up). */
const eastNorthUp = ([x, y, z]) => new Vector3(x, -z, y);

window.peer = {
  failures,
  look(eye, target) {
    camera.up.set(0, 0, 1);
    camera.position.copy(eastNorthUp(eye));
    camera.lookAt(eastNorthUp(target));
  },
  land(place, radiusM) {
    const sphere = new Sphere(eastNorthUp(place).applyMatrix4(placed), radiusM);
    if (landing !== null) regions.removeRegion(landing);
    landing = new SphereRegion({ sphere, errorTarget: 1e-3 });
    regions.addRegion(landing);
    isSettled = false;
  },
  get isPlaced() {
    return isPlaced;
  },
  get isSettled() {
    return isSettled;
  },
  get digest() {
    return [...tiles.visibleTiles].map((tile) => tile.content?.uri ?? "").sort().join(" ");
  },
  get triangles() {
    return renderer.info.render.triangles;
  },
};
requestAnimationFrame(frame);
