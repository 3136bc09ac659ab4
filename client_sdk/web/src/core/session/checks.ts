/**
 * What the caller says, checked before anything is sent.
 *
 * PURE.
 */

import type { GroupCommand } from "../group-types.ts";
import type { LandOptions, Vec3 } from "../types.ts";
import { encodeMessage } from "../wire/codec.ts";
import { InvalidMessageError } from "../wire/errors.ts";
import type { ClientMessage } from "../wire/messages.generated.ts";
import { arrivedMessage, gatherMessage, joinMessage } from "./group-state.ts";
import { landMessage } from "./landing-state.ts";

/** @throws RangeError on a number that the protocol does not allow. */
export function checkLand(position: Vec3, radiusM: number, options: LandOptions): void {
  check(landMessage(0, position, radiusM, options));
}

/** @throws RangeError on a number that the protocol does not allow. */
export function checkAim(position: Vec3, radiusM: number, coarseRadiusM: number | undefined): void {
  check({ type: "aim", generation: 0, position, radius_m: radiusM, coarse_radius_m: coarseRadiusM });
}

/** @throws RangeError on a number that the protocol does not allow. */
export function checkPick(origin: Vec3, direction: Vec3 | undefined): void {
  check({ type: "pick", request: 0, origin, direction });
}

/** @throws RangeError on a name or number that the protocol does not allow. */
export function checkGroup(command: GroupCommand): void {
  if (command.type === "join") check(joinMessage(command, 0));
  else if (command.type === "gather") check(gatherMessage(command, 0));
  else if (command.type === "arrive") check(arrivedMessage(command));
}

/** @throws RangeError on a value that the protocol does not allow. */
export function check(message: ClientMessage): void {
  try {
    encodeMessage(message);
  } catch (error) {
    if (error instanceof InvalidMessageError) throw new RangeError(error.message, { cause: error });
    throw error;
  }
}
