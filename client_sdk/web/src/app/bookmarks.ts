/**
 * Places that the user keeps, per scene, in the browser's storage.
 *
 * What is stored may have been written by another version of the page, or by hand: it is checked entry by entry.
 */

/** A kept place. */
export interface Bookmark {
  readonly id: string;
  readonly name: string;
  /** The place's address (see route.ts), with `#`. */
  readonly hash: string;
}

/** The part of `Storage` that is used; a browser may refuse its own. */
export interface KeyValueStorage {
  getItem(key: string): string | null;
  setItem(key: string, value: string): void;
}

/** More than anyone keeps, few enough for any browser's storage. */
export const MAX_BOOKMARKS = 200;
/** Longest name of a bookmark, characters. */
export const MAX_NAME_LENGTH = 80;

const FORMAT = "terraport-places";

/** The bookmarks of a scene, oldest first. */
export function readBookmarks(storage: KeyValueStorage, scene: string): readonly Bookmark[] {
  try {
    return checked(JSON.parse(storage.getItem(keyOf(scene)) ?? "[]"));
  } catch {
    return [];
  }
}

/** Store them; false where the browser refuses (no room, or storage is switched off). */
export function writeBookmarks(storage: KeyValueStorage, scene: string, bookmarks: readonly Bookmark[]): boolean {
  try {
    storage.setItem(keyOf(scene), JSON.stringify(bookmarks));
    return true;
  } catch {
    return false;
  }
}

/** With one more at the end; the same list where it is full. */
export function withBookmark(bookmarks: readonly Bookmark[], name: string, hash: string): readonly Bookmark[] {
  if (bookmarks.length >= MAX_BOOKMARKS) return bookmarks;
  const highest = bookmarks.reduce((max, { id }) => Math.max(max, Number(id) || 0), 0);
  return [...bookmarks, { id: String(highest + 1), name: cleanName(name, highest + 1), hash }];
}

/** With one renamed. An empty name keeps the old one. */
export function withRenamed(bookmarks: readonly Bookmark[], id: string, name: string): readonly Bookmark[] {
  const text = name.trim().slice(0, MAX_NAME_LENGTH);
  return bookmarks.map((bookmark) => (bookmark.id === id && text ? { ...bookmark, name: text } : bookmark));
}

/** Without one. */
export function withoutBookmark(bookmarks: readonly Bookmark[], id: string): readonly Bookmark[] {
  return bookmarks.filter((bookmark) => bookmark.id !== id);
}

/** A file's text for somebody else. */
export function exportBookmarks(scene: string, bookmarks: readonly Bookmark[]): string {
  const savedBookmarks = bookmarks.map(({ name, hash }) => ({ name, hash }));
  return `${JSON.stringify({ format: FORMAT, scene, places: savedBookmarks }, null, 2)}\n`;
}

/** With those of an exported file that are not there yet; null where the text is no such file. */
export function importBookmarks(bookmarks: readonly Bookmark[], text: string): readonly Bookmark[] | null {
  let document: unknown;
  try {
    document = JSON.parse(text);
  } catch {
    return null;
  }
  if (!isRecord(document) || document.format !== FORMAT || !Array.isArray(document.places)) return null;
  let merged = bookmarks;
  for (const candidate of document.places) {
    if (!isRecord(candidate) || typeof candidate.name !== "string" || !isHash(candidate.hash)) continue;
    const { name, hash } = candidate;
    if (!merged.some((bookmark) => bookmark.name === name && bookmark.hash === hash)) {
      merged = withBookmark(merged, name, hash as string);
    }
  }
  return merged;
}

function checked(document: unknown): readonly Bookmark[] {
  if (!Array.isArray(document)) return [];
  return document
    .filter(
      (entry): entry is Bookmark =>
        isRecord(entry) && typeof entry.id === "string" && typeof entry.name === "string" && isHash(entry.hash),
    )
    .slice(0, MAX_BOOKMARKS);
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null;
}

function isHash(value: unknown): value is string {
  return typeof value === "string" && value.startsWith("#") && value.length <= 2000;
}

function cleanName(name: string, number: number): string {
  return name.trim().slice(0, MAX_NAME_LENGTH) || `Place ${number}`;
}

function keyOf(scene: string): string {
  return `terraport.places.${scene}`;
}
