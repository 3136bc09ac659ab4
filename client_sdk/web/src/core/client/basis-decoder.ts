/** KTX2 textures to what this device's GPU keeps compressed. Its transcoder is fetched with the first of them. */

import type { BasisModule, Ktx2File } from "../transcoder/basis_transcoder.js";
import type { CompressedImage } from "../types.ts";

/** A form that a GPU may read: its number for the transcoder, for WebGL, and the extension that it needs. */
interface Form {
  readonly transcoder: number;
  readonly gl: number;
  readonly extension: string | null;
}

const BC1: Form = { transcoder: 2, gl: 0x8c4c, extension: "WEBGL_compressed_texture_s3tc_srgb" };
const ETC1: Form = { transcoder: 0, gl: 0x9275, extension: "WEBGL_compressed_texture_etc" };
const ASTC: Form = { transcoder: 10, gl: 0x93d0, extension: "WEBGL_compressed_texture_astc" };
const BC7: Form = { transcoder: 6, gl: 0x8e8d, extension: "EXT_texture_compression_bptc" };
/** Where the GPU reads none of them; eight times as large. */
const RGBA: Form = { transcoder: 13, gl: 0x8c43, extension: null };

let loading: Promise<BasisModule> | undefined;
let extensions: readonly string[] | undefined;

/** Transcode a whole KTX2 file of Basis Universal. Rejects where it is not one, or has not all its levels. */
export async function decodeBasis(bytes: Uint8Array<ArrayBuffer>): Promise<CompressedImage> {
  loading ??= load();
  const file = new (await loading).KTX2File(bytes);
  try {
    return transcode(file);
  } finally {
    file.close();
    file.delete();
  }
}

function transcode(file: Ktx2File): CompressedImage {
  const width = file.getWidth();
  const height = file.getHeight();
  const levels = Math.floor(Math.log2(Math.max(width, height))) + 1;
  if (!file.isValid() || file.getLevels() !== levels || !file.startTranscoding()) {
    throw new Error(`KTX2 with ${file.getLevels()} levels, expected ${levels} of Basis Universal`);
  }
  const form = formFor(file.isETC1S());
  const data = Array.from({ length: levels }, (_, level) => {
    const out = new Uint8Array(file.getImageTranscodedSizeInBytes(level, 0, 0, form.transcoder));
    if (!file.transcodeImage(out, level, 0, 0, form.transcoder, 0, -1, -1))
      throw new Error(`KTX2 level ${level} is damaged`);
    return out;
  });
  return { width, height, form: form.gl, extension: form.extension, levels: data };
}

/** The first form that the GPU reads, of as many bits a texel as the file's own. */
function formFor(isEtc1s: boolean): Form {
  extensions ??= new OffscreenCanvas(1, 1).getContext("webgl2")?.getSupportedExtensions() ?? [];
  const forms = isEtc1s ? [BC1, ETC1] : [ASTC, BC7];
  return forms.find(({ extension }) => extension !== null && extensions?.includes(extension)) ?? RGBA;
}

async function load(): Promise<BasisModule> {
  try {
    const [{ default: makeBasis }, answer] = await Promise.all([
      import("../transcoder/basis_transcoder.js"),
      fetch(new URL("../transcoder/basis_transcoder.wasm", import.meta.url)),
    ]);
    if (!answer.ok) throw new Error(`the transcoder of textures: HTTP ${answer.status}`);
    const basis = await makeBasis({ wasmBinary: await answer.arrayBuffer() });
    basis.initializeBasis();
    return basis;
  } catch (error) {
    loading = undefined; // The next texture tries again.
    throw error;
  }
}
