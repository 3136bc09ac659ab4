/** What a headset is asked for: frame rate, resolution, foveation. Chosen by the device, once, when the session begins. */

export interface HeadsetProfile {
  /** Frames per second asked for; the highest supported that does not exceed it is taken. */
  readonly frameRateHz: number;
  /** Of the resolution that the system recommends. */
  readonly framebufferScale: number;
  /** 0 none, 1 the most: how coarsely the rim of the view may be drawn. */
  readonly foveation: number;
  /** Milliseconds a frame for uploads: a share of what the frame rate leaves. */
  readonly uploadBudgetMs: number;
}

/** Headsets with a graphics processor of 2020 or before: 72 Hz, a coarser rim. */
const OLDER = /Quest 2|Quest 1|Quest\)|Quest;|Pico Neo|PICO Neo|VIVE Focus/i;
/** Headsets that draw by themselves, whatever their age. */
const STANDALONE = /OculusBrowser|Quest|Pico|Wolvic|VIVE|VisionOS/i;

const OLDER_STANDALONE: HeadsetProfile = {
  frameRateHz: 72,
  framebufferScale: 0.9,
  foveation: 0.8,
  uploadBudgetMs: 1.5,
};
const NEWER_STANDALONE: HeadsetProfile = { frameRateHz: 90, framebufferScale: 1, foveation: 0.5, uploadBudgetMs: 2 };
/** On a computer the graphics card has room, and foveation shows on a sharp panel. */
const TETHERED: HeadsetProfile = { frameRateHz: 90, framebufferScale: 1, foveation: 0, uploadBudgetMs: 2 };

/** The profile of a device, by its user agent; an unknown one counts as a computer with a headset. */
export function profileOf(userAgent: string): HeadsetProfile {
  if (OLDER.test(userAgent)) {
    return OLDER_STANDALONE;
  }
  return STANDALONE.test(userAgent) ? NEWER_STANDALONE : TETHERED;
}

/** The highest supported rate not above the wanted one, else the lowest; null where the system offers no choice. */
export function chooseFrameRate(supported: ArrayLike<number> | null | undefined, wantedHz: number): number | null {
  let below: number | null = null;
  let lowest: number | null = null;
  for (let k = 0; k < (supported?.length ?? 0); k++) {
    const rate = supported![k]!;
    lowest = lowest === null ? rate : Math.min(lowest, rate);
    // Rates come as float32 and some systems say 89.99.
    if (rate <= wantedHz + 0.5 && (below === null || rate > below)) {
      below = rate;
    }
  }
  return below ?? lowest;
}
