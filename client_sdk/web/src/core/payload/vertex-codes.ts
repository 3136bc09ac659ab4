/** Colours and normals of segment format 2 to the integers that the GPU is given. */

/** Linear light of the sRGB levels (IEC 61966-2-1); 65535 is 1. */
const LINEAR = Uint16Array.from({ length: 256 }, (_, level) => {
  const value = level / 255;
  return Math.round(65535 * (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
});

/** Decode the colours' planes: green, red - green, blue - green. Four entries a vertex, the fourth is alpha. */
export function linearColours(green: Uint8Array, red: Uint8Array, blue: Uint8Array): Uint16Array<ArrayBuffer> {
  const colours = new Uint16Array(4 * green.length).fill(65535);
  for (let vertex = 0; vertex < green.length; vertex += 1) {
    colours[4 * vertex] = LINEAR[(green[vertex]! + red[vertex]!) & 0xff]!;
    colours[4 * vertex + 1] = LINEAR[green[vertex]!]!;
    colours[4 * vertex + 2] = LINEAR[(green[vertex]! + blue[vertex]!) & 0xff]!;
  }
  return colours;
}

/** Decode the normals' planes, octahedral codes, to vectors of length 127. Four entries a vertex, the fourth is padding. */
export function unfoldedNormals(codesX: Uint8Array, codesZ: Uint8Array): Int8Array<ArrayBuffer> {
  const normals = new Int8Array(4 * codesX.length);
  for (let vertex = 0; vertex < codesX.length; vertex += 1) {
    let x = (codesX[vertex]! << 24) >> 24; // Signed.
    let z = (codesZ[vertex]! << 24) >> 24;
    const y = 127 - Math.abs(x) - Math.abs(z);
    if (y < 0) {
      x = Math.sign(x) * Math.max(Math.abs(x) + y, 0);
      z = Math.sign(z) * Math.max(Math.abs(z) + y, 0);
    }
    const scale = 127 / Math.sqrt(x * x + y * y + z * z);
    normals[4 * vertex] = Math.round(x * scale);
    normals[4 * vertex + 1] = Math.round(y * scale);
    normals[4 * vertex + 2] = Math.round(z * scale);
  }
  return normals;
}
