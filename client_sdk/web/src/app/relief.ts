/** A few contour lines for a scene's card: drawn from its id, so that a scene is known again at a glance. */

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 320;
const HEIGHT = 128;
const LINES = 9;

/** An ornament; says nothing, and is hidden from assistive technology. */
export function relief(seed: string): SVGSVGElement {
  const random = randomOf(seed);
  const centreX = WIDTH * (0.25 + 0.5 * random());
  const centreY = HEIGHT * (0.35 + 0.4 * random());
  const waves = [2, 3, 5].map((count) => ({
    count,
    size: (0.28 * random()) / Math.sqrt(count),
    phase: 6.28 * random(),
  }));
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute("preserveAspectRatio", "xMidYMid slice");
  svg.setAttribute("class", "relief");
  svg.setAttribute("aria-hidden", "true");
  for (let line = 1; line <= LINES; line += 1) {
    const path = document.createElementNS(SVG, "path");
    let d = "";
    for (let step = 0; step <= 72; step += 1) {
      const angle = (step / 72) * Math.PI * 2;
      // Outer lines are smoother, and none crosses another: the wave grows with the radius in the same way for all.
      const swell = waves.reduce((sum, wave) => sum + wave.size * Math.sin(wave.count * angle + wave.phase), 1);
      const radius = line * 19 * swell;
      d += `${step === 0 ? "M" : "L"}${(centreX + Math.cos(angle) * radius * 1.35).toFixed(1)} ${(centreY + Math.sin(angle) * radius * 0.8).toFixed(1)}`;
    }
    path.setAttribute("d", `${d}Z`);
    path.setAttribute("opacity", String(0.75 - line * 0.065));
    svg.append(path);
  }
  return svg;
}

/** FNV-1a, then xorshift: the same line for the same id everywhere. */
function randomOf(seed: string): () => number {
  let state = 2166136261;
  for (const character of seed) {
    state = Math.imul(state ^ character.charCodeAt(0), 16777619);
  }
  return () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 4294967296;
  };
}
