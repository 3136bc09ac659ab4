/** Places that are kept: in a storage that may be full, off, or written by somebody else. */

import { describe, expect, test } from "vitest";
import {
  exportBookmarks,
  importBookmarks,
  type KeyValueStorage,
  MAX_BOOKMARKS,
  readBookmarks,
  withBookmark,
  withoutBookmark,
  withRenamed,
  writeBookmarks,
} from "../src/app/bookmarks.ts";

function memoryStorage(entries: Record<string, string> = {}): KeyValueStorage {
  const values = new Map(Object.entries(entries));
  return { getItem: (key) => values.get(key) ?? null, setItem: (key, value) => void values.set(key, value) };
}

const TWO = withBookmark(withBookmark([], "North wall", "#scene=pit&at=1,2,3"), "", "#scene=pit&at=4,5,6");

describe("bookmarks", () => {
  test("are named, numbered and kept by scene", () => {
    expect(TWO.map(({ id, name }) => [id, name])).toEqual([
      ["1", "North wall"],
      ["2", "Place 2"],
    ]);
    const storage = memoryStorage();
    expect(writeBookmarks(storage, "pit", TWO)).toBe(true);
    expect(readBookmarks(storage, "pit")).toEqual(TWO);
    expect(readBookmarks(storage, "other")).toEqual([]);
  });

  test("are renamed and deleted; a number is not given twice", () => {
    expect(withRenamed(TWO, "2", "  Crack  ")[1]?.name).toBe("Crack");
    expect(withRenamed(TWO, "2", "   ")[1]?.name).toBe("Place 2");
    const remaining = withoutBookmark(TWO, "1");
    expect(withBookmark(remaining, "new", "#x").map(({ id }) => id)).toEqual(["2", "3"]);
  });

  test("end where they are too many", () => {
    let bookmarks = TWO;
    for (let index = 0; index < MAX_BOOKMARKS + 5; index += 1) bookmarks = withBookmark(bookmarks, "x", "#x");
    expect(bookmarks).toHaveLength(MAX_BOOKMARKS);
  });

  test("survive a storage that is refused or spoiled", () => {
    const broken: KeyValueStorage = {
      getItem: () => {
        throw new Error("denied");
      },
      setItem: () => {
        throw new Error("full");
      },
    };
    expect(readBookmarks(broken, "pit")).toEqual([]);
    expect(writeBookmarks(broken, "pit", TWO)).toBe(false);
    for (const text of ["", "nonsense", "{}", "[null, 3]", '[{"id":"1","name":"a","hash":"javascript:alert(1)"}]']) {
      expect(readBookmarks(memoryStorage({ "terraport.places.pit": text }), "pit")).toEqual([]);
    }
  });

  test("go into a file and come back, without doubles", () => {
    const file = exportBookmarks("pit", TWO);
    expect(importBookmarks([], file)?.map(({ name, hash }) => ({ name, hash }))).toEqual(
      TWO.map(({ name, hash }) => ({ name, hash })),
    );
    expect(importBookmarks(TWO, file)).toEqual(TWO);
    expect(importBookmarks(TWO, "not json")).toBeNull();
    expect(importBookmarks(TWO, '{"format":"other","places":[]}')).toBeNull();
  });
});
