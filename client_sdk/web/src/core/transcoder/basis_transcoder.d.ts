/** Of Basis Universal's transcoder what we use: written here by `packing/transcoder.ts`, from three.js. */

export interface Ktx2File {
  isValid(): boolean;
  isETC1S(): boolean;
  getWidth(): number;
  getHeight(): number;
  getLevels(): number;
  startTranscoding(): boolean;
  getImageTranscodedSizeInBytes(level: number, layer: number, face: number, format: number): number;
  transcodeImage(
    out: Uint8Array,
    level: number,
    layer: number,
    face: number,
    format: number,
    flags: number,
    channel0: number,
    channel1: number,
  ): boolean;
  close(): void;
  delete(): void;
}

export interface BasisModule {
  initializeBasis(): void;
  readonly KTX2File: new (bytes: Uint8Array) => Ktx2File;
}

declare const makeBasis: (options: { wasmBinary: ArrayBuffer }) => Promise<BasisModule>;
export default makeBasis;
