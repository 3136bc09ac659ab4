/** A value that its kind does not allow; never leaves core/wire: callers see DecodeError or InvalidMessageError. */

/** `path` names the place below the field. */
export class Refused extends Error {
  readonly path: string;

  constructor(text: string, path = "") {
    super(text);
    this.path = path;
  }
}

/** Run a step whose refusals lie below `path`. */
export function below<T>(path: string, step: () => T): T {
  try {
    return step();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    throw new Refused(error.message, error.path === "" ? path : `${path}.${error.path}`);
  }
}
