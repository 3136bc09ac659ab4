/** `@terraport/client/element`: importing it defines `<terraport-scene>`. */

import { TerraportScene, type TerraportSceneEventMap } from "./terraport-scene.ts";

export { TerraportScene, type TerraportSceneEventMap };

declare global {
  interface HTMLElementTagNameMap {
    "terraport-scene": TerraportScene;
  }
}

if (!customElements.get("terraport-scene")) customElements.define("terraport-scene", TerraportScene);
