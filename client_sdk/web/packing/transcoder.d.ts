/** Write `src/core/transcoder/` where it is not there. */
export function prepareTranscoder(): void;
