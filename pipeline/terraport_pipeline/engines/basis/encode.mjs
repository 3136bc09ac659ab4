// One image to KTX2 by Basis Universal's encoder: RGBA on standard input, the file on standard output.
// node encode.mjs WIDTH HEIGHT QUALITY (1 to 255)
import { readFileSync, writeSync } from "node:fs";
import makeBasis from "./basis_encoder.js";

const RAW_PIXELS = 0;
const TEXTURE_2D = 0;
/** Of 0 to 6: more takes twice the time for a quarter of a decibel. */
const EFFORT = 1;

const [width, height, quality] = process.argv.slice(2).map(Number);
const pixels = new Uint8Array(readFileSync(0));
const say = console.error;
console.log = say; // The encoder's own words: standard output is the file's.
const basis = await makeBasis({ print: say, printErr: say });
basis.initializeBasis();
const encoder = new basis.BasisEncoder();
encoder.setCreateKTX2File(true);
encoder.setUASTC(false);
encoder.setPerceptual(true);
encoder.setKTX2AndBasisSRGBTransferFunc(true);
encoder.setMipGen(true);
encoder.setETC1SCompressionLevel(EFFORT);
encoder.setQualityLevel(quality);
encoder.setTexType(TEXTURE_2D);
if (encoder.setSliceSourceImage(0, pixels, width, height, RAW_PIXELS) === false) throw new Error("image refused");
const file = new Uint8Array(width * height * 6 + 65_536);
const length = encoder.encode(file);
if (length <= 0) throw new Error("nothing encoded");
for (let at = 0; at < length; ) at += writeSync(1, file, at, length - at);
