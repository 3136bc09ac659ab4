/** Buffers and textures of WebGL, created empty, filled in slices, and counted. */

import type { WebGLRenderer } from "three";

import { imageBytes } from "../core/gpu-budget.ts";
import type { CompressedImage, MeshImage } from "../core/types.ts";

/** A buffer and its size; `null` once freed. */
export interface GpuBuffer {
  readonly buffer: WebGLBuffer;
  readonly bytes: number;
}

/** A texture with all its mips, and its size. */
export interface GpuTexture {
  readonly texture: WebGLTexture;
  readonly width: number;
  readonly height: number;
  readonly bytes: number;
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

  /** An empty texture of sRGB colours with all its mips, in the image's own form. */
  createTexture(image: MeshImage): GpuTexture {
    const gl = this.#gl;
    const { width, height, pixels } = image;
    let form: GLenum = gl.SRGB8_ALPHA8;
    if ("levels" in pixels) {
      ({ form } = pixels);
      if (pixels.extension !== null) gl.getExtension(pixels.extension); // Its forms are unknown before.
    }
    const texture = gl.createTexture();
    const anisotropy = gl.getExtension("EXT_texture_filter_anisotropic"); // Lost with the context, so asked for each time.
    const levels = Math.floor(Math.log2(Math.max(width, height))) + 1;
    this.#withTexture(texture, () => {
      gl.texStorage2D(gl.TEXTURE_2D, levels, form, width, height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      if (anisotropy) {
        gl.texParameteri(gl.TEXTURE_2D, anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, ANISOTROPY);
      }
    });
    const bytes = imageBytes(image);
    this.textureBytes += bytes;
    this.createdBytes += bytes;
    return { texture, width, height, bytes };
  }

  /** Write `rows` rows of the image from row `top` on; (0, 0) is its upper left corner, as in glTF. */
  writeTextureRows(target: GpuTexture, image: ImageBitmap, top: number, rows: number): void {
    const gl = this.#gl;
    this.#withTexture(target.texture, () => {
      this.#withUnpack(top, () => {
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, top, target.width, rows, gl.RGBA, gl.UNSIGNED_BYTE, image);
      });
    });
  }

  /** Write one level of an image that comes as a GPU keeps it. */
  writeTextureLevel(target: GpuTexture, image: CompressedImage, level: number): void {
    const gl = this.#gl;
    const width = Math.max(target.width >> level, 1);
    const height = Math.max(target.height >> level, 1);
    const data = image.levels[level]!;
    this.#withTexture(target.texture, () => {
      this.#withUnpack(0, () => {
        if (image.extension === null) {
          gl.texSubImage2D(gl.TEXTURE_2D, level, 0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);
        } else {
          gl.compressedTexSubImage2D(gl.TEXTURE_2D, level, 0, 0, width, height, image.form, data);
        }
      });
    });
  }

  /** Once all rows are written. */
  makeMips(target: GpuTexture): void {
    this.#withTexture(target.texture, () => this.#gl.generateMipmap(this.#gl.TEXTURE_2D));
  }

  freeTexture(target: GpuTexture): void {
    this.#gl.deleteTexture(target.texture);
    this.textureBytes -= target.bytes;
    this.freedBytes += target.bytes;
  }

  /** Through three.js, which remembers what is bound: asking WebGL would do, but some of the answers wait for the GPU. */
  #withTexture(texture: WebGLTexture, act: () => void): void {
    const { state } = this.#renderer;
    state.bindTexture(this.#gl.TEXTURE_2D, texture);
    act();
    state.unbindTexture();
  }

  #withUnpack(skipRows: number, act: () => void): void {
    const gl = this.#gl;
    // Remembered by three.js as well. Its types lack the function.
    const state = this.#renderer.state as unknown as { pixelStorei(name: GLenum, value: number | boolean): void };
    state.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    state.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    state.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    state.pixelStorei(gl.UNPACK_ROW_LENGTH, 0);
    state.pixelStorei(gl.UNPACK_SKIP_PIXELS, 0);
    state.pixelStorei(gl.UNPACK_SKIP_ROWS, skipRows);
    act();
    state.pixelStorei(gl.UNPACK_SKIP_ROWS, 0); // The one that three.js takes for granted.
  }
}
