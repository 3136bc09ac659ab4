import { Canvas, useFrame, useThree } from "@react-three/fiber";
import { loadSceneInWorker, openStream, type SceneFiles } from "@terraport/client/core";
import { Stage } from "@terraport/client/three";
import { use, useEffect, useState } from "react";
import { createRoot } from "react-dom/client";

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";
const loading = loadSceneInWorker(sceneUrl);

/** The ground of a scene; a click on it lands there. */
function Ground({ files, radiusM }: { files: SceneFiles; radiusM: number }) {
  const renderer = useThree(({ gl }) => gl);
  const [stage, setStage] = useState<Stage | null>(null);
  useEffect(() => {
    const stream = openStream({ sceneUrl, budgets: { maxTriangles: 2_000_000 }, cacheBytes: 1 << 27 });
    const made = new Stage({ renderer, stream, files });
    stream.onEvent = (event) => made.handle(event);
    setStage(made);
    return () => {
      made.dispose();
      stream.close();
    };
  }, [renderer, files]);
  useFrame(() => {
    if (stage?.status.phase === "presentable") stage.swap();
    stage?.update();
  });
  useEffect(() => {
    stage?.land([0, 0, 0], radiusM);
    Object.assign(window, { stage }); // To look at from the console.
  }, [stage, radiusM]);
  return stage && <primitive object={stage.object} />;
}

function App() {
  return (
    <Canvas camera={{ position: [0, 12, 16], fov: 55, far: 4000 }} flat>
      <Ground files={use(loading)} radiusM={10} />
    </Canvas>
  );
}

createRoot(document.querySelector("#app")!).render(<App />);
