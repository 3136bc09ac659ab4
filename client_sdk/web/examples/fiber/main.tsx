import { Canvas, type ThreeEvent, useFrame, useThree } from "@react-three/fiber";
import { Terrain } from "@terraport/client/three";
import { useEffect, useState } from "react";
import { createRoot } from "react-dom/client";

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";

/** The ground of a scene; a click on it lands there. */
function Ground({ url, radiusM }: { url: string; radiusM: number }) {
  const renderer = useThree(({ gl }) => gl);
  const [ground, setGround] = useState<Terrain | null>(null);
  useEffect(() => {
    const opening = new AbortController();
    const opened = Terrain.open(url, { renderer, signal: opening.signal });
    opened.then(setGround, (error) => opening.signal.aborted || alert(error));
    return () => {
      opening.abort();
      opened.then(
        (terrain) => terrain.dispose(),
        () => undefined,
      );
    };
  }, [renderer, url]);
  useEffect(() => {
    ground?.land([0, 0, 0], radiusM);
    Object.assign(window, { ground }); // To look at from the console.
  }, [ground, radiusM]);
  useFrame(() => ground?.update());
  const land = ({ point }: ThreeEvent<MouseEvent>) => ground?.land(ground.worldToLocal(point.clone()), radiusM);
  // biome-ignore lint/a11y/noStaticElementInteractions: no HTML element, an object of three.js
  return ground && <primitive object={ground} onClick={land} />;
}

createRoot(document.querySelector("#app")!).render(
  <Canvas camera={{ position: [0, 12, 16], fov: 55, far: 4000 }} flat>
    <Ground url={sceneUrl} radiusM={10} />
  </Canvas>,
);
