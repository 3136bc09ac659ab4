import { Terrain } from "@terraport/client/three";
import { Color, PerspectiveCamera, Raycaster, Scene, Vector2, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";
const renderer = new WebGLRenderer({ canvas: document.querySelector("canvas")!, antialias: true });
renderer.setSize(innerWidth, innerHeight, false);
const camera = new PerspectiveCamera(55, innerWidth / innerHeight, 0.1, 4000);
camera.position.set(0, 16, 22);
new OrbitControls(camera, renderer.domElement);
const scene = new Scene();
scene.background = new Color(0xb9cdd8);

const ground = await Terrain.open(sceneUrl, { renderer });
scene.add(ground);
ground.land([0, 0, 0], 10);

// A double click lands where it points.
const raycaster = new Raycaster();
renderer.domElement.addEventListener("dblclick", ({ clientX, clientY }) => {
  raycaster.setFromCamera(new Vector2((2 * clientX) / innerWidth - 1, 1 - (2 * clientY) / innerHeight), camera);
  const [hit] = raycaster.intersectObject(ground);
  if (hit !== undefined) ground.land(ground.worldToLocal(hit.point), 10);
});

renderer.setAnimationLoop(() => {
  ground.update();
  renderer.render(scene, camera);
});
Object.assign(window, { ground, camera, scene }); // To look at from the console.
