import { defineConfig } from "vitest/config";
import { compress } from "./packing/compress.ts";
import { notices } from "./packing/notices.ts";
import { prepareTranscoder } from "./packing/transcoder.js";

prepareTranscoder();
const licences = notices();

// The page is served from wherever terraport's service is reached, also behind a proxy's prefix: every address in it is
// relative. The service ships the folder `page` inside its package.
export default defineConfig({
  base: "./",
  plugins: [licences.page, compress()],
  build: {
    outDir: "../../server/terraport_server/page",
    emptyOutDir: true,
    // The study is a page of its own: what it has beside the viewer nobody else loads.
    rollupOptions: { input: ["index.html", "study.html"] },
    target: "es2022",
    // A data: address would need an exception in the page's Content-Security-Policy.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    // The service's own figures, with brotli: .ci/page_size.py.
    reportCompressedSize: false,
    chunkSizeWarningLimit: 1024,
  },
  worker: { format: "es", plugins: () => [licences.worker] },
  server: {
    // `npm run dev` beside a running `terraport serve`.
    proxy: { "/scenes": { target: process.env.TERRAPORT_URL ?? "http://127.0.0.1:8080", ws: true } },
  },
  // Wall time is never asserted: the machine may be busy.
  test: { include: ["test/**/*.test.ts"], environment: "node", testTimeout: 60_000 },
});
