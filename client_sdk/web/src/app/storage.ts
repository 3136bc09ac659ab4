/** The browser's storage, or a stand-in for this visit where it is refused (a private window, a strict policy). */

import type { KeyValueStorage } from "./bookmarks.ts";

/** Storage that keeps over visits. */
export function localStorageOrMemory(): KeyValueStorage {
  return usable(() => window.localStorage);
}

/** Storage of this tab: for a token, which must not outlive it. */
export function sessionStorageOrMemory(): KeyValueStorage {
  return usable(() => window.sessionStorage);
}

function usable(get: () => Storage): KeyValueStorage {
  try {
    const storage = get();
    storage.getItem("terraport");
    return storage;
  } catch {
    const values = new Map<string, string>();
    return {
      getItem: (key) => values.get(key) ?? null,
      setItem: (key, value) => {
        values.set(key, value);
      },
    };
  }
}
