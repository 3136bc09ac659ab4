/** Frame times as bars, newest right, with lines at 60 and 30 frames a second. */

const WIDTH = 300;
const HEIGHT = 56;
/** The whole height; longer frames are cut, and told in words. */
const FULL_MS = 50;

/** Draw into a canvas; its colours are the page's. */
export function drawSparkline(canvas: HTMLCanvasElement, times: readonly number[]): void {
  const scale = window.devicePixelRatio;
  if (canvas.width !== WIDTH * scale || canvas.height !== HEIGHT * scale) {
    canvas.width = WIDTH * scale;
    canvas.height = HEIGHT * scale;
  }
  const context = canvas.getContext("2d");
  if (context === null) return;
  const style = getComputedStyle(canvas);
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, WIDTH, HEIGHT);
  const yOf = (ms: number) => HEIGHT - (Math.min(ms, FULL_MS) / FULL_MS) * HEIGHT;
  context.strokeStyle = style.getPropertyValue("border-top-color");
  context.setLineDash([3, 3]);
  for (const ms of [1000 / 60, 1000 / 30]) {
    context.beginPath();
    context.moveTo(0, yOf(ms));
    context.lineTo(WIDTH, yOf(ms));
    context.stroke();
  }
  context.setLineDash([]);
  context.fillStyle = style.color;
  const recent = times.slice(-WIDTH / 2);
  for (const [index, ms] of recent.entries()) {
    const x = WIDTH - (recent.length - index) * 2;
    context.fillRect(x, yOf(ms), 1.4, HEIGHT - yOf(ms));
  }
}
