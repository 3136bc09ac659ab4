/** Every failure says what happened and what to do. */

import { describe, expect, test } from "vitest";
import { linkNotice, loadFailure, type Notice, REMEDY_NAMES, refusalNotice } from "../src/app/failures.ts";

const closed = (code: string): Notice =>
  linkNotice({ state: "closed", closeCode: 4400, code, message: "got x, expected y" }, true, 0)!;
const waiting = (code: string): Notice =>
  linkNotice({ state: "waiting", attempt: 2, retryInMs: 3000, closeCode: 1006, code, message: "lost" }, true, 10_000)!;

describe("a link", () => {
  test("that is well says nothing", () => {
    expect(linkNotice({ state: "open" }, true, 0)).toBeNull();
    expect(linkNotice({ state: "connecting", attempt: 1 }, false, 0)).toBeNull();
  });

  test("that was lost counts down, keeps what is shown, and can be hurried", () => {
    const notice = waiting("lost");
    expect(notice.untilMs).toBe(13_000);
    expect(notice.text).toContain("{seconds}");
    expect(notice.text).toContain("stays");
    expect(notice.remedies).toEqual(["reconnect"]);
  });

  test("to a full server says so", () => {
    expect(waiting("too_many").title).toBe("The server is full");
    expect(waiting("draining").title).toBe("The server restarts");
  });

  test.each([
    ["unauthorised", "token"],
    ["forbidden", "token"],
    ["unknown_scene", "scenes"],
    ["unsupported_version", "reload-page"],
    ["a_code_of_tomorrow", "reconnect"],
  ] as const)("that was ended with %s offers %s", (code, remedy) => {
    const notice = closed(code);
    expect(notice.tone).toBe("failure");
    expect(notice.remedies).toContain(remedy);
    for (const each of notice.remedies) expect(REMEDY_NAMES[each]).toBeTruthy();
  });

  test("shows the service's words as a sentence where it has none of its own", () => {
    expect(closed("a_code_of_tomorrow").text).toBe("Got x, expected y.");
  });
});

test("a radius that is too large tells the largest, and offers it", () => {
  const notice = refusalNotice("radius_too_large", "", 500);
  expect(notice.text).toContain("500 m");
  expect(notice.remedies).toContain("smaller-radius");
  expect(refusalNotice("radius_too_large", "", null).remedies).not.toContain("smaller-radius");
  expect(refusalNotice("invalid_field", "position: not finite", 500).text).toBe("Position: not finite.");
});

test("what could not be loaded says what to do", () => {
  for (const code of ["unauthorised", "forbidden", "unknown_scene", "too_many", "draining", "unreachable"]) {
    const { title, text } = loadFailure(code, "no answer");
    expect(title.length).toBeGreaterThan(5);
    expect(text).toMatch(/\.$/);
  }
});
