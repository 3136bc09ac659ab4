/** What people paint on a scene, and what that has taught. */

/** What is painted on the ground with one stroke. */
export interface Stroke {
  readonly name: string;
  /** `#rrggbb`. */
  readonly colour: string;
  readonly widthM: number;
  /** x and z of the scene frame, 2 to 256. */
  readonly line: readonly (readonly [number, number])[];
}

/** A stroke that the service keeps. */
export interface PaintedStroke extends Stroke {
  readonly id: string;
  readonly who: string;
  /** UTC. */
  readonly when: string;
  /** Whether it can be taken back with this token. */
  readonly isOwn: boolean;
}

/** A name that ground was taught. */
export interface TaughtName {
  readonly name: string;
  /** `#rrggbb`. */
  readonly colour: string;
  readonly areaM2: number;
  /** Mean probability, 0 to 1. */
  readonly confidence: number;
}

/** What strokes have taught: squares of the ground, seen from above. */
export interface TaughtPicture {
  readonly names: readonly TaughtName[];
  /** Rows run with z, columns with x. */
  readonly rows: number;
  readonly columns: number;
  readonly cellM: number;
  /** x and z where the first square begins. */
  readonly cornerM: readonly [number, number];
  /** Place in `names`, 255 without ground. */
  readonly kind: Uint8Array<ArrayBuffer>;
  /** 0 sure to 255 two names equally likely. */
  readonly doubt: Uint8Array<ArrayBuffer>;
  /** Where a next stroke pays most, best first. */
  readonly places: readonly {
    readonly position: readonly [number, number];
    readonly doubt: number;
    readonly likeliest: string;
    readonly other: string;
  }[];
}

/** The answer to strokes. */
export interface TaughtGround {
  /** Of the strokes that it answers. */
  readonly revision: string;
  /** `taught`, `published` or `refused`. */
  readonly state: string;
  /** For people. */
  readonly text: string;
  /** Null where they were refused. */
  readonly picture: TaughtPicture | null;
}
