/**
 * The newest aim: noted, sent, and sent anew where a lost connection cut it short.
 *
 * PURE. Section numbers are those of `spec/wire-protocol.md`.
 */

import type { Vec3 } from "../types.ts";
import type { AimMessage } from "../wire/messages.generated.ts";
import { ringOf } from "./landing-state.ts";

interface Aim {
  readonly position: Vec3;
  readonly radiusM: number;
  readonly coarseRadiusM: number | undefined;
}

/** Where the user points. Older aims are forgotten; so are all once the user lands. */
export class AimState {
  #unsent: Aim | null = null;
  #sent: Aim | null = null;
  #generation = -1;

  /** Whether an aim is to be sent. */
  get waits(): boolean {
    return this.#unsent !== null;
  }

  /** Note the newest one, in place of any that waits. */
  note(position: Vec3, radiusM: number, coarseRadiusM: number | undefined): void {
    this.#unsent = { position, radiusM, coarseRadiusM };
  }

  /**
   * The message to send now, under a generation of this connection, whose server allows so large a radius; null where none
   * waits.
   */
  take(generation: number, maxRadiusM: number): AimMessage | null {
    const aim = this.#unsent;
    if (aim === null) return null;
    this.#unsent = null;
    this.#sent = aim;
    this.#generation = generation;
    const { position, radiusM, coarseRadiusM } = aim;
    const coarse_radius_m = ringOf(radiusM, coarseRadiusM, maxRadiusM);
    return { type: "aim", generation, position, radius_m: radiusM, coarse_radius_m };
  }

  /** Forget it: the user has landed. */
  clear(): void {
    this.#unsent = null;
    this.#sent = null;
  }

  /** Forget it where it was refused: it would be again. */
  refused(generation: number | undefined): void {
    if (generation !== undefined && generation === this.#generation) this.#sent = null;
  }

  /**
   * Send it anew on the next connection, unless all of it had come (7, rule 4).
   *
   * @param completedGeneration - generation of the newest aim of which everything has come.
   */
  connectionLost(completedGeneration: number): void {
    if (this.#unsent === null && this.#generation !== completedGeneration) this.#unsent = this.#sent;
    this.#generation = -1;
  }
}
