/** A value that is replaced, never changed, and tells who listens. */

/** A value that can be watched. */
export interface Store<T extends object> {
  get(): T;
  /** Replace some fields. Listeners run at once, unless no field differs. */
  set(patch: Partial<T>): void;
  /** Call `listener` after each change; returns how to stop. */
  subscribe(listener: (state: T, before: T) => void): () => void;
}

/** Holds `initial` until the first `set`. */
export function createStore<T extends object>(initial: T): Store<T> {
  let state = initial;
  const listeners = new Set<(state: T, before: T) => void>();
  return {
    get: () => state,
    set(patch) {
      const changed = (Object.keys(patch) as (keyof T)[]).some((key) => !Object.is(patch[key], state[key]));
      if (!changed) return;
      const before = state;
      state = { ...state, ...patch };
      for (const listener of listeners) listener(state, before);
    },
    subscribe(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
  };
}
