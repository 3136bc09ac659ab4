/**
 * The two forms of the study: SSQ (Kennedy, Lane, Berbaum and Lilienthal 1993) and VRSQ (Kim, Park, Choi and Choe 2018). The
 * symptoms of VRSQ are nine of SSQ's; both are asked at once, and answered 0 to 3.
 */

import { h } from "../app/dom.ts";
import type { FormAnswers } from "./log.ts";

/** In the order of the SSQ; terraport_research scores by it. */
export const SYMPTOMS = [
  "General discomfort",
  "Fatigue",
  "Headache",
  "Eye strain",
  "Difficulty focusing",
  "Increased salivation",
  "Sweating",
  "Nausea",
  "Difficulty concentrating",
  "Fullness of head",
  "Blurred vision",
  "Dizziness with eyes open",
  "Dizziness with eyes closed",
  "Vertigo",
  "Stomach awareness",
  "Burping",
] as const;

/** The VRSQ's nine, as rows of the SSQ: oculomotor first, then disorientation. */
export const VRSQ_ROWS = [0, 1, 3, 4, 2, 9, 10, 12, 13] as const;

const LEVELS = ["None", "Slight", "Moderate", "Severe"] as const;

/** Ask; resolves when every row is answered. */
export function askForms(root: HTMLElement, when: "before" | "after", nowMs: () => number): Promise<FormAnswers[]> {
  return new Promise((resolve) => {
    const rows = SYMPTOMS.map((symptom, row) =>
      h(
        "fieldset",
        { class: "symptom" },
        h("legend", {}, symptom),
        ...LEVELS.map((level, value) =>
          h("label", {}, h("input", { type: "radio", name: `symptom-${row}`, value, required: true }), level),
        ),
      ),
    );
    const form = h(
      "form",
      { class: "study-form", id: `form-${when}` },
      h("h1", {}, when === "before" ? "Before you begin" : "Now that you are back"),
      h("p", {}, "How much does each of these affect you right now?"),
      ...rows,
      h("button", { type: "submit", class: "button primary" }, "Done"),
    ) as HTMLFormElement;
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const fields = new FormData(form);
      const ssq = SYMPTOMS.map((_, row) => Number(fields.get(`symptom-${row}`)));
      form.remove();
      const tMs = nowMs();
      resolve([
        { name: "SSQ", when, tMs, answers: ssq },
        { name: "VRSQ", when, tMs, answers: VRSQ_ROWS.map((row) => ssq[row]!) },
      ]);
    });
    root.append(form);
  });
}
