import { Terrain } from "@terraport/client/three";
import * as three from "three";

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";
const renderer = new three.WebGLRenderer({ canvas: document.querySelector("canvas")! });
renderer.setSize(innerWidth, innerHeight, false);
renderer.shadowMap.enabled = true;
renderer.toneMapping = three.ACESFilmicToneMapping;
renderer.clippingPlanes = [new three.Plane(new three.Vector3(0, 0, -1), 12)]; // Nothing south of z = 12 m.

const scene = new three.Scene();
scene.background = new three.Color(0xb9cdd8);
scene.fog = new three.Fog(scene.background, 30, 80);
const sun = new three.DirectionalLight(0xfff2e0, 3);
sun.position.set(28, 24, -14);
sun.castShadow = true;
sun.shadow.mapSize.set(2048, 2048);
Object.assign(sun.shadow.camera, { left: -25, right: 25, bottom: -25, top: 25, far: 90 });
const box = new three.Mesh(new three.BoxGeometry(3, 5, 3), new three.MeshLambertMaterial({ color: 0xd0602c }));
box.position.set(6, 4, 2);
box.castShadow = true;
box.receiveShadow = true;
scene.add(sun, new three.HemisphereLight(0xdfeaff, 0x8f8272, 2), box);

const ground = await Terrain.open(sceneUrl, {
  renderer,
  shading: { lit: true, receiveShadow: true, castShadow: true },
});
scene.add(ground);
ground.land([6, 2, 0], 6);

const camera = new three.PerspectiveCamera(50, innerWidth / innerHeight, 0.1, 500);
camera.position.set(24, 18, 26);
camera.lookAt(0, 4, 0);
renderer.setAnimationLoop(() => {
  ground.update();
  renderer.render(scene, camera);
});
Object.assign(window, { three, renderer, scene, camera, sun, box, ground }); // To look at from the console.
