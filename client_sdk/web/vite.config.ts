import { defineConfig } from "vitest/config";

// The page is served from wherever terraport's service is reached, also behind a proxy's prefix: every address in it is
// relative. The service ships the folder `page` inside its package.
export default defineConfig({
  base: "./",
  build: {
    outDir: "../../server/terraport_server/page",
    emptyOutDir: true,
    target: "es2022",
    // A data: address would need an exception in the page's Content-Security-Policy.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
  },
  worker: { format: "es" },
  server: {
    // `npm run dev` beside a running `terraport serve`.
    proxy: { "/scenes": { target: process.env.TERRAPORT_URL ?? "http://127.0.0.1:8080", ws: true } },
  },
  test: { include: ["test/**/*.test.ts"], environment: "node" },
});
