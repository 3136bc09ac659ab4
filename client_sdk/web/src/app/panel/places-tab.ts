/** Bookmarks: places that the user keeps in this browser. */

import {
  type Bookmark,
  exportBookmarks,
  importBookmarks,
  type KeyValueStorage,
  MAX_NAME_LENGTH,
  readBookmarks,
  withBookmark,
  withoutBookmark,
  withRenamed,
  writeBookmarks,
} from "../bookmarks.ts";
import { fill, h, setShown } from "../dom.ts";
import { formatArea } from "../format.ts";
import { icon } from "../icons.ts";
import type { RegionToVisit } from "../region-places.ts";
import { saveFile } from "../save-file.ts";

/** Where bookmarks are kept, and how to go to one. */
export interface PlacesOptions {
  readonly storage: KeyValueStorage;
  readonly scene: string;
  /** The section about going with others. */
  readonly together: HTMLElement;
  /** What has a name on the ground. */
  readonly regions: readonly RegionToVisit[];
  /** The address of what is shown now; null before the first landing. */
  currentHash(): string | null;
  go(hash: string): void;
  announce(text: string): void;
}

/** Bookmarks of one scene in this browser. */
export interface PlacesTab {
  readonly element: HTMLElement;
  /** Keep what is shown; false where nothing was landed on. */
  keep(): boolean;
  list(): readonly Bookmark[];
}

/** Build the tab over what the storage holds for the scene. */
export function createPlacesTab({
  storage,
  scene,
  together,
  regions,
  currentHash,
  go,
  announce,
}: PlacesOptions): PlacesTab {
  let bookmarks = readBookmarks(storage, scene);
  let renaming: string | null = null;

  const list = h("ul", { id: "places", class: "places", "aria-label": "Kept places" });
  const empty = h(
    "p",
    { class: "faint" },
    "Land somewhere and keep the place: it comes back with the view, the radius and the colours.",
  );
  const name = h("input", {
    id: "place-name",
    type: "text",
    maxlength: MAX_NAME_LENGTH,
    placeholder: "North wall, crack",
  });
  const form = h(
    "form",
    {
      class: "keep-form",
      on: {
        submit: (event) => {
          event.preventDefault();
          keep();
        },
      },
    },
    h("label", { for: "place-name" }, "Name of this place"),
    h(
      "div",
      { class: "row" },
      name,
      h("button", { type: "submit", class: "button primary", "data-action": "keep" }, "Keep"),
    ),
  );
  const file = h("input", {
    type: "file",
    accept: ".json,application/json",
    class: "visually-hidden",
    tabindex: -1,
    "aria-label": "File with places",
    on: { change: () => void importFile() },
  });
  const exportButton = h("button", { type: "button", class: "button", on: { click: exportFile } }, "Export");
  const importButton = h("button", { type: "button", class: "button", on: { click: () => file.click() } }, "Import");

  // --- Keep, list, rename: every change goes through `save`, which writes first and shows what is kept then.
  function save(next: readonly Bookmark[]): void {
    bookmarks = next;
    if (!writeBookmarks(storage, scene, bookmarks))
      announce("The browser does not keep places: its storage is full or off.");
    show();
  }

  function keep(): boolean {
    const hash = currentHash();
    if (hash === null) {
      announce("Land somewhere first: a place is kept with its detail.");
      return false;
    }
    const countBefore = bookmarks.length;
    save(withBookmark(bookmarks, name.value, hash));
    const newest = bookmarks[bookmarks.length - 1];
    announce(
      bookmarks.length > countBefore ? `Kept as ${newest?.name}` : "There are too many places; delete some first.",
    );
    name.value = "";
    return true;
  }

  function show(): void {
    setShown(empty, bookmarks.length === 0);
    exportButton.disabled = bookmarks.length === 0;
    fill(list, ...bookmarks.map((bookmark) => (bookmark.id === renaming ? renameRow(bookmark) : row(bookmark))));
  }

  function row(bookmark: Bookmark): HTMLElement {
    const button = (action: string, title: string, image: "edit" | "delete", run: () => void) =>
      h(
        "button",
        {
          type: "button",
          class: "icon-button",
          "data-action": action,
          "aria-label": `${title} ${bookmark.name}`,
          title,
          on: { click: run },
        },
        icon(image),
      );
    return h(
      "li",
      { "data-place": bookmark.id },
      h(
        "button",
        { type: "button", class: "place-go", "data-action": "go", on: { click: () => go(bookmark.hash) } },
        icon("go"),
        bookmark.name,
      ),
      button("rename", "Rename", "edit", () => {
        renaming = bookmark.id;
        show();
        list.querySelector<HTMLInputElement>("input")?.select();
      }),
      button("delete", "Delete", "delete", () => {
        save(withoutBookmark(bookmarks, bookmark.id));
        announce(`Deleted ${bookmark.name}`);
        name.focus();
      }),
    );
  }

  function renameRow(bookmark: Bookmark): HTMLElement {
    const input = h("input", {
      type: "text",
      maxlength: MAX_NAME_LENGTH,
      value: bookmark.name,
      "aria-label": `New name of ${bookmark.name}`,
    });
    const finish = (text: string) => {
      renaming = null;
      save(withRenamed(bookmarks, bookmark.id, text));
      list.querySelector<HTMLElement>(`[data-place="${CSS.escape(bookmark.id)}"] [data-action="rename"]`)?.focus();
    };
    input.addEventListener("keydown", (event) => {
      if (event.key === "Escape") {
        event.stopPropagation();
        finish("");
      }
    });
    const form = h(
      "form",
      {
        class: "row",
        on: {
          submit: (event) => {
            event.preventDefault();
            finish(input.value);
          },
        },
      },
      input,
      h("button", { type: "submit", class: "button" }, "Save"),
    );
    return h("li", { "data-place": bookmark.id }, form);
  }

  function exportFile(): void {
    saveFile(new Blob([exportBookmarks(scene, bookmarks)], { type: "application/json" }), `${scene}-places.json`);
  }

  async function importFile(): Promise<void> {
    const chosen = file.files?.[0];
    file.value = "";
    if (chosen === undefined) return;
    // A list of places is some kilobytes; a file of another kind is not read into memory.
    const merged = chosen.size > 1_000_000 ? null : importBookmarks(bookmarks, await chosen.text());
    if (merged === null) {
      announce("That file has no places of terraport.");
      return;
    }
    const added = merged.length - bookmarks.length;
    save(merged);
    announce(`${added} ${added === 1 ? "place" : "places"} added`);
  }

  show();
  return {
    element: h(
      "div",
      { class: "tab-content" },
      form,
      empty,
      list,
      h("div", { class: "row" }, exportButton, importButton, file),
      together,
      ...(regions.length === 0 ? [] : [namedRegions(regions, go)]),
    ),
    keep,
    list: () => bookmarks,
  };
}

/** "Take me to": a click lands where the region is seen best. */
function namedRegions(regions: readonly RegionToVisit[], go: (hash: string) => void): HTMLElement {
  const rows = regions.map(({ name, areaM2, hash }) =>
    h(
      "li",
      {},
      h(
        "button",
        { type: "button", class: "place-go", "data-action": "go-to-region", on: { click: () => go(hash) } },
        icon("go"),
        h("span", { class: "region-name" }, name),
        h("span", { class: "faint number" }, formatArea(areaM2)),
      ),
    ),
  );
  return h(
    "section",
    { "aria-label": "Named regions" },
    h("h2", {}, "Take me to"),
    h("ul", { id: "named-regions", class: "places" }, ...rows),
  );
}
