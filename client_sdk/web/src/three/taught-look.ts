/** What strokes have taught, as a picture that the ground's shader lays over every mode. */

import { DataTexture, NearestFilter, RGBAFormat, SRGBColorSpace, Vector2 } from "three";

import type { TaughtPicture } from "../core/types.ts";

/** How strongly a name covers the ground: what lies below must be seen, or nobody knows where to paint. */
const SHARE = 0.62;
/** Squares of one stripe and its gap, where it is unsure. */
const STRIPE_CELLS = 3;
const NO_GROUND = 255;

/** Uniforms of the shader; `set` fills them, `dispose` frees the picture. */
export class TaughtLook {
  #texture = textureOf(new Uint8Array([0, 0, 0, NO_GROUND]), 1, 1);
  readonly uniforms = {
    taught: { value: this.#texture },
    taughtCorner: { value: new Vector2() },
    taughtSize: { value: new Vector2(1, 1) },
    taughtStripe: { value: 1 },
    taughtShare: { value: 0 },
  };

  set(picture: TaughtPicture | null): void {
    const { uniforms } = this;
    uniforms.taughtShare.value = picture === null ? 0 : SHARE;
    if (picture === null) return;
    const { rows, columns, cellM, cornerM } = picture;
    this.#texture.dispose();
    this.#texture = textureOf(texelsOf(picture), columns, rows);
    uniforms.taught.value = this.#texture;
    uniforms.taughtCorner.value.set(...cornerM);
    uniforms.taughtSize.value.set(columns * cellM, rows * cellM);
    uniforms.taughtStripe.value = STRIPE_CELLS * cellM;
  }

  dispose(): void {
    this.#texture.dispose();
  }
}

/** Colours of names; alpha is doubt in 254ths, or 255 without ground. */
export function texelsOf({ names, kind, doubt }: TaughtPicture): Uint8Array<ArrayBuffer> {
  const colours = names.map(({ colour }) => Number.parseInt(colour.slice(1), 16));
  const texels = new Uint8Array(kind.length * 4).fill(NO_GROUND);
  for (let square = 0; square < kind.length; square += 1) {
    const colour = colours[kind[square]!];
    if (colour === undefined) continue;
    texels[square * 4] = colour >> 16;
    texels[square * 4 + 1] = (colour >> 8) & 255;
    texels[square * 4 + 2] = colour & 255;
    texels[square * 4 + 3] = Math.min(doubt[square]!, NO_GROUND - 1);
  }
  return texels;
}

function textureOf(texels: Uint8Array<ArrayBuffer>, columns: number, rows: number): DataTexture {
  const texture = new DataTexture(texels, columns, rows, RGBAFormat);
  texture.colorSpace = SRGBColorSpace;
  texture.minFilter = NearestFilter;
  texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}
