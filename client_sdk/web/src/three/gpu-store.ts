/** Buffers and textures of WebGL, created empty, filled in slices, and counted. */

import { ExternalTexture, type WebGLRenderer } from "three";

import { imageBytes } from "../core/gpu-budget.ts";
import type { CompressedImage, MeshImage } from "../core/types.ts";

/** A buffer and its size; `null` once freed. */
export interface GpuBuffer {
  readonly buffer: WebGLBuffer;
  readonly bytes: number;
}

/** Size and form of an image: those of one form can be layers of one array. */
export interface ImageForm {
  readonly width: number;
  readonly height: number;
  /** WebGL's number, sRGB. */
  readonly form: GLenum;
  /** WebGL extension that knows it; null where none is needed, and then a GPU can copy it: what is compressed it only reads. */
  readonly extension: string | null;
  /** With all levels. */
  readonly bytes: number;
  /** Equal for equal forms. */
  readonly key: string;
}

/** Images of one form, with all their levels: the layers of an array. */
export interface GpuImages {
  readonly texture: WebGLTexture;
  readonly form: ImageForm;
  readonly layers: number;
  readonly bytes: number;
}

const SRGB8_ALPHA8 = 0x8c43;

/** The form in which an image is kept. */
export function imageFormOf(image: MeshImage): ImageForm {
  const { width, height, pixels } = image;
  const { form, extension } = "levels" in pixels ? pixels : { form: SRGB8_ALPHA8, extension: null };
  return { width, height, form, extension, bytes: imageBytes(image), key: `${form} ${width} x ${height}` };
}

/** Ground is seen at grazing angles: without it, photographs blur away a few metres from the feet. */
const ANISOTROPY = 4;

/**
 * Makes and fills what three.js then only draws with (GLBufferAttribute, ExternalTexture): so uploading needs no draw, and a
 * segment can be split over as many frames as it takes. three.js remembers what is bound, so no binding is changed behind
 * its back.
 */
export class GpuStore {
  readonly #renderer: WebGLRenderer;
  readonly #gl: WebGL2RenderingContext;
  bufferBytes = 0;
  textureBytes = 0;
  createdBytes = 0;
  freedBytes = 0;

  constructor(renderer: WebGLRenderer) {
    const gl = renderer.getContext();
    if (!(gl instanceof WebGL2RenderingContext)) {
      throw new TypeError("the renderer has no WebGL 2 context");
    }
    this.#renderer = renderer;
    this.#gl = gl;
  }

  get isLost(): boolean {
    return this.#gl.isContextLost();
  }

