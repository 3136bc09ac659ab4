/** What every page of the app shares. */

import { StreamError } from "../core/scene/errors.ts";
import type { Announcer } from "./announcer.ts";
import type { KeyValueStorage } from "./bookmarks.ts";
import type { ThemeSwitch } from "./theme.ts";
import type { TokenKeeper } from "./token.ts";

/** Made once in main.ts, and given to every page; pages neither replace nor dispose it. */
export interface Shell {
  /** Of the service that served the page, also behind a proxy's prefix; ends in a slash. */
  readonly serverUrl: string;
  readonly theme: ThemeSwitch;
  readonly token: TokenKeeper;
  readonly announcer: Announcer;
  readonly storage: KeyValueStorage;
  codeOf(error: unknown): string;
}

/** The service's code for what went wrong; `failed` where it has none. */
export function codeOf(error: unknown): string {
  return error instanceof StreamError ? error.code : "failed";
}
