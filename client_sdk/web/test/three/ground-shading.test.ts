/** Materials of the ground: a program is made anew only where it is another. */

import { Mesh, Plane, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { ShadedMaterial } from "../../src/three/ground-shading.ts";

const PARAMETERS = { vertexShader: "", fragmentShader: "" };

describe("ShadedMaterial", () => {
  it("is without lights, and of a three.js scene's fog, planes and tones, by itself", () => {
    const { material } = new ShadedMaterial(PARAMETERS, "pages", ["PAGED"]);
    expect(material).toMatchObject({
      lights: false,
      fog: true,
      clipping: true,
      toneMapped: true,
      clippingPlanes: null,
    });
    expect(material.defines).toEqual({ PAGED: "" });
  });

  it("asks for another program where light, shadow, fog or comparing change, and nowhere else", () => {
    const shaded = new ShadedMaterial(PARAMETERS, "pages", ["PAGED"]);
    const { material } = shaded;
    const asked = (change: () => void): boolean => {
      const before = material.version;
      change();
      return material.version !== before;
    };
    expect(asked(() => shaded.set({}))).toBe(false);
    expect(asked(() => shaded.set({ castShadow: true, toneMapped: false }))).toBe(false);
    expect(asked(() => shaded.set({ clippingPlanes: [new Plane(new Vector3(1, 0, 0), 2)] }))).toBe(false);
    expect(asked(() => shaded.set({ lit: true }))).toBe(true);
    expect(material).toMatchObject({ lights: true, toneMapped: true, clippingPlanes: null });
    expect(asked(() => shaded.compare(true))).toBe(true);
    expect(asked(() => shaded.compare(true))).toBe(false);
    expect(material.defines).toEqual({ PAGED: "", COMPARED: "", LIT: "" });
    expect(asked(() => shaded.set({ receiveShadow: true }))).toBe(true);
    expect(material.defines).toEqual({ PAGED: "", COMPARED: "", SHADOWED: "" });
    expect(asked(() => shaded.set({ fog: false }))).toBe(true);
    expect(material).toMatchObject({ lights: false, fog: false });
  });

  it("dresses meshes for what is set, and takes it back", () => {
    const shaded = new ShadedMaterial(PARAMETERS, "ground", []);
    const mesh = new Mesh();
    shaded.dress(mesh, true);
    expect(mesh).toMatchObject({ castShadow: false, receiveShadow: false, customDepthMaterial: undefined });
    shaded.set({ castShadow: true, receiveShadow: true });
    shaded.dress(mesh, true);
    expect(mesh).toMatchObject({ castShadow: true, receiveShadow: true });
    // A point light's too: its shadow map is made of depths.
    expect(mesh.customDepthMaterial).toBe(mesh.customDistanceMaterial);
    expect(mesh.customDepthMaterial).toMatchObject({ defines: { CASTER: "" }, polygonOffset: true });
    shaded.dress(mesh, false);
    expect(mesh).toMatchObject({ castShadow: false, receiveShadow: true });
  });
});
