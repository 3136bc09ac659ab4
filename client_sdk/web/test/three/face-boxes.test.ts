import { describe, expect, it } from "vitest";

import type { Vec3 } from "../../src/core/types.ts";
import { FaceBoxes, type PickableMesh, rayMeetsBounds } from "../../src/three/face-boxes.ts";
import { castGround, groundOnVertical, type Pickable, type ShownGround } from "../../src/three/ground-picking.ts";
import { random } from "../random.ts";

/** A square of cells, `side` a side, with one vertex per corner: codes of half a metre about a far origin. */
function terrain(side: number, heightOf: (x: number, z: number) => number): PickableMesh {
  const positions = new Uint16Array((side + 1) * (side + 1) * 4);
  const regionIds = new Uint16Array((side + 1) * (side + 1) * 2);
  for (let z = 0; z <= side; z += 1) {
    for (let x = 0; x <= side; x += 1) {
      const at = z * (side + 1) + x;
      positions.set([x * 2, heightOf(x, z) * 2, z * 2, 0], at * 4);
      regionIds[at * 2] = x < side / 2 ? 4 : 9;
    }
  }
  const indices: number[] = [];
  for (let z = 0; z < side; z += 1) {
    for (let x = 0; x < side; x += 1) {
      const a = z * (side + 1) + x;
      indices.push(a, a + side + 1, a + 1, a + 1, a + side + 1, a + side + 2);
    }
  }
  return {
    translation: [-1000, 20, 3000],
    stepM: 0.5,
    positions,
    regionIds,
    indices: Uint32Array.from(indices),
    faceCount: indices.length / 3,
    bounds: [-1000, 20, 3000, -1000 + side, 60, 3000 + side],
  };
}

/** Every face asked, by another formula: the plane first, then the side of each edge. */
function castAtAll(mesh: PickableMesh, origin: Vec3, direction: Vec3): number | null {
  const corner = (face: number, at: number): Vec3 => {
    const vertex = mesh.indices[face * 3 + at]! * 4;
    return [0, 1, 2].map(
      (axis) => mesh.translation[axis]! + mesh.stepM * mesh.positions[vertex + axis]!,
    ) as unknown as Vec3;
  };
  const minus = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const cross = (a: Vec3, b: Vec3): Vec3 => [
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
  ];
  const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  let best: number | null = null;
  for (let face = 0; face < mesh.faceCount; face += 1) {
    const corners = [corner(face, 0), corner(face, 1), corner(face, 2)] as const;
    const normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
    const t = dot(minus(corners[0], origin), normal) / dot(direction, normal);
    const point: Vec3 = [origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]];
    const isInside = [0, 1, 2].every((at) => {
      const from = corners[at]!;
      const to = corners[(at + 1) % 3]!;
      return dot(cross(minus(to, from), minus(point, from)), normal) >= -1e-6;
    });
    if (isInside && t >= 0 && (best === null || t < best)) {
      best = t;
    }
  }
  return best;
}

describe("FaceBoxes", () => {
  it("meets what a look at every face meets", () => {
    const next = random(3);
    const mesh = terrain(40, (x, z) => Math.floor(6 + 5 * Math.sin(x / 5) + 4 * Math.cos(z / 3)));
    const boxes = new FaceBoxes(mesh);
    let met = 0;
    for (let ray = 0; ray < 500; ray += 1) {
      const origin: Vec3 = [-1010 + 60 * next(), 15 + 50 * next(), 2990 + 60 * next()];
      const direction: Vec3 = [next() - 0.5, next() - 0.7, next() - 0.5];
      const expected = castAtAll(mesh, origin, direction);
      const hit = boxes.cast(origin, direction, Number.MAX_VALUE);
      expect(hit === null).toBe(expected === null);
      if (hit && expected !== null) {
        met += 1;
        expect(hit.t).toBeCloseTo(expected, 9);
      }
    }
    expect(met).toBeGreaterThan(100);
  });

  it("lets no ray slip through an edge or a corner", () => {
    const mesh = terrain(16, () => 3);
    const boxes = new FaceBoxes(mesh);
    for (let x = 0; x <= 32; x += 1) {
      for (let z = 0; z <= 32; z += 1) {
        const hit = boxes.cast([-1000 + x / 2, 100, 3000 + z / 2], [0, -1, 0], 1000);
        expect(hit?.t).toBe(77);
      }
    }
  });

  it("sees both sides, nothing behind, nothing beyond, and no hidden face", () => {
    const mesh = terrain(1, () => 0);
    const boxes = new FaceBoxes(mesh);
    const above: Vec3 = [-999.7, 25, 3000.2];
    expect(boxes.cast(above, [0, -1, 0], 10)).toEqual({ t: 5, face: 0 });
    expect(boxes.cast([-999.7, 15, 3000.2], [0, 1, 0], 10)).toEqual({ t: 5, face: 0 });
    expect(boxes.cast(above, [0, 1, 0], 10)).toBeNull();
    expect(boxes.cast(above, [0, -1, 0], 4.9)).toBeNull();
    expect(boxes.cast(above, [0, -2, 0], 10)?.t).toBe(2.5);
    expect(boxes.cast(above, [0, -1, 0], 10, Uint8Array.of(1, 0))).toBeNull();
  });

  it("tells normal and region of a face", () => {
    const boxes = new FaceBoxes(terrain(2, () => 0));
    expect(boxes.normalOf(0)).toEqual([0, 1, 0]);
    expect(boxes.regionOf(0)).toBe(4);
    expect(boxes.regionOf(6)).toBe(9);
    const bare = new FaceBoxes({ ...terrain(2, () => 0), regionIds: null });
    expect(bare.regionOf(0)).toBe(-1);
  });

  it("takes float positions as they are", () => {
    const mesh: PickableMesh = {
      translation: [0, 0, 0],
      stepM: 1,
      positions: Float32Array.of(0, 1.5, 0, 0, 1.5, 4, 4, 1.5, 0),
      indices: Uint16Array.of(0, 1, 2),
      regionIds: null,
      faceCount: 1,
      bounds: [0, 1.5, 0, 4, 1.5, 4],
    };
    expect(new FaceBoxes(mesh).cast([1, 5, 1], [0, -1, 0], 100)?.t).toBe(3.5);
  });
});

