/** Decodes payloads, pictures included, one after the other. */

import { decodeSegment } from "../payload/segment-format.ts";
import { imageDecoder } from "./image-decoder.ts";
import { transferablesOfMesh } from "./transferables.ts";
import { sentError } from "./worker-errors.ts";
import type { DecodeAnswer, DecodeJob } from "./worker-messages.ts";

const decodeImage = imageDecoder();

self.onmessage = async (event: MessageEvent<DecodeJob>) => {
  const { payload, attributes } = event.data;
  try {
    const mesh = await decodeSegment(payload, attributes, decodeImage);
    const answer: DecodeAnswer = { type: "decoded", mesh };
    self.postMessage(answer, { transfer: transferablesOfMesh(mesh) });
  } catch (error) {
    const answer: DecodeAnswer = { type: "failed", error: sentError(error) };
    self.postMessage(answer);
  }
};
