/** Files that the page gives its user. */

import { h } from "./dom.ts";

/** Long enough for any browser to have begun. */
const KEPT_MS = 10_000;

/** Save under a name, as a click on a link would. */
export function saveFile(content: Blob, fileName: string): void {
  const url = URL.createObjectURL(content);
  h("a", { href: url, download: fileName }).click();
  window.setTimeout(() => URL.revokeObjectURL(url), KEPT_MS);
}