describe("rayMeetsBounds", () => {
  it.each([
    [[0, 5, 0], [0, -1, 0], 10, true],
    [[0, 5, 0], [0, -1, 0], 3, false],
    [[0, 5, 0], [0, 1, 0], 10, false],
    [[0, 0, 0], [0, 0, 1], 0, true],
    [[1, 5, 1], [0, -1, 0], 10, true],
    [[1.01, 5, 1], [0, -1, 0], 10, false],
  ] as const)("from %j along %j within %d: %s", (origin, direction, maxT, expected) => {
    expect(rayMeetsBounds(origin, direction, maxT, [-1, -1, -1, 1, 1, 1])).toBe(expected);
  });
});

describe("what is shown", () => {
  const flat = (height: number, segment: number): Pickable => {
    const mesh = terrain(4, () => height);
    return { segment, bounds: mesh.bounds, boxes: new FaceBoxes(mesh) };
  };
  const ground = (changes: Partial<ShownGround>): ShownGround => ({
    segments: [],
    base: flat(1, -1),
    hidden: undefined,
    pushM: 0.5,
    ...changes,
  });
  const above: Vec3 = [-998, 100, 3001.7];

  it("is the base where nothing else is, and where it stands before detail by more than the push", () => {
    expect(castGround(ground({}), above, [0, -1, 0], 1000)).toMatchObject({ segment: -1, distanceM: 79 });
    const deep = ground({ segments: [flat(0, 6)] });
    expect(castGround(deep, above, [0, -1, 0], 1000)).toMatchObject({ segment: -1, distanceM: 79 });
  });

  it("is the detail where it stands less than the push behind the base, as in the picture", () => {
    const pushed = ground({ segments: [flat(0, 6)], pushM: 1.5 });
    expect(castGround(pushed, above, [0, -3, 0], 1000)).toMatchObject({ segment: 6, distanceM: 80, region: 9 });
  });

  it("is the nearest of several segments, and only within reach", () => {
    const many = ground({ segments: [flat(4, 1), flat(9, 2), flat(6, 3)] });
    expect(castGround(many, above, [0, -1, 0], 1000)).toMatchObject({ segment: 2, position: [-998, 29, 3001.7] });
    expect(castGround(many, above, [0, -1, 0], 70)).toBeNull();
    expect(castGround(many, above, [0, 0, 0], 70)).toBeNull();
  });

  it("has no hidden base faces", () => {
    expect(castGround(ground({ hidden: new Uint8Array(32).fill(255) }), above, [0, -1, 0], 1000)).toBeNull();
  });

  it("has normals towards the ray", () => {
    expect(castGround(ground({}), [-998, 0, 3001.7], [0, 1, 0], 1000)?.normal).toEqual([0, -1, 0]);
  });

  it("on a vertical is the highest not above, else the lowest above, facing up", () => {
    const storeys = ground({ segments: [flat(10, 1), flat(20, 2)] });
    expect(groundOnVertical(storeys, -998, 3001.7, 35)).toMatchObject({ segment: 1, position: [-998, 30, 3001.7] });
    expect(groundOnVertical(storeys, -998, 3001.7, 30)).toMatchObject({ segment: 1 });
    expect(groundOnVertical(storeys, -998, 3001.7, 0)).toMatchObject({ segment: -1, normal: [0, 1, 0] });
    expect(groundOnVertical(storeys, 50, 50, 35)).toBeNull();
  });
});
