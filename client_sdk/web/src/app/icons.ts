/** The page's icons: strokes of one width on a grid of 24. Always beside or inside something that has a name. */

const PATHS = {
  back: ["M14.5 5.5 8 12l6.5 6.5"],
  orbit: ["M12 4.5a7.5 7.5 0 1 0 7.5 7.5", "M19.5 4.5v4h-4", "M12 9.8a2.2 2.2 0 1 0 0 4.4 2.2 2.2 0 0 0 0-4.4z"],
  walk: [
    "M13 3.6a1.6 1.6 0 1 0 0 3.2 1.6 1.6 0 0 0 0-3.2z",
    "M12.5 9 9 11v3.5",
    "M12.5 9l-1 6 3 5.5",
    "M11.5 15 8.5 20.5",
    "M12.5 9l2.5 3 3 1",
  ],
  land: ["M12 3v11", "M8 10.5l4 4 4-4", "M5 17.5c2 2 4.3 3 7 3s5-1 7-3"],
  pick: ["M12 3.5v4", "M12 16.5v4", "M3.5 12h4", "M16.5 12h4", "M12 11.2a.8.8 0 1 0 0 1.6.8.8 0 0 0 0-1.6z"],
  measure: ["M4 16.5 16.5 4 20 7.5 7.5 20z", "M8 12.5l2 2", "M11 9.5l1.5 1.5", "M14 6.5l2 2"],
  brush: [
    "M14.5 4.5 19.5 9.5",
    "M16 3.5a2.5 2.5 0 0 1 4.5 4L12 16l-4-4z",
    "M8 12c-2.5.5-3 2.5-3 4.5-.3 1.5-1 2.5-2 3 4 .7 8.5 0 9-3.5",
  ],
  compare: ["M12 3.5v17", "M9 7 4.5 12 9 17", "M15 7l4.5 5-4.5 5"],
  home: ["M4 11.5 12 4.5l8 7", "M6.5 10v9h11v-9"],
  sun: [
    "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8z",
    "M12 2.8v2",
    "M12 19.2v2",
    "M2.8 12h2",
    "M19.2 12h2",
    "M5.5 5.5l1.4 1.4",
    "M17.1 17.1l1.4 1.4",
    "M5.5 18.5l1.4-1.4",
    "M17.1 6.9l1.4-1.4",
  ],
  moon: ["M19.5 14.5A8 8 0 1 1 9.5 4.5a6.5 6.5 0 0 0 10 10z"],
  auto: ["M12 3.8a8.2 8.2 0 1 0 0 16.4 8.2 8.2 0 0 0 0-16.4z", "M12 4v16", "M12 8h6.5", "M12 12h8", "M12 16h6.5"],
  headset: [
    "M4 8.5h16a1 1 0 0 1 1 1v6a1.5 1.5 0 0 1-1.5 1.5H16l-2.2-2.6a2.3 2.3 0 0 0-3.6 0L8 17H4.5A1.5 1.5 0 0 1 3 15.5v-6a1 1 0 0 1 1-1z",
  ],
  help: [
    "M12 3.8a8.2 8.2 0 1 0 0 16.4 8.2 8.2 0 0 0 0-16.4z",
    "M9.8 9.8a2.3 2.3 0 1 1 3.4 2c-.8.5-1.2 1-1.2 2",
    "M12 16.4v.1",
  ],
  panel: ["M4 5.5h16v13H4z", "M14.5 5.5v13"],
  close: ["M6 6l12 12", "M18 6 6 18"],
  copy: ["M9 9h10v11H9z", "M15 9V4H5v11h4"],
  link: ["M10 14a4 4 0 0 0 5.7 0l3-3A4 4 0 0 0 13 5.3l-1 1", "M14 10a4 4 0 0 0-5.7 0l-3 3A4 4 0 0 0 11 18.7l1-1"],
  edit: ["M5 19l1-4L15.5 5.5l3 3L9 18z", "M13.5 7.5l3 3"],
  delete: ["M5 7h14", "M9.5 7V4.5h5V7", "M7 7l.8 12.5h8.4L17 7"],
  go: ["M5 12h13", "M13 7l5 5-5 5"],
  undo: ["M9 6 5 10l4 4", "M5 10h9a5 5 0 0 1 0 10h-3"],
  warn: ["M12 4 21 19.5H3z", "M12 10v4.5", "M12 17v.1"],
  key: ["M8.5 11.5a4 4 0 1 0 0 8 4 4 0 0 0 0-8z", "M11.5 12.5 20 4", "M16.5 7.5l3 3"],
  report: ["M6 3.5h8.5L18 7v13.5H6z", "M9 11h6", "M9 14.5h6", "M9 18h4"],
  mountain: ["M2.5 19 9 7.5l4 7 2.5-4 6 8.5z"],
} as const;

/** The icons there are. */
export type IconName = keyof typeof PATHS;

const SVG = "http://www.w3.org/2000/svg";

/** Draw an icon; it is hidden from assistive technology, its button has the name. */
export function icon(name: IconName): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  svg.setAttribute("focusable", "false");
  for (const d of PATHS[name]) {
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("d", d);
    svg.append(path);
  }
  return svg;
}