  /** An empty buffer. What it is for must be said at once: WebGL keeps indices apart from everything else. */
  createBuffer(bytes: number, use: "vertices" | "indices"): GpuBuffer {
    const gl = this.#gl;
    const buffer = gl.createBuffer();
    if (use === "indices") {
      // The binding of indices belongs to the vertex array: none is bound meanwhile.
      const boundVertexArray: WebGLVertexArrayObject | null = gl.getParameter(gl.VERTEX_ARRAY_BINDING);
      gl.bindVertexArray(null);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, null);
      gl.bindVertexArray(boundVertexArray);
    } else {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
      gl.bindBuffer(gl.ARRAY_BUFFER, null);
    }
    this.bufferBytes += bytes;
    this.createdBytes += bytes;
    return { buffer, bytes };
  }

  /** Write `bytes` at `offset`. By a binding point that three.js does not use. */
  writeBuffer(target: GpuBuffer, offset: number, bytes: Uint8Array): void {
    const gl = this.#gl;
    gl.bindBuffer(gl.COPY_WRITE_BUFFER, target.buffer);
    gl.bufferSubData(gl.COPY_WRITE_BUFFER, offset, bytes);
    gl.bindBuffer(gl.COPY_WRITE_BUFFER, null);
  }

  /** Copy between two buffers for vertices; indices go between no others. */
  copyBuffer(from: GpuBuffer, fromOffset: number, to: GpuBuffer, toOffset: number, bytes: number): void {
    const gl = this.#gl;
    gl.bindBuffer(gl.COPY_READ_BUFFER, from.buffer);
    gl.bindBuffer(gl.COPY_WRITE_BUFFER, to.buffer);
    gl.copyBufferSubData(gl.COPY_READ_BUFFER, gl.COPY_WRITE_BUFFER, fromOffset, toOffset, bytes);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    gl.bindBuffer(gl.COPY_WRITE_BUFFER, null);
  }

  freeBuffer(target: GpuBuffer): void {
    this.#gl.deleteBuffer(target.buffer);
    this.bufferBytes -= target.bytes;
    this.freedBytes += target.bytes;
  }

  /** Empty images with all their levels. */
  createImages(form: ImageForm, layers: number): GpuImages {
    const gl = this.#gl;
    if (form.extension !== null) gl.getExtension(form.extension); // Its forms are unknown before.
    const texture = gl.createTexture();
    const anisotropy = gl.getExtension("EXT_texture_filter_anisotropic"); // Lost with the context, so asked for each time.
    this.#withTexture(texture, () => {
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, levelsOf(form), form.form, form.width, form.height, layers);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      if (anisotropy) {
        gl.texParameteri(gl.TEXTURE_2D_ARRAY, anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, ANISOTROPY);
      }
    });
    const bytes = layers * form.bytes;
    this.textureBytes += bytes;
    this.createdBytes += bytes;
    return { texture, form, layers, bytes };
  }

  /** Write `rows` rows of an image from row `top` on; (0, 0) is its upper left corner, as in glTF. */
  writeRows(target: GpuImages, layer: number, image: ImageBitmap, top: number, rows: number): void {
    const gl = this.#gl;
    const { width } = target.form;
    this.#withTexture(target.texture, () => {
      this.#withUnpack(top, () => {
        const [form, type] = [gl.RGBA, gl.UNSIGNED_BYTE];
        gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, top, layer, width, rows, 1, form, type, image);
      });
    });
  }

  /** Write one level of an image that comes as a GPU keeps it. */
  writeLevel(target: GpuImages, layer: number, image: CompressedImage, level: number): void {
    const gl = this.#gl;
    const [width, height] = sizeOf(target.form, level);
    const data = image.levels[level]!;
    this.#withTexture(target.texture, () => {
      this.#withUnpack(0, () => {
        if (image.extension === null) {
          const [form, type] = [gl.RGBA, gl.UNSIGNED_BYTE];
          gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, level, 0, 0, layer, width, height, 1, form, type, data);
        } else {
          gl.compressedTexSubImage3D(gl.TEXTURE_2D_ARRAY, level, 0, 0, layer, width, height, 1, image.form, data);
        }
      });
    });
  }

  /** Once all rows of a layer are written: each level from the one before. (`generateMipmap` would make all layers anew.) */
  makeLevels(target: GpuImages, layer: number): void {
    const source = { images: target, layer };
    for (let level = 1; level < levelsOf(target.form); level += 1) {
      this.#blit({ ...source, level: level - 1 }, { ...source, level }, this.#gl.LINEAR);
    }
  }

  /** Copy an image, with its levels, between arrays of one size and form. */
  copyImage(from: GpuImages, fromLayer: number, to: GpuImages, toLayer: number): void {
    for (let level = 0; level < levelsOf(from.form); level += 1) {
      const source = { images: from, layer: fromLayer, level };
      this.#blit(source, { images: to, layer: toLayer, level }, this.#gl.NEAREST);
    }
  }

  /** The images, as a texture that three.js draws with. */
  asTexture({ texture }: GpuImages): ExternalTexture {
    const external = new ExternalTexture(texture);
    // Version 0.180 looks for it here alone, where it is an array; later ones put it here themselves.
    (this.#renderer.properties.get(external) as { __webglTexture?: WebGLTexture }).__webglTexture = texture;
    return external;
  }

  freeImages(target: GpuImages): void {
    this.#gl.deleteTexture(target.texture);
    this.textureBytes -= target.bytes;
    this.freedBytes += target.bytes;
  }

  #blit(from: LayerLevel, to: LayerLevel, filter: GLenum): void {
    const gl = this.#gl;
    const isScissored = gl.isEnabled(gl.SCISSOR_TEST);
    // What three.js has bound is asked of the browser, which knows without waiting for the GPU.
    const read: WebGLFramebuffer | null = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
    const drawn: WebGLFramebuffer | null = gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
    const frames = [gl.createFramebuffer(), gl.createFramebuffer()] as const;
    const attach = (target: GLenum, frame: WebGLFramebuffer, { images, layer, level }: LayerLevel): void => {
      gl.bindFramebuffer(target, frame);
      gl.framebufferTextureLayer(target, gl.COLOR_ATTACHMENT0, images.texture, level, layer);
    };
    gl.disable(gl.SCISSOR_TEST);
    attach(gl.READ_FRAMEBUFFER, frames[0], from);
    attach(gl.DRAW_FRAMEBUFFER, frames[1], to);
    const [width, height] = sizeOf(from.images.form, from.level);
    const [toWidth, toHeight] = sizeOf(to.images.form, to.level);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, toWidth, toHeight, gl.COLOR_BUFFER_BIT, filter);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, read);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, drawn);
    if (isScissored) gl.enable(gl.SCISSOR_TEST);
    for (const frame of frames) gl.deleteFramebuffer(frame);
  }

  /** Through three.js, which remembers what is bound: asking WebGL would do, but some of the answers wait for the GPU. */
  #withTexture(texture: WebGLTexture, act: () => void): void {
    const { state } = this.#renderer;
    state.bindTexture(this.#gl.TEXTURE_2D_ARRAY, texture);
    act();
    state.unbindTexture();
  }

  /**
   * Run an action with the unpack state for uploads, then restore the state, as some versions of three.js cache parts of it.
   * The browser reads the state without asking the GPU.
   */
  #withUnpack(skipRows: number, act: () => void): void {
    const gl = this.#gl;
    const wanted: readonly (readonly [GLenum, number | boolean])[] = [
      [gl.UNPACK_FLIP_Y_WEBGL, false],
      [gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false],
      [gl.UNPACK_ALIGNMENT, 4],
      [gl.UNPACK_ROW_LENGTH, 0],
      [gl.UNPACK_IMAGE_HEIGHT, 0],
      [gl.UNPACK_SKIP_PIXELS, 0],
      [gl.UNPACK_SKIP_IMAGES, 0],
      [gl.UNPACK_SKIP_ROWS, skipRows],
    ];
    const found = wanted.map(([name]) => [name, gl.getParameter(name)] as const);
    for (const [name, value] of wanted) gl.pixelStorei(name, value);
    act();
    for (const [name, value] of found) gl.pixelStorei(name, value);
  }
}

/** A level of a layer. */
interface LayerLevel {
  readonly images: GpuImages;
  readonly layer: number;
  readonly level: number;
}

function levelsOf({ width, height }: ImageForm): number {
  return Math.floor(Math.log2(Math.max(width, height))) + 1;
}

function sizeOf({ width, height }: ImageForm, level: number): readonly [number, number] {
  return [Math.max(width >> level, 1), Math.max(height >> level, 1)];
}
